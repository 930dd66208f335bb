//! The text form of STL: `solid NAME`, facets of `vertex` lines, `endsolid`.

use glam::DVec3;

use super::{Solid, Solids, StlError};
use crate::import::assemble::grey;
use crate::import::report::WarningKind;
use crate::import::text::{Lines, decode, excerpt, statement};

/// The facet that is being read.
#[derive(Default)]
struct Facet {
    is_open: bool,
    corners: Vec<DVec3>,
    /// The first error in it.
    wrong: Option<String>,
}

/// Reads the solids of a file.
pub(super) fn read(bytes: &[u8], solids: &mut Solids<'_>) -> Result<(), StlError> {
    let text = decode(bytes)?;
    let mut reader = Reader { solids, facet: Facet::default(), solid: Solid::default(), name: None };
    let mut last = 0;
    for (number, line) in Lines::of(&text).uncontinued() {
        last = number;
        reader.line(number, line)?;
    }
    if reader.facet.is_open {
        return Err(StlError::CutFacet { line: last });
    }
    reader.solids.part.report.warn(WarningKind::SolidLeftOpen, u64::from(reader.is_in_solid()));
    reader.end_solid()
}

struct Reader<'s, 'a> {
    solids: &'s mut Solids<'a>,
    facet: Facet,
    solid: Solid,
    /// The current solid's name; none between two solids.
    name: Option<String>,
}

impl Reader<'_, '_> {
    fn line(&mut self, number: u32, line: &str) -> Result<(), StlError> {
        let (first, rest) = statement(line);
        if first.eq_ignore_ascii_case("solid") {
            self.end_facet(number);
            self.end_solid()?;
            self.name = Some(rest.trim().to_owned());
            return Ok(());
        }
        if first.eq_ignore_ascii_case("endsolid") {
            self.end_facet(number);
            return self.end_solid();
        }
        let mut words = line.split_ascii_whitespace();
        while let Some(word) = words.next() {
            match word.to_ascii_lowercase().as_str() {
                "facet" => {
                    self.end_facet(number);
                    self.facet.is_open = true;
                }
                "vertex" => {
                    self.facet.is_open = true;
                    let mut corner = [f64::NAN; 3];
                    for value in &mut corner {
                        let word = words.next().unwrap_or_default();
                        match word.parse() {
                            Ok(read) => *value = read,
                            Err(_) => self.facet.wrong(|| format!("{} is no number", excerpt(word))),
                        }
                    }
                    self.facet.corners.push(DVec3::from_array(corner));
                }
                "endloop" | "endfacet" => self.end_facet(number),
                "outer" | "loop" => {}
                // Normals follow from the corners.
                "normal" => {
                    words.nth(2);
                }
                _ => {
                    let said = || format!("line {number}: {}", excerpt(line.trim_ascii()));
                    self.solids.statements.note(said);
                    break;
                }
            }
        }
        Ok(())
    }

    /// Ends the facet, if one is open.
    fn end_facet(&mut self, number: u32) {
        if !std::mem::take(&mut self.facet.is_open) {
            return;
        }
        let wrong = match self.facet.wrong.take() {
            Some(wrong) => Err(wrong),
            None => self.solids.facet(&mut self.solid, &self.facet.corners, grey()),
        };
        self.facet.corners.clear();
        if let Err(what) = wrong {
            self.solids.faces.note(|| format!("line {number}: {what}"));
        }
    }

    fn is_in_solid(&self) -> bool {
        self.name.is_some() || !self.solid.positions.is_empty()
    }

    /// Ends the solid, if one is open.
    fn end_solid(&mut self) -> Result<(), StlError> {
        if !self.is_in_solid() {
            return Ok(());
        }
        let solid = std::mem::take(&mut self.solid);
        let name = self.name.take().unwrap_or_default();
        self.solids.count(&name, solid.indices.len() / 3, solid.positions.len())?;
        Ok(self.solids.add(&name, solid)?)
    }
}

impl Facet {
    fn wrong(&mut self, what: impl FnOnce() -> String) {
        self.wrong.get_or_insert_with(what);
    }
}
