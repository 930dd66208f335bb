//! Pages' questions outside their links: a scene's parts, and its heightfield.

use std::{
    borrow::Cow,
    sync::{Arc, Once},
};

use hyper::{Response, StatusCode, body::Bytes, header::HeaderName};
use parking_lot::Mutex;
use serde::Serialize;
use trimaran_proto::ObjectSet;
use trimaran_scene::{Bounds, ReadError, Scene, heightfield::Heightfield};

use super::{
    clearance::Between,
    finding::{FindError, Finder, Rows},
    notes::{Notes, NotesQuestion, Person},
    parts::{PartId, Parts},
    server::{Body, file, plain},
    snap::Pointing,
    tiles::Tiles,
};
use crate::notes::NotesFolder;

/// The most bytes of an answer. Longer ones are cut: see [`Parts`] and [`Heightfield::SPANS`].
const LONGEST: usize = 1 << 20;

/// The header with the number of a table's next row.
const NEXT_ROW: HeaderName = HeaderName::from_static("next-row");

/// A question about a scene that takes a moment to answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Question {
    Part(PartId),
    Children {
        group: Option<u32>,
        from: usize,
    },
    Search {
        text: String,
        from: usize,
    },
    /// All objects that a query finds, from one of these on.
    Objects {
        text: String,
        from: u32,
    },
    /// The box around all that a query finds.
    Box {
        text: String,
    },
    /// The box around most of these objects.
    Bounds(ObjectSet),
    /// All parts that a query finds, as rows of a table.
    Rows {
        text: String,
        from: usize,
    },
    Attributes,
    /// The classes of objects by an attribute, from one of these on.
    Classes {
        attribute: String,
        from: u32,
    },
    Snap(Pointing),
    Surface(Pointing),
    Object(Pointing),
    Clearance(Between),
    Tile {
        x: i32,
        z: i32,
    },
    /// Of this person.
    Notes(NotesQuestion, Person),
}

/// Answers questions.
#[derive(Debug)]
pub(super) struct Answers {
    scene: Arc<Scene>,
    parts: Parts,
    finder: Finder,
    heightfield: Heightfield,
    tiles: Mutex<Tiles>,
    notes: Notes,
    /// A damaged scene stays damaged, so the error is logged once.
    is_told: Once,
}

impl Question {
    /// Parses a path and the names and values of a query of this person; `None` if they are no question.
    pub(super) fn parse<'q>(
        path: &str,
        query: impl IntoIterator<Item = (Cow<'q, str>, Cow<'q, str>)>,
        person: Person,
    ) -> Option<Self> {
        let query: Vec<_> = query.into_iter().collect();
        let value = |name: &str| query.iter().find(|(known, _)| known == name).map(|(_, value)| &**value);
        let from = || value("from").map(str::parse).transpose().ok().map(Option::unwrap_or_default);
        let object = || u32::try_from(from()?).ok();
        Some(match path {
            "/part" => Self::Part(match value("group") {
                Some(group) => PartId::Group(group.parse().ok()?),
                None => PartId::Object(value("object")?.parse().ok()?),
            }),
            "/children" => {
                Self::Children { group: value("group").map(str::parse).transpose().ok()?, from: from()? }
            }
            "/search" => Self::Search { text: value("text")?.to_owned(), from: from()? },
            "/objects" => Self::Objects { text: value("text")?.to_owned(), from: object()? },
            "/box" => Self::Box { text: value("text")?.to_owned() },
            "/rows" => Self::Rows { text: value("text")?.to_owned(), from: from()? },
            "/attributes" => Self::Attributes,
            "/classes" => Self::Classes { attribute: value("attribute")?.to_owned(), from: object()? },
            "/snap" => Self::Snap(Pointing::parse(|name| value(name).map(Cow::Borrowed))?),
            "/object" => Self::Object(Pointing::parse(|name| value(name).map(Cow::Borrowed))?),
            "/surface" => Self::Surface(Pointing::parse(|name| value(name).map(Cow::Borrowed))?),
            "/clearance" => Self::Clearance(Between::parse(value)?),
            "/tile" => Self::Tile { x: value("x")?.parse().ok()?, z: value("z")?.parse().ok()? },
            path => Self::Notes(NotesQuestion::parse(path, |name| value(name).map(Cow::Borrowed))?, person),
        })
    }
}

impl Answers {
    /// Answers about a scene with these notes, for eyes this high above floors.
    ///
    /// # Errors
    /// If its hierarchy cannot be read.
    pub(super) fn new(scene: &Arc<Scene>, notes: NotesFolder, eye_height: f64) -> Result<Self, ReadError> {
        let heightfield = Heightfield::new(scene, eye_height);
        let parts = Parts::new(Arc::clone(scene))?;
        Ok(Self {
            scene: Arc::clone(scene),
            finder: Finder::new(Arc::clone(scene), Arc::clone(parts.hierarchy())),
            notes: Notes::new(notes, scene, parts.hierarchy())?,
            parts,
            heightfield,
            tiles: Mutex::default(),
            is_told: Once::new(),
        })
    }

