//! Materials by name, and the reader of material libraries (.mtl).

use std::collections::HashMap;

use super::faults::Faults;
use crate::import::report::WarningKind;
use crate::import::text::{Lines, excerpt, name, numbers, statement};

/// The number for no material.
pub(super) const NO_MATERIAL: u32 = u32::MAX;

/// The kept properties of a material.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Material {
    /// `Kd`, the base colour, each component from 0 to 1.
    pub(super) diffuse: Option<[f64; 3]>,
    /// `d`: its opacity.
    dissolve: Option<f64>,
    /// `Tr`: its transparency.
    transparency: Option<f64>,
}

impl Material {
    /// Its opacity, from 0 to 1. Programs that write both `d` and `Tr` disagree about the second.
    pub(super) fn opacity(&self) -> f64 {
        self.dissolve.or(self.transparency.map(|transparency| 1.0 - transparency)).unwrap_or(1.0)
    }
}

/// All materials that were defined or used.
#[derive(Default)]
pub(super) struct Materials {
    list: Vec<Material>,
    defined: HashMap<String, u32>,
    /// Those used before anything defined them.
    wanted: HashMap<String, u32>,
}

impl Materials {
    /// The number of the material of this name: the last defined one. It may be defined later.
    pub(super) fn wanted(&mut self, name: &str) -> u32 {
        // In `steel #2`, the second part may be a comment.
        let short = name.split_once(" #").map(|(short, _)| short.trim_end());
        let known = |name: &str| self.defined.get(name).copied();
        if let Some(known) = known(name).or_else(|| short.and_then(known)) {
            return known;
        }
        if name.is_empty() || name.eq_ignore_ascii_case("(null)") || name.eq_ignore_ascii_case("none") {
            return NO_MATERIAL;
        }
        if let Some(&number) = self.wanted.get(name) {
            return number;
        }
        let number = self.add();
        self.wanted.insert(name.to_owned(), number);
        number
    }

    /// A material by its number; none if undefined.
    pub(super) fn get(&self, number: u32) -> Option<&Material> {
        self.list.get(number as usize)
    }

    /// Gives materials that were used before their definition the later one. Returns the others: number and
    /// name.
    pub(super) fn settle(&mut self) -> HashMap<u32, String> {
        let mut undefined = HashMap::new();
        for (name, number) in std::mem::take(&mut self.wanted) {
            let found = self.defined.get(&name).and_then(|&number| self.get(number)).cloned();
            match (found, self.list.get_mut(number as usize)) {
                (Some(found), Some(material)) => *material = found,
                _ => _ = undefined.insert(number, name),
            }
        }
        undefined
    }

    fn add(&mut self) -> u32 {
        self.list.push(Material::default());
        (self.list.len() as u32).saturating_sub(1)
    }

    /// Reads a library's text. A faulty line is skipped and noted.
    pub(super) fn read(&mut self, text: &str, library: &str, faults: &mut Faults) {
        let mut current = None;
        let mut current_name = String::new();
        for (number, mut line) in Lines::of(text) {
            if line.contains('\0') {
                let said = || "it has bytes of zero, read as white space".to_owned();
                faults.note(WarningKind::MalformedLine, library, number, "", said);
                line = line.replace('\0', " ").into();
            }
            let (word, rest) = statement(&line);
            if word.eq_ignore_ascii_case("newmtl") {
                current = Some(self.add());
                name(rest).clone_into(&mut current_name);
                self.defined.insert(current_name.clone(), current.unwrap_or(NO_MATERIAL));
                continue;
            }
            let material = current.and_then(|number| self.list.get_mut(number as usize));
            let done = match word.to_ascii_lowercase().as_str() {
                "kd" => colour(numbers(rest)).map(|colour| material.map(|of| of.diffuse = Some(colour))),
                "d" => part(numbers(rest)).map(|part| material.map(|of| of.dissolve = Some(part))),
                "tr" => part(numbers(rest)).map(|part| material.map(|of| of.transparency = Some(part))),
                "map_kd" if name(rest).is_empty() => None,
                "map_kd" => {
                    if current.is_some() {
                        let said = || format!("material {}", excerpt(&current_name));
                        faults.note(WarningKind::TexturedMaterial, library, number, "", said);
                    }
                    Some(current.map(|_| ()))
                }
                _ => continue,
            };
            if done.flatten().is_none() {
                faults.note(WarningKind::MalformedLine, library, number, "", || {
                    excerpt(line.trim_ascii_start())
                });
            }
        }
    }
}

