//! Finds the parts for which a query holds.
//!
//! A part has what the groups around it have. So a group that is found stands for all of its objects, and
//! `zone-1 valve` finds the valves of a zone.

use std::{cmp::Ordering, ops::Range};

use fixedbitset::FixedBitSet;
use memchr::memmem::Finder;
use trimaran_proto::ObjectSet;

use super::{
    error::{QueryError, QueryFault},
    index::Index,
    quantity::{Quantity, compare, factor},
    query::{Condition, Expression, Field, Query, Test},
    texts::bare,
    tokens::Sign,
};

/// The attribute that names a part.
const NAME: &str = "name";

/// The parts that a query finds.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Found {
    /// The numbers of parts: groups, then objects behind all groups, until [`Index::rank`] sorts them. Parts
    /// of a found group are left out, unless a condition holds for themselves.
    pub parts: Vec<u32>,
    /// All objects of these.
    pub objects: ObjectSet,
}

impl Index {
    /// The result of a query. `None` soon after `is_given_up` says that nobody waits for it.
    ///
    /// # Errors
    /// If the query has an attribute that no part has.
    pub fn find(&self, query: &Query, is_given_up: &dyn Fn() -> bool) -> Result<Option<Found>, QueryError> {
        self.check(&query.expression)?;
        let mut search =
            Search { index: self, direct: FixedBitSet::with_capacity(self.part_count()), is_given_up };
        let Some(holds) = search.of(&query.expression) else { return Ok(None) };
        Ok(Some(self.found(&holds, &search.direct)))
    }

    /// Whether all attributes of a query exist.
    fn check(&self, expression: &Expression) -> Result<(), QueryError> {
        match expression {
            Expression::Condition(Condition { field: Field::Attribute { name, at }, .. }) => {
                let is_known = self.column(name).is_some();
                if is_known { Ok(()) } else { Err(QueryFault::UnknownAttribute.at(at.clone())) }
            }
            Expression::Condition(_) => Ok(()),
            Expression::Not(one) => self.check(one),
            Expression::All(all) | Expression::Any(all) => all.iter().try_for_each(|one| self.check(one)),
        }
    }

    /// The parts for which a condition holds by themselves.
    pub(super) fn having(&self, Condition { field, test }: &Condition) -> FixedBitSet {
        let mut parts = FixedBitSet::with_capacity(self.part_count());
        let is_name = matches!(field, Field::Any | Field::Name);
        match test {
            Test::Contains(wanted) if is_name => {
                self.names.each_with(wanted, |part| parts.insert(part as usize));
            }
            Test::Is(wanted) if is_name => {
                let wanted = bare(wanted);
                self.names.each(|name| name == wanted.as_bytes(), |part| parts.insert(part as usize));
            }
            Test::Exists if is_name => {
                self.names.each(|name| !name.is_empty(), |part| parts.insert(part as usize));
            }
            _ => {}
        }
        let mut add = |pair: usize| parts.extend(self.parts_of(pair).iter().map(|part| *part as usize));
        match field {
            Field::Any => {
                // All values at once, and each only once.
                let mut values = FixedBitSet::with_capacity(self.spelled.len());
                if let Test::Contains(wanted) = test {
                    self.values.each_with(wanted, |value| values.insert(value as usize));
                }
                let pairs = self.pairs.iter().enumerate();
                pairs
                    .filter(|(_, pair)| values.contains(pair.value as usize))
                    .for_each(|(pair, _)| add(pair));
            }
            Field::Name => self.pairs_of(NAME, test).for_each(&mut add),
            Field::Attribute { name, .. } => self.pairs_of(name, test).for_each(&mut add),
        }
        parts
    }

    /// The pairs of a column for which a test holds.
    fn pairs_of<'s>(&'s self, column: &str, test: &'s Test) -> impl Iterator<Item = usize> + 's {
        let pairs = self.column(column).map_or(0..0, |column| column.pairs.clone());
        let holds = self.holds(test);
        pairs.filter(move |pair| self.pairs.get(*pair).is_some_and(|pair| holds(pair.value)))
    }

