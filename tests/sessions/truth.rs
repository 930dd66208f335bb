//! Compares the exactly visible objects at full detail with those of an independent ray caster.
//!
//! The truth gives, for each of its views, the objects (nodes of the glTF file) that a ray through a pixel's
//! centre meets first. If another surface lies within a hundred-thousandth of the winner's depth, as with
//! coplanar walls, the pixel is ambiguous; the others are strict. So an object that wins a strict pixel must
//! be found here as well; any that wins a pixel or ties at one may be; no other. A rasterizer may decide
//! differently than a ray caster where an edge passes a pixel's centre, within rounding: such a difference is
//! a pixel here and a pixel there, and objects with no more than [`EDGE_PIXELS`] are forgiven, counted and
//! printed.
//!
//! Objects that place the same mesh by the same matrix show the same surface, and their order decides which
//! one is reported: here they count as one. The platform has a box that its designers placed twelve times,
//! and the truth, whose rays look for ties among a few surfaces only, takes 29 pixels of one copy for strict.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    error::Error,
    fs,
};

use glam::DVec3;
use serde::Deserialize;
use trimaran::walkthrough::{Auditor, ViewStates};
use trimaran_cook::Model;
use trimaran_cull::{LodRule, Viewport};
use trimaran_gpu::{GpuScene, ItemImage};
use trimaran_proto::{Camera, FrameNumber, ObjectSet, Settings, ViewState};
use trimaran_scene::{Scene, path::Pose};

use crate::common::data::{Data, imported};
use crate::common::scenes::scene_of;

/// An object visible at no more pixels than this, here or there, may be missing from the other.
const EDGE_PIXELS: u32 = 2;

/// The most strict pixels of a view that may show another object here: one in 10,000.
const LOST_PIXELS: u32 = 104;

/// A `.views.json` file.
#[derive(Deserialize)]
struct Truth {
    width: u32,
    height: u32,
    vfov_deg: f64,
    objects: usize,
    views: Vec<TrueView>,
}

/// The ground truth of one viewpoint.
#[derive(Deserialize)]
struct TrueView {
    eye: [f64; 3],
    forward: [f64; 3],
    up: [f64; 3],
    /// The distance of the nearest surface from the eye, in the model's unit.
    clearance: f64,
    /// The objects that win a pixel, and how many strict pixels each wins.
    nodes: Vec<u32>,
    strict_pixels: Vec<u32>,
    /// The objects that tie at a pixel and win none.
    tie: Vec<u32>,
}

impl TrueView {
    /// The truth has no near plane; this one cuts nothing off.
    fn camera(&self, truth: &Truth, number: u32) -> Camera {
        let [eye, forward, up] = [self.eye, self.forward, self.up].map(DVec3::from_array);
        let near = (self.clearance * 1e-3) as f32;
        let pose = Pose::new(eye, forward, up).unwrap();
        pose.camera(truth.vfov_deg, near, FrameNumber(number)).unwrap()
    }
}

/// The differences between the objects found in one view and the truth. Objects with their pixels.
#[derive(Debug, Default, PartialEq, Eq)]
struct Difference {
    /// Expected, and not found; strict pixels of the truth.
    missing: Vec<(u32, u32)>,
    /// The same with so few pixels that an edge explains it.
    missing_at_edges: Vec<(u32, u32)>,
    /// Found, and neither visible nor tied in the truth; pixels here.
    surplus: Vec<(u32, u32)>,
    /// The same with so few pixels that an edge explains it.
    surplus_at_edges: Vec<(u32, u32)>,
    /// How many strict pixels of the truth certainly show another object here.
    lost_pixels: u32,
}

impl Difference {
    fn between(found: &Pixels, view: &TrueView, twins: &Twins) -> Self {
        let few = |&(_, pixels): &(u32, u32)| pixels <= EDGE_PIXELS;
        let must = view.must_be_found(twins);
        let shows = |node| found.get(node).copied().unwrap_or(0);
        let missing = must.iter().filter(|(node, _)| shows(node) == 0).map(|(&n, &p)| (n, p));
        let (missing_at_edges, missing) = missing.partition(few);
        let may: BTreeSet<u32> = view.nodes.iter().chain(&view.tie).map(|&node| twins.one_of(node)).collect();
        let surplus = found.iter().filter(|(node, _)| !may.contains(node)).map(|(&n, &p)| (n, p));
        let (surplus_at_edges, surplus) = surplus.partition(few);
        let lost_pixels = must.iter().map(|(node, strict)| strict.saturating_sub(shows(node))).sum();
        Self { missing, missing_at_edges, surplus, surplus_at_edges, lost_pixels }
    }
}

/// Pixels of objects, by their index in the model's file.
type Pixels = BTreeMap<u32, u32>;

/// Objects that show the same surface.
#[derive(Default)]
struct Twins {
    /// The representative of each object that has one.
    first: HashMap<u32, u32>,
}

