//! Makes a surface of a PLY file's rows.

use glam::{DAffine3, DVec3};

use super::PlyError;
use super::header::{Element, Header, Kind};
use super::rows::{Row, Values};
use crate::import::assemble::{grey, is_in_reach, rgba};
use crate::import::budget::Budget;
use crate::import::left_out::LeftOut;
use crate::import::polygon::Triangulator;
use crate::import::report::{ImportReport, WarningKind};
use crate::lists::{at, put};
use trimaran_scene::Rgba8;

/// Positions, one colour for each, and corners of triangles.
pub(super) type Surface = (Vec<DVec3>, Vec<Rgba8>, Vec<u32>);

/// The number of no vertex; it ends a strip.
const NONE: u32 = u32::MAX;

/// A file's vertices and faces so far.
pub(super) struct Shape {
    to_world: DAffine3,
    places: Vec<DVec3>,
    /// One for each vertex, or none.
    colours: Vec<Rgba8>,
    /// The corners of all faces in sequence: numbers of vertices.
    corners: Vec<u32>,
    faces: Vec<Face>,
    /// Whether faces have colours of their own.
    faces_coloured: bool,
    /// Edges, and faces of fewer than three corners.
    points_or_lines: u64,
}

/// A polygon, or strips of triangles. Its corners are next to those of the one before.
struct Face {
    corners: u32,
    is_strip: bool,
    colour: Rgba8,
    /// Its row in the file, from 1 on.
    row: u32,
}

impl Shape {
    /// The empty shape of a file with this header.
    pub(super) fn new(header: &Header, to_world: DAffine3) -> Result<Self, PlyError> {
        let wrong = |line, what: &str| Err(PlyError::Header { line, what: what.to_owned() });
        let Some(vertex) = header.elements.iter().find(|element| element.name == "vertex") else {
            return wrong(header.line, "no element is called vertex");
        };
        let has =
            |name| vertex.properties.iter().any(|known| known.name == name && known.counted_by.is_none());
        if !["x", "y", "z"].into_iter().all(has) {
            return wrong(vertex.line, "a vertex has no x, y and z");
        }
        let has_faces =
            |element: &Element| ["face", "tristrips"].contains(&&*element.name) && element.rows > 0;
        if vertex.rows > 0 && !header.elements.iter().any(has_faces) {
            return Err(PlyError::PointCloud { points: vertex.rows });
        }
        Ok(Self {
            to_world,
            places: Vec::new(),
            colours: Vec::new(),
            corners: Vec::new(),
            faces: Vec::new(),
            faces_coloured: false,
            points_or_lines: 0,
        })
    }

    /// Reads the rows of an element.
    pub(super) fn read(&mut self, element: &Element, values: &mut Values<'_>) -> Result<(), PlyError> {
        let colour = Colour::of(element);
        match element.name.as_str() {
            "vertex" => values.rows(element, |_, row| {
                let [x, y, z, ..] = row.values;
                self.places.push(self.to_world.transform_point3(DVec3::new(x, y, z)));
                if let Some(colour) = &colour {
                    self.colours.push(colour.of_row(row));
                }
            }),
            name @ ("face" | "tristrips") => {
                self.faces_coloured |= colour.is_some();
                values.rows(element, |number, row| {
                    let colour = colour.as_ref().map_or_else(grey, |colour| colour.of_row(row));
                    self.face(row, name == "tristrips", colour, number);
                })
            }
            name => {
                self.points_or_lines += if name == "edge" { element.rows } else { 0 };
                values.rows(element, |_, _| {})
            }
        }
    }

    fn face(&mut self, row: &Row, is_strip: bool, colour: Rgba8, number: u64) {
        if row.list.len() < 3 {
            self.points_or_lines += 1;
            return;
        }
        // The casts clamp.
        let corner = |&corner: &f64| if corner >= 0.0 { corner as u32 } else { NONE };
        self.corners.extend(row.list.iter().map(corner));
        let (corners, row) = (row.list.len() as u32, u32::try_from(number).unwrap_or(u32::MAX));
        self.faces.push(Face { corners, is_strip, colour, row });
    }