    /// Whether a test holds for a value, by its number.
    fn holds<'s>(&'s self, test: &'s Test) -> Box<dyn Fn(u32) -> bool + 's> {
        match test {
            Test::Exists => Box::new(|_| true),
            Test::Contains(wanted) => {
                let finder = Finder::new(wanted);
                Box::new(move |value| finder.find(self.values.get(value)).is_some())
            }
            Test::Is(wanted) => {
                let bare = bare(wanted);
                let is_same = move |value| self.values.get(value) == bare.as_bytes();
                match Quantity::parse(wanted) {
                    None => Box::new(is_same),
                    Some(number) => {
                        // 1.5 is not 15.
                        let order = self.order(&number);
                        Box::new(move |value| match order(value) {
                            Some(order) => order.is_eq(),
                            None => !self.is_number(value) && is_same(value),
                        })
                    }
                }
            }
            Test::Number(sign, number) => {
                let order = self.order(number);
                let is_it: fn(Ordering) -> bool = match sign {
                    Sign::Above => Ordering::is_gt,
                    Sign::Below => Ordering::is_lt,
                    Sign::AtLeast => Ordering::is_ge,
                    Sign::AtMost => Ordering::is_le,
                    Sign::Is | Sign::Contains => Ordering::is_eq,
                    Sign::IsNot => Ordering::is_ne,
                };
                Box::new(move |value| order(value).is_some_and(is_it))
            }
        }
    }

    fn is_number(&self, value: u32) -> bool {
        self.numbers.values.get(value as usize).is_some_and(|number| !number.is_nan())
    }

    /// The order of a value and a number, if they can be compared.
    fn order<'s>(&'s self, wanted: &Quantity) -> impl Fn(u32) -> Option<Ordering> + use<'s> {
        let numbers = &self.numbers;
        let factors: Vec<Option<f64>> = numbers.names.iter().map(|unit| factor(unit, &wanted.unit)).collect();
        let wanted = wanted.value;
        move |value| {
            let number = *numbers.values.get(value as usize)?;
            let unit = *numbers.units.get(value as usize)?;
            let number = number * (*factors.get(usize::from(unit))?)?;
            (!number.is_nan()).then(|| compare(number, wanted))
        }
    }

    /// Adds all that is in the groups of a set.
    fn with_inner(&self, mut parts: FixedBitSet) -> FixedBitSet {
        for (id, group) in self.groups.iter().enumerate() {
            if group.parent.is_some_and(|parent| parts.contains(parent as usize)) {
                parts.insert(id);
            } else if parts.contains(id) {
                parts.insert_range(self.numbers_of(&group.objects));
            }
        }
        parts
    }

    /// The parts to show of those for which a query holds.
    fn found(&self, holds: &FixedBitSet, direct: &FixedBitSet) -> Found {
        let first = self.groups.len();
        let objects: ObjectSet =
            holds.ones().filter_map(|part| part.checked_sub(first)).map(|object| object as u32).collect();
        // A group with an object that is not found is not found as a whole.
        let has_all = |range: &Range<u32>| {
            let runs = objects.runs();
            let run = runs.get(runs.partition_point(|run| run.end <= range.start));
            range.is_empty() || run.is_some_and(|run| run.start <= range.start && range.end <= run.end)
        };
        let mut parts = Vec::new();
        let mut covered = FixedBitSet::with_capacity(self.part_count());
        for (id, group) in self.groups.iter().enumerate() {
            let is_covered = group.parent.is_some_and(|parent| covered.contains(parent as usize));
            let is_found = holds.contains(id) && has_all(&group.objects);
            if is_found && (direct.contains(id) || !is_covered) {
                parts.push(id as u32);
            }
            if is_covered {
                covered.insert(id);
            } else if is_found {
                covered.insert(id);
                covered.insert_range(self.numbers_of(&group.objects));
            }
        }
        let is_shown = |part: &usize| *part >= first && (direct.contains(*part) || !covered.contains(*part));
        parts.extend(holds.ones().filter(is_shown).map(|part| part as u32));
        Found { parts, objects }
    }

    /// The numbers of objects among all parts.
    fn numbers_of(&self, objects: &Range<u32>) -> Range<usize> {
        let first = self.groups.len();
        first + objects.start as usize..first + objects.end as usize
    }
}

struct Search<'s> {
    index: &'s Index,
    /// The parts for which any condition holds by itself.
    direct: FixedBitSet,
    is_given_up: &'s dyn Fn() -> bool,
}

