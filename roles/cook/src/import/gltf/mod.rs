//! glTF 2.0: .glb, and .gltf with its buffers beside it or in data URIs.
//!
//! Instances stay instances: each mesh of the document becomes one mesh of the model, each node with a mesh
//! one object (with EXT_mesh_gpu_instancing one an instance). Matrices are taken as they stand, in f64.

mod accessor;
mod buffers;
mod column;
mod container;
mod draco;
mod error;
mod faults;
mod gradient;
mod json;
mod lenient;
mod material;
mod mend;
mod mesh;
mod metadata;
mod nodes;
mod objects;
mod packed;
mod surface;
mod texture;
mod tolerant;

use std::collections::{BTreeSet, HashMap};
use std::path::Path;

use rayon::prelude::*;

pub use error::GltfError;

use self::accessor::Accessors;
use self::buffers::Resources;
use self::container::Container;
use self::faults::Faults;
use self::json::Document;
use self::mesh::{Imported, Shape};
use self::metadata::Lookup;
use self::nodes::Placement;
use self::texture::Textures;
use super::assemble::{bounds, draws_nothing, is_near, place};
use super::budget::Budget;
use super::hierarchy::groups;
use super::neighbours::Neighbours;
use super::report::{ImportReport, WarningKind};
use super::{Format, ImportOptions, Part};
use crate::lists::{at, put};
use crate::{Mesh, Model};
use trimaran_scene::ObjectAttributes;

/// Supported required extensions: those that are read, and those that do not affect a model.
const SUPPORTED: [&str; 20] = [
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_structural_metadata",
    "KHR_draco_mesh_compression",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "KHR_animation_pointer",
    "KHR_audio_emitter",
    "KHR_lights_punctual",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_xmp_json_ld",
    "MSFT_lod",
];
/// Likewise, by prefix: of materials, only base colours are kept.
const SUPPORTED_PREFIXES: [&str; 4] = ["KHR_materials_", "EXT_texture_", "KHR_texture_", "MSFT_texture_"];

/// Parts of names of other extensions that do not affect shapes: of materials, lights, motion, grouping and
/// metadata.
const SHAPELESS: [&str; 16] = [
    "_materials_",
    "_material_",
    "_techniques_webgl",
    "_technique_webgl",
    "_lights_",
    "_audio",
    "_physics_",
    "_animation",
    "_articulations",
    "_metadata",
    "_edge_visibility",
    "_tile_edges",
    "VRM",
    "GODOT_single_root",
    "MSFT_packing_",
    "OMI_",
];

