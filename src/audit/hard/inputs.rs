//! Inputs that must be refused by a typed error, and error bounds at their limits.

use std::collections::BTreeSet;

use glam::{DVec3, Mat3, Vec3};
use trimaran_audit::cases::{Case, Mesh, Object, build, looking};
use trimaran_cull::{LodCut, LodRule, Viewport};
use trimaran_proto::{Camera, FrameNumber};
use trimaran_scene::NodeId;

/// "All" and how many there were, or how many of them.
fn share(good: impl Iterator<Item = bool>) -> (String, bool) {
    let all: Vec<bool> = good.collect();
    let count = all.iter().filter(|good| **good).count();
    (format!("{count} of {}", all.len()), count == all.len())
}

/// How many invalid cameras and sizes of pictures are refused.
pub(super) fn invalid_cameras() -> (String, bool) {
    let (place, still) = ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
    let camera = |eye, turn, tan, near| Camera::new(eye, turn, tan, near, FrameNumber(0)).is_err();
    let eyes = [f64::NAN, f64::INFINITY].map(|x| camera([0.0, x, 0.0], still, 1.0, 0.1));
    let turns = [[0.0; 4], [f64::NAN; 4], [1.0; 4]].map(|turn| camera(place, turn, 1.0, 0.1));
    let fields = [0.0, -1.0, 1e-6, 1e6, f32::NAN].map(|tan| camera(place, still, tan, 0.1));
    let nears = [0.0, -0.1, f32::NAN, f32::INFINITY].map(|near| camera(place, still, 1.0, near));
    let sizes = [(0, 5), (5, 0), (65_537, 1), (1, u32::MAX)].map(|(w, h)| Viewport::new(w, h).is_err());
    let eye = DVec3::from_array(place);
    let on_target = Viewport::new(8, 8).map(|size| looking(eye, eye, 60.0, size, 0).is_err());
    let bounds = [0.0, -1.0, f64::NAN, f64::INFINITY].map(|bound| LodRule::new(bound).is_err());
    share([&eyes[..], &turns, &fields, &nears, &sizes, &bounds].concat().into_iter().chain(on_target))
}

/// How many scenes with numbers that are not finite are refused.
pub(super) fn not_finite() -> (String, bool) {
    let cube = || Object::new(Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 1));
    let changed = |change: fn(&mut Object, f64)| {
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].map(|number| {
            let mut object = cube();
            change(&mut object, number);
            build(&[object, cube().at(DVec3::X)], false).is_err()
        })
    };
    let changes: [fn(&mut Object, f64); 4] = [
        |object, x| object.mesh.positions.iter_mut().for_each(|p| p.x = x as f32),
        |object, x| object.origin.y = x,
        |object, x| object.linear = Mat3::from_diagonal(Vec3::new(x as f32, 1.0, 1.0)),
        |object, x| object.coarser.push((x as f32, Mesh::cuboid(Vec3::ZERO, Vec3::ONE, 1))),
    ];
    share(changes.into_iter().flat_map(changed))
}

/// How many cuts at bounds that equal a projected error, or are the next number below or above, cover each
/// leaf in the frustum exactly once.
pub(super) fn equal_bounds(case: &Case) -> (String, bool) {
    let Some((view, one)) = case.views.first().zip(LodRule::new(1.0).ok()) else {
        return share([].into_iter());
    };
    let scene = &case.scene;
    let cut = LodCut::new(scene, view, one);
    let errors = scene.drawables().iter().filter_map(|drawable| {
        let node = scene.nodes().get(drawable.node as usize)?;
        Some(cut.error_on_screen(node, f64::from(drawable.error)))
    });
    let bounds: Vec<LodRule> = errors
        .flat_map(|error| [error.next_down(), error, error.next_up()])
        .filter_map(|bound| LodRule::new(bound).ok())
        .collect();
    share(bounds.into_iter().map(|rule| {
        let cut = LodCut::new(scene, view, rule);
        let levels = cut.levels();
        let of = |level: &trimaran_scene::Level| Some(scene.drawables().get(level.first().index())?.node);
        let drawn: BTreeSet<u32> = levels.iter().filter_map(of).collect();
        let leaves = (0..).zip(scene.nodes()).filter(|(_, node)| node.is_leaf());
        drawn.len() == levels.len()
            && leaves.into_iter().all(|(leaf, node)| {
                let above = scene.ancestors(NodeId(leaf)).filter(|(above, _)| drawn.contains(&above.0));
                let least = usize::from(!cut.outside(node));
                (least..=1).contains(&above.count())
            })
    }))
}
