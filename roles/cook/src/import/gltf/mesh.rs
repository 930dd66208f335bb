//! A glTF mesh, which may be several primitives, as one mesh with a colour a vertex.

use glam::Vec3;

use super::GltfError;
use super::accessor::Accessors;
use super::json::{AlphaMode, Document, Material, Primitive};
use crate::Mesh;
use crate::import::assemble::weld;
use crate::import::budget::Budget;
use trimaran_scene::Rgba8;

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
    budget: &Budget,
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
        let reader = Reader { document, accessors, budget, primitive, place: &place };
        reader.append(&mut imported.mesh, mode)?;
    }
    imported.mesh = weld(&imported.mesh);
    Ok(imported)
}

/// Reads one primitive.
struct Reader<'a> {
    document: &'a Document,
    accessors: &'a Accessors<'a>,
    budget: &'a Budget,
    primitive: &'a Primitive,
    /// Says which primitive it is.
    place: &'a dyn Fn() -> String,
}

/// The corners of a primitive's triangles.
struct Corners {
    /// Each as the number of a vertex; `None` if they are the vertices in order.
    numbers: Option<Vec<u32>>,
    /// Which elements of the primitive's arrays are its vertices; `None` if all are.
    picks: Option<Vec<u32>>,
}

impl Reader<'_> {
    fn malformed(&self, what: String) -> GltfError {
        GltfError::Mesh { mesh: (self.place)(), what }
    }

    fn broken(&self, accessor: u32) -> impl Fn(&'static str) -> GltfError {
        move |what| GltfError::Accessor { accessor, user: (self.place)(), what }
    }

    fn append(&self, mesh: &mut Mesh, mode: Mode) -> Result<(), GltfError> {
        let attributes = &self.primitive.attributes;
        let position = attributes.position.ok_or_else(|| self.malformed("it has no positions".into()))?;
        let Corners { numbers, picks } = self.corners(position, mode)?;
        let positions =
            self.accessors.vectors_at::<3>(position, picks.as_deref()).map_err(self.broken(position))?;
        let corners = numbers.unwrap_or_else(|| (0..positions.len() as u32).collect());
        let bad = positions.iter().enumerate().find(|(_, p)| !p.iter().all(|value| value.is_finite()));
        if let Some((vertex, bad)) = bad {
            let vertex =
                picks.as_ref().and_then(|picks| picks.get(vertex)).map_or(vertex, |&pick| pick as usize);
            return Err(
                self.malformed(format!("vertex {vertex} is at {bad:?}; repair the model where it was made"))
            );
        }
        let material = match self.primitive.material {
            None => &Material::default(),
            Some(index) => self
                .document
                .materials
                .get(index as usize)
                .ok_or_else(|| self.malformed(format!("its material {index} does not exist")))?,
        };
        match attributes.colour {
            None => mesh.colours.extend(std::iter::repeat_n(colour(material, [1.0; 4]), positions.len())),
            Some(index) => {
                let count = self.accessors.count(index).map_err(self.broken(index))?;
                if Ok(count) != self.accessors.count(position) {
                    return Err(self.broken(index)("it has not one colour a vertex"));
                }
                let colours = vertex_colours(self.accessors, index, picks.as_deref());
                let colours = colours.map_err(self.broken(index))?;
                mesh.colours.extend(colours.into_iter().map(|vertex| colour(material, vertex)));
            }
        }
        // The budget allows no more vertices than can be numbered.
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(positions.into_iter().map(Vec3::from_array));
        mode.triangles(&corners, |triangle| mesh.indices.extend(triangle.map(|corner| corner + first)));
        Ok(())
    }

    /// Reads the primitive's corners, and asks for what they come to before anything is read. A thousand
    /// primitives may share one array of positions, so each takes those that it uses.
    fn corners(&self, position: u32, mode: Mode) -> Result<Corners, GltfError> {
        let vertices = self.accessors.count(position).map_err(self.broken(position))?;
        let Some(index) = self.primitive.indices else {
            self.budget.mesh(mode.most_triangles(vertices), vertices, self.place)?;
            return Ok(Corners { numbers: None, picks: None });
        };
        let count = self.accessors.count(index).map_err(self.broken(index))?;
        let mut arrays = std::iter::once(position).chain(self.primitive.attributes.colour);
        let picked = count < vertices && arrays.all(|array| self.accessors.is_dense(array));
        self.budget.mesh(mode.most_triangles(count), if picked { count } else { vertices }, self.place)?;
        let mut corners = self.accessors.indices(index).map_err(self.broken(index))?;
        if let Some(bad) = corners.iter().find(|&&corner| u64::from(corner) >= vertices) {
            return Err(self.malformed(format!("an index is {bad}, but it has {vertices} vertices")));
        }
        if !picked {
            return Ok(Corners { numbers: Some(corners), picks: None });
        }
        let mut picks = corners.clone();
        picks.sort_unstable();
        picks.dedup();
        for corner in &mut corners {
            *corner = picks.partition_point(|pick| pick < corner) as u32;
        }
        Ok(Corners { numbers: Some(corners), picks: Some(picks) })
    }
}

impl Mode {
    /// The most triangles that so many corners make.
    const fn most_triangles(self, corners: u64) -> u64 {
        match self {
            Self::Triangles => corners / 3,
            Self::Strip | Self::Fan => corners.saturating_sub(2),
        }
    }

    /// Calls `emit` for each triangle, all wound as the specification says (section 3.7.2.1). Corners that do
    /// not fill a triangle are dropped, and so are the triangles without area that only link two pieces
    /// of a strip.
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

fn vertex_colours(
    accessors: &Accessors<'_>,
    index: u32,
    picks: Option<&[u32]>,
) -> Result<Vec<[f32; 4]>, &'static str> {
    if accessors.lanes(index)? == 3 {
        let opaque = |[r, g, b]: [f32; 3]| [r, g, b, 1.0];
        Ok(accessors.vectors_at::<3>(index, picks)?.into_iter().map(opaque).collect())
    } else {
        accessors.vectors_at::<4>(index, picks)
    }
}

/// The material's base colour times the vertex's, from linear to sRGB. An opaque material's alpha means
/// nothing.
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
