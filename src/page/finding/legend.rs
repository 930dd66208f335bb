//! Colours by an attribute: which objects have which value of it.

use std::{collections::HashMap, ops::Range};

use serde::Serialize;

use super::{
    super::parts::{NAME, cut},
    index::Index,
    quantity::factor,
    texts::bare,
};

/// The most different values with a colour of their own: those of most objects.
const MOST_VALUES: usize = 9;
/// The steps of a scale of numbers.
const STEPS: usize = 32;
/// No pair, and no class.
const NONE: u32 = u32::MAX;
const NO_CLASS: u8 = u8::MAX;

/// The classes of objects by their values of an attribute.
///
/// An object without the attribute has that of the innermost group around it that has it.
#[derive(Debug)]
pub(super) struct Classes {
    pub(super) legend: Legend,
    /// The class of each object: an index of the legend's counts.
    of: Vec<u8>,
}

/// The classes.
#[derive(Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "camelCase")]
pub(super) enum Legend {
    /// Values, those of most objects first.
    #[serde(rename_all = "camelCase")]
    Values {
        labels: Vec<String>,
        /// How many objects have each.
        counts: Vec<u32>,
        /// How many objects have other values.
        others: u32,
    },
    /// Numbers from the least to the largest, in steps of one size.
    #[serde(rename_all = "camelCase")]
    Numbers {
        least: f64,
        largest: f64,
        /// Empty without one.
        unit: String,
        /// How many objects are in each step.
        counts: Vec<u32>,
        /// How many objects have a value that is no such number.
        others: u32,
    },
}

impl Classes {
    /// The classes of all objects of an index by an attribute; `None` if there is none of that name.
    pub(super) fn new(index: &Index, attribute: &str) -> Option<Self> {
        let column = index.column(&bare(attribute))?;
        let pairs = pairs_of_objects(index, &column.pairs);
        let mut counts: HashMap<u32, u32> = HashMap::new();
        for pair in pairs.iter().filter(|pair| **pair != NONE) {
            *counts.entry(*pair).or_default() += 1;
        }
        let scale = Scale::new(index, &counts);
        let legend = |class_of: &dyn Fn(u32) -> u8, classes: usize| {
            let of: Vec<u8> = pairs.iter().map(|pair| class_of(*pair)).collect();
            let mut counts = vec![0; classes];
            for class in &of {
                if let Some(count) = counts.get_mut(usize::from(*class)) {
                    *count += 1;
                }
            }
            (of, counts)
        };
        let with_value: u32 = counts.values().sum();
        let others = |of_classes: &[u32]| with_value - of_classes.iter().sum::<u32>();
        Some(match scale {
            Some(scale) => {
                let (of, counts) = legend(&|pair| scale.step(index, pair), STEPS);
                let Scale { least, largest, unit } = scale;
                let others = others(&counts);
                Self { legend: Legend::Numbers { least, largest, unit, counts, others }, of }
            }
            None => {
                let mut common: Vec<(u32, u32)> = counts.into_iter().collect();
                // Pairs of fewer numbers come first in the file.
                common.sort_by_key(|(pair, count)| (u32::MAX - count, *pair));
                common.truncate(MOST_VALUES);
                let class = |pair: u32| common.iter().position(|(known, _)| *known == pair);
                let class = |pair: u32| class(pair).map_or(NO_CLASS, |class| class as u8);
                let (of, counts) = legend(&class, common.len());
                let labels = common.iter().map(|(pair, _)| label(index, *pair)).collect();
                let others = others(&counts);
                Self { legend: Legend::Values { labels, counts, others }, of }
            }
        })
    }

    /// Runs of objects of one class, in their order: the first object, how many more there are, and the
    /// class. They begin at object `from`.
    pub(super) fn runs(&self, from: u32) -> impl Iterator<Item = [u32; 3]> + '_ {
        let mut next = from as usize;
        std::iter::from_fn(move || {
            loop {
                let class = *self.of.get(next)?;
                let first = next;
                let rest = self.of.get(first..)?;
                next += rest.iter().take_while(|other| **other == class).count();
                if class != NO_CLASS {
                    return Some([first as u32, (next - first - 1) as u32, u32::from(class)]);
                }
            }
        })
    }
}

