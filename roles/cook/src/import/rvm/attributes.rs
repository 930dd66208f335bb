//! The attribute file that AVEVA's programs write beside a review file: what is said of its groups, by name.
//!
//! A text: the first line says by which words it is divided, and then `NEW name` opens a group, `END` closes
//! it, and between them stand attributes, `name := value`, each on a line or several divided by `&end&`. There
//! is no public specification; the facts here are those that readers of the format agree on.

use std::collections::{HashMap, hash_map::Entry};

use trimaran_scene::Attribute;

/// What the first line begins with.
const MAGIC: &str = "CADC_Attributes_File";

/// What is said of groups, by their names.
#[derive(Debug, Default)]
pub(super) struct Attributes(HashMap<String, Vec<Attribute>>);

/// The words that divide a file.
struct Words<'t> {
    start: &'t str,
    end: &'t str,
    name_end: &'t str,
    separator: &'t str,
}

impl Attributes {
    /// Reads a file; `None` if it is none. Bytes that are not UTF-8 are read as they can be. Of groups of one
    /// name the first one counts.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_start_matches('\u{feff}');
        let (first, rest) = text.split_once('\n')?;
        let words = Words::parse(first.trim().strip_prefix(MAGIC)?);
        let mut found: HashMap<String, Vec<Attribute>> = HashMap::new();
        // Names of the groups that are open. Nothing is kept for one whose name was met before.
        let mut open: Vec<Option<&str>> = Vec::new();
        for line in rest.lines().map(str::trim) {
            if let Some(name) = words.opens(line) {
                open.push(match found.entry(name.to_owned()) {
                    Entry::Vacant(free) => {
                        free.insert(Vec::new());
                        Some(name)
                    }
                    Entry::Occupied(_) => None,
                });
            } else if line == words.end {
                open.pop();
            } else if let Some(Some(name)) = open.last()
                && let Some(attributes) = found.get_mut(*name)
            {
                attributes.extend(line.split(words.separator).filter_map(|part| words.attribute(part)));
            }
        }
        Some(Self(found))
    }

    /// What is said of a group.
    pub(super) fn of(&self, name: &str) -> Vec<Attribute> {
        self.0.get(name).cloned().unwrap_or_default()
    }
}

impl<'t> Words<'t> {
    /// Those of a first line, such as `v1.0 , start: NEW , end: END , name_end: := , sep: &end&`.
    fn parse(line: &'t str) -> Self {
        let mut words = Self { start: "NEW", end: "END", name_end: ":=", separator: "&end&" };
        for part in line.split(" , ").map(str::trim) {
            match part.split_once(": ").map(|(key, word)| (key, word.trim())) {
                Some((_, "")) | None => {}
                Some(("start", word)) => words.start = word,
                Some(("end", word)) => words.end = word,
                Some(("name_end", word)) => words.name_end = word,
                Some(("sep", word)) => words.separator = word,
                Some(_) => {}
            }
        }
        words
    }

    /// The name of the group that a line opens.
    fn opens(&self, line: &'t str) -> Option<&'t str> {
        let name = line.strip_prefix(self.start)?;
        name.starts_with(char::is_whitespace).then_some(name.trim())
    }

    fn attribute(&self, part: &str) -> Option<Attribute> {
        let (name, value) = part.split_once(self.name_end)?;
        let (name, value) = (name.trim(), value.trim());
        (!name.is_empty()).then(|| Attribute { name: name.into(), value: value.into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "CADC_Attributes_File v1.0 , start: NEW , end: END , name_end: := , sep: &end&\r\n\
        NEW Header Information\r\n Source := PDMS Data &end& User := me\r\nEND\r\n\
        NEW /ZONE-1\r\n TYPE := ZONE &end&\r\n NEW /PIPE-7\r\n  TYPE:=PIPE\r\n  SPEC := A3B := x\r\n END\r\n\
         OWNER := /SITE &end& \r\nEND\r\nNEW /PIPE-7\r\n TYPE := OTHER\r\nEND\r\n";

    fn pairs(attributes: &Attributes, name: &str) -> Vec<(String, String)> {
        attributes.of(name).into_iter().map(|of| (of.name.to_string(), of.value.to_string())).collect()
    }

    fn owned(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
        pairs.iter().map(|(name, value)| ((*name).into(), (*value).into())).collect()
    }

    #[test]
    fn attributes_belong_to_the_innermost_open_group() {
        let read = Attributes::parse(FILE.as_bytes()).unwrap();
        assert_eq!(pairs(&read, "/ZONE-1"), owned(&[("TYPE", "ZONE"), ("OWNER", "/SITE")]));
        assert_eq!(pairs(&read, "/PIPE-7"), owned(&[("TYPE", "PIPE"), ("SPEC", "A3B := x")]));
        assert_eq!(pairs(&read, "Header Information"), owned(&[("Source", "PDMS Data"), ("User", "me")]));
        assert_eq!(pairs(&read, "/ELSE"), []);
    }

    #[test]
    fn a_file_says_its_own_words() {
        let text = "CADC_Attributes_File v1.0 , start: BEGIN , end: DONE , name_end: = , sep: ;\n\
                    BEGIN A\nx = 1; y = 2\nDONE\nz = 3\n";
        assert_eq!(
            pairs(&Attributes::parse(text.as_bytes()).unwrap(), "A"),
            owned(&[("x", "1"), ("y", "2")])
        );
    }

    #[test]
    fn what_is_no_attribute_file_is_not_read() {
        for other in ["", "CADC_Attributes_File", "HEAD\nNEW A\nEND\n", "read me\n"] {
            assert!(Attributes::parse(other.as_bytes()).is_none(), "{other:?}");
        }
        // A file that ends early, and one that closes too much.
        for odd in
            ["CADC_Attributes_File v1.0\nNEW A\n x := 1", "CADC_Attributes_File\nEND\nNEW A\n x := 1\nEND"]
        {
            assert_eq!(
                pairs(&Attributes::parse(odd.as_bytes()).unwrap(), "A"),
                owned(&[("x", "1")]),
                "{odd:?}"
            );
        }
    }
}