    /// The triangles of all faces that can be drawn.
    pub(super) fn surface(
        mut self,
        name: &str,
        budget: &Budget,
        report: &mut ImportReport,
    ) -> Result<Surface, PlyError> {
        // Colours of vertices count before those of faces.
        let by_face = self.faces_coloured && self.colours.is_empty();
        self.colours.resize_with(self.places.len(), grey);
        let triangles = self.faces.iter().map(|face| u64::from(face.corners.saturating_sub(2))).sum();
        let vertices = if by_face { 3 * triangles } else { self.places.len() as u64 };
        budget.mesh(triangles, vertices, || format!("object {name:?}"))?;

        let mut drawn = Drawn { places: &self.places, ..Drawn::default() };
        let mut colours_of_corners = Vec::new();
        let mut rest = self.corners.as_slice();
        for &Face { corners, is_strip, colour, row } in &self.faces {
            let corners = rest.split_off(..corners as usize).unwrap_or_default();
            if is_strip {
                corners.split(|&corner| corner == NONE).for_each(|strip| drawn.strip(strip, row));
            } else {
                drawn.face(corners, row);
            }
            if by_face {
                colours_of_corners.resize(drawn.indices.len(), colour);
            }
        }
        let Drawn { indices, left_out, triangulator, .. } = drawn;
        if let (true, Some(first)) = (indices.is_empty(), left_out.first()) {
            return Err(PlyError::Nothing { first: first.to_owned() });
        }
        left_out.report(WarningKind::FaceLeftOut, report);
        report.warn(WarningKind::PointsOrLines, self.points_or_lines);
        report.warn(WarningKind::LargePolygon, triangulator.large_polygons());
        if by_face {
            let positions = indices.iter().map(|&corner| at(&self.places, corner)).collect();
            let numbers = (0..).take(indices.len()).collect();
            return Ok((positions, colours_of_corners, numbers));
        }
        // Vertices of no face may be anywhere: they would move the middle of the mesh.
        let mut is_used = vec![false; self.places.len()];
        indices.iter().for_each(|&corner| put(&mut is_used, corner, true));
        let used = indices.first().map_or(DVec3::ZERO, |&corner| at(&self.places, corner));
        for (place, _) in self.places.iter_mut().zip(is_used).filter(|(_, is_used)| !is_used) {
            *place = used;
        }
        Ok((self.places, self.colours, indices))
    }
}

/// The triangles of faces so far.
#[derive(Default)]
struct Drawn<'p> {
    places: &'p [DVec3],
    indices: Vec<u32>,
    left_out: LeftOut,
    triangulator: Triangulator,
}

impl Drawn<'_> {
    fn face(&mut self, corners: &[u32], row: u32) {
        let places = self.places;
        let place = |corner: &u32| places.get(*corner as usize);
        match corners.iter().find(|&corner| !place(corner).is_some_and(|&place| is_in_reach(place))) {
            Some(corner) => self.left_out.note(|| match place(corner) {
                Some(_) => format!("face {row}: vertex {corner} has no finite place, or is too far away"),
                None => format!("face {row}: a corner is at none of the {} vertices", places.len()),
            }),
            None => self.triangulator.face(corners, places, &mut self.indices),
        }
    }

    /// A strip of triangles. Every other one winds the other way; some have no area, to turn the strip.
    fn strip(&mut self, corners: &[u32], row: u32) {
        for (first, &[a, b, c]) in corners.array_windows().enumerate() {
            if a != b && b != c && c != a {
                self.face(&if first % 2 == 0 { [a, b, c] } else { [a, c, b] }, row);
            }
        }
    }
}

/// The colours of an element's rows.
struct Colour {
    /// The kinds of red, green, blue and alpha.
    kinds: [Option<Kind>; 4],
}

impl Colour {
    /// None if the element lacks one of the three colours.
    fn of(element: &Element) -> Option<Self> {
        let [_, _, _, names @ ..] = Row::NAMES;
        let kind = |names: &[&str]| {
            let is_named = |name: &str, is_list: bool| names.contains(&name) && !is_list;
            let mut properties = element.properties.iter();
            properties.find(|one| is_named(&one.name, one.counted_by.is_some())).map(|one| one.kind)
        };
        let kinds = names.map(kind);
        kinds.iter().take(3).all(Option::is_some).then_some(Self { kinds })
    }

    fn of_row(&self, row: &Row) -> Rgba8 {
        let [_, _, _, values @ ..] = row.values;
        let mut parts = [1.0; 4];
        for ((part, kind), value) in parts.iter_mut().zip(self.kinds).zip(values) {
            *part = match kind {
                None => 1.0,
                Some(Kind::I16 | Kind::U16) => value / f64::from(u16::MAX),
                // Some programs write numbers up to 255 as floats.
                Some(Kind::F32 | Kind::F64) if value <= 1.0 => value,
                Some(_) => value / 255.0,
            };
        }
        rgba(parts)
    }
}
