//! An index of all names and attributes of a scene.
//!
//! Its memory is bounded by the model. It has the bytes of all names and of the different values. To these
//! come 5 bytes for each object, 45 for each group and 32 for each different value. Each value of each
//! attribute takes 8 more, and each attribute of a part takes 4.

use std::{collections::HashMap, iter, ops::Range, sync::Arc};

use thiserror::Error;
use trimaran_scene::{Attribute, Group, Hierarchy};

use super::{
    quantity::Quantity,
    texts::{Texts, bare},
};

/// The most bytes of a text that are searched: no more of it is shown.
const LONGEST_TEXT: usize = 4096;
/// The most bytes of all names, and of all different values.
const MOST_BYTES: usize = 1 << 30;

/// An index of the names and attributes of groups and objects.
///
/// A part's number is that of its group, or that of its object behind all groups.
#[derive(Debug)]
pub struct Index {
    pub(super) groups: Vec<GroupSpan>,
    pub(super) objects: u32,
    /// The innermost group of objects from each of these on, until the next one.
    innermost: Vec<(u32, Option<u32>)>,
    /// By the numbers of parts.
    pub(super) names: Texts,
    /// Different values.
    pub(super) values: Texts,
    /// The values as they are spelled.
    pub(super) spelled: Vec<Arc<str>>,
    pub(super) numbers: Numbers,
    /// By their bare names.
    pub(super) columns: Vec<Column>,
    /// The column of each name of an attribute, as it is spelled.
    by_name: HashMap<Arc<str>, u32>,
    /// Each value of each column, column by column.
    pub(super) pairs: Vec<Pair>,
    /// The parts of each pair, pair by pair.
    parts: Vec<u32>,
}

/// A group's objects, and the group around it.
#[derive(Debug, Clone)]
pub(super) struct GroupSpan {
    pub(super) parent: Option<u32>,
    pub(super) objects: Range<u32>,
}

/// Attributes whose names differ only by case and separators.
#[derive(Debug)]
pub(super) struct Column {
    /// As spelled first.
    pub(super) name: Arc<str>,
    pub(super) bare: String,
    pub(super) pairs: Range<usize>,
    /// How many attributes of parts it has.
    pub(super) count: usize,
}

/// An attribute with a value.
#[derive(Debug)]
pub(super) struct Pair {
    /// The number of the value.
    pub(super) value: u32,
    /// The first of its parts in the list of all pairs.
    first: u32,
}

/// The values that are numbers, by their own numbers.
#[derive(Debug, Default)]
pub(super) struct Numbers {
    /// NaN where the value is no number.
    pub(super) values: Vec<f64>,
    /// Indices of `names`.
    pub(super) units: Vec<u8>,
    /// The different units, at most 256.
    pub(super) names: Vec<String>,
}

/// A scene cannot be indexed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum IndexError {
    /// Its texts are too large.
    #[error("the model has more than {MOST_BYTES} bytes of names or of attributes: it cannot be searched")]
    TooLarge,
}

impl GroupSpan {
    /// That of a group in a scene of so many objects.
    fn of(group: &Group, count: u32) -> Self {
        let Range { start, end } = group.objects;
        Self { parent: group.parent, objects: start.min(count)..end.min(count) }
    }
}

impl Index {
    /// An index of a hierarchy, and of the names of all objects in their order.
    ///
    /// # Errors
    /// If the texts are too large.
    pub fn new<N: AsRef<str>>(
        hierarchy: &Hierarchy,
        objects: impl Iterator<Item = N>,
    ) -> Result<Self, IndexError> {
        let mut names = Texts::default();
        for group in &hierarchy.groups {
            add(&mut names, &group.name)?;
        }
        let mut count = 0;
        for name in objects {
            add(&mut names, name.as_ref())?;
            count += 1;
        }
        let mut index = Self {
            groups: hierarchy.groups.iter().map(|group| GroupSpan::of(group, count)).collect(),
            objects: count,
            innermost: Vec::new(),
            names,
            values: Texts::default(),
            spelled: Vec::new(),
            numbers: Numbers::default(),
            columns: Vec::new(),
            by_name: HashMap::new(),
            pairs: Vec::new(),
            parts: Vec::new(),
        };
        index.innermost = index.runs();
        index.add_attributes(hierarchy)?;
        Ok(index)
    }

