//! `trimaran info`: the content of a cooked scene.

use std::path::Path;

use glam::DVec3;
use serde::Serialize;
use trimaran_scene::{Coordinates, FileFrame, Node, PlantFrame, ReadError, Records, Scene, Sides, UpAxis};

use super::{Failure, args::InfoArgs, number, terminal::word};

/// The content of a scene, as `info --json` prints it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct SceneSummary {
    /// The cooked file.
    file: String,
    /// Its size, bytes.
    file_bytes: u64,
    /// Its fingerprint, which the roles compare.
    hash: String,
    /// The files it was cooked from.
    sources: Vec<String>,
    /// Objects of the model.
    objects: usize,
    /// Nodes of the tree, of which `interior` stand for several objects; the others are objects and their
    /// clusters.
    nodes: usize,
    interior: usize,
    /// Interior nodes that have merged levels of their own.
    interior_with_levels: usize,
    /// The tree's depth; 1 is a lone root.
    depth: u32,
    /// Nodes times their levels.
    drawables: usize,
    /// Of these, how many are made of solids: their backs are not drawn.
    solids: usize,
    /// How many are made of solids open to some sides: seen from others, their backs are not drawn.
    open_solids: usize,
    /// Triangles at full detail, instances counted each.
    triangles: u64,
    /// Triangles stored, over all levels.
    triangles_stored: u64,
    vertices_stored: u64,
    /// The world box, metres, y up.
    min: [f64; 3],
    max: [f64; 3],
    /// The plant's coordinates.
    plant: Plant,
    /// The coordinates of the source files, in their order; those past the end have glTF's: y up, in metres.
    source_frames: Vec<FileFrame>,
}

/// East, north and up, metres, as `info --json` prints them.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Plant {
    /// The frame: the coordinates of the scene's origin, and the direction of north.
    #[serde(flatten)]
    frame: PlantFrame,
    /// The least and the largest coordinates of the world box.
    min: [f64; 3],
    max: [f64; 3],
}

impl SceneSummary {
    /// The content of a scene, whose file is at `path`.
    ///
    /// # Errors
    /// If its coordinates cannot be read.
    pub(super) fn of(path: &Path, scene: &Scene) -> Result<Self, ReadError> {
        let Coordinates { plant: frame, files: source_frames } = scene.coordinates()?;
        let nodes = scene.nodes();
        let tree = Tree::of(nodes);
        let (min, max) = nodes.first().map_or((DVec3::ZERO, DVec3::ZERO), Node::world_box);
        let count = |has: &dyn Fn(Sides) -> bool| {
            scene.drawables().iter().filter(|drawable| has(drawable.sides)).count()
        };
        let [low, high] = frame.bounds(min, max);
        Ok(Self {
            file: path.display().to_string(),
            file_bytes: std::fs::metadata(path).map_or(0, |file| file.len()),
            hash: scene.hash().to_string(),
            sources: scene.sources().to_vec(),
            objects: scene.objects().len(),
            nodes: nodes.len(),
            interior: tree.interior,
            interior_with_levels: tree.interior_with_levels,
            depth: tree.depth,
            drawables: scene.drawables().len(),
            solids: count(&|sides| sides.are_of_solids()),
            open_solids: count(&|sides| !sides.are_of_solids() && sides != Sides::BOTH),
            triangles: scene.totals().full_detail_triangles,
            triangles_stored: scene.totals().stored_triangles,
            vertices_stored: scene.totals().stored_vertices,
            min: min.to_array(),
            max: max.to_array(),
            plant: Plant { frame, min: low.to_array(), max: high.to_array() },
            source_frames,
        })
    }

