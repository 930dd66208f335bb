//! glTF 2.0: .glb, and .gltf with its buffers beside it or in data URIs.
//!
//! Instances stay instances: each mesh of the document becomes one mesh of the model, each node with a mesh
//! one object (with EXT_mesh_gpu_instancing one an instance). Matrices are taken as they stand, in f64.

mod accessor;
mod buffers;
mod container;
mod error;
mod json;
mod mesh;
mod nodes;

use std::path::Path;

use rayon::prelude::*;

pub use error::GltfError;

use self::accessor::Accessors;
use self::container::Container;
use self::json::Document;
use super::assemble::place;
use super::budget::Budget;
use super::hierarchy::groups;
use super::report::{ImportReport, WarningKind};
use super::{ImportOptions, Part, UpAxis};
use crate::Model;
use trimaran_scene::ObjectAttributes;

/// Extensions that may be required: the first is implemented; quantized numbers are ordinary accessors here;
/// the others change materials, textures and lights only, which a model does not keep.
const SUPPORTED: [&str; 3] = ["EXT_mesh_gpu_instancing", "KHR_mesh_quantization", "KHR_lights_punctual"];
const IGNORED_PREFIXES: [&str; 4] = ["KHR_materials_", "EXT_texture_", "KHR_texture_", "MSFT_texture_"];

/// Reads a .glb or .gltf file; with no path, from memory alone. `source_index` of its objects is the node's
/// index in the document.
pub(super) fn import(
    path: Option<&Path>,
    file: &[u8],
    options: &ImportOptions,
    budget: &Budget,
) -> Result<Part, GltfError> {
    let container = Container::parse(file)?;
    let document: Document = serde_json::from_slice(container.json)?;
    check(&document)?;
    let buffers = buffers::load(path, &document.buffers, container.bin, budget)?;
    let accessors = Accessors::new(&document, &buffers);
    let (placements, branches) =
        nodes::place(&document, &accessors, budget, options.file_to_world(UpAxis::Y))?;

    let mut part = Part { model: Model::default(), report: ImportReport::default() };
    let mut used = vec![false; document.meshes.len()];
    for placement in &placements {
        if let Some(used) = used.get_mut(placement.mesh as usize) {
            *used = true;
        }
    }
    let meshes: Vec<_> = used
        .par_iter()
        .enumerate()
        .map(|(index, used)| used.then(|| mesh::import(&document, &accessors, budget, index)).transpose())
        .collect::<Result<_, _>>()?;

    // Index of each document's mesh among the model's; none for those without a triangle.
    let mut model_index = vec![None; meshes.len()];
    for (slot, imported) in model_index.iter_mut().zip(meshes) {
        let Some(imported) = imported else { continue };
        part.report.warn(WarningKind::PointsOrLines, imported.without_surface);
        if imported.mesh.triangle_count() > 0 {
            *slot = Some(part.model.meshes.len() as u32);
            part.model.meshes.push(imported.mesh);
        }
    }
    // Numbers of the placements that are objects.
    let mut leaves = Vec::new();
    for (number, placement) in (0..).zip(placements) {
        let name = document.object_name(placement.node, placement.mesh).to_owned();
        match model_index.get(placement.mesh as usize).copied().flatten() {
            Some(mesh) => {
                let object = part.model.objects.len() as u32;
                place(&mut part, budget, mesh, placement.to_world, name, placement.node)?;
                leaves.push(number);
                let attributes = document.attributes_of_one(placement.node);
                if !attributes.is_empty() {
                    part.model.hierarchy.attributes.push(ObjectAttributes { object, attributes });
                }
            }
            None => part.report.warn_of(WarningKind::EmptyObject, "", &name),
        }
    }
    part.model.hierarchy.groups = groups(branches, &leaves);
    let textured = |material: &&json::Material| material.pbr_metallic_roughness.base_color_texture.is_some();
    part.report
        .warn(WarningKind::TexturedMaterial, document.materials.iter().filter(textured).count() as u64);
    let skinned = document.nodes.iter().filter(|node| node.skin.is_some()).count();
    part.report.warn(WarningKind::SkinnedNode, skinned as u64);
    Ok(part)
}

fn check(document: &Document) -> Result<(), GltfError> {
    let version = document.asset.min_version.as_ref().unwrap_or(&document.asset.version);
    if version != "2.0" {
        return Err(GltfError::Version { version: version.clone() });
    }
    let unknown = |name: &&String| {
        !SUPPORTED.contains(&name.as_str()) && !IGNORED_PREFIXES.iter().any(|prefix| name.starts_with(prefix))
    };
    match document.extensions_required.iter().find(unknown) {
        Some(extension) => Err(GltfError::Extension { extension: extension.clone() }),
        None => Ok(()),
    }
}