    /// Bytes of memory, without those that the hierarchy shares.
    #[must_use]
    pub fn memory(&self) -> usize {
        let columns = self.columns.len() * (size_of::<Column>() + 2 * size_of::<(Arc<str>, u32)>());
        self.groups.len() * size_of::<GroupSpan>()
            + self.innermost.len() * size_of::<(u32, Option<u32>)>()
            + self.names.memory()
            + self.values.memory()
            + self.spelled.len() * (size_of::<Arc<str>>() + size_of::<f64>() + size_of::<u8>())
            + columns
            + self.pairs.len() * size_of::<Pair>()
            + self.parts.len() * size_of::<u32>()
    }

    /// How many parts there are.
    pub(super) fn part_count(&self) -> usize {
        self.groups.len() + self.objects as usize
    }

    /// The innermost group around an object.
    pub(super) fn innermost(&self, object: u32) -> Option<u32> {
        let next = self.innermost.partition_point(|(first, _)| *first <= object);
        self.innermost.get(next.checked_sub(1)?).and_then(|(_, group)| *group)
    }

    /// The groups around a part, the innermost first.
    pub(super) fn around(&self, part: u32) -> impl Iterator<Item = u32> + '_ {
        let parent = |group: u32| self.groups.get(group as usize).and_then(|group| group.parent);
        let innermost = match part.checked_sub(self.groups.len() as u32) {
            None => parent(part),
            Some(object) => self.innermost(object),
        };
        iter::successors(innermost, move |group| parent(*group))
    }

    /// The parts of a pair, by its number.
    pub(super) fn parts_of(&self, pair: usize) -> &[u32] {
        let first = |pair: usize| self.pairs.get(pair).map_or(self.parts.len(), |pair| pair.first as usize);
        self.parts.get(first(pair)..first(pair + 1)).unwrap_or_default()
    }

    /// The column of a bare name.
    pub(super) fn column(&self, bare: &str) -> Option<&Column> {
        let found = self.columns.binary_search_by(|column| (*column.bare).cmp(bare));
        found.ok().and_then(|place| self.columns.get(place))
    }

    /// The number of an attribute's column.
    pub(super) fn column_of(&self, attribute: &Attribute) -> Option<u32> {
        self.by_name.get(&attribute.name).copied()
    }

    /// The innermost groups of all objects, run by run.
    fn runs(&self) -> Vec<(u32, Option<u32>)> {
        let mut runs: Vec<(u32, Option<u32>)> = vec![(0, None)];
        let mut begin = |at: u32, group: Option<u32>| {
            // An empty run has no objects.
            runs.pop_if(|(first, _)| *first == at);
            runs.push((at, group));
        };
        let end_of = |group: u32| self.groups.get(group as usize).map_or(0, |group| group.objects.end);
        // The groups around the present place, the innermost last.
        let mut open: Vec<u32> = Vec::new();
        for (id, group) in (0..).zip(&self.groups) {
            while let Some(ended) = open.pop_if(|open| Some(*open) != group.parent) {
                begin(end_of(ended), open.last().copied());
            }
            begin(group.objects.start, Some(id));
            open.push(id);
        }
        while let Some(ended) = open.pop() {
            begin(end_of(ended), open.last().copied());
        }
        runs
    }

    fn add_attributes(&mut self, hierarchy: &Hierarchy) -> Result<(), IndexError> {
        let groups = (0..).zip(hierarchy.groups.iter().map(|group| &group.attributes));
        let first = self.groups.len() as u32;
        let count = self.objects;
        let objects = hierarchy.attributes.iter().filter(|of| of.object < count);
        let objects = objects.map(|of| (first + of.object, &of.attributes));
        let mut texts = Interned::default();
        let mut by_bare = HashMap::new();
        // The column and the value of each attribute of each part.
        let mut entries: Vec<(u32, u32, u32)> = Vec::new();
        for (part, attributes) in groups.chain(objects) {
            for attribute in attributes {
                let column = self.column_number(&attribute.name, &mut by_bare);
                let value = match texts.number(&attribute.value) {
                    (number, false) => number,
                    (number, true) => {
                        add(&mut self.values, &attribute.value)?;
                        self.numbers.push(&attribute.value);
                        number
                    }
                };
                entries.push((column, value, part));
            }
        }
        self.spelled = texts.in_order();
        self.sort_columns(&mut entries);
        entries.sort_unstable();
        // A part has an attribute of one value once.
        entries.dedup();
        self.take(&entries);
        Ok(())
    }

    /// The number of the column of an attribute's name, until columns are sorted.
    fn column_number(&mut self, name: &Arc<str>, by_bare: &mut HashMap<String, u32>) -> u32 {
        if let Some(known) = self.by_name.get(name) {
            return *known;
        }
        let next = self.columns.len() as u32;
        let bare = bare(name);
        let number = *by_bare.entry(bare.clone()).or_insert(next);
        if number == next {
            self.columns.push(Column { name: Arc::clone(name), bare, pairs: 0..0, count: 0 });
        }
        self.by_name.insert(Arc::clone(name), number);
        number
    }

    /// Sorts the columns by their bare names.
    fn sort_columns(&mut self, entries: &mut [(u32, u32, u32)]) {
        let mut order: Vec<u32> = (0..self.columns.len() as u32).collect();
        order.sort_by(|a, b| {
            let name = |column: &u32| self.columns.get(*column as usize).map(|column| &column.bare);
            name(a).cmp(&name(b))
        });
        let mut places = vec![0; order.len()];
        for (place, column) in (0..).zip(order) {
            if let Some(slot) = places.get_mut(column as usize) {
                *slot = place;
            }
        }
        let place = |column: u32| places.get(column as usize).copied().unwrap_or_default();
        entries.iter_mut().for_each(|(column, ..)| *column = place(*column));
        self.by_name.values_mut().for_each(|column| *column = place(*column));
        self.columns.sort_by(|a, b| a.bare.cmp(&b.bare));
    }

    /// Takes the sorted attributes of all parts.
    fn take(&mut self, entries: &[(u32, u32, u32)]) {
        let mut last = None;
        for &(column, value, part) in entries {
            if last != Some((column, value)) {
                last = Some((column, value));
                self.pairs.push(Pair { value, first: self.parts.len() as u32 });
            }
            let pair = self.pairs.len();
            if let Some(column) = self.columns.get_mut(column as usize) {
                let first = if column.count == 0 { pair - 1 } else { column.pairs.start };
                column.pairs = first..pair;
                column.count += 1;
            }
            self.parts.push(part);
        }
    }
}