/// The pair of each object, its own or that of the innermost group around it that has one; `NONE` without.
fn pairs_of_objects(index: &Index, pairs: &Range<usize>) -> Vec<u32> {
    let mut own = vec![NONE; index.part_count()];
    // Of several values the first one counts.
    for pair in pairs.clone().rev() {
        for part in index.parts_of(pair) {
            if let Some(slot) = own.get_mut(*part as usize) {
                *slot = pair as u32;
            }
        }
    }
    let get = |own: &[u32], part: usize| own.get(part).copied().unwrap_or(NONE);
    for (id, group) in index.groups.iter().enumerate() {
        if let Some(parent) = group.parent
            && get(&own, id) == NONE
        {
            let inherited = get(&own, parent as usize);
            if let Some(slot) = own.get_mut(id) {
                *slot = inherited;
            }
        }
    }
    let first = index.groups.len();
    let of_group: Vec<u32> = own.iter().take(first).copied().collect();
    let mut objects = own.split_off(first);
    for (object, slot) in (0..).zip(&mut objects) {
        if *slot == NONE
            && let Some(group) = index.innermost(object)
        {
            *slot = get(&of_group, group as usize);
        }
    }
    objects
}

fn label(index: &Index, pair: u32) -> String {
    let value = index.pairs.get(pair as usize).and_then(|pair| index.spelled.get(pair.value as usize));
    value.map(|value| cut(value, NAME)).unwrap_or_default()
}

/// The scale of numbers.
#[derive(Debug)]
struct Scale {
    least: f64,
    largest: f64,
    unit: String,
}

impl Scale {
    /// That of an attribute of which most objects have numbers, in the unit of most of them.
    fn new(index: &Index, counts: &HashMap<u32, u32>) -> Option<Self> {
        let number = |pair: u32| {
            let value = index.pairs.get(pair as usize)?.value as usize;
            let number = index.numbers.values.get(value).filter(|number| !number.is_nan())?;
            Some((*number, *index.numbers.units.get(value)?))
        };
        let mut units: HashMap<u8, u32> = HashMap::new();
        for (pair, count) in counts {
            if let Some((_, unit)) = number(*pair) {
                *units.entry(unit).or_default() += count;
            }
        }
        let (unit, _) = units.iter().max_by_key(|(unit, count)| (**count, u8::MAX - **unit))?;
        let unit = index.numbers.names.get(usize::from(*unit))?.clone();
        let scale = Self { least: f64::INFINITY, largest: f64::NEG_INFINITY, unit };
        let all = counts.iter().filter_map(|(pair, count)| Some((scale.number(index, *pair)?, *count)));
        let of_numbers: u32 = all.clone().map(|(_, count)| count).sum();
        let are_most = 2 * u64::from(of_numbers) > counts.values().copied().map(u64::from).sum::<u64>();
        are_most.then(|| {
            all.fold(Self { unit: scale.unit.clone(), ..scale }, |scale, (number, _)| Self {
                least: scale.least.min(number),
                largest: scale.largest.max(number),
                ..scale
            })
        })
    }

    /// The value of a pair in the scale's unit.
    fn number(&self, index: &Index, pair: u32) -> Option<f64> {
        let value = index.pairs.get(pair as usize)?.value as usize;
        let unit = index.numbers.names.get(usize::from(*index.numbers.units.get(value)?))?;
        let number = index.numbers.values.get(value)? * factor(unit, &self.unit)?;
        number.is_finite().then_some(number)
    }

    /// The step of a pair.
    fn step(&self, index: &Index, pair: u32) -> u8 {
        let share = |number: f64| match self.largest - self.least {
            0.0 => 0.0,
            length => (number - self.least) / length,
        };
        let step = |number| ((share(number) * STEPS as f64) as usize).min(STEPS - 1) as u8;
        self.number(index, pair).map_or(NO_CLASS, step)
    }
}

#[cfg(test)]
mod tests {
    use trimaran_scene::{Attribute, Extent, Group, Hierarchy, ObjectAttributes};

    use super::*;

    fn attributes(all: &[(&str, &str)]) -> Vec<Attribute> {
        all.iter().map(|(name, value)| Attribute { name: (*name).into(), value: (*value).into() }).collect()
    }

