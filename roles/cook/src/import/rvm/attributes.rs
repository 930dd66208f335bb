//! The attribute file that AVEVA's programs write beside a review file, for its groups.
//!
//! A text: the first line defines the delimiting words. Then `NEW name` opens a group and `END` closes it.
//! Between them are groups and attributes, `name := value`, each on a line or several divided by `&end&`.
//! There is no public specification; these facts are common to readers of the format.

use std::collections::HashMap;

use trimaran_scene::Attribute;

use super::encoding::lines;

/// The beginning of the first line.
const MAGIC: &str = "CADC_Attributes_File";

/// The content of attribute files: a tree of groups.
#[derive(Debug, Default)]
pub(super) struct Attributes {
    /// In depth-first order, by opening.
    nodes: Vec<Node>,
    /// Numbers of names.
    names: HashMap<String, usize>,
    /// The nodes of each name, ascending.
    of_name: Vec<Vec<u32>>,
    /// The nodes of each name by their parent, or without one.
    within: HashMap<(Option<u32>, usize), Vec<u32>>,
    /// Whether any group is nested.
    nested: bool,
}

/// A group of an attribute file.
#[derive(Debug)]
struct Node {
    parent: Option<u32>,
    /// The end of its descendants' numbers.
    end: u32,
    attributes: Vec<Attribute>,
}

/// Lines of an attribute file without kept content.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct OddLines {
    pub count: u64,
    /// Number of the first one, from 1 on.
    pub first: usize,
    /// The beginning of that line.
    pub text: String,
}

/// The delimiting words of a file.
struct Words<'t> {
    start: &'t str,
    end: &'t str,
    name_end: &'t str,
    separator: &'t str,
}

/// Whether a text is an attribute file.
pub(super) fn is_attributes(text: &str) -> bool {
    text.trim_start_matches(is_blank).starts_with(MAGIC)
}

impl Attributes {
    /// Adds the content of an attribute file. Returns the lines that are not attributes, if there are any.
    pub(super) fn add(&mut self, text: &str) -> Option<OddLines> {
        let start = text.trim_start_matches(is_blank);
        let before = text.len() - start.len();
        let first = text.get(..before).map_or(1, |blank| 1 + lines(blank).skip(1).count());
        let lines = (first..).zip(lines(start).map(str::trim));
        let mut lines = lines.filter(|(_, line)| !line.is_empty());
        let words =
            Words::parse(lines.next().and_then(|(_, first)| first.strip_prefix(MAGIC)).unwrap_or_default());
        let mut open: Vec<u32> = Vec::new();
        let mut odd: Option<OddLines> = None;
        for (number, line) in lines {
            if let Some(name) = words.opens(line) {
                open.push(self.open(name, open.last().copied()));
                continue;
            }
            let mut is_odd = false;
            if line == words.end {
                match open.pop() {
                    Some(node) => self.close(node),
                    None => is_odd = true,
                }
            } else if let Some(node) = open.last().and_then(|&node| self.nodes.get_mut(node as usize)) {
                for part in line.split(words.separator).filter(|part| !part.trim().is_empty()) {
                    match words.attribute(part) {
                        Some(attribute) => node.attributes.push(attribute),
                        None => is_odd = true,
                    }
                }
            } else {
                is_odd = true;
            }
            if is_odd {
                let first = || OddLines { count: 0, first: number, text: line.chars().take(60).collect() };
                odd.get_or_insert_with(first).count += 1;
            }
        }
        open.into_iter().for_each(|node| self.close(node));
        odd
    }

    fn open(&mut self, name: &str, parent: Option<u32>) -> u32 {
        let node = self.nodes.len() as u32;
        self.nested |= parent.is_some();
        let next_name = self.names.len();
        let name = match self.names.get(name) {
            Some(&known) => known,
            None => {
                self.names.insert(name.to_owned(), next_name);
                self.of_name.push(Vec::new());
                next_name
            }
        };
        if let Some(nodes) = self.of_name.get_mut(name) {
            nodes.push(node);
        }
        self.within.entry((parent, name)).or_default().push(node);
        self.nodes.push(Node { parent, end: node + 1, attributes: Vec::new() });
        node
    }

