//! Reads a glTF mesh of several primitives as one mesh with vertex colours, or as one per feature.

use std::collections::BTreeMap;

use glam::Vec3;

use super::GltfError;
use super::accessor::Accessors;
use super::draco::Decoded;
use super::json::{Document, Primitive};
use super::material::{Alpha, Material, encoded};
use super::metadata::{Feature, Metadata};
use super::surface::Surface;
use super::texture::{Placed, Textures};
use crate::Mesh;
use crate::import::assemble::weld;
use crate::import::budget::Budget;
use crate::import::report::WarningKind;

/// A mesh of the document, with the weights of its morph targets.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shape {
    /// Index of the mesh.
    pub mesh: u32,
    /// Empty if nothing is morphed.
    pub weights: Vec<f32>,
}

/// A mesh, and its omissions.
#[derive(Default)]
pub(super) struct Imported {
    /// The mesh of each feature, and of none.
    pub pieces: BTreeMap<Option<Feature>, Mesh>,
    /// Primitives that are points or lines.
    pub without_surface: u64,
    /// Triangles with a corner that is not finite or does not exist.
    pub left_out: u64,
    /// Materials whose texture has several colours within a triangle.
    pub averaged: Vec<u32>,
    /// Materials whose texture cannot be mapped to the mesh.
    pub unplaced: Vec<u32>,
    /// Broken parts that were left out, with counts.
    pub broken: BTreeMap<(WarningKind, String), u64>,
    /// The first cause.
    pub cause: Option<GltfError>,
}

impl Imported {
    /// Leaves out a part that cannot be read. Only a limit ends an import.
    fn leave_out(&mut self, kind: WarningKind, what: &str, why: GltfError) -> Result<(), GltfError> {
        if matches!(why, GltfError::Budget(_)) {
            return Err(why);
        }
        let detail =
            if self.broken.len() < MOST_TOLD { what.to_owned() + &why.what() } else { String::new() };
        *self.broken.entry((kind, detail)).or_default() += 1;
        self.cause.get_or_insert(why);
        Ok(())
    }

    /// A part, unless it cannot be read.
    fn kept<T>(
        &mut self,
        kind: WarningKind,
        what: &str,
        part: Result<Option<T>, GltfError>,
    ) -> Result<Option<T>, GltfError> {
        part.or_else(|why| self.leave_out(kind, what, why).map(|()| None))
    }
}

/// How many different causes in a mesh are distinguished.
const MOST_TOLD: usize = 100;

/// The inputs of meshes.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub document: &'a Document,
    pub accessors: &'a Accessors<'a>,
    pub textures: &'a Textures,
    pub budget: &'a Budget,
}

/// How a primitive's corners make triangles: glTF's modes 4 to 6. Modes 0 to 3 are points and lines.
#[derive(Clone, Copy)]
enum Mode {
    Triangles,
    Strip,
    Fan,
}

/// Reads a mesh of the document.
pub(super) fn import(from: Input<'_>, shape: &Shape) -> Result<Imported, GltfError> {
    let mut imported = Imported::default();
    let Some(source) = from.document.meshes.get(shape.mesh as usize) else { return Ok(imported) };
    for (number, primitive) in source.primitives.iter().enumerate() {
        let place = || {
            let cut = |name: &str| name.chars().take(LONGEST_NAME).collect::<String>();
            let name = source.name.as_deref().map(|name| format!(" ({:?})", cut(name))).unwrap_or_default();
            format!("primitive {number} of mesh {}{name}", shape.mesh)
        };
        let mode = match primitive.mode {
            None | Some(4) => Mode::Triangles,
            Some(5) => Mode::Strip,
            Some(6) => Mode::Fan,
            Some(0..=3) => {
                imported.without_surface += 1;
                continue;
            }
            Some(mode) => {
                let why = GltfError::Malformed { part: place(), what: format!("its mode {mode} is unknown") };
                imported.leave_out(WarningKind::PrimitiveLeftOut, "", why)?;
                continue;
            }
        };
        let reader = Reader { from, primitive, weights: &shape.weights, place: &place };
        if let Err(why) = reader.append(&mut imported, mode) {
            imported.leave_out(WarningKind::PrimitiveLeftOut, "", why)?;
        }
    }
    imported.pieces.values_mut().for_each(|mesh| *mesh = weld(mesh));
    imported.pieces.retain(|_, mesh| !mesh.indices.is_empty());
    Ok(imported)
}

