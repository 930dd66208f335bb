//! Finds the material libraries that an OBJ file names.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use super::faults::Faults;
use super::materials::Materials;
use crate::import::neighbours::Neighbours;
use crate::import::report::{ImportReport, WarningKind};
use crate::import::text::decode;

/// How many missing libraries are named.
const MOST_NAMED: usize = 100;

/// The files beside an OBJ file.
pub(super) struct Libraries<'b> {
    neighbours: Neighbours<'b>,
    /// Missing or unreadable ones, with the error if they exist; and how often each was requested.
    missing: HashMap<String, u64>,
    further: u64,
}

impl<'b> Libraries<'b> {
    pub(super) fn of(neighbours: Neighbours<'b>) -> Self {
        Self { neighbours, missing: HashMap::new(), further: 0 }
    }

    /// Reads the libraries of a line: one, whose name may have spaces, or several. Each is read once.
    pub(super) fn read(&mut self, names: &str, materials: &mut Materials, faults: &mut Faults) {
        let names = names.trim_matches('"');
        if self.library(names, materials, faults) {
            return;
        }
        for name in split(names) {
            if self.library(name, materials, faults) {
                continue;
            }
            let words: Vec<&str> = name.split_whitespace().collect();
            let found: Vec<bool> = words.iter().map(|word| self.library(word, materials, faults)).collect();
            if !found.contains(&true) {
                self.miss(name);
                continue;
            }
            for (word, _) in words.into_iter().zip(found).filter(|(_, found)| !found) {
                self.miss(word);
            }
        }
    }

    /// Adds missing ones to the report.
    pub(super) fn report(self, report: &mut ImportReport) {
        let mut missing: Vec<(String, u64)> = self.missing.into_iter().collect();
        missing.sort_unstable();
        for (name, count) in missing {
            report.warn_about(WarningKind::MaterialsMissing, &name, count);
        }
        report.warn_about(WarningKind::MaterialsMissing, "further ones", self.further);
    }

    /// Whether the library of this name exists, or of its last part: programs write whole paths of their
    /// machine.
    fn library(&mut self, name: &str, materials: &mut Materials, faults: &mut Faults) -> bool {
        let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
        let found = match self.neighbours.read(Path::new(name)) {
            Err(_) if last != name && !last.is_empty() => self.neighbours.read(Path::new(last)),
            found => found,
        };
        let Ok((bytes, known)) = found else { return false };
        if !known {
            self.parse(name, &bytes, materials, faults);
        }
        true
    }

    fn parse(&mut self, name: &str, bytes: &Arc<Vec<u8>>, materials: &mut Materials, faults: &mut Faults) {
        match decode(bytes) {
            Ok(text) => materials.read(&text, name, faults),
            Err(why) => self.miss(&format!("{name}: {why}")),
        }
    }

    fn miss(&mut self, name: &str) {
        if let Some(count) = self.missing.get_mut(name) {
            *count += 1;
        } else if self.missing.len() < MOST_NAMED {
            self.missing.insert(name.to_owned(), 1);
        } else {
            self.further += 1;
        }
    }
}

/// Consecutive names that end in `.mtl`, and the rest.
fn split(names: &str) -> Vec<&str> {
    let lower = names.to_ascii_lowercase();
    let ends = lower.match_indices(".mtl").map(|(at, ending)| at + ending.len());
    let is_end = |end: &usize| {
        names.as_bytes().get(*end).is_none_or(|byte| byte.is_ascii_whitespace() || *byte == b'"')
    };
    let is_around = |letter: char| letter == '"' || letter.is_whitespace();
    let mut start = 0;
    let mut found = Vec::new();
    for end in ends.filter(is_end).chain([names.len()]) {
        found.extend(names.get(start..end).map(|name| name.trim_matches(is_around)));
        start = end;
    }
    found.retain(|name| !name.is_empty());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_divided_behind_their_ending() {
        let found = split("my steel.mtl  b.MTL \"c d.mtl\" e f");
        assert_eq!(found, ["my steel.mtl", "b.MTL", "c d.mtl", "e f"]);
        assert_eq!(split("a.mtlx b"), ["a.mtlx b"]);
    }
}
