//! A view and a level rule in the shaders' layout, for a device that traverses the tree by itself. Everything
//! that is the same for all nodes is computed here.

use bytemuck::{Pod, Zeroable};
use trimaran_proto::{Section, Sections};
use trimaran_scene::Scene;

use crate::boxes::{BoxMaker, DEPTH_SLACK, POSITION_SLACK};
use crate::frustum::RELATIVE_SLACK;
use crate::hzb::BUDGET;
use crate::lod_cut::LodCut;
use crate::screen_record::ScreenRecords;
use crate::{CutRule, Outline, View};

/// A view and a level rule.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct CutRecord {
    eye: [f64; 3],
    /// World to view, without the translation; column-major.
    to_view: [f64; 9],
    focal: f64,
    spread: f64,
    near: f64,
    tan: [f64; 2],
    epsilon: f64,
    frustum_slack: f64,
    position_slack: f64,
    depth_slack: f64,
    nearest_tested: f64,
    screen_focal: [f64; 2],
    screen_middle: [f64; 2],
    screen_last: [f64; 2],
    grown: f64,
    nearer: f64,
    sections: [SectionRecord; Sections::MOST],
    section_count: u32,
    last_level: u32,
    budget: u32,
    /// For the device's own use: where the pages of drawables begin in its table.
    pub drawable_pages: u32,
    /// How many drawables are mapped. Without any the frame is culled.
    pub mapped: u32,
    /// The stamp of this mapping.
    pub stamp: u32,
    /// How many nodes the scene has.
    pub nodes: u32,
    unused: u32,
}

/// A section: a plane's location and direction, or the corners of a box.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SectionRecord {
    is_box: u32,
    unused: u32,
    low: [f64; 3],
    high: [f64; 3],
}

impl CutRecord {
    /// For `view` and the levels of `rule`, and boxes whose outlines the test grows on the screen.
    #[must_use]
    pub fn new(scene: &Scene, view: &View, rule: &CutRule) -> Self {
        let screen = ScreenRecords::new(view, Outline::OnScreen);
        let mut sections = [SectionRecord::zeroed(); Sections::MOST];
        for (slot, section) in sections.iter_mut().zip(view.sections().iter()) {
            *slot = match section {
                Section::Plane(plane) => SectionRecord::new(false, plane.location(), plane.direction()),
                Section::Box(kept) => SectionRecord::new(true, kept.min(), kept.max()),
            };
        }
        let (focal, spread) = LodCut::new(scene, view, rule).focal_and_spread();
        let [screen_focal, screen_middle, screen_last] = screen.projection().focal_middle_last();
        Self {
            eye: view.eye().to_array(),
            to_view: view.to_view().to_cols_array(),
            focal,
            spread,
            near: f64::from(view.camera().near()),
            tan: [view.tan_half_fov_x(), view.tan_half_fov_y()],
            epsilon: rule.lod().epsilon_px(),
            frustum_slack: RELATIVE_SLACK,
            position_slack: POSITION_SLACK,
            depth_slack: DEPTH_SLACK,
            nearest_tested: BoxMaker::new(view, Outline::OnScreen).nearest_tested(),
            screen_focal,
            screen_middle,
            screen_last,
            grown: screen.margins().grown,
            nearer: screen.margins().nearer,
            sections,
            section_count: view.sections().iter().count() as u32,
            last_level: screen.last_level() as u32,
            budget: BUDGET,
            drawable_pages: 0,
            mapped: 0,
            stamp: 0,
            nodes: scene.nodes().len() as u32,
            unused: 0,
        }
    }
}

impl SectionRecord {
    fn new(is_box: bool, low: [f64; 3], high: [f64; 3]) -> Self {
        Self { is_box: is_box.into(), unused: 0, low, high }
    }
}
