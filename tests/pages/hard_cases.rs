//! The hard cases of culling, drawn by the page's renderer (WebGL2) in a real browser.

use std::sync::Arc;

use serde_json::{Value, json};
use trimaran_audit::cases::{Case, hard_cases};
use trimaran_audit::{Placement, ReferenceWalkthrough, Testing};
use trimaran_cull::{LodRule, View, lod_cut};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

use crate::common::page::Browser;

/// The cullers of each case: boxes rasterized, and boxes tested against a depth pyramid.
const CULLERS: [Testing; 2] = [Testing::Rasterized, Testing::Pyramid];

/// The cases in which the browser sees something past an occluder's edge and the culler does not, because
/// their rasterizers differ; and the most pixels of all frames at which it does. A grating has gaps finer than
/// a pixel; rounding moves a triangle of 500 m that is clipped 1 cm before the eye; an edge runs along the only
/// row of a picture.
const AT_EDGES: [(&str, u64); 3] =
    [("a grating finer than a pixel", 1), ("scaled by 1e-3 to 1e3, mirrored, sheared", 3), ("97 x 1", 1)];

#[test]
fn culling_changes_no_pixel_of_a_hard_case() {
    let Some(mut browser) = Browser::with_hard_cases() else { return };
    let mut beyond = Vec::new();
    for case in hard_cases().unwrap() {
        let [boxes, pyramid] = CULLERS.map(|testing| found(&case, testing));
        let found = boxes.into_iter().zip(pyramid).map(|(a, b)| vec![a, b]);
        let wrong = wrong(&mut browser, &case, found.collect());
        println!("{}: {wrong:?} px in {} frames", case.name, case.views.len());
        let most = AT_EDGES.iter().find(|(name, _)| *name == case.name).map_or(0, |(_, most)| *most);
        if wrong.iter().any(|wrong| *wrong > most) {
            beyond.push((case.name, wrong));
        }
    }
    assert!(beyond.is_empty(), "pixels that culling changed, by culler: {beyond:?}");
}

/// Without one visible drawable, pixels are wrong.
#[test]
fn a_lost_drawable_of_a_hard_case_is_noticed() {
    let Some(mut browser) = Browser::with_hard_cases() else { return };
    let case = hard_cases().unwrap().into_iter().find(|case| case.name == "eye inside a box").unwrap();
    let mut walkthrough = walkthrough(&case, Testing::Rasterized);
    let lost = case.views.iter().map(|view| {
        let frame = walkthrough.frame(view).unwrap();
        let nearest = *frame.exact.first().unwrap();
        vec![frame.emitted.into_iter().filter(|id| *id != nearest).collect()]
    });
    let lost = lost.collect();
    assert!(wrong(&mut browser, &case, lost)[0] > 0);
}

fn rule() -> LodRule {
    LodRule::new(1.0).unwrap()
}

fn walkthrough(case: &Case, testing: Testing) -> ReferenceWalkthrough {
    let walkthrough = ReferenceWalkthrough::new(Arc::clone(&case.scene), rule());
    walkthrough.testing(testing).placing(Placement::Single)
}

/// The drawables that a culler finds in each frame.
fn found(case: &Case, testing: Testing) -> Vec<Vec<DrawableId>> {
    let mut walkthrough = walkthrough(case, testing);
    case.views.iter().map(|view| walkthrough.frame(view).unwrap().emitted).collect()
}

/// Draws each frame whole, and by what each of several cullers found; returns the differing pixels of each.
fn wrong(browser: &mut Browser, case: &Case, found: Vec<Vec<Vec<DrawableId>>>) -> Vec<u64> {
    let Case { scene, views, .. } = case;
    let viewport = views[0].viewport();
    let pieces = (0..scene.places().len() as u32).map(|number| piece(scene, number));
    let frames = views.iter().zip(found).map(|(view, found)| {
        let found: Vec<_> = found.iter().map(|ids| numbers(ids)).collect();
        json!({ "camera": camera(view), "whole": numbers(&lod_cut(scene, view, rule())), "found": found })
    });
    let drawables = (0..scene.drawables().len() as u32).map(|id| record(scene, DrawableId(id)));
    let told = browser.tell(json!({
        "width": viewport.width(),
        "height": viewport.height(),
        "pieces": pieces.collect::<Vec<_>>(),
        "drawables": drawables.collect::<Vec<_>>(),
        "frames": frames.collect::<Vec<_>>(),
    }));
    assert_eq!(told["faults"], json!([]), "{}", case.name);
    serde_json::from_value(told["wrong"].clone()).unwrap()
}

fn numbers(ids: &[DrawableId]) -> Vec<u32> {
    ids.iter().map(|id| id.0).collect()
}

fn piece(scene: &Scene, number: u32) -> Value {
    let geometry = scene.geometry(number).unwrap();
    let vertices: &[u8] = bytemuck::cast_slice(&geometry.vertices);
    json!({ "vertices": vertices, "indices": geometry.indices })
}

fn record(scene: &Scene, id: DrawableId) -> Value {
    let (drawable, part) = scene.part(id).unwrap();
    let (low, high) = part.world_box();
    json!({
        "id": id.0,
        "object": part.object,
        "objects": 1,
        "geometry": drawable.geometry,
        "origin": part.origin().to_array(),
        "linear": part.linear().to_cols_array(),
        "sides": bytemuck::cast::<_, u32>(drawable.sides),
        "worldMin": low.to_array(),
        "worldMax": high.to_array(),
    })
}

fn camera(view: &View) -> Value {
    let camera = view.camera();
    json!({
        "eye": camera.eye(),
        "orientation": camera.orientation(),
        "tanHalfFov": camera.tan_half_fov_y(),
        "near": camera.near(),
    })
}
