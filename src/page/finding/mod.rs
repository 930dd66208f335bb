//! Finding all of a kind: a query language, an index of a scene's names and attributes, and the answers to
//! pages.

mod error;
mod index;
mod legend;
mod quantity;
mod query;
mod ranking;
mod search;
mod table;
mod texts;
mod tokens;

use std::{
    collections::VecDeque,
    sync::{Arc, OnceLock},
};

use parking_lot::Mutex;
use serde::Serialize;
use thiserror::Error;
use trimaran_scene::{Bounds, Hierarchy, ReadError, Scene};

pub use error::{QueryError, QueryFault};
pub use index::{Index, IndexError};
pub use query::Query;
pub use search::Found;

use super::parts::{NAME, Part, PartId, Parts, cut, that_fit};
use legend::{Classes, Legend};
use table::{Layout, Table};

pub(super) use table::Rows;

/// The most parts in an answer.
const FOUND: usize = 100;
/// The most attributes in a list of them.
const ATTRIBUTES: usize = 500;
/// How many results are kept: a page asks for parts, objects and rows of one query one after the other.
const RECENT: usize = 4;

/// Answers queries about a scene. Its index is made for the first one.
#[derive(Debug)]
pub(super) struct Finder {
    scene: Arc<Scene>,
    hierarchy: Arc<Hierarchy>,
    index: Mutex<Option<Arc<Index>>>,
    /// The newest last.
    recent: Mutex<VecDeque<Arc<Answered>>>,
}

/// A query, and what it found.
#[derive(Debug)]
struct Answered {
    query: String,
    found: Found,
    /// That of its table, once it is asked for.
    layout: OnceLock<Layout>,
}

/// A query is not answered.
#[derive(Debug, Error)]
pub(super) enum FindError {
    #[error(transparent)]
    Wrong(#[from] QueryError),
    #[error(transparent)]
    Index(#[from] IndexError),
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("nobody waits for the answer")]
    GivenUp,
}

/// Some of the parts that a query finds, as pages get them.
#[derive(Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct FoundParts {
    parts: Vec<Part>,
    /// How many parts there are in all.
    total: usize,
    /// How many objects these have.
    objects: usize,
    /// The fault of the query.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<WrongPlace>,
}

/// A fault of a query, and its place.
#[derive(Debug, PartialEq, Eq, Serialize)]
struct WrongPlace {
    text: String,
    /// In UTF-16 code units, as browsers count.
    at: usize,
    end: usize,
}

/// Some runs of objects, and from which object on the next answer has more.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(super) struct FoundObjects {
    /// The first object of a run, and how many more there are.
    runs: Vec<[u32; 2]>,
    next: Option<u32>,
}

/// The name of an attribute, and how many parts have it.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(super) struct AttributeName {
    name: String,
    parts: usize,
}

/// The classes of objects by an attribute, and some of their runs.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct ClassRuns {
    #[serde(flatten)]
    legend: Legend,
    /// The first object of a run, how many more there are, and the class.
    runs: Vec<[u32; 3]>,
    next: Option<u32>,
}

impl Finder {
    /// Answers about a scene with this hierarchy.
    pub(super) fn new(scene: Arc<Scene>, hierarchy: Arc<Hierarchy>) -> Self {
        Self { scene, hierarchy, index: Mutex::default(), recent: Mutex::default() }
    }