impl Numbers {
    /// Adds a value, which is no number if there are too many units.
    fn push(&mut self, text: &str) {
        let number = Quantity::parse(text).and_then(|Quantity { value, unit }| {
            let known = self.names.iter().position(|name| *name == unit);
            let place = u8::try_from(known.unwrap_or(self.names.len())).ok()?;
            if known.is_none() {
                self.names.push(unit);
            }
            Some((value, place))
        });
        let (value, unit) = number.unwrap_or((f64::NAN, 0));
        self.values.push(value);
        self.units.push(unit);
    }
}

/// Different texts, numbered as they come.
#[derive(Default)]
struct Interned(HashMap<Arc<str>, u32>);

impl Interned {
    /// The number of a text, and whether it is new.
    fn number(&mut self, text: &Arc<str>) -> (u32, bool) {
        if let Some(known) = self.0.get(text) {
            return (*known, false);
        }
        let number = self.0.len() as u32;
        self.0.insert(Arc::clone(text), number);
        (number, true)
    }

    fn in_order(self) -> Vec<Arc<str>> {
        let mut all: Vec<(Arc<str>, u32)> = self.0.into_iter().collect();
        all.sort_unstable_by_key(|(_, number)| *number);
        all.into_iter().map(|(text, _)| text).collect()
    }
}