    fn close(&mut self, node: u32) {
        let end = self.nodes.len() as u32;
        if let Some(node) = self.nodes.get_mut(node as usize) {
            node.end = end;
        }
    }

    /// How many groups there are.
    pub(super) const fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether no group is nested.
    pub(super) const fn is_flat(&self) -> bool {
        !self.nested
    }

    /// The parent of a group.
    pub(super) fn parent(&self, node: u32) -> Option<u32> {
        self.nodes.get(node as usize).and_then(|node| node.parent)
    }

    /// The groups of a name directly within one, or at the top.
    pub(super) fn children(&self, within: Option<u32>, name: &str) -> &[u32] {
        let name = self.names.get(name);
        name.and_then(|&name| self.within.get(&(within, name))).map_or(&[], Vec::as_slice)
    }

    /// The only group of a name anywhere within one, or in the file.
    pub(super) fn only(&self, within: Option<u32>, name: &str) -> Option<u32> {
        let nodes = self.names.get(name).and_then(|&name| self.of_name.get(name))?;
        let inside = within.map_or(0..u32::MAX, |around| {
            around + 1..self.nodes.get(around as usize).map_or(0, |node| node.end)
        });
        let first = nodes.partition_point(|&node| node < inside.start);
        let mut found = nodes.iter().skip(first).copied().take_while(|&node| node < inside.end);
        let only = found.next()?;
        found.next().is_none().then_some(only)
    }

    /// The attributes of a group.
    pub(super) fn of(&mut self, node: u32) -> Option<&mut Vec<Attribute>> {
        self.nodes.get_mut(node as usize).map(|node| &mut node.attributes)
    }
}

fn is_blank(letter: char) -> bool {
    letter.is_whitespace() || letter == '\u{feff}'
}

