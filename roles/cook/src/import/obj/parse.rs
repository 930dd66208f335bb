//! The statements of an OBJ file.

use std::borrow::Cow;

use glam::DVec3;

use super::faults::Faults;
use super::library::Libraries;
use super::materials::{Materials, NO_MATERIAL};
use super::tints::Tints;
use crate::import::OverBudget;
use crate::import::budget::Budget;
use crate::import::neighbours::Neighbours;
use crate::import::report::WarningKind;
use crate::import::text::{Lines, excerpt, name, numbers, statement};

/// The name of an object without one.
pub(super) const UNNAMED: &str = "unnamed_object";

/// Statements that would read another file, or run a program.
const NEVER_DONE: &[&str] = &["call", "csh"];

/// A file's contents. Vertex numbers out of range are still there.
#[derive(Default)]
pub(super) struct Parsed {
    /// In the file's frame; NaN for malformed lines.
    pub(super) vertices: Vec<DVec3>,
    pub(super) tints: Tints,
    /// The corners of all faces in sequence: numbers of vertices from 0 on.
    pub(super) corners: Vec<u32>,
    pub(super) faces: Vec<Face>,
    /// The faces of one object and one material.
    pub(super) runs: Vec<Run>,
    pub(super) objects: Vec<Heading>,
    /// The names that `o` gave.
    pub(super) outers: Vec<String>,
    pub(super) materials: Materials,
    /// Elements without a surface.
    pub(super) points_or_lines: u64,
}

pub(super) struct Face {
    pub(super) corners: u32,
    pub(super) line: u32,
}

pub(super) struct Run {
    /// Index of the object.
    pub(super) object: u32,
    /// Index of the material, or [`NO_MATERIAL`].
    pub(super) material: u32,
    pub(super) faces: u32,
}

/// The names above an object's faces.
pub(super) struct Heading {
    /// Index of the name that `o` gave.
    pub(super) outer: Option<u32>,
    /// The name that `g` gave within it; empty if none, or the same one.
    pub(super) group: String,
}

struct Parser<'a, 'b> {
    parsed: Parsed,
    libraries: Libraries<'a>,
    faults: &'b mut Faults,
    budget: &'a Budget,
    outer: String,
    group: String,
    material: u32,
    /// Whether a name or a material was given since the last face.
    is_new: bool,
}

/// Reads a file's statements. A fault costs its statement, and is noted.
pub(super) fn parse<'a>(
    text: &str,
    neighbours: Neighbours<'a>,
    budget: &'a Budget,
    faults: &mut Faults,
) -> Result<(Parsed, Libraries<'a>), OverBudget> {
    let mut parser = Parser {
        parsed: Parsed::default(),
        libraries: Libraries::of(neighbours),
        faults,
        budget,
        outer: String::new(),
        group: String::new(),
        material: NO_MATERIAL,
        is_new: true,
    };
    for (number, line) in Lines::of(text) {
        parser.statement(number, &line)?;
    }
    Ok((parser.parsed, parser.libraries))
}

impl Parser<'_, '_> {
    fn statement(&mut self, number: u32, line: &str) -> Result<(), OverBudget> {
        if line.contains('\0') {
            self.malformed(number, || "it has bytes of zero, read as white space".to_owned());
            return self.statement(number, &line.replace('\0', " "));
        }
        let (word, rest) = statement(line);
        let is_upper = word.bytes().any(|byte| byte.is_ascii_uppercase());
        let word = if is_upper { Cow::Owned(word.to_ascii_lowercase()) } else { Cow::Borrowed(word) };
        match &*word {
            "v" => self.vertex(number, numbers(rest)),
            "f" | "fo" => return self.face(number, numbers(rest)),
            "usemtl" => self.use_material(name(rest)),
            "o" => {
                name(rest).clone_into(&mut self.outer);
                self.group.clear();
                self.is_new = true;
            }
            "g" => {
                let name = Some(name(rest)).filter(|name| *name != self.outer).unwrap_or_default();
                name.clone_into(&mut self.group);
                self.is_new = true;
            }
            "mtllib" if name(rest).is_empty() => self.malformed(number, || "no library is named".to_owned()),
            "mtllib" => self.libraries.read(name(rest), &mut self.parsed.materials, self.faults),
            "l" | "p" => self.parsed.points_or_lines += 1,
            // Normals, texture coordinates, smoothing, and the parts of free-form curves and surfaces.
            "vn" | "vt" | "vp" | "s" | "mg" | "bevel" | "c_interp" | "d_interp" | "lod" | "shadow_obj"
            | "trace_obj" | "ctech" | "stech" | "usemap" | "maplib" | "cstype" | "deg" | "bmat" | "step"
            | "parm" | "trim" | "hole" | "scrv" | "sp" | "end" | "con" | "res" => {}
            word if word.is_empty() || word.starts_with('#') => {}
            // These draw a curve or surface; the last four are those of the format's first version.
            word @ ("surf" | "curv" | "curv2" | "bzp" | "bsp" | "cdc" | "cdp") => {
                let object = self.parsed_name();
                self.faults.note(WarningKind::FreeForm, word, number, &object, String::new);
            }
            word => {
                let of = if NEVER_DONE.contains(&word) { word } else { "" };
                self.faults
                    .note(WarningKind::UnknownStatement, of, number, "", || excerpt(line.trim_ascii_start()));
            }
        }
        Ok(())
    }

