//! The result of a query as a table of comma-separated values (RFC 4180), for spreadsheets.

use std::borrow::Cow;

use trimaran_scene::{Attribute, Hierarchy};

use super::{index::Index, search::Found};

/// The most columns of attributes: those that most parts have.
const MOST_COLUMNS: usize = 200;
/// The most bytes of a cell. Longer ones are cut.
const LONGEST_CELL: usize = 1000;
/// How many bytes of rows an answer has before no more are added. Then it has less than a mebibyte.
const ENOUGH: usize = 256 << 10;
/// Marks the end of a cut text.
const CUT: char = '…';
/// Spreadsheets recognize UTF-8 by it.
const MARK: char = '\u{feff}';

/// A table of found parts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Table<'t> {
    pub(super) index: &'t Index,
    pub(super) hierarchy: &'t Hierarchy,
    pub(super) found: &'t Found,
}

/// The properties that all rows share.
#[derive(Debug)]
pub(super) struct Layout {
    /// The columns of attributes.
    columns: Vec<u32>,
    /// How many named groups are in each group one within the other, itself included.
    heights: Vec<u32>,
}

/// Some rows of a table.
#[derive(Debug, Default, PartialEq, Eq)]
pub(in crate::page) struct Rows {
    /// With the names of columns before the first row.
    pub(in crate::page) csv: String,
    /// The number of the next row, if there is one.
    pub(in crate::page) next: Option<usize>,
}

impl<'t> Table<'t> {
    /// The properties that its rows share.
    pub(super) fn layout(self) -> Layout {
        let mut counts = vec![0_u32; self.index.columns.len()];
        for part in &self.found.parts {
            for column in self.attributes(*part).iter().filter_map(|one| self.index.column_of(one)) {
                if let Some(count) = counts.get_mut(column as usize) {
                    *count += 1;
                }
            }
        }
        let mut columns: Vec<(u32, u32)> = (0..).zip(counts).filter(|(_, count)| *count > 0).collect();
        columns.sort_by_key(|(column, count)| (u32::MAX - count, *column));
        columns.truncate(MOST_COLUMNS);
        let mut columns: Vec<u32> = columns.into_iter().map(|(column, _)| column).collect();
        columns.sort_unstable();
        Layout { columns, heights: heights(self.hierarchy) }
    }

    /// The rows from number `from` on, as many as an answer takes. `name_of` names an object.
    pub(super) fn rows<'n>(self, layout: &Layout, from: usize, name_of: impl Fn(u32) -> &'n str) -> Rows {
        let mut csv = String::new();
        if from == 0 {
            csv.push(MARK);
            let names = layout.columns.iter().filter_map(|column| self.index.columns.get(*column as usize));
            let first = ["name", "path", "level"].into_iter();
            row(&mut csv, first.chain(names.map(|column| &*column.name)));
        }
        for (number, part) in self.found.parts.iter().enumerate().skip(from) {
            if csv.len() >= ENOUGH {
                return Rows { csv, next: Some(number) };
            }
            self.row(layout, &mut csv, *part, &name_of);
        }
        Rows { csv, next: None }
    }

    fn row<'n>(self, layout: &Layout, csv: &mut String, part: u32, name_of: &impl Fn(u32) -> &'n str) {
        let object = part.checked_sub(self.hierarchy.groups.len() as u32);
        let group = |group: u32| self.hierarchy.groups.get(group as usize).map_or("", |group| &*group.name);
        let name = match object {
            None => group(part),
            Some(object) => name_of(object),
        };
        let mut around: Vec<&str> = Vec::new();
        let mut bytes = 0;
        for name in self.index.around(part).map(group).filter(|name| !name.is_empty()) {
            around.push(name);
            bytes += name.len();
            if bytes > LONGEST_CELL {
                around.push("…");
                break;
            }
        }
        around.reverse();
        let path = around.join(" > ");
        let attributes = self.attributes(part);
        let cells = layout.columns.iter().map(|column| {
            let mut values = attributes.iter().filter(|one| self.index.column_of(one) == Some(*column));
            let first = values.next().map_or(Cow::Borrowed(""), |one| Cow::Borrowed(&*one.value));
            values.fold(first, |all, one| format!("{all}; {}", one.value).into())
        });
        let cells: Vec<Cow<'_, str>> = cells.collect();
        let first = [name, &path, self.level(layout, part)].into_iter();
        row(csv, first.chain(cells.iter().map(|cell| &**cell)));
    }

    fn attributes(self, part: u32) -> &'t [Attribute] {
        match part.checked_sub(self.hierarchy.groups.len() as u32) {
            None => self.hierarchy.groups.get(part as usize).map_or(&[], |group| &group.attributes),
            Some(object) => self.hierarchy.attributes_of(object),
        }
    }

    /// The level at which a click picks the part: see the page's `levels.ts`.
    fn level(self, layout: &Layout, part: u32) -> &'static str {
        let Some(group) = self.hierarchy.groups.get(part as usize) else { return "primitive" };
        match layout.heights.get(part as usize) {
            _ if group.parent.is_none() => "file",
            _ if group.name.is_empty() => "group",
            Some(0 | 1) | None => "part",
            Some(2) => "equipment",
            Some(_) => "system",
        }
    }
}

/// How many named groups are in each group one within the other, itself included.
fn heights(hierarchy: &Hierarchy) -> Vec<u32> {
    let mut heights = vec![0_u32; hierarchy.groups.len()];
    for (id, group) in hierarchy.groups.iter().enumerate().rev() {
        // Those in it stand behind it, and are done.
        let within = heights.get(id).copied().unwrap_or_default();
        let own = within + u32::from(!group.name.is_empty());
        if let Some(height) = heights.get_mut(id) {
            *height = own;
        }
        if let Some(around) = group.parent.and_then(|parent| heights.get_mut(parent as usize)) {
            *around = own.max(*around);
        }
    }
    heights
}

