//! The cost of culling on the CPU: the pyramid, and the traversal with it, in random plants of ten and a
//! hundred thousand objects. Also prints how tight the visible sets are.

#![allow(clippy::unwrap_used, reason = "a test or benchmark that cannot be set up fails")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_audit::{Placement, rasterize};
use trimaran_cull::{
    Culler, DepthImage, DepthPyramid, HzbTest, LodCut, LodRule, NoOccluders, OccluderMapper, Outline, View,
    Viewport, draw_order,
};
use trimaran_proto::DrawableId;

fn pyramid(c: &mut Criterion) {
    for (width, height) in [(1024, 1024), (1023, 777)] {
        let viewport = Viewport::new(width, height).unwrap();
        let depth: Vec<f32> = (0..width * height).map(|i| (i % 977) as f32 / 977.0).collect();
        let image = DepthImage::new(viewport, &depth).unwrap();
        let mut pyramid = DepthPyramid::default();
        c.bench_function(&format!("pyramid {width} x {height}"), |b| {
            b.iter(|| pyramid.rebuild(black_box(image)));
        });
    }
}

/// Depth of the exactly visible part of a view's cut, its drawables, and those HC emits.
struct Frame {
    view: View,
    depth: Vec<f32>,
    exact: Vec<DrawableId>,
}

fn traversal(c: &mut Criterion) {
    let viewport = Viewport::new(1024, 1024).unwrap();
    let rule = LodRule::new(2.0).unwrap();
    for objects in [10_000, 100_000] {
        let scene = plant(1, objects, DVec3::ZERO).unwrap();
        let mut culler = Culler::new(scene.clone());
        let frames: Vec<Frame> = plant_views(2, objects, DVec3::ZERO, viewport, 130)
            .unwrap()
            .into_iter()
            .step_by(13)
            .map(|view| {
                let mut cut = LodCut::new(&scene, &view, rule).drawables();
                draw_order(&scene, &view, &mut cut);
                let picture = rasterize(&scene, &view, cut, Placement::Single);
                Frame { view, depth: picture.depth32(), exact: picture.seen() }
            })
            .collect();
        for outline in [Outline::OnScreen, Outline::InBox] {
            let (mut emitted, mut exact) = (0, 0);
            let mut sums = [0; 6];
            for frame in &frames {
                let image = DepthImage::new(viewport, &frame.depth).unwrap();
                let pyramid = DepthPyramid::over(image);
                let mut test = HzbTest::new(image, &pyramid).unwrap().with_outline(outline);
                let counts =
                    culler.cull(&frame.view, rule, &mut test, |ids| emitted += ids.len()).unwrap().counts;
                exact += frame.exact.len();
                let figures = [
                    counts.visited,
                    counts.tested,
                    counts.hidden,
                    counts.outside,
                    counts.refined,
                    counts.near_visible,
                ];
                sums.iter_mut().zip(figures).for_each(|(sum, figure)| *sum += figure);
            }
            println!(
                "{objects} objects, {outline:?}: {emitted} emitted / {exact} exactly visible = {:.3}; \
                 visited, tested, hidden, outside, refined, near: {sums:?}",
                emitted as f64 / exact as f64
            );
        }
        let frame = &frames[3];
        let image = DepthImage::new(viewport, &frame.depth).unwrap();
        let pyramid = DepthPyramid::over(image);
        c.bench_function(&format!("cull {objects} objects, pyramid"), |b| {
            let mut test = HzbTest::new(image, &pyramid).unwrap();
            b.iter(|| {
                culler
                    .cull(&frame.view, rule, &mut test, |ids| {
                        black_box(ids);
                    })
                    .unwrap()
            });
        });
        c.bench_function(&format!("cull {objects} objects, no occluders"), |b| {
            b.iter(|| {
                culler
                    .cull(&frame.view, rule, &mut NoOccluders, |ids| {
                        black_box(ids);
                    })
                    .unwrap()
            });
        });
        let mut mapper = OccluderMapper::new(scene.clone(), frame.view, rule);
        let mut due = Vec::new();
        c.bench_function(&format!("map {} ids of {objects} objects", frame.exact.len()), |b| {
            b.iter(|| {
                mapper.begin(frames[3].view, rule);
                due.clear();
                mapper.push(&frame.exact, &mut due).unwrap();
            });
        });
    }
}

criterion_group!(benches, pyramid, traversal);
criterion_main!(benches);