    /// How many named groups an object is in, at most.
    pub(super) fn group_levels(&self) -> usize {
        self.parts.levels()
    }

    /// The answer, if it is cached.
    pub(super) fn known(&self, question: &Question) -> Option<Response<Body>> {
        match question {
            Question::Tile { x, z } => self.tiles.lock().get([*x, *z]).map(tile),
            _ => None,
        }
    }

    /// The answer, or none soon after `is_given_up` says that the client has gone.
    pub(super) fn answer(
        &self,
        question: &Question,
        is_given_up: &dyn Fn() -> bool,
    ) -> Option<Response<Body>> {
        // Another client may have asked the same.
        if let Some(known) = self.known(question) {
            return Some(known);
        }
        Some(match question {
            Question::Part(id) => json(self.parts.details(*id)),
            Question::Children { group, from } => json(self.parts.children(*group, *from)),
            Question::Search { text, from } => {
                self.found(self.finder.parts(&self.parts, text, *from, is_given_up), json)?
            }
            Question::Objects { text, from } => {
                self.found(self.finder.objects(text, *from, is_given_up), json)?
            }
            Question::Box { text } => self.found(self.finder.bounds(text, is_given_up), json)?,
            Question::Bounds(objects) => match self.bounds(objects) {
                Ok(bounds) => json(Some(bounds)),
                Err(fault) => self.unread(&fault),
            },
            Question::Rows { text, from } => self.found(self.finder.rows(text, *from, is_given_up), table)?,
            Question::Attributes => self.found(self.finder.attributes(), json)?,
            Question::Classes { attribute, from } => match self.finder.classes(attribute, *from) {
                Ok(None) => plain(StatusCode::NOT_FOUND, "no part has an attribute of this name\n"),
                classes => self.found(classes, json)?,
            },
            Question::Notes(question, person) => self.notes.answer(question, person),
            Question::Snap(pointing) => match pointing.snap(&self.scene) {
                // An empty answer is valid as well.
                Ok(snapped) => json(Some(snapped)),
                Err(fault) => self.unread(&fault),
            },
            Question::Surface(pointing) => match pointing.surface(&self.scene) {
                Ok(surface) => json(Some(surface)),
                Err(fault) => self.unread(&fault),
            },
            Question::Object(pointing) => match pointing.object(&self.scene) {
                Ok(object) => json(Some(object)),
                Err(fault) => self.unread(&fault),
            },
            Question::Clearance(between) => match between.shortest(&self.scene, is_given_up)? {
                Ok(shortest) => json(Some(shortest)),
                Err(fault) => self.unread(&fault),
            },
            Question::Tile { x, z } => match self.heightfield.tile_unless(&self.scene, *x, *z, is_given_up) {
                Ok(made) => {
                    let made = made?;
                    let bytes = Bytes::from(made.to_bytes());
                    // Tiles beside the scene are cheap to make, and endless, so they are not kept.
                    if !made.is_empty() {
                        self.tiles.lock().keep([*x, *z], bytes.clone());
                    }
                    tile(bytes)
                }
                Err(fault) => self.unread(&fault),
            },
        })
    }

    /// The box around most of these objects.
    fn bounds(&self, objects: &ObjectSet) -> Result<Bounds, ReadError> {
        // A page can name numbers that no object has.
        let end = self.scene.objects().len();
        let known = objects.iter().take_while(|object| (*object as usize) < end);
        self.scene.reading(|| Bounds::of_most(&self.scene, known))
    }

    /// The answer to a query, in its form; none if nobody waits for it.
    fn found<T>(
        &self,
        found: Result<T, FindError>,
        form: impl FnOnce(Option<T>) -> Response<Body>,
    ) -> Option<Response<Body>> {
        Some(match found {
            Ok(found) => form(Some(found)),
            Err(FindError::GivenUp) => return None,
            Err(FindError::Read(fault)) => self.unread(&fault),
            Err(fault @ FindError::Wrong(_)) => plain(StatusCode::BAD_REQUEST, format!("{fault}\n")),
            Err(fault @ FindError::Index(_)) => {
                plain(StatusCode::INTERNAL_SERVER_ERROR, format!("{fault}\n"))
            }
        })
    }

    fn unread(&self, fault: &ReadError) -> Response<Body> {
        self.is_told.call_once(|| tracing::warn!("{fault}"));
        plain(StatusCode::INTERNAL_SERVER_ERROR, "the scene's file cannot be read\n")
    }
}

fn tile(bytes: Bytes) -> Response<Body> {
    file("application/octet-stream", bytes)
}

