//! A glTF mesh, which may be several primitives, as one mesh with a colour a vertex.

use glam::Vec3;

use super::GltfError;
use super::accessor::Accessors;
use super::json::{AlphaMode, Document, Material, Primitive};
use crate::import::assemble::weld;
use crate::{Mesh, Rgba8};

/// A mesh, and how many of its primitives were left out because they are points or lines.
pub(super) struct Imported {
    pub mesh: Mesh,
    pub without_surface: u64,
}

/// How a primitive's corners make triangles: glTF's modes 4 to 6. Modes 0 to 3 are points and lines.
#[derive(Clone, Copy)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Reads mesh `index` of the document.
pub(super) fn import(
    document: &Document,
    accessors: &Accessors<'_>,
    index: usize,
) -> Result<Imported, GltfError> {
    let mut imported = Imported { mesh: Mesh::default(), without_surface: 0 };
    let Some(source) = document.meshes.get(index) else { return Ok(imported) };
    for (number, primitive) in source.primitives.iter().enumerate() {
        let place = || {
            let name = source.name.as_deref().map(|name| format!(" ({name:?})")).unwrap_or_default();
            format!("primitive {number} of mesh {index}{name}")
        };
        let mode = match primitive.mode {
            4 => Mode::Triangles,
            5 => Mode::Strip,
            6 => Mode::Fan,
            0..=3 => {
                imported.without_surface += 1;
                continue;
            }
            mode => {
                return Err(GltfError::Mesh { mesh: place(), what: format!("its mode {mode} is unknown") });
            }
        };
        append(&mut imported.mesh, document, accessors, primitive, mode, &place)?;
    }
    imported.mesh = weld(&imported.mesh);
    Ok(imported)
}

fn append(
    mesh: &mut Mesh,
    document: &Document,
    accessors: &Accessors<'_>,
    primitive: &Primitive,
    mode: Mode,
    place: &dyn Fn() -> String,
) -> Result<(), GltfError> {
    let malformed = |what: String| GltfError::Mesh { mesh: place(), what };
    let accessor = |accessor| move |what| GltfError::Accessor { accessor, user: place(), what };

    let position = primitive.attributes.position.ok_or_else(|| malformed("it has no positions".into()))?;
    let positions = accessors.vectors::<3>(position).map_err(accessor(position))?;
    let count = positions.len() as u32;
    if let Some((vertex, bad)) =
        positions.iter().enumerate().find(|(_, p)| !p.iter().all(|value| value.is_finite()))
    {
        return Err(malformed(format!("vertex {vertex} is at {bad:?}; repair the model where it was made")));
    }
    let corners = match primitive.indices {
        Some(index) => accessors.indices(index).map_err(accessor(index))?,
        None => (0..count).collect(),
    };
    if let Some(bad) = corners.iter().find(|&&corner| corner >= count) {
        return Err(malformed(format!("an index is {bad}, but it has {count} vertices")));
    }
    let first = u32::try_from(mesh.positions.len())
        .ok()
        .filter(|first| first.checked_add(count).is_some())
        .ok_or_else(|| {
        malformed("the mesh has more than 4 thousand million vertices: split it".into())
    })?;

    let material = match primitive.material {
        None => &Material::default(),
        Some(index) => document
            .materials
            .get(index as usize)
            .ok_or_else(|| malformed(format!("its material {index} does not exist")))?,
    };
    match primitive.attributes.colour {
        None => mesh.colours.extend(std::iter::repeat_n(colour(material, [1.0; 4]), positions.len())),
        Some(index) => {
            let colours = vertex_colours(accessors, index).map_err(accessor(index))?;
            if colours.len() != positions.len() {
                return Err(accessor(index)("it has not one colour a vertex"));
            }
            mesh.colours.extend(colours.into_iter().map(|vertex| colour(material, vertex)));
        }
    }
    mesh.positions.extend(positions.into_iter().map(Vec3::from_array));
    mode.triangles(&corners, |triangle| mesh.indices.extend(triangle.map(|corner| corner + first)));
    Ok(())
}

impl Mode {
    /// Calls `emit` for each triangle, all wound as the specification says (section 3.7.2.1). Corners that do not fill a
    /// triangle are dropped, and so are the triangles without area that only link two pieces of a strip.
    fn triangles(self, corners: &[u32], mut emit: impl FnMut([u32; 3])) {
        match self {
            Self::Triangles => corners.as_chunks::<3>().0.iter().for_each(|&triangle| emit(triangle)),
            Self::Strip => {
                for (number, window) in corners.windows(3).enumerate() {
                    if let &[a, b, c] = window
                        && a != b
                        && b != c
                        && c != a
                    {
                        emit(if number % 2 == 0 { [a, b, c] } else { [a, c, b] });
                    }
                }
            }
            Self::Fan => {
                if let Some((&hub, rim)) = corners.split_first() {
                    for window in rim.windows(2) {
                        if let &[b, c] = window {
                            emit([b, c, hub]);
                        }
                    }
                }
            }
        }
    }
}

fn vertex_colours(accessors: &Accessors<'_>, index: u32) -> Result<Vec<[f32; 4]>, &'static str> {
    if accessors.lanes(index)? == 3 {
        let opaque = |[r, g, b]: [f32; 3]| [r, g, b, 1.0];
        Ok(accessors.vectors::<3>(index)?.into_iter().map(opaque).collect())
    } else {
        accessors.vectors::<4>(index)
    }
}

/// The material's base colour times the vertex's, from linear to sRGB. An opaque material's alpha means nothing.
fn colour(material: &Material, vertex: [f32; 4]) -> Rgba8 {
    let [r, g, b, a] = material.pbr_metallic_roughness.base_color_factor;
    let [vr, vg, vb, va] = vertex;
    let alpha = if material.alpha_mode == AlphaMode::Opaque { 255 } else { byte(a * va) };
    Rgba8([byte(srgb(r * vr)), byte(srgb(g * vg)), byte(srgb(b * vb)), alpha])
}

/// Linear light to sRGB (IEC 61966-2-1).
fn srgb(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// 0..1 to 0..255; the cast clamps, and makes NaN 0.
fn byte(value: f32) -> u8 {
    (value * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
        let mut all = Vec::new();
        mode.triangles(corners, |triangle| all.push(triangle));
        all
    }

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangles(Mode::Strip, &[0, 1, 2, 3, 4]), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
        assert_eq!(triangles(Mode::Strip, &[0, 1, 2, 2, 3, 3, 4, 5]), [[0, 1, 2], [3, 5, 4]]);
        assert_eq!(triangles(Mode::Fan, &[0, 1, 2, 3]), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(triangles(Mode::Triangles, &[0, 1, 2, 3]), [[0, 1, 2]]);
        for mode in [Mode::Triangles, Mode::Strip, Mode::Fan] {
            assert!(triangles(mode, &[]).is_empty() && triangles(mode, &[1, 2]).is_empty());
        }
    }

    #[test]
    fn colours_go_from_linear_to_srgb() {
        let mut material = Material::default();
        material.pbr_metallic_roughness.base_color_factor = [0.5, 0.0, 1.0, 0.5];
        assert_eq!(colour(&material, [1.0; 4]), Rgba8([188, 0, 255, 255]));
        material.alpha_mode = AlphaMode::Other;
        assert_eq!(colour(&material, [1.0, 1.0, 0.0, 1.0]), Rgba8([188, 0, 0, 128]));
        assert_eq!(colour(&material, [f32::NAN, -1.0, 9.0, f32::INFINITY]), Rgba8([0, 0, 255, 255]));
    }
}