/// Reads a .glb or .gltf file; with no path, from memory alone. `source_index` of its objects is the node's
/// index in the document.
pub(super) fn import(
    path: Option<&Path>,
    file: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, GltfError> {
    let container = Container::parse(file)?;
    let mut faults = Faults::default();
    let document = Document::parse(container.json, &mut faults)?;
    check(&document, &mut faults.report)?;
    let mut neighbours = Neighbours::of(path, budget);
    let mut resources = Resources(&mut neighbours);
    let buffers = buffers::load(&mut resources, &document.buffers, container.bin, &mut faults);
    let decompressed = packed::decompress(&document.buffer_views, &buffers, budget, &mut faults)?;
    let accessors = Accessors::new(&document, &buffers, &decompressed);

    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    let (placements, branches) =
        nodes::place(&document, &accessors, budget, &mut faults, options.frame_of(Format::Gltf).to_scene())?;
    let (shapes, numbers) = shapes(&document, &placements);
    let materials = materials(&document, &shapes);
    let materials = materials.iter().filter_map(|&index| document.materials.get(index as usize));
    let textures =
        Textures::load(&document, &accessors, &mut resources, materials, budget, &mut faults.report);
    let from = mesh::Input { document: &document, accessors: &accessors, textures: &textures, budget };
    let mut imported: Vec<_> =
        shapes.par_iter().map(|shape| mesh::import(from, shape)).collect::<Result<_, _>>()?;
    warn(&mut faults, &document, &mut imported, &placements, &numbers);
    part.report = std::mem::take(&mut faults.report);

    // The index of each shape among the model's meshes.
    let mut meshes = Vec::new();
    for Imported { pieces, .. } in imported {
        let first = part.model.meshes.len() as u32;
        meshes.push((first..).zip(pieces.keys().copied()).collect::<Vec<_>>());
        part.model.meshes.extend(pieces.into_values());
    }
    let placed = |mesh: &Mesh| bounds(&mesh.positions.iter().map(|p| p.as_dvec3()).collect::<Vec<_>>());
    let boxes: Vec<_> = part.model.meshes.iter().map(placed).collect();
    let without_area: Vec<_> = part.model.meshes.iter().map(draws_nothing).collect();
    // Numbers of the placements that are objects.
    let mut leaves = Vec::new();
    let mut lookup = Lookup::new(&document, &accessors);
    for ((number, placement), shape) in (0..).zip(placements).zip(numbers) {
        let name = document.object_name(placement.node, placement.mesh);
        let pieces = meshes.get(shape).map(Vec::as_slice).unwrap_or_default();
        if pieces.is_empty() {
            part.report.warn_of(WarningKind::EmptyObject, "", name);
        }
        for &(mesh, feature) in pieces {
            let bounds = at(&boxes, mesh);
            if !is_near(bounds, &placement.to_world) {
                part.report.warn_of(WarningKind::NodeLeftOut, "it reaches farther than 1e15 m", name);
                continue;
            }
            if without_area.get(mesh as usize) == Some(&true) {
                part.report.warn_of(WarningKind::NoArea, "", name);
            }
            let mut name = name.to_owned();
            let mut attributes = document.attributes_of_one(placement.node);
            if let Some(row) = lookup.row(&placement, feature) {
                budget.attributes(row.text(), || format!("a feature of object {name:?}"))?;
                budget.objects(1, 0, || format!("a feature of object {name:?}"))?;
                name = row.name.unwrap_or(name);
                attributes.extend(row.attributes);
            }
            let object = part.model.objects.len() as u32;
            place(&mut part, budget, mesh, placement.to_world, name, placement.node)?;
            leaves.push(number);
            if !attributes.is_empty() {
                part.model.hierarchy.attributes.push(ObjectAttributes { object, attributes });
            }
        }
    }
    lookup.warn(&mut part.report);
    part.model.hierarchy.groups = groups(branches, &leaves);
    match faults.first().filter(|_| part.model.objects.is_empty()) {
        Some(why) => Err(why),
        None => Ok(part),
    }
}

/// The distinct shapes of placements, and the index of each placement's.
fn shapes(document: &Document, placements: &[Placement]) -> (Vec<Shape>, Vec<usize>) {
    let mut shapes: Vec<Shape> = Vec::new();
    let mut known = HashMap::new();
    let firsts = first_of_equals(document);
    let number = |placement: &Placement| {
        let first = firsts.get(placement.mesh as usize).copied().unwrap_or(placement.mesh);
        let mesh = document.meshes.get(first as usize);
        let node = document.nodes.get(placement.node as usize);
        let is_morphed = mesh.is_some_and(|mesh| mesh.primitives.iter().any(|one| !one.targets.is_empty()));
        let own = node.and_then(|node| node.weights.as_deref());
        let weights = own.or(mesh.and_then(|mesh| mesh.weights.as_deref())).unwrap_or_default();
        let weights: &[f32] = if is_morphed { weights } else { &[] };
        let key = (first, weights.iter().map(|weight| weight.to_bits()).collect::<Vec<_>>());
        *known.entry(key).or_insert_with(|| {
            shapes.push(Shape { mesh: first, weights: weights.to_vec() });
            shapes.len() - 1
        })
    };
    let numbers = placements.iter().map(number).collect();
    (shapes, numbers)
}

/// For each mesh the first one with equal primitives: some programs, Open CASCADE too, write a mesh for each
/// node.
fn first_of_equals(document: &Document) -> Vec<u32> {
    let mut known = HashMap::new();
    let numbers = (0..).zip(&document.meshes).map(|(number, mesh)| {
        let is_plain = mesh.primitives.iter().all(|one| one.targets.is_empty() && one.extensions.is_none());
        let key = mesh.primitives.iter().map(|one| (&one.attributes, one.indices, one.material, one.mode));
        if is_plain { *known.entry(key.collect::<Vec<_>>()).or_insert(number) } else { number }
    });
    numbers.collect()
}

/// The materials of shapes.
fn materials(document: &Document, shapes: &[Shape]) -> BTreeSet<u32> {
    let meshes = shapes.iter().filter_map(|shape| document.meshes.get(shape.mesh as usize));
    meshes.flat_map(|mesh| &mesh.primitives).filter_map(|primitive| primitive.material).collect()
}

/// Warns of omissions of the meshes and the model.
fn warn(
    faults: &mut Faults,
    document: &Document,
    imported: &mut [Imported],
    placements: &[Placement],
    shapes: &[usize],
) {
    let mut named = vec![""; imported.len()];
    for (placement, &shape) in placements.iter().zip(shapes).rev() {
        put(&mut named, shape, document.object_name(placement.node, placement.mesh));
    }
    for (name, mesh) in named.into_iter().zip(&mut *imported) {
        for ((kind, detail), count) in &mesh.broken {
            faults.note_many(*kind, detail, name, *count);
        }
        if let Some(why) = mesh.cause.take() {
            faults.cause(|| why);
        }
        let report = &mut faults.report;
        report.warn(WarningKind::PointsOrLines, mesh.without_surface);
        report.warn_many(WarningKind::TriangleLeftOut, "", name, mesh.left_out);
    }
    let report = &mut faults.report;
    let mut materials = |kind, of: fn(&Imported) -> &[u32]| {
        for index in imported.iter().flat_map(of).collect::<BTreeSet<_>>() {
            let name = document.materials.get(*index as usize).and_then(|material| material.name.as_deref());
            report.warn_about(kind, &name.map_or_else(|| format!("material {index}"), str::to_owned), 1);
        }
    };
    materials(WarningKind::TextureAveraged, |mesh| &mesh.averaged);
    materials(WarningKind::TexturedMaterial, |mesh| &mesh.unplaced);
    let skinned = document.nodes.iter().filter(|node| node.skin.is_some()).count();
    report.warn(WarningKind::SkinnedNode, skinned as u64);
}

fn check(document: &Document, report: &mut ImportReport) -> Result<(), GltfError> {
    let asset = &document.asset;
    let numbers = |version: &str| -> Option<(u32, u32)> {
        let mut numbers = version.trim().trim_start_matches(['v', 'V']).split('.');
        Some((numbers.next()?.parse().ok()?, numbers.next().unwrap_or("0").parse().ok()?))
    };
    let (needed, is_read) = match (&asset.min_version, &asset.version) {
        (Some(least), _) => (least.clone(), numbers(least) == Some((2, 0))),
        (None, Some(version)) => (version.clone(), numbers(version).is_some_and(|(major, _)| major == 2)),
        (None, None) => ("of no version that it names".to_owned(), false),
    };
    if !is_read {
        return Err(GltfError::Version { version: needed });
    }
    for extension in &document.extensions_required {
        let name = extension.as_str();
        if SUPPORTED.contains(&name) || SUPPORTED_PREFIXES.iter().any(|start| name.starts_with(start)) {
            continue;
        }
        if !SHAPELESS.iter().any(|part| name.contains(part)) {
            return Err(GltfError::Extension { extension: extension.clone() });
        }
        report.warn_about(WarningKind::ExtensionLeftOut, name, 1);
    }
    Ok(())
}