/// Rows of a table. A header has the number of the next row.
fn table(rows: Option<Rows>) -> Response<Body> {
    let Rows { csv, next } = rows.unwrap_or_default();
    let mut response = file("text/csv; charset=utf-8", csv.into());
    if let Some(next) = next {
        response.headers_mut().insert(NEXT_ROW, next.into());
    }
    response
}

fn json(answer: Option<impl Serialize>) -> Response<Body> {
    let Some(answer) = answer else {
        return plain(StatusCode::NOT_FOUND, "the scene has no such part\n");
    };
    match serde_json::to_vec(&answer) {
        Ok(bytes) if bytes.len() <= LONGEST => file("application/json", bytes.into()),
        _ => plain(StatusCode::INTERNAL_SERVER_ERROR, "the answer cannot be written\n"),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use trimaran_cook::{
        CookOptions, Model, cook,
        generate::{PlantOptions, plant},
    };

    use super::*;
    use crate::notes::{Guid, bcf::BcfVersion};

    /// Soon, however many numbers a page sends.
    #[test]
    fn the_box_around_objects_is_that_of_those_in_the_scene() {
        let model: Model = plant(&PlantOptions::small(7));
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let notes = NotesFolder::new(PathBuf::from("none"), false);
        let answers = Answers::new(&scene, notes, 1.7).unwrap();
        let bounds = |pairs: &str| answers.bounds(&serde_json::from_str(pairs).unwrap()).unwrap();
        let two = Bounds::of_most(&scene, [2, 5]);
        assert_eq!(bounds("[[2,0],[1,0]]"), two);
        assert_eq!(bounds("[[2,0],[1,0],[4000000000,9]]"), two);
        let all = Bounds::of_most(&scene, 0..scene.objects().len() as u32);
        assert_eq!(bounds("[[0,4294967000]]"), all);
        assert_ne!(two, all);
    }

    #[test]
    fn questions_are_read_from_path_and_query() {
        let person = Person { name: None, may_write: false };
        let ask = |path: &str, query: &str| {
            Question::parse(path, form_urlencoded::parse(query.as_bytes()), person.clone())
        };
        assert_eq!(ask("/part", "token=x&object=7"), Some(Question::Part(PartId::Object(7))));
        assert_eq!(ask("/part", "group=0"), Some(Question::Part(PartId::Group(0))));
        let children = |group, from| Some(Question::Children { group, from });
        assert_eq!(ask("/children", "from=0"), children(None, 0));
        assert_eq!(ask("/children", "group=3&from=500"), children(Some(3), 500));
        let search = |text: &str, from| Some(Question::Search { text: text.to_owned(), from });
        assert_eq!(ask("/search", "text=P-101%20A%26B"), search("P-101 A&B", 0));
        assert_eq!(ask("/search", "from=100&text=P"), search("P", 100));
        let text = || "P=5".to_owned();
        assert_eq!(ask("/objects", "text=P%3D5&from=7"), Some(Question::Objects { text: text(), from: 7 }));
        assert_eq!(ask("/rows", "text=P%3D5"), Some(Question::Rows { text: text(), from: 0 }));
        assert_eq!(ask("/box", "text=P%3D5"), Some(Question::Box { text: text() }));
        assert_eq!(ask("/attributes", ""), Some(Question::Attributes));
        let classes = Question::Classes { attribute: "Line Size".to_owned(), from: 9 };
        assert_eq!(ask("/classes", "attribute=Line%20Size&from=9"), Some(classes));
        assert_eq!(ask("/tile", "x=-3&z=0"), Some(Question::Tile { x: -3, z: 0 }));
        let known = || "x".to_owned();
        let notes = |question| Some(Question::Notes(question, person.clone()));
        assert_eq!(ask("/notes", "known=x"), notes(NotesQuestion::List { known: known() }));
        let guid: Guid = "84d4a28c-0638-4813-aa4b-bcd62fe5fc93".parse().unwrap();
        assert_eq!(
            ask("/note", &format!("guid={guid}&key=x")),
            notes(NotesQuestion::One { guid, key: known() })
        );
        assert_eq!(
            ask("/notes.bcf", "version=2.1"),
            notes(NotesQuestion::Export { version: BcfVersion::V2 })
        );
        for (path, query) in [
            ("/note", "guid=../x"),
            ("/note-picture", ""),
            ("/notes.bcf", "version=2.0"),
            ("/part", ""),
            ("/part", "object=-1"),
            ("/part", "group=x&object=1"),
            ("/children", "group=4294967296"),
            ("/search", ""),
            ("/objects", "text=P&from=4294967296"),
            ("/objects", "from=1"),
            ("/rows", "text=P&from=-1"),
            ("/classes", "from=1"),
            ("/tile", "x=1"),
            ("/else", "x=1&z=1"),
        ] {
            assert_eq!(ask(path, query), None, "{path}?{query}");
        }
    }
}
