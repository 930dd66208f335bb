//! The scene of this module's tests, and views of it.

use std::{
    collections::BTreeSet,
    sync::{Arc, LazyLock},
};

use glam::{DQuat, DVec3};
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, DrawableId, FrameNumber, NumberList};
use trimaran_scene::Scene;

pub(super) static PLANT: LazyLock<Arc<Scene>> = LazyLock::new(|| {
    let model = plant(&PlantOptions { objects: 500, triangles: 40_000, ..PlantOptions::small(3) });
    Arc::new(cook(&model, &CookOptions::default(), &()).unwrap())
});

/// A view from the origin.
pub(super) fn view(frame: u32) -> View {
    view_from(DVec3::ZERO, 0.0, frame, 64)
}

/// A view from this distance to the middle, turned to the left by this many radians, for a square picture.
pub(super) fn view_at(distance: f64, turn: f64, frame: u32, side: u32) -> View {
    let (min, max) = PLANT.nodes()[0].world_box();
    view_from((min + max) * 0.5 + distance * DVec3::Z, turn, frame, side)
}

/// The distance from which all of the plant is seen.
pub(super) fn outside() -> f64 {
    let (min, max) = PLANT.nodes()[0].world_box();
    (max - min).length()
}

fn view_from(eye: DVec3, turn: f64, frame: u32, side: u32) -> View {
    let orientation = DQuat::from_rotation_y(turn).to_array();
    let camera = Camera::new(eye.to_array(), orientation, 0.5, 0.1, FrameNumber(frame)).unwrap();
    View::new(camera, Viewport::new(side, side).unwrap())
}

pub(super) fn geometry_of(id: DrawableId) -> u32 {
    PLANT.drawables()[id.index()].geometry
}

/// Drawables that share no geometry among each other.
pub(super) fn unlike(count: usize) -> Vec<DrawableId> {
    let mut seen = BTreeSet::new();
    let all = (0..PLANT.drawables().len() as u32).map(DrawableId);
    all.filter(|id| seen.insert(geometry_of(*id))).take(count).collect()
}

pub(super) fn list(ids: &[DrawableId]) -> NumberList {
    NumberList::of(ids.iter().map(|id| id.0).collect())
}