/// A colour of one to three values: missing ones equal the first. Full is 1, or 255 if one is above 2: some
/// programs write a little more than 1.
fn colour(rest: &str) -> Option<[f64; 3]> {
    let mut words = rest.split_ascii_whitespace();
    let first = value(words.next()?)?;
    let mut next = || words.next().map_or(Some(first), value);
    let colour = [first, next()?, next()?];
    let full = if colour.iter().any(|&value| value > 2.0) { 255.0 } else { 1.0 };
    Some(colour.map(|value| (value / full).clamp(0.0, 1.0)))
}

/// A number from 0 to 1. `d -halo 0.3` is only see-through at its edges in ray tracers.
fn part(rest: &str) -> Option<f64> {
    let mut words = rest.split_ascii_whitespace().skip_while(|word| word.eq_ignore_ascii_case("-halo"));
    value(words.next()?).map(|value| value.clamp(0.0, 1.0))
}

fn value(word: &str) -> Option<f64> {
    word.parse().ok().filter(|value: &f64| value.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::report::ImportReport;

    fn read(text: &str) -> (Materials, Vec<String>) {
        let (mut materials, mut faults, mut report) =
            (Materials::default(), Faults::default(), ImportReport::default());
        materials.read(text, "a.mtl", &mut faults);
        faults.report(&mut report);
        (materials, report.warnings.iter().map(ToString::to_string).collect())
    }

    fn of(text: &str) -> (Option<[f64; 3]>, f64) {
        let (mut materials, warnings) = read(&format!("newmtl a\n{text}"));
        assert_eq!(warnings, [""; 0]);
        let number = materials.wanted("a");
        let material = materials.get(number).unwrap();
        (material.diffuse, material.opacity())
    }

    #[test]
    fn colours_have_one_to_three_values() {
        assert_eq!(of("Kd 0.7 # grey\nKa x\n"), (Some([0.7; 3]), 1.0));
        assert_eq!(of("  Kd\t0.7 0.2"), (Some([0.7, 0.2, 0.7]), 1.0));
        assert_eq!(of("KD 1 0 2\nKs\nmap_Bump\n"), (Some([1.0, 0.0, 1.0]), 1.0));
        assert_eq!(of("Kd 255 51 0"), (Some([1.0, 0.2, 0.0]), 1.0));
        assert_eq!(of(""), (None, 1.0));
    }

    #[test]
    fn opacity_has_two_words_of_which_d_counts() {
        assert_eq!(of("d 0.25").1, 0.25);
        assert_eq!(of("Tr 0.25").1, 0.75);
        assert_eq!(of("d 0.25\nTr 0.25").1, 0.25);
        assert_eq!(of("Tr 1\nd 1").1, 1.0);
        assert_eq!(of("d -halo 0.5").1, 0.5);
    }

    #[test]
    fn a_line_that_is_wrong_costs_that_line() {
        let text = "Kd 1 1 1\nnewmtl a\nKd 1 0 0\nKd 0 x 0\nKd 0,5 0 0\nKd spectral a.rfl\nKd xyz 1 1 1\n\
                    d nan\nd\nmap_Kd \nnewmtl b\nmap_Kd -s 1 1 1 b.png\n";
        let (mut materials, warnings) = read(text);
        let number = materials.wanted("a");
        assert_eq!(materials.get(number).unwrap().diffuse, Some([1.0, 0.0, 0.0]));
        let said = warnings.join("\n");
        let parts = [
            "1 textured",
            "a.mtl, first at line 12: material \"b\"",
            "8 malformed",
            "a.mtl, first at line 1:",
        ];
        assert!(parts.iter().all(|part| said.contains(part)) && warnings.len() == 2, "{said}");
    }

    #[test]
    fn the_last_definition_counts_and_one_that_comes_late_counts_too() {
        let mut materials = Materials::default();
        let early = materials.wanted("a");
        let never = materials.wanted("b");
        let mut faults = Faults::default();
        materials.read("newmtl a\nKd 1\n", "1", &mut faults);
        let first = materials.wanted("a");
        materials.read("newmtl a\nKd 0\n", "2", &mut faults);
        let second = materials.wanted("a # comment");
        assert_eq!(materials.settle(), HashMap::from([(never, "b".to_owned())]));
        let grey = |number| materials.get(number).unwrap().diffuse.unwrap()[0];
        assert_eq!([early, first, second].map(grey), [0.0, 1.0, 0.0]);
        assert_eq!(["", "(null)", "None"].map(|name| materials.wanted(name)), [NO_MATERIAL; 3]);
    }
}