impl<'t> Words<'t> {
    /// Parses a first line, such as `v1.0 , start: NEW , end: END , name_end: := , sep: &end&`.
    fn parse(line: &'t str) -> Self {
        let mut words = Self { start: "NEW", end: "END", name_end: ":=", separator: "&end&" };
        for part in line.split(',').map(str::trim) {
            match part.split_once(':').map(|(key, word)| (key.trim(), word.trim())) {
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
        (name.is_empty() || name.starts_with(char::is_whitespace)).then_some(name.trim())
    }

    fn attribute(&self, part: &str) -> Option<Attribute> {
        let (name, value) = part.split_once(self.name_end)?;
        let (name, value) = (name.trim(), unquoted(value.trim()));
        (!name.is_empty()).then(|| Attribute { name: name.into(), value: value.into() })
    }
}

/// A value without the quotes around it.
fn unquoted(value: &str) -> &str {
    let within = |quote| value.strip_prefix(quote).and_then(|rest| rest.strip_suffix(quote));
    within('\'').or_else(|| within('"')).unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "CADC_Attributes_File v1.0 , start: NEW , end: END , name_end: := , sep: &end&\r\n\
        NEW Header Information\r\n Source := PDMS Data &end& User := me\r\nEND\r\n\
        NEW /ZONE-1\r\n TYPE := ZONE &end&\r\n NEW /PIPE-7\r\n  TYPE:=PIPE\r\n  SPEC := A3B := x\r\n END\r\n\
         OWNER := /SITE &end& \r\nEND  \r\nNEW /PIPE-7\r\n TYPE := OTHER\r\nEND\r\n";

    fn read(text: &str) -> Attributes {
        let mut all = Attributes::default();
        assert!(is_attributes(text), "{text:?}");
        let _odd = all.add(text);
        all
    }

    /// The attributes of the group at a path.
    fn at(all: &mut Attributes, path: &[&str]) -> Vec<(String, String)> {
        let node = path.iter().fold(None, |around, name| Some(all.children(around, name)[0])).unwrap();
        all.of(node).unwrap().iter().map(|of| (of.name.to_string(), of.value.to_string())).collect()
    }

    fn owned(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
        pairs.iter().map(|(name, value)| ((*name).into(), (*value).into())).collect()
    }

    #[test]
    fn attributes_belong_to_the_innermost_open_group() {
        let mut all = read(FILE);
        assert_eq!(at(&mut all, &["/ZONE-1"]), owned(&[("TYPE", "ZONE"), ("OWNER", "/SITE")]));
        assert_eq!(at(&mut all, &["/ZONE-1", "/PIPE-7"]), owned(&[("TYPE", "PIPE"), ("SPEC", "A3B := x")]));
        assert_eq!(at(&mut all, &["/PIPE-7"]), owned(&[("TYPE", "OTHER")]));
        assert_eq!(at(&mut all, &["Header Information"]), owned(&[("Source", "PDMS Data"), ("User", "me")]));
        assert!(all.children(None, "/ELSE").is_empty() && all.children(Some(0), "/PIPE-7").is_empty());
    }

    #[test]
    fn a_group_is_found_within_another_where_it_is_the_only_one_of_its_name() {
        let all = read(FILE);
        let zone = all.children(None, "/ZONE-1")[0];
        assert_eq!(all.only(None, "/PIPE-7"), None);
        assert_eq!(all.only(Some(zone), "/PIPE-7"), Some(zone + 1));
        assert_eq!(all.parent(zone + 1), Some(zone));
        assert_eq!(all.only(Some(zone + 1), "/PIPE-7"), None);
    }

    #[test]
    fn lines_that_are_no_attribute_are_counted() {
        let odd = |text: &str| Attributes::default().add(text).map(|odd| (odd.count, odd.first, odd.text));
        assert_eq!(odd(FILE), None);
        let text = "\n\nCADC_Attributes_File\nNEW A\nx := 1 &end& &end&\n\ny = 2\nz := 3 &end& more\nEND\n\
                    END\nw := 4\n";
        assert_eq!(odd(text), Some((4, 7, "y = 2".into())));
    }

    #[test]
    fn quotes_around_a_value_are_no_part_of_it() {
        let text =
            "CADC_Attributes_File\nNEW A\nA:='Pump (duty)' &end& B:= \"x\"\nC:=''\nD:='\nE:= it's\nEND";
        let expected = owned(&[("A", "Pump (duty)"), ("B", "x"), ("C", ""), ("D", "'"), ("E", "it's")]);
        assert_eq!(at(&mut read(text), &["A"]), expected);
    }

    #[test]
    fn a_file_says_its_own_words() {
        for first in [
            "CADC_Attributes_File v1.0 , start: BEGIN , end: DONE , name_end: = , sep: ;",
            "\u{feff}\nCADC_Attributes_File v1.0, start:BEGIN, end:DONE, name_end:=, sep:;",
        ] {
            let text = format!("{first}\rBEGIN A\rx = 1; y = 2\rDONE\rz = 3\r");
            assert_eq!(at(&mut read(&text), &["A"]), owned(&[("x", "1"), ("y", "2")]), "{first:?}");
        }
    }

    #[test]
    fn what_is_no_attribute_file_is_told() {
        for other in ["", "CADC", "HEAD\nNEW A\nEND\n", "read me\n"] {
            assert!(!is_attributes(other), "{other:?}");
        }
        // A file that ends early, and one with too many ends.
        for odd in ["NEW A\n x := 1", "END\nNEW A\n x := 1\nEND", "NEW\nEND\nNEW A\nx := 1"] {
            let mut all = read(&format!("CADC_Attributes_File v1.0\n{odd}"));
            assert_eq!(at(&mut all, &["A"]), owned(&[("x", "1")]), "{odd:?}");
        }
    }
}