impl Search<'_> {
    /// The parts for which an expression holds; `None` if it is given up.
    fn of(&mut self, expression: &Expression) -> Option<FixedBitSet> {
        match expression {
            Expression::Condition(condition) => {
                if (self.is_given_up)() {
                    return None;
                }
                let found = self.index.having(condition);
                self.direct.union_with(&found);
                Some(self.index.with_inner(found))
            }
            Expression::Not(one) => {
                let mut parts = self.of(one)?;
                parts.toggle_range(..);
                Some(parts)
            }
            Expression::All(all) => self.joined(all, FixedBitSet::intersect_with),
            Expression::Any(any) => self.joined(any, FixedBitSet::union_with),
        }
    }

    fn joined(
        &mut self,
        all: &[Expression],
        join: fn(&mut FixedBitSet, &FixedBitSet),
    ) -> Option<FixedBitSet> {
        let Some((first, rest)) = all.split_first() else {
            return Some(FixedBitSet::with_capacity(self.index.part_count()));
        };
        let mut parts = self.of(first)?;
        for one in rest {
            join(&mut parts, &self.of(one)?);
        }
        Some(parts)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_scene::{Attribute, Extent, Group, Hierarchy, ObjectAttributes};

    use super::*;

    const OBJECTS: [&str; 8] = ["Body", "Stem", "Seat 1", "20-CE50", "CE-50/20", "Elbow", "Body", "Rest"];

    fn attributes(all: &[(&str, &str)]) -> Vec<Attribute> {
        all.iter().map(|(name, value)| Attribute { name: (*name).into(), value: (*value).into() }).collect()
    }

    /// A file with two zones: a valve of three objects, two tags and an elbow; another body. One object is in
    /// the file itself.
    fn plant() -> (Hierarchy, Index) {
        let group = |name: &str, parent, objects: Range<u32>, of: &[(&str, &str)]| Group {
            name: name.into(),
            parent,
            objects,
            attributes: attributes(of),
            extent: Extent::default(),
        };
        let of = |object, of: &[(&str, &str)]| ObjectAttributes { object, attributes: attributes(of) };
        let hierarchy = Hierarchy {
            groups: vec![
                group("plant.rvm", None, 0..8, &[]),
                group("ZONE-1", Some(0), 0..6, &[("Status", "in use")]),
                group("HV-1001", Some(1), 0..3, &[("Type", "ball valve"), ("Size", "150 mm")]),
                group("ZONE-2", Some(0), 6..7, &[("status", "new"), ("Size", "0.2 m")]),
            ],
            attributes: vec![
                of(0, &[("Material", "steel")]),
                of(3, &[("Size", "100"), ("Type", "valve")]),
                of(4, &[("Size", "1.5 bar")]),
                of(5, &[("STATUS", "removed"), ("Size", "15 mm"), ("Name", "bend")]),
            ],
        };
        hierarchy.check(8).unwrap();
        let index = Index::new(&hierarchy, OBJECTS.iter()).unwrap();
        (hierarchy, index)
    }

    /// The names of what a query finds, and its objects.
    fn names(query: &str) -> (Vec<String>, Vec<u32>) {
        let (hierarchy, index) = plant();
        let query = Query::parse(query).unwrap();
        let mut found = index.find(&query, &|| false).unwrap().unwrap();
        let name = |part: u32| match hierarchy.groups.get(part as usize) {
            Some(group) => &*group.name,
            None => OBJECTS[part as usize - hierarchy.groups.len()],
        };
        index.rank(&query, &mut found, name);
        let Found { parts, objects } = found;
        (parts.into_iter().map(|part| name(part).to_owned()).collect(), objects.iter().collect())
    }

    #[track_caller]
    fn finds(query: &str, parts: &[&str], objects: &[u32]) {
        let (found, all) = names(query);
        assert_eq!((found, &*all), (parts.iter().map(ToString::to_string).collect(), objects), "{query}");
    }

    #[test]
    fn a_word_is_in_a_name_or_a_value() {
        finds("valve", &["HV-1001", "20-CE50"], &[0, 1, 2, 3]);
        finds("body", &["Body", "Body"], &[0, 6]);
        finds("hv 1001", &["HV-1001"], &[0, 1, 2]);
        finds("\"Ball  VALVE\"", &["HV-1001"], &[0, 1, 2]);
        finds("nowhere", &[], &[]);
        finds("", &[], &[]);
    }

    /// Both words are in both tags; the tag that was meant comes first.
    #[test]
    fn words_side_by_side_come_first() {
        finds("20 CE50", &["20-CE50", "CE-50/20"], &[3, 4]);
        finds("CE50 20", &["CE-50/20", "20-CE50"], &[3, 4]);
        finds("CE50 and 20", &["20-CE50", "CE-50/20"], &[3, 4]);
        finds("\"20 CE50\"", &["20-CE50"], &[3]);
    }

    #[test]
    fn a_part_has_what_the_groups_around_it_have() {
        finds("zone-1 valve", &["HV-1001", "20-CE50"], &[0, 1, 2, 3]);
        finds("zone-2 body", &["Body"], &[6]);
        finds("\"in use\" and type:\"\"", &["HV-1001", "20-CE50"], &[0, 1, 2, 3]);
        finds("zone", &["ZONE-1", "ZONE-2"], &[0, 1, 2, 3, 4, 5, 6]);
    }

    /// The file is neither a zone nor a valve, but it has some in it.
    #[test]
    fn what_is_negated_is_left_out_with_all_that_is_in_it() {
        finds("not zone", &["Rest"], &[7]);
        finds("not valve", &["ZONE-2", "CE-50/20", "Elbow", "Rest"], &[4, 5, 6, 7]);
        finds("not not valve", &["HV-1001", "20-CE50"], &[0, 1, 2, 3]);
        finds("zone-1 and not valve", &["CE-50/20", "Elbow"], &[4, 5]);
        finds("not nowhere", &["plant.rvm"], &[0, 1, 2, 3, 4, 5, 6, 7]);
        finds("plant not (zone-1 or zone-2)", &["Rest"], &[7]);
    }

    #[test]
    fn attributes_are_equal_but_for_case_and_separators() {
        finds("status=new", &["ZONE-2"], &[6]);
        finds("status=IN-USE", &["ZONE-1"], &[0, 1, 2, 3, 4, 5]);
        finds("status=in", &[], &[]);
        finds("status:in", &["ZONE-1"], &[0, 1, 2, 3, 4, 5]);
        finds("status:\"\"", &["ZONE-1", "ZONE-2", "Elbow"], &[0, 1, 2, 3, 4, 5, 6]);
        // The zone of an elbow that is removed is not found as a whole.
        let left = ["HV-1001", "ZONE-2", "20-CE50", "CE-50/20"];
        finds("status != removed", &left, &[0, 1, 2, 3, 4, 6]);
        finds("type=valve", &["20-CE50"], &[3]);
        finds("name=body", &["Body", "Body"], &[0, 6]);
        finds("name:bend", &["Elbow"], &[5]);
        finds("name!=body zone-2", &[], &[]);
    }

    #[test]
    fn numbers_are_compared_with_their_units() {
        finds("size > 100", &["HV-1001"], &[0, 1, 2]);
        finds("size>=100", &["HV-1001", "20-CE50"], &[0, 1, 2, 3]);
        // A number without a unit is compared as it stands.
        finds("size > 10 cm", &["HV-1001", "ZONE-2", "20-CE50"], &[0, 1, 2, 3, 6]);
        finds("size > 160mm", &["ZONE-2"], &[6]);
        finds("size < 2 bar", &["CE-50/20"], &[4]);
        finds("size < 1.5 bar", &[], &[]);
        finds("size <= 1.5 bar", &["CE-50/20"], &[4]);
        finds("size = \"0.150 m\"", &["HV-1001"], &[0, 1, 2]);
        finds("size = 15", &["Elbow"], &[5]);
        finds("size = 1.5", &["CE-50/20"], &[4]);
        finds("size = 200mm", &["ZONE-2"], &[6]);
        // A text is no number.
        finds("type > 0", &[], &[]);
    }

    #[test]
    fn an_unknown_attribute_is_wrong_and_told_with_its_place() {
        let (_, index) = plant();
        let find = |query| index.find(&Query::parse(query).unwrap(), &|| false);
        assert_eq!(find("valve diameter>5"), Err(QueryFault::UnknownAttribute.at(6..14)));
        assert_eq!(find("not (\"é x\"=5)"), Err(QueryFault::UnknownAttribute.at(5..11)));
        assert_eq!(index.find(&Query::parse("valve").unwrap(), &|| true), Ok(None));
    }

    /// Whether a condition holds for an object by the attributes and names of it and of the groups around it.
    fn holds(expression: &Expression, texts: &[(String, String)]) -> bool {
        match expression {
            Expression::Condition(Condition { field, test }) => texts.iter().any(|(name, value)| {
                let is_place = match field {
                    Field::Any => true,
                    Field::Name => name == NAME,
                    Field::Attribute { name: wanted, .. } => name == wanted,
                };
                is_place
                    && match test {
                        Test::Exists => !(value.is_empty() && name == NAME),
                        Test::Contains(wanted) => value.contains(wanted),
                        Test::Is(wanted) => *value == bare(wanted),
                        Test::Number(..) => false,
                    }
            }),
            Expression::Not(one) => !holds(one, texts),
            Expression::All(all) => all.iter().all(|one| holds(one, texts)),
            Expression::Any(any) => any.iter().any(|one| holds(one, texts)),
        }
    }

    /// Groups within each other by chance.
    fn nested() -> impl Strategy<Value = (Hierarchy, Vec<String>)> {
        let text = || "[ab]{0,2}";
        let of = move || prop::collection::vec(("[pq]", text()), 0..2);
        let group = (text(), 0..4_u32, 0..4_u32, 0..4_usize, of());
        let groups = prop::collection::vec(group, 0..6);
        let objects = prop::collection::vec((text(), of()), 1..10);
        (groups, objects).prop_map(|(groups, objects)| {
            let count = objects.len() as u32;
            let mut made: Vec<Group> = Vec::new();
            let mut open: Vec<u32> = Vec::new();
            for (name, skip, length, close, of) in groups {
                for _ in 0..close {
                    open.pop();
                }
                let parent = open.last().copied();
                let within = parent.map_or(0..count, |parent| made[parent as usize].objects.clone());
                // Behind all that was made within it.
                let from = made.iter().filter(|one| one.parent == parent).map(|one| one.objects.end).max();
                let start = (from.unwrap_or(within.start) + skip / 2).min(within.end);
                let end = (start + 2 * length).min(within.end);
                open.push(made.len() as u32);
                let of: Vec<(&str, &str)> = of.iter().map(|(name, value)| (&**name, &**value)).collect();
                let attributes = attributes(&of);
                made.push(Group {
                    name: name.into(),
                    parent,
                    objects: start..end,
                    attributes,
                    extent: Extent::default(),
                });
            }
            let of = (0..).zip(&objects).filter(|(_, (_, of))| !of.is_empty()).map(|(object, (_, of))| {
                let of: Vec<(&str, &str)> = of.iter().map(|(name, value)| (&**name, &**value)).collect();
                ObjectAttributes { object, attributes: attributes(&of) }
            });
            let hierarchy = Hierarchy { groups: made, attributes: of.collect() };
            (hierarchy, objects.into_iter().map(|(name, _)| name).collect())
        })
    }

    proptest! {
        /// The objects are those for which the query holds, and the parts that are shown have just these.
        #[test]
        fn a_query_finds_what_each_object_alone_would_answer(
            (hierarchy, names) in nested(),
            query in "(not )?[ab]( (and|or)( not)? [ab]{1,2}| p:[ab]| q=[ab]| q!=b| name=a){0,3}",
        ) {
            prop_assert_eq!(hierarchy.check(names.len() as u32), Ok(()));
            let index = Index::new(&hierarchy, names.iter()).unwrap();
            let query = Query::parse(&query).unwrap();
            let Ok(found) = index.find(&query, &|| false) else { return Ok(()) };
            let Found { parts, objects } = found.unwrap();
            let first = hierarchy.groups.len() as u32;
            let texts = |part: u32| {
                let own = |part: u32| {
                    let (name, of) = match hierarchy.groups.get(part as usize) {
                        Some(group) => (&*group.name, &*group.attributes),
                        None => (&*names[(part - first) as usize], hierarchy.attributes_of(part - first)),
                    };
                    let name = std::iter::once((NAME.to_owned(), bare(name)));
                    let of = of.iter().map(|one| (bare(&one.name), bare(&one.value)));
                    name.chain(of).collect::<Vec<_>>()
                };
                index.around(part).chain([part]).flat_map(own).collect::<Vec<_>>()
            };
            let expected: Vec<u32> =
                (0..names.len() as u32)
                    .filter(|object| holds(&query.expression, &texts(first + object)))
                    .collect();
            prop_assert_eq!(objects.iter().collect::<Vec<_>>(), &*expected);
            let of = |part: &u32| match hierarchy.groups.get(*part as usize) {
                Some(group) => group.objects.clone(),
                None => *part - first..*part - first + 1,
            };
            prop_assert_eq!(parts.iter().flat_map(of).collect::<ObjectSet>(), objects);
            let each: std::collections::HashSet<_> = parts.iter().collect();
            prop_assert_eq!(each.len(), parts.len(), "each once");
            for part in &parts {
                prop_assert!(holds(&query.expression, &texts(*part)));
            }
        }
    }
}