    fn malformed(&mut self, number: u32, what: impl FnOnce() -> String) {
        self.faults.note(WarningKind::MalformedLine, "", number, "", what);
    }

    /// The name of the next face's object.
    fn parsed_name(&self) -> String {
        let names = [&*self.group, &*self.outer, UNNAMED];
        names.into_iter().find(|name| !name.is_empty()).unwrap_or_default().to_owned()
    }

    /// Adds a vertex even for a malformed line: faces count them.
    fn vertex(&mut self, number: u32, rest: &str) {
        let mut values = [f64::NAN; 7];
        let mut count = 0;
        let mut wrong = None;
        for word in rest.split_ascii_whitespace() {
            let Some(value) = values.get_mut(count) else { break };
            let Ok(read) = word.parse() else {
                wrong = Some(word);
                break;
            };
            *value = read;
            count += 1;
        }
        match wrong {
            Some(word) => self.malformed(number, || format!("{} is no number", excerpt(word))),
            None if count < 3 => self.malformed(number, || format!("a vertex of {count} coordinates")),
            None => {}
        }
        let [x, y, z, ..] = values;
        if count > 5 {
            let [_, _, _, tint @ ..] = values;
            self.parsed.tints.set(self.parsed.vertices.len(), tint);
        }
        self.parsed.vertices.push(DVec3::new(x, y, z));
    }

    fn face(&mut self, number: u32, rest: &str) -> Result<(), OverBudget> {
        let start = self.parsed.corners.len();
        let mut wrong = None;
        for word in rest.split_ascii_whitespace() {
            match corner(word, self.parsed.vertices.len()) {
                Ok(corner) => self.parsed.corners.push(corner),
                Err(what) => {
                    wrong = Some((word, what));
                    break;
                }
            }
        }
        let corners = self.parsed.corners.len() - start;
        // A face of two corners is a line by another name.
        if corners < 3 && wrong.is_none() {
            self.parsed.corners.truncate(start);
            self.parsed.points_or_lines += 1;
            return Ok(());
        }
        self.begin_run()?;
        match (wrong, u32::try_from(corners)) {
            (None, Ok(corners)) => {
                self.parsed.faces.push(Face { corners, line: number });
                if let Some(run) = self.parsed.runs.last_mut() {
                    run.faces += 1;
                }
            }
            (wrong, _) => {
                self.parsed.corners.truncate(start);
                let (word, what) = wrong.unwrap_or((rest, "too many corners"));
                let name = self.parsed_name();
                let said = || format!("{}: {what}", excerpt(word));
                self.faults.note(WarningKind::FaceLeftOut, "", number, &name, said);
            }
        }
        Ok(())
    }

    /// Makes the object and the run of the next face.
    fn begin_run(&mut self) -> Result<(), OverBudget> {
        if !std::mem::take(&mut self.is_new) {
            return Ok(());
        }
        let outer = self.outer_number()?;
        let last = self.parsed.objects.last();
        if last.is_none_or(|last| last.outer != outer || last.group != self.group) {
            let name = self.parsed_name();
            self.budget.objects(1, name.len(), || format!("object {name:?}"))?;
            self.parsed.objects.push(Heading { outer, group: self.group.clone() });
        }
        let (object, material) = ((self.parsed.objects.len() as u32).saturating_sub(1), self.material);
        let last = self.parsed.runs.last();
        if last.is_none_or(|run| run.object != object || run.material != material || run.faces == u32::MAX) {
            self.parsed.runs.push(Run { object, material, faces: 0 });
        }
        Ok(())
    }

    fn outer_number(&mut self) -> Result<Option<u32>, OverBudget> {
        if self.outer.is_empty() {
            return Ok(None);
        }
        if self.parsed.outers.last() != Some(&self.outer) {
            // It becomes a group of its own.
            let groups = u64::from(!self.group.is_empty());
            self.budget.objects(groups, self.outer.len(), || format!("object {:?}", self.outer))?;
            self.parsed.outers.push(self.outer.clone());
        }
        Ok(Some((self.parsed.outers.len() as u32).saturating_sub(1)))
    }

    fn use_material(&mut self, name: &str) {
        let material = self.parsed.materials.wanted(name);
        self.is_new |= material != self.material;
        self.material = material;
    }
}

/// The vertex number of a corner, from 0 on, with `vertices` read so far. The vertex may come later, or
/// never.
fn corner(word: &str, vertices: usize) -> Result<u32, &'static str> {
    let number = word.split_once('/').map_or(word, |(number, _)| number);
    let from_one: i64 = number.parse().map_err(|_| "no number of a vertex")?;
    let from_zero = match from_one {
        0 => return Err("vertices count from 1"),
        1.. => from_one - 1,
        _ => (vertices as i64).checked_add(from_one).unwrap_or(-1),
    };
    if from_zero < 0 {
        return Err("so many vertices did not come before it");
    }
    u32::try_from(from_zero).map_err(|_| "there is no such vertex")
}