fn row<'c>(csv: &mut String, cells: impl Iterator<Item = &'c str>) {
    for (number, text) in cells.enumerate() {
        if number > 0 {
            csv.push(',');
        }
        cell(csv, text);
    }
    csv.push_str("\r\n");
}

fn cell(csv: &mut String, text: &str) {
    let start = text.get(..text.floor_char_boundary(LONGEST_CELL)).unwrap_or(text);
    // A spreadsheet would compute what begins like a formula.
    let is_formula = start.starts_with(['=', '+', '-', '@', '\t', '\r']) && start.parse::<f64>().is_err();
    let is_cut = start.len() < text.len();
    let is_quoted = start.contains(['"', ',', '\n', '\r']) || start.trim().len() < start.len();
    let mark = if is_quoted { "\"" } else { "" };
    csv.push_str(mark);
    if is_formula {
        csv.push('\'');
    }
    for (number, piece) in start.split('"').enumerate() {
        if number > 0 {
            csv.push_str("\"\"");
        }
        csv.push_str(piece);
    }
    if is_cut {
        csv.push(CUT);
    }
    csv.push_str(mark);
}

#[cfg(test)]
mod tests {
    use trimaran_scene::{Extent, Group, ObjectAttributes};

    use super::super::query::Query;
    use super::*;

    fn attributes(all: &[(&str, &str)]) -> Vec<Attribute> {
        all.iter().map(|(name, value)| Attribute { name: (*name).into(), value: (*value).into() }).collect()
    }

    fn hierarchy() -> Hierarchy {
        let group = |name: &str, parent, of: &[(&str, &str)]| Group {
            name: name.into(),
            parent,
            objects: 0..3,
            attributes: attributes(of),
            extent: Extent::default(),
        };
        let of = |object, of: &[(&str, &str)]| ObjectAttributes { object, attributes: attributes(of) };
        Hierarchy {
            groups: vec![
                group("a.rvm", None, &[]),
                group("ZONE", Some(0), &[("Area", "=1+1")]),
                group("", Some(1), &[]),
                group("EQUI", Some(2), &[("TAG", "20-CE50")]),
                group("SUBE", Some(3), &[]),
            ],
            attributes: vec![
                of(0, &[("tag", "a \"b\", c"), ("Note", "-5"), ("Tag", "d")]),
                of(2, &[("Note", "two\nlines")]),
            ],
        }
    }

    fn csv(hierarchy: &Hierarchy, query: &str) -> String {
        let index = Index::new(hierarchy, ["box", "pipe", "box ö"].iter()).unwrap();
        let found = index.find(&Query::parse(query).unwrap(), &|| false).unwrap().unwrap();
        let table = Table { index: &index, hierarchy, found: &found };
        let rows = table.rows(&table.layout(), 0, |object| ["box", "pipe", "box ö"][object as usize]);
        assert_eq!(rows.next, None);
        rows.csv
    }

    #[test]
    fn a_table_has_names_paths_levels_and_all_attributes() {
        let expected = "\u{feff}name,path,level,Note,TAG\r\n\
            SUBE,a.rvm > ZONE > EQUI,part,,\r\n\
            box,a.rvm > ZONE > EQUI > SUBE,primitive,-5,\"a \"\"b\"\", c; d\"\r\n\
            box ö,a.rvm > ZONE > EQUI > SUBE,primitive,\"two\nlines\",\r\n";
        assert_eq!(csv(&hierarchy(), "name=sube or name:box"), expected);
        let expected = "\u{feff}name,path,level,Area,TAG\r\n\
            a.rvm,,file,,\r\n\
            ZONE,a.rvm,system,'=1+1,\r\n\
            EQUI,a.rvm > ZONE,equipment,,20-CE50\r\n";
        assert_eq!(csv(&hierarchy(), "name:rvm or zone or name:equi"), expected);
        assert_eq!(csv(&hierarchy(), "nowhere"), "\u{feff}name,path,level\r\n");
    }

    /// Each row once, in answers of less than a mebibyte, and no cell is computed or breaks a row.
    #[test]
    fn a_long_table_comes_answer_by_answer() {
        let long = format!("@{}", "\"".repeat(5000));
        let of = |object| ObjectAttributes { object, attributes: attributes(&[("Long", &long)]) };
        let hierarchy = Hierarchy { groups: Vec::new(), attributes: (0..700).map(of).collect() };
        let names: Vec<String> = (0..700).map(|object| format!("O{object}")).collect();
        let index = Index::new(&hierarchy, names.iter()).unwrap();
        let found = index.find(&Query::parse("O").unwrap(), &|| false).unwrap().unwrap();
        let table = Table { index: &index, hierarchy: &hierarchy, found: &found };
        let layout = table.layout();
        let (mut from, mut answers, mut told) = (Some(0), 0, Vec::new());
        while let Some(first) = from {
            let rows = table.rows(&layout, first, |object| &names[object as usize]);
            assert!(rows.csv.len() < 1 << 20);
            told.extend(rows.csv.lines().map(|line| line.split(',').next().unwrap().to_owned()));
            assert!(rows.csv.lines().skip(1).all(|line| line.contains(",\"'@\"\"") && line.ends_with("…\"")));
            (from, answers) = (rows.next, answers + 1);
        }
        assert!(answers > 2, "{answers}");
        assert!(told.iter().skip(1).eq(&names) && told[0] == "\u{feff}name");
        assert_eq!(table.rows(&layout, 700, |_| "").csv, "");
    }
}