impl Twins {
    fn of(model: &Model) -> Self {
        let mut surfaces = HashMap::new();
        let mut first = HashMap::new();
        for object in &model.objects {
            let place = object.to_world.to_cols_array().map(f64::to_bits);
            let one = *surfaces.entry((object.mesh, place)).or_insert(object.source_index);
            if one != object.source_index {
                first.insert(object.source_index, one);
            }
        }
        Self { first }
    }

    fn one_of(&self, node: u32) -> u32 {
        self.first.get(&node).copied().unwrap_or(node)
    }
}

impl TrueView {
    /// The objects that win a strict pixel, with how many.
    fn must_be_found(&self, twins: &Twins) -> Pixels {
        let mut must = Pixels::new();
        for (&node, &strict) in self.nodes.iter().zip(&self.strict_pixels).filter(|(_, strict)| **strict > 0)
        {
            *must.entry(twins.one_of(node)).or_insert(0) += strict;
        }
        must
    }
}

/// The pixels of each visible object.
fn found(scene: &Scene, image: &ItemImage, twins: &Twins) -> Pixels {
    let mut pixels = Pixels::new();
    for &id in image.drawable.iter().filter(|&&id| id != ItemImage::BACKGROUND) {
        let object = scene.nodes()[scene.drawables()[id as usize].node as usize].object;
        let node = scene.objects()[object as usize].source_index;
        *pixels.entry(twins.one_of(node)).or_insert(0) += 1;
    }
    pixels
}

/// Compares every view of a model with the truth, and prints a table.
fn agrees_with_the_truth(name: &str) -> Result<(), Box<dyn Error>> {
    let Some(data) = Data::find() else { return Ok(()) };
    let Some([gpu, ..]) = crate::common::devices() else { return Ok(()) };
    let truth: Truth = serde_json::from_str(&fs::read_to_string(data.truth(&format!("{name}.views.json")))?)?;
    let files = [data.unpacked(&format!("{name}.glb"))];
    let twins = Twins::of(&imported(&files));
    let scene = scene_of(&files);
    assert_eq!(scene.objects().len(), truth.objects, "every object of the truth is in the scene");
    let drawn = GpuScene::new(gpu, &scene)?;
    // The rule decides levels, and does not matter at full detail.
    let size = Viewport::new(truth.width, truth.height)?;
    let settings = Settings::new(size, LodRule::new(1.0)?);
    // To the truth all objects are solid.
    let solid = ViewState { see_through: Some(ObjectSet::default()), ..settings.into() };
    let mut auditor = Auditor::new(&scene, &drawn, ViewStates::new(solid, Vec::new()))?;

    println!(
        "{name}: {} objects are twins of another; missing/surplus objects (at edges)",
        twins.first.len()
    );
    println!("view  must be found  found   missing   surplus  lost pixels");
    let mut differences = Vec::new();
    for (number, view) in (0..).zip(&truth.views) {
        let found = found(&scene, &auditor.full_detail_items(view.camera(&truth, number))?, &twins);
        let difference = Difference::between(&found, view, &twins);
        println!(
            "{number:4} {:14} {:6} {:5} ({}) {:5} ({}) {:12}",
            view.must_be_found(&twins).len(),
            found.len(),
            difference.missing.len(),
            difference.missing_at_edges.len(),
            difference.surplus.len(),
            difference.surplus_at_edges.len(),
            difference.lost_pixels,
        );
        differences.push(difference);
    }
    for (number, difference) in differences.iter().enumerate() {
        assert_eq!(difference.missing, [], "view {number}: visible and not found (node, pixels)");
        assert_eq!(difference.surplus, [], "view {number}: found and not visible (node, pixels)");
        assert!(
            difference.lost_pixels <= LOST_PIXELS,
            "view {number}: {} pixels differ, which edges do not explain",
            difference.lost_pixels
        );
    }
    assert_eq!(gpu.validation_messages(), Vec::<String>::new());
    Ok(())
}

#[test]
fn town_hall() -> Result<(), Box<dyn Error>> {
    agrees_with_the_truth("ldraw_town_hall_1.3Mtri")
}

#[test]
fn platform_in_14_copies() -> Result<(), Box<dyn Error>> {
    agrees_with_the_truth("huldra_x14_13Mtri")
}

#[test]
fn a_difference_is_told_from_an_edge() {
    let view = TrueView {
        eye: [0.0; 3],
        forward: [0.0; 3],
        up: [0.0; 3],
        clearance: 1.0,
        nodes: vec![1, 2, 3, 4, 8],
        strict_pixels: vec![9, 2, 3, 0, 7],
        tie: vec![5],
    };
    let twins = Twins { first: HashMap::from([(8, 1)]) };
    let found = Pixels::from([(1, 12), (5, 40), (6, 3), (7, 1)]);
    let expected = Difference {
        missing: vec![(3, 3)],
        missing_at_edges: vec![(2, 2)],
        surplus: vec![(6, 3)],
        surplus_at_edges: vec![(7, 1)],
        lost_pixels: 4 + 2 + 3,
    };
    assert_eq!(Difference::between(&found, &view, &twins), expected);
}