    pub(super) fn print(&self) {
        let size = DVec3::from_array(self.max) - DVec3::from_array(self.min);
        println!("{}", word(&self.file));
        println!("  size        {:.1} MB, fingerprint {}", self.file_bytes as f64 / 1e6, self.hash);
        println!("  from        {}", word(&self.sources.join(", ")));
        println!("  extent      {:.2} x {:.2} x {:.2} m (y up)", size.x, size.y, size.z);
        println!("  plant       {}", self.plant.text());
        println!("  axes        {}", self.axes());
        println!("  objects     {}", number(self.objects as u64));
        println!(
            "  triangles   {} at full detail; {} stored over all levels",
            number(self.triangles),
            number(self.triangles_stored)
        );
        println!(
            "  tree        {} nodes, {} deep; {} of {} groups of objects have merged levels",
            number(self.nodes as u64),
            self.depth,
            number(self.interior_with_levels as u64),
            number(self.interior as u64)
        );
        println!("  drawables   {} (pieces of all levels)", number(self.drawables as u64));
        println!(
            "  solids      {} drawables are closed and {} open to one side: backs that nobody sees are not \
             drawn",
            number(self.solids as u64),
            number(self.open_solids as u64)
        );
    }
}

impl SceneSummary {
    /// The axes and units of the source files, in words.
    fn axes(&self) -> String {
        let frames = &self.source_frames;
        let first = frames.first().copied().unwrap_or_default();
        let frame_of = |index: usize| frames.get(index).copied().unwrap_or_default();
        if (0..self.sources.len()).all(|index| frame_of(index) == first) {
            return axes(first);
        }
        let of = |(index, name): (usize, &String)| format!("{name}: {}", axes(frame_of(index)));
        word(&self.sources.iter().enumerate().map(of).collect::<Vec<_>>().join("; ")).into_owned()
    }
}

/// The axes of a file as directions of the plant, and its unit.
fn axes(FileFrame { up, metres_per_unit }: FileFrame) -> String {
    let directions = match up {
        UpAxis::Y => "x east, y up, z south",
        UpAxis::Z => "x east, y north, z up",
    };
    match metres_per_unit {
        Some(1.0) => format!("{directions}; in metres"),
        Some(0.001) => format!("{directions}; in millimetres"),
        Some(unit) => format!("{directions}; {unit} m a unit"),
        None => format!("{directions}; converted to metres"),
    }
}

impl Plant {
    /// The extent, and the frame where it is not that of the files.
    fn text(&self) -> String {
        let Self { frame: PlantFrame { origin, north_deg }, min, max } = *self;
        // The sum with zero leaves no negative zero.
        let [min, max] =
            [min, max].map(|corner| corner.map(|metres| (metres * 1000.0).round() / 1000.0 + 0.0));
        let extent = format!(
            "E {:.3} to {:.3}, N {:.3} to {:.3}, U {:.3} to {:.3} m",
            min[0], max[0], min[1], max[1], min[2], max[2]
        );
        let [east, north, up] = origin;
        let shift = match origin == [0.0; 3] {
            true => String::new(),
            false => format!("; the files' origin is at E {east:.3}, N {north:.3}, U {up:.3} m"),
        };
        let turn = match north_deg == 0.0 {
            true => String::new(),
            false => format!("; north is {north_deg} degrees clockwise from theirs"),
        };
        extent + &shift + &turn
    }
}

/// Figures of the tree, from one pass over the nodes, which are the largest part of a scene.
#[derive(Default)]
struct Tree {
    interior: usize,
    interior_with_levels: usize,
    depth: u32,
}

impl Tree {
    fn of(nodes: Records<'_, Node>) -> Self {
        let mut tree = Self::default();
        // Parents stand before their children, so their depths are known.
        let mut depths: Vec<u32> = Vec::with_capacity(nodes.len());
        for node in nodes {
            let depth = depths.get(node.parent as usize).copied().unwrap_or(0) + 1;
            depths.push(depth);
            tree.depth = tree.depth.max(depth);
            if node.object == Node::NONE {
                tree.interior += 1;
                tree.interior_with_levels += usize::from(node.drawable_count > 0);
            }
        }
        tree
    }
}

pub(super) fn run(args: &InfoArgs) -> Result<(), Failure> {
    let scene = Scene::open(&args.scene).map_err(Failure::bad_input)?;
    // Checks all of it: an overview of a damaged file would be wrong.
    scene.check().map_err(Failure::bad_input)?;
    let summary = SceneSummary::of(&args.scene, &scene).map_err(Failure::bad_input)?;
    if args.json {
        super::print_json(&summary)
    } else {
        summary.print();
        Ok(())
    }
}