/// The longest name of a mesh in messages.
const LONGEST_NAME: usize = 100;

/// Reads one primitive.
struct Reader<'a> {
    from: Input<'a>,
    primitive: &'a Primitive,
    weights: &'a [f32],
    /// Names the primitive.
    place: &'a dyn Fn() -> String,
}

/// The arrays of a primitive, and its corners.
struct Arrays<'a> {
    source: Source<'a>,
    mode: Mode,
    /// The corners as numbers of vertices; `None` if they are the vertices in order.
    corners: Option<Vec<u32>>,
}

enum Source<'a> {
    /// In accessors: the vertices are these elements, or all.
    Plain {
        picks: Option<Vec<u32>>,
    },
    Draco(Box<Decoded<'a>>),
}

const POSITION: &str = "POSITION";
const COLOUR: &str = "COLOR_0";
/// A corner that does not exist.
const NOWHERE: u32 = u32::MAX;

impl Reader<'_> {
    fn malformed(&self, what: String) -> GltfError {
        GltfError::Malformed { part: (self.place)(), what }
    }

    fn broken(&self, accessor: u32) -> impl Fn(&'static str) -> GltfError {
        move |what| GltfError::Accessor { accessor, user: (self.place)(), what }
    }

    fn append(&self, imported: &mut Imported, mode: Mode) -> Result<(), GltfError> {
        let Input { document, textures, .. } = self.from;
        let plain = Material::default();
        let number = self.primitive.material;
        let known = number.and_then(|number| document.materials.get(number as usize));
        if let Some(number) = number.filter(|_| known.is_none()) {
            let why = self.malformed(format!("its material {number} does not exist"));
            imported.leave_out(WarningKind::ReferenceLeftOut, "", why)?;
        }
        let material = known.unwrap_or(&plain);
        let texture = textures.of(document, material);
        let coordinates = texture.as_ref().map(|texture| format!("TEXCOORD_{}", texture.coordinates()));
        let features = self.primitive.features().filter(|_| Metadata::of(document).is_some());
        let named = [coordinates.as_deref(), features.as_ref().map(|(name, _)| &**name)];
        let arrays = self.arrays(mode, named)?;
        let positions = self.positions(&arrays, imported)?;
        let colours = self.colours(&arrays, material, positions.len());
        let colours = imported.kept(WarningKind::FieldLeftOut, "colours of vertices: ", colours)?;
        let triangles = self.triangles(&arrays, &positions, &mut imported.left_out);
        let coordinates = coordinates.map(|name| self.vectors::<2>(&arrays, &name, None));
        let coordinates = coordinates.and_then(Result::ok).flatten();
        if texture.is_some() && coordinates.is_none() {
            imported.unplaced.extend(self.primitive.material);
        }
        let numbers = |(name, ids): (String, _)| {
            let numbers = self.vectors::<1>(&arrays, &name, None).transpose()?;
            Some(numbers.map(|numbers| (numbers, ids)))
        };
        let numbers = features.and_then(numbers).transpose();
        let numbers = imported.kept(WarningKind::MetadataLeftOut, "numbers of features: ", numbers)?;
        let whole = Surface { positions, colours, coordinates, triangles };
        let Some((numbers, ids)) = numbers else {
            return self.append_piece(imported, None, whole, texture.as_ref(), material);
        };
        let mut pieces: BTreeMap<_, Vec<[u32; 3]>> = BTreeMap::new();
        for &triangle in &whole.triangles {
            let number = numbers.get(triangle[0] as usize).map(|&[number]| number);
            pieces.entry(number.and_then(|number| ids.feature(number))).or_default().push(triangle);
        }
        for (feature, triangles) in pieces {
            self.append_piece(imported, feature, whole.part(&triangles), texture.as_ref(), material)?;
        }
        Ok(())
    }

    /// Colours a surface and adds it to a feature's mesh.
    fn append_piece(
        &self,
        imported: &mut Imported,
        feature: Option<Feature>,
        mut surface: Surface,
        texture: Option<&Placed<'_>>,
        material: &Material,
    ) -> Result<(), GltfError> {
        let budget = self.from.budget;
        match (texture, surface.coordinates.take()) {
            (Some(texture), Some(coordinates)) => {
                // Each triangle gets corners of its own.
                budget.mesh(0, 3 * surface.triangles.len() as u64, self.place)?;
                if surface.paint(texture, &coordinates, material) {
                    imported.averaged.extend(self.primitive.material);
                }
            }
            _ => {
                let before = (surface.triangles.len(), surface.positions.len());
                surface.shade(material);
                let more = |now: usize, before: usize| now.saturating_sub(before) as u64;
                let triangles = more(surface.triangles.len(), before.0);
                budget.mesh(triangles, more(surface.positions.len(), before.1), self.place)?;
            }
        }
        // The budget allows no more vertices than can be numbered.
        let mesh = imported.pieces.entry(feature).or_default();
        let first = mesh.positions.len() as u32;
        match surface.colours {
            Some(colours) => mesh.colours.extend(colours.into_iter().map(encoded)),
            None => {
                let [r, g, b, a] = material.factor();
                let a = if material.alpha() == Alpha::Blend { a } else { 1.0 };
                let all = std::iter::repeat_n(encoded([r, g, b, a]), surface.positions.len());
                mesh.colours.extend(all);
            }
        }
        mesh.positions.extend(surface.positions);
        mesh.indices.extend(surface.triangles.iter().flatten().map(|corner| corner + first));
        Ok(())
    }

    /// Finds the primitive's arrays and reads its corners. Sizes are counted before anything is read. A
    /// thousand primitives may share one array of positions, so each takes only those that it uses.
    fn arrays(&self, mode: Mode, named: [Option<&str>; 2]) -> Result<Arrays<'_>, GltfError> {
        let Input { accessors, budget, .. } = self.from;
        if let Some(decoded) = Decoded::of(self.primitive, accessors, budget, self.place) {
            let decoded = decoded?;
            let corners = Some(decoded.corners());
            return Ok(Arrays { source: Source::Draco(Box::new(decoded)), mode: Mode::Triangles, corners });
        }
        let attributes = &self.primitive.attributes;
        let position =
            *attributes.get(POSITION).ok_or_else(|| self.malformed("it has no positions".into()))?;
        let vertices = accessors.count(position).map_err(self.broken(position))?;
        let Some(index) = self.primitive.indices else {
            budget.mesh(mode.most_triangles(vertices), vertices, self.place)?;
            return Ok(Arrays { source: Source::Plain { picks: None }, mode, corners: None });
        };
        let count = accessors.count(index).map_err(self.broken(index))?;
        let names = [Some(POSITION), Some(COLOUR)].into_iter().chain(named).flatten();
        let used = names.filter_map(|name| attributes.get(name).copied());
        let mut used = used.chain(self.targets().map(|target| target.0));
        let picked = count < vertices && used.all(|array| accessors.is_dense(array));
        budget.mesh(mode.most_triangles(count), if picked { count } else { vertices }, self.place)?;
        let mut corners = accessors.indices(index).map_err(self.broken(index))?;
        for corner in &mut corners {
            if u64::from(*corner) >= vertices {
                *corner = NOWHERE;
            }
        }
        let mut picks = None;
        if picked {
            let mut used = corners.clone();
            used.sort_unstable();
            used.dedup();
            while used.last() == Some(&NOWHERE) {
                used.pop();
            }
            for corner in corners.iter_mut().filter(|corner| **corner != NOWHERE) {
                *corner = used.partition_point(|pick| pick < corner) as u32;
            }
            picks = Some(used);
        }
        Ok(Arrays { source: Source::Plain { picks }, mode, corners: Some(corners) })
    }

    /// An attribute's vectors, if it has them. If the format does not define whether integers stand for 0..1,
    /// the accessor decides.
    fn vectors<const N: usize>(
        &self,
        arrays: &Arrays<'_>,
        name: &str,
        scaled: Option<bool>,
    ) -> Result<Option<Vec<[f32; N]>>, GltfError> {
        let accessors = self.from.accessors;
        let Some(&index) = self.primitive.attributes.get(name) else { return Ok(None) };
        let scaled = scaled.unwrap_or_else(|| accessors.is_normalized(index));
        let picks = match &arrays.source {
            Source::Draco(decoded) => match decoded.vectors(name, scaled) {
                Some(vectors) => return Ok(Some(vectors)),
                None => None,
            },
            Source::Plain { picks } => picks.as_deref(),
        };
        Ok(Some(accessors.vectors_at(index, picks, scaled).map_err(self.broken(index))?))
    }

    fn positions(&self, arrays: &Arrays<'_>, imported: &mut Imported) -> Result<Vec<Vec3>, GltfError> {
        let positions = self.vectors::<3>(arrays, POSITION, None)?.unwrap_or_default();
        let mut positions: Vec<Vec3> = positions.into_iter().map(Vec3::from_array).collect();
        for (index, weight) in self.targets() {
            self.from.budget.mesh(0, positions.len() as u64, self.place)?;
            match self.moves(arrays, index, positions.len()) {
                Ok(moves) => {
                    for (position, by) in positions.iter_mut().zip(moves) {
                        *position += weight * Vec3::from_array(by);
                    }
                }
                Err(why) => imported.leave_out(WarningKind::FieldLeftOut, "morph targets: ", why)?,
            }
        }
        Ok(positions)
    }

    /// The offsets of a morph target for each vertex.
    fn moves(&self, arrays: &Arrays<'_>, index: u32, vertices: usize) -> Result<Vec<[f32; 3]>, GltfError> {
        let accessors = self.from.accessors;
        let picks = match &arrays.source {
            Source::Plain { picks } => picks.as_deref(),
            Source::Draco(_) => None,
        };
        let scaled = accessors.is_normalized(index);
        let moves = accessors.vectors_at::<3>(index, picks, scaled).map_err(self.broken(index))?;
        if moves.len() == vertices {
            Ok(moves)
        } else {
            Err(self.broken(index)("it has not one element a vertex"))
        }
    }

    /// The morph targets with an effect: their accessors and weights.
    fn targets(&self) -> impl Iterator<Item = (u32, f32)> {
        let weighted = self.primitive.targets.iter().zip(self.weights);
        weighted
            .filter(|(_, weight)| **weight != 0.0)
            .filter_map(|(of, &weight)| Some((of.position?, weight)))
    }

    /// A linear colour per vertex, if there are vertex colours: multiplied by the material's.
    fn colours(
        &self,
        arrays: &Arrays<'_>,
        material: &Material,
        vertices: usize,
    ) -> Result<Option<Vec<[f32; 4]>>, GltfError> {
        let Some(&index) = self.primitive.attributes.get(COLOUR) else { return Ok(None) };
        let lanes = match &arrays.source {
            Source::Draco(decoded) => decoded.lanes(COLOUR),
            Source::Plain { .. } => None,
        };
        let lanes = lanes.map_or_else(|| self.from.accessors.lanes(index), Ok).map_err(self.broken(index))?;
        // Integers stand for 0..1 by the specification, even if an exporter forgot the flag.
        let colours = if lanes == 3 {
            let colours = self.vectors::<3>(arrays, COLOUR, Some(true))?.unwrap_or_default();
            colours.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()
        } else {
            self.vectors::<4>(arrays, COLOUR, Some(true))?.unwrap_or_default()
        };
        if colours.len() != vertices {
            return Err(self.broken(index)("it has not one colour a vertex"));
        }
        let factor = material.factor();
        // Also maps NaN to 0.
        let within = |value: f32| if value > 0.0 { value.min(1.0) } else { 0.0 };
        let times =
            |colour: [f32; 4]| [0, 1, 2, 3].map(|channel: usize| within(colour[channel] * factor[channel]));
        Ok(Some(colours.into_iter().map(times).collect()))
    }

    /// The triangles whose corners all exist and are finite; `left_out` counts the others.
    fn triangles(&self, arrays: &Arrays<'_>, positions: &[Vec3], left_out: &mut u64) -> Vec<[u32; 3]> {
        let in_order: Vec<u32>;
        let corners = match &arrays.corners {
            Some(corners) => corners,
            None => {
                in_order = (0..positions.len() as u32).collect();
                &in_order
            }
        };
        let is_there = |&corner: &u32| positions.get(corner as usize).is_some_and(|at| at.is_finite());
        let mut triangles = Vec::with_capacity(corners.len() / 3);
        arrays.mode.triangles(corners, |triangle| match triangle.iter().all(is_there) {
            true => triangles.push(triangle),
            false => *left_out += 1,
        });
        triangles
    }
}

impl Mode {
    /// The most triangles of this many corners.
    const fn most_triangles(self, corners: u64) -> u64 {
        match self {
            Self::Triangles => corners / 3,
            Self::Strip | Self::Fan => corners.saturating_sub(2),
        }
    }

    /// Calls `emit` for each triangle, wound as specified (section 3.7.2.1). Drops corners that do not fill a
    /// triangle, and degenerate triangles that only link two pieces of a strip.
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
}