    /// An index of `count` objects in two nested groups, the outer one of objects 0 to 8, the inner one of
    /// objects 2 to 4.
    fn index(outer: &[(&str, &str)], inner: &[(&str, &str)], own: &[(u32, &str, &str)]) -> Index {
        let group = |parent, objects, of: &[(&str, &str)]| Group {
            name: "".into(),
            parent,
            objects,
            attributes: attributes(of),
            extent: Extent::default(),
        };
        let own = own.iter().map(|(object, name, value)| ObjectAttributes {
            object: *object,
            attributes: attributes(&[(name, value)]),
        });
        let hierarchy = Hierarchy {
            groups: vec![group(None, 0..8, outer), group(Some(0), 2..4, inner)],
            attributes: own.collect(),
        };
        hierarchy.check(10).unwrap();
        Index::new(&hierarchy, (0..10).map(|object| object.to_string())).unwrap()
    }

    #[test]
    fn an_object_has_the_nearest_value_around_it() {
        let index =
            index(&[("Fluid", "oil")], &[("FLUID", "gas")], &[(3, "fluid", "water"), (9, "Fluid", "oil")]);
        let classes = Classes::new(&index, "fluid").unwrap();
        let labels = ["oil", "gas", "water"].map(str::to_owned).to_vec();
        assert_eq!(classes.legend, Legend::Values { labels, counts: vec![7, 1, 1], others: 0 });
        let runs = [[0, 1, 0], [2, 0, 1], [3, 0, 2], [4, 3, 0], [9, 0, 0]];
        assert_eq!(classes.runs(0).collect::<Vec<_>>(), runs);
        assert_eq!(classes.runs(5).collect::<Vec<_>>(), [[5, 2, 0], [9, 0, 0]]);
        assert_eq!(classes.runs(10).count() + classes.runs(u32::MAX).count(), 0);
        assert!(Classes::new(&index, "flow").is_none() && Classes::new(&index, "").is_none());
    }

    #[test]
    fn the_rarest_of_many_values_have_no_class() {
        let values: Vec<(u32, String)> =
            (0..10).map(|object| (object, format!("v{}", object.max(1)))).collect();
        let own: Vec<(u32, &str, &str)> =
            values.iter().map(|(object, value)| (*object, "V", &**value)).collect();
        let classes = Classes::new(&index(&[], &[], &own), "v").unwrap();
        let Legend::Values { labels, counts, others } = &classes.legend else { panic!("{classes:?}") };
        assert_eq!((labels.len(), &*labels[0], counts[0], *others), (9, "v1", 2, 0));
        let mut more = own;
        more[0].2 = "v0";
        let classes = Classes::new(&index(&[], &[], &more), "v").unwrap();
        let Legend::Values { counts, others, .. } = &classes.legend else { panic!("{classes:?}") };
        assert_eq!((counts.iter().sum::<u32>(), *others), (9, 1));
        assert_eq!(classes.runs(0).count(), 9);
    }

    #[test]
    fn numbers_are_a_scale_in_the_unit_of_most() {
        let own =
            [(0, "L", "100 mm"), (1, "L", "0.2 m"), (2, "L", "300 mm"), (3, "L", "x"), (4, "L", "5 bar")];
        let classes = Classes::new(&index(&[], &[], &own), "l").unwrap();
        let Legend::Numbers { least, largest, unit, counts, others } = &classes.legend else {
            panic!("{classes:?}")
        };
        assert_eq!(
            (*least, *largest, &**unit, counts.iter().sum::<u32>(), *others),
            (100.0, 300.0, "mm", 3, 2)
        );
        let last = STEPS as u32 - 1;
        assert_eq!(classes.runs(0).collect::<Vec<_>>(), [[0, 0, 0], [1, 0, 16], [2, 0, last]]);
    }

    #[test]
    fn one_number_alone_is_a_scale_and_few_numbers_among_words_are_none() {
        let classes = Classes::new(&index(&[("N", "7")], &[], &[]), "n").unwrap();
        assert_eq!(classes.runs(0).collect::<Vec<_>>(), [[0, 7, 0]]);
        assert!(matches!(classes.legend, Legend::Numbers { least: 7.0, largest: 7.0, .. }));
        let mixed = index(&[], &[], &[(0, "N", "7"), (1, "N", "a")]);
        assert!(matches!(Classes::new(&mixed, "n").unwrap().legend, Legend::Values { .. }));
        let huge = index(&[], &[], &[(0, "N", "1e308"), (1, "N", "-1e308")]);
        assert_eq!(Classes::new(&huge, "n").unwrap().runs(0).count(), 1);
    }
}