fn add(texts: &mut Texts, text: &str) -> Result<(), IndexError> {
    texts.push(text.get(..text.floor_char_boundary(LONGEST_TEXT)).unwrap_or(text));
    if texts.bytes() > MOST_BYTES { Err(IndexError::TooLarge) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::{Extent, ObjectAttributes};

    use super::*;

    fn attribute(name: &str, value: &str) -> Attribute {
        Attribute { name: name.into(), value: value.into() }
    }

    fn group(parent: Option<u32>, objects: Range<u32>) -> Group {
        Group { name: "".into(), parent, objects, attributes: Vec::new(), extent: Extent::default() }
    }

    fn index(hierarchy: &Hierarchy, objects: u32) -> Index {
        hierarchy.check(objects).unwrap();
        Index::new(hierarchy, (0..objects).map(|object| format!("O-{object}"))).unwrap()
    }

    #[test]
    fn the_innermost_group_of_each_object_is_known() {
        let groups = vec![
            group(None, 1..9),
            group(Some(0), 1..4),
            group(Some(1), 1..1),
            group(Some(1), 2..4),
            group(Some(0), 4..5),
            group(None, 10..10),
            group(None, 10..12),
        ];
        let hierarchy = Hierarchy { groups, attributes: Vec::new() };
        let index = index(&hierarchy, 13);
        for object in 0..13 {
            let has = |group: &Group| group.objects.contains(&object);
            let expected = hierarchy.groups.iter().rposition(has).map(|group| group as u32);
            assert_eq!(index.innermost(object), expected, "{object}");
        }
        let around: Vec<u32> = index.around(7 + 3).collect();
        assert_eq!(around, [3, 1, 0]);
        assert_eq!(index.around(4).collect::<Vec<_>>(), [0]);
        assert_eq!(index.around(99).count(), 0);
    }

    #[test]
    fn attributes_of_names_that_are_alike_are_one_column() {
        let hierarchy = Hierarchy {
            groups: vec![Group {
                attributes: vec![
                    attribute("TAG", "b"),
                    attribute("tag", "b"),
                    attribute("Line Size", "5 mm"),
                ],
                ..group(None, 0..2)
            }],
            attributes: vec![ObjectAttributes {
                object: 1,
                attributes: vec![attribute("LINE-SIZE", "x"), attribute("TAG", "b"), attribute("Tag", "a")],
            }],
        };
        let index = index(&hierarchy, 2);
        let columns: Vec<_> = index.columns.iter().map(|of| (&*of.name, &*of.bare, of.count)).collect();
        assert_eq!(columns, [("Line Size", "linesize", 2), ("TAG", "tag", 3)]);
        let tag = index.column("tag").unwrap();
        let values = tag.pairs.clone().map(|pair| {
            let value = index.pairs[pair].value as usize;
            (&*index.spelled[value], index.parts_of(pair).to_vec())
        });
        assert_eq!(values.collect::<Vec<_>>(), [("b", vec![0, 2]), ("a", vec![2])]);
        assert_eq!(index.column_of(&attribute("LINE-SIZE", "")), Some(0));
        assert_eq!(index.column_of(&attribute("Tag", "")), Some(1));
        assert_eq!(index.column_of(&attribute("size", "")), None);
        assert!(index.column("size").is_none() && index.numbers.values.contains(&5.0));
    }

    #[test]
    fn an_empty_scene_has_an_index_too() {
        let index = index(&Hierarchy::default(), 0);
        assert_eq!((index.part_count(), index.innermost(0), index.columns.len()), (0, None, 0));
    }

    /// The rest of a long text is neither searched nor shown.
    #[test]
    fn memory_is_that_of_the_texts_however_long_one_is() {
        let name = "é".repeat(1 << 20);
        let index = Index::new(&Hierarchy::default(), iter::once(name)).unwrap();
        assert_eq!(index.names.get(0).len(), LONGEST_TEXT);
        assert!(index.memory() < 4 * LONGEST_TEXT, "{}", index.memory());
    }
}