    /// Parts that a query finds: starting at number `from`, as many as fit in an answer. A wrong query finds
    /// none, and the answer says what is wrong.
    ///
    /// # Errors
    /// If there is no index, or soon after `is_given_up` says that the client has gone.
    pub(super) fn parts(
        &self,
        parts: &Parts,
        query: &str,
        from: usize,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<FoundParts, FindError> {
        let answered = match self.find(query, is_given_up) {
            Err(FindError::Wrong(error)) => {
                return Ok(FoundParts {
                    fault: Some(WrongPlace::new(query, &error)),
                    ..FoundParts::default()
                });
            }
            answered => answered?,
        };
        let found = &answered.found;
        let first = self.hierarchy.groups.len() as u32;
        let id = |part: &u32| part.checked_sub(first).map_or(PartId::Group(*part), PartId::Object);
        let some = found.parts.iter().skip(from).take(FOUND);
        Ok(FoundParts {
            parts: that_fit(some.filter_map(|part| parts.part(id(part)))),
            total: found.parts.len(),
            objects: found.objects.len(),
            fault: None,
        })
    }

    /// All objects of the parts that a query finds: their runs from object `from` on, as many as fit in an
    /// answer.
    ///
    /// # Errors
    /// As [`parts`](Self::parts), and if the query is wrong.
    pub(super) fn objects(
        &self,
        query: &str,
        from: u32,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<FoundObjects, FindError> {
        let answered = self.find(query, is_given_up)?;
        let all = answered.found.objects.runs();
        let all = all.get(all.partition_point(|run| run.end <= from)..).unwrap_or_default();
        let runs = that_fit(all.iter().map(|run| {
            let first = run.start.max(from);
            [first, run.end - first - 1]
        }));
        let next = all.get(runs.len()).map(|run| run.start);
        Ok(FoundObjects { runs, next })
    }

    /// The box around most objects that a query finds.
    ///
    /// # Errors
    /// As [`objects`](Self::objects), and if the scene cannot be read.
    pub(super) fn bounds(&self, query: &str, is_given_up: &dyn Fn() -> bool) -> Result<Bounds, FindError> {
        let answered = self.find(query, is_given_up)?;
        Ok(self.scene.reading(|| Bounds::of_most(&self.scene, answered.found.objects.iter()))?)
    }

    /// The parts that a query finds as a table: its rows from number `from` on.
    ///
    /// # Errors
    /// As [`objects`](Self::objects).
    pub(super) fn rows(
        &self,
        query: &str,
        from: usize,
        is_given_up: &dyn Fn() -> bool,
    ) -> Result<Rows, FindError> {
        let answered = self.find(query, is_given_up)?;
        let index = self.index()?;
        let table = Table { index: &index, hierarchy: &self.hierarchy, found: &answered.found };
        let layout = answered.layout.get_or_init(|| table.layout());
        let name = |object: u32| self.scene.object_name(object).unwrap_or_default();
        Ok(self.scene.reading(|| table.rows(layout, from, name))?)
    }

    /// The attributes of the scene, those of most parts first.
    ///
    /// # Errors
    /// If there is no index.
    pub(super) fn attributes(&self) -> Result<Vec<AttributeName>, FindError> {
        let index = self.index()?;
        let mut columns: Vec<_> = index.columns.iter().collect();
        columns.sort_by_key(|column| (usize::MAX - column.count, &column.bare));
        let named =
            |column: &&index::Column| AttributeName { name: cut(&column.name, NAME), parts: column.count };
        Ok(that_fit(columns.iter().filter(|column| !column.bare.is_empty()).take(ATTRIBUTES).map(named)))
    }

    /// The classes of objects by an attribute; `None` if no part has it. Runs begin at object `from`.
    ///
    /// # Errors
    /// If there is no index.
    pub(super) fn classes(&self, attribute: &str, from: u32) -> Result<Option<ClassRuns>, FindError> {
        let index = self.index()?;
        Ok(Classes::new(&index, attribute).map(|classes| {
            let runs = that_fit(classes.runs(from));
            let end = runs.last().map_or(from, |[first, more, _]| first.saturating_add(*more) + 1);
            let next = classes.runs(end).next().map(|[first, ..]| first);
            ClassRuns { runs, next, legend: classes.legend }
        }))
    }

    fn find(&self, text: &str, is_given_up: &dyn Fn() -> bool) -> Result<Arc<Answered>, FindError> {
        let query = Query::parse(text)?;
        let known = self.recent.lock().iter().find(|known| known.query == text).map(Arc::clone);
        if let Some(known) = known {
            return Ok(known);
        }
        let index = self.index()?;
        let mut found = index.find(&query, is_given_up)?.ok_or(FindError::GivenUp)?;
        let first = self.hierarchy.groups.len() as u32;
        let name_of = |part: u32| match part.checked_sub(first) {
            None => self.hierarchy.groups.get(part as usize).map_or("", |group| &*group.name),
            Some(object) => self.scene.object_name(object).unwrap_or_default(),
        };
        self.scene.reading(|| index.rank(&query, &mut found, name_of))?;
        let answered = Arc::new(Answered { query: text.to_owned(), found, layout: OnceLock::new() });
        let mut recent = self.recent.lock();
        recent.push_back(Arc::clone(&answered));
        if recent.len() > RECENT {
            recent.pop_front();
        }
        Ok(answered)
    }

    /// The index. Others wait while one makes it.
    fn index(&self) -> Result<Arc<Index>, FindError> {
        let mut index = self.index.lock();
        if let Some(index) = &*index {
            return Ok(Arc::clone(index));
        }
        let objects = 0..self.scene.objects().len() as u32;
        let names = objects.map(|object| self.scene.object_name(object).unwrap_or_default());
        let made = Arc::new(self.scene.reading(|| Index::new(&self.hierarchy, names))??);
        let megabytes = made.memory() as f64 / 1e6;
        tracing::info!("the index of the model's names and attributes takes {megabytes:.1} MB of memory");
        *index = Some(Arc::clone(&made));
        Ok(made)
    }
}

impl WrongPlace {
    fn new(query: &str, error: &QueryError) -> Self {
        let units = |end: usize| query.get(..end).unwrap_or(query).encode_utf16().count();
        Self { text: error.to_string(), at: units(error.at.start), end: units(error.at.end) }
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use trimaran_cook::{
        CookOptions, Model, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_scene::{Attribute, Extent, Group, ObjectAttributes};

    use super::*;

    /// The parts of a model with these names of objects, and their finder.
    fn finder(names: impl Iterator<Item = String>, hierarchy: Hierarchy) -> (Parts, Finder) {
        let mut model: Model = plant(&PlantOptions::small(7));
        let one = model.objects[0].clone();
        model.objects = names.map(|name| trimaran_cook::Object { name, ..one.clone() }).collect();
        model.hierarchy = hierarchy;
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let parts = Parts::new(Arc::clone(&scene)).unwrap();
        let finder = Finder::new(scene, Arc::clone(parts.hierarchy()));
        (parts, finder)
    }

    /// A plant from a file with two zones, and some objects between them.
    fn zones() -> (Parts, Finder) {
        let group = |name: &str, parent, objects: Range<u32>| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        let groups = vec![
            group("plant.RVM", None, 0..9),
            group("/ZONE-1", Some(0), 1..4),
            group("/PIPE-7", Some(1), 2..4),
            group("/ZONE-2", Some(0), 6..7),
        ];
        let attribute = |name: &str, value: &str| Attribute { name: name.into(), value: value.into() };
        let attributes = vec![
            ObjectAttributes { object: 3, attributes: vec![attribute("TAG", "P-101A")] },
            ObjectAttributes { object: 8, attributes: vec![attribute("Size", "7"), attribute("tag", "Q")] },
        ];
        finder((0..9).map(|object| format!("box{object}")), Hierarchy { groups, attributes })
    }

    fn ids(found: &FoundParts) -> Vec<(&str, u32)> {
        found.parts.iter().map(Part::key).collect()
    }

    #[test]
    fn a_search_finds_names_and_attributes_whatever_their_case_and_separators() {
        let (parts, finder) = zones();
        let found = |text| finder.parts(&parts, text, 0, &|| false).unwrap();
        assert_eq!(ids(&found(" zone ")), [("group", 1), ("group", 3)]);
        assert_eq!(found("zone").objects, 4);
        for text in ["p-101", "P 101A", "p101a", "P_101.A", "p/101-a", "101 a", "tag=p101a"] {
            assert_eq!(ids(&found(text)), [("object", 3)], "{text}");
        }
        assert_eq!(ids(&found("pipe 7")), [("group", 2)]);
        assert_eq!((found("").total, found("p 102").total, found("box").total), (0, 0, 9));
    }

    #[test]
    fn a_wrong_query_is_told_with_its_place_as_browsers_count() {
        let (parts, finder) = zones();
        let found = finder.parts(&parts, "𝒳é size > big", 0, &|| false).unwrap();
        let fault = found.fault.as_ref().unwrap();
        assert_eq!((fault.at, fault.end, found.total), (11, 14, 0));
        let json = serde_json::to_value(&found).unwrap();
        assert!(json["fault"]["text"].as_str().unwrap().contains("compares numbers"), "{json}");
        let unknown = finder.parts(&parts, "sise=5", 0, &|| false).unwrap().fault.unwrap();
        assert_eq!((unknown.at, unknown.end), (0, 4));
        assert!(matches!(finder.objects("(", 0, &|| false), Err(FindError::Wrong(_))));
        assert!(matches!(finder.rows("(", 0, &|| false), Err(FindError::Wrong(_))));
        let right = finder.parts(&parts, "box", 0, &|| false).unwrap();
        assert_eq!(serde_json::to_value(right).unwrap().get("fault"), None);
    }

    #[test]
    fn all_that_is_found_comes_answer_by_answer() {
        let (parts, finder) = finder((0..250).map(|number| format!("20-CE{number}")), Hierarchy::default());
        let mut found = Vec::new();
        while found.len() < 250 {
            let answer = finder.parts(&parts, "20 ce", found.len(), &|| false).unwrap();
            assert_eq!((answer.total, answer.objects), (250, 250));
            assert!(!answer.parts.is_empty() && answer.parts.len() <= FOUND);
            found.extend(answer.parts.iter().map(|part| part.key().1));
        }
        assert!(found.iter().copied().eq(0..250), "each once, in order: {found:?}");
        assert!(finder.parts(&parts, "20 ce", 250, &|| false).unwrap().parts.is_empty());
        let objects = |from| finder.objects("20 ce", from, &|| false).unwrap();
        assert_eq!(objects(0), FoundObjects { runs: vec![[0, 249]], next: None });
        assert_eq!(objects(7).runs, [[7, 242]]);
        assert_eq!(objects(250).runs.len() + objects(u32::MAX).runs.len(), 0);
    }

    /// No two objects are beside each other: the most runs that there can be.
    #[test]
    fn objects_and_classes_come_in_short_answers() {
        let name = |number: u32| if number.is_multiple_of(2) { "valve" } else { "pipe" }.to_owned();
        let of = |object| ObjectAttributes {
            object,
            attributes: vec![Attribute { name: "Kind".into(), value: (object % 3).to_string().into() }],
        };
        let hierarchy = Hierarchy { groups: Vec::new(), attributes: (0..60_000).map(of).collect() };
        let index = Index::new(&hierarchy, (0..60_000).map(name)).unwrap();
        let (_, mut finder) = zones();
        finder.index = Mutex::new(Some(Arc::new(index)));
        let (mut from, mut answers, mut all) = (Some(0), 0, Vec::new());
        while let Some(first) = from {
            let answer = finder.objects("valve", first, &|| false).unwrap();
            assert!(serde_json::to_vec(&answer).unwrap().len() < 1 << 20);
            all.extend(answer.runs.iter().map(|[first, more]| (*first, *more)));
            (from, answers) = (answer.next, answers + 1);
        }
        assert!(answers > 1 && all.iter().copied().eq((0..30_000).map(|number| (2 * number, 0))));
        let (mut from, mut answers, mut all) = (Some(0), 0, Vec::new());
        while let Some(first) = from {
            let answer = finder.classes("KIND", first).unwrap().unwrap();
            assert!(serde_json::to_vec(&answer).unwrap().len() < 1 << 20);
            all.extend(answer.runs.iter().map(|[first, more, class]| (*first, *more, *class)));
            (from, answers) = (answer.next, answers + 1);
        }
        let class = |object: u32| [0, 16, 31][object as usize % 3];
        assert!(answers > 1 && all.iter().copied().eq((0..60_000).map(|object| (object, 0, class(object)))));
        assert!(finder.classes("colour", 0).unwrap().is_none());
    }

    #[test]
    fn attributes_are_listed_with_their_parts() {
        let (_, finder) = zones();
        let names: Vec<_> = finder.attributes().unwrap().into_iter().map(|of| (of.name, of.parts)).collect();
        assert_eq!(names, [("TAG".to_owned(), 2), ("Size".to_owned(), 1)]);
    }

    #[test]
    fn results_are_kept_for_the_next_answer_and_no_more_of_them() {
        let (parts, finder) = zones();
        for text in ["a", "b", "a", "c", "d", "e", "("] {
            finder.parts(&parts, text, 0, &|| false).unwrap();
        }
        let kept: Vec<String> = finder.recent.lock().iter().map(|known| known.query.clone()).collect();
        assert_eq!(kept, ["b", "c", "d", "e"]);
        assert!(matches!(finder.parts(&parts, "f", 0, &|| true), Err(FindError::GivenUp)));
        assert!(finder.parts(&parts, "e", 0, &|| true).is_ok(), "it is known");
    }
}
