//! Notes for pages: the list of them, one with its view, and what people write.

use std::{borrow::Cow, sync::Arc, time::SystemTime};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use hyper::{Response, StatusCode, body::Bytes};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use trimaran_proto::{ObjectSet, Sections};
use trimaran_scene::{Hierarchy, ReadError, Scene};
use trimaran_transport::causes;
use xxhash_rust::xxh3::xxh3_128;

use super::{
    server::{Body, file, plain},
    tokens::PersonName,
};
use crate::notes::{
    Camera, Date, Frame, Guid, Lens, Note, NotesError, NotesFolder, Owner, Reply, SceneParts, Section,
    Snapshot, SnapshotKind, Status, Topic, View, Visibility,
    bcf::{self, BcfVersion, import},
};

/// The longest message of a page, bytes: a note with its picture.
pub(super) const LONGEST_NOTE: usize = 4 << 20;
/// The longest BCF file that a page sends or gets.
pub(super) const LONGEST_BCF: usize = 32 << 20;
/// The most bytes of a text in the list.
const START: usize = 300;
/// The longest key of a browser.
const LONGEST_KEY: usize = 128;

/// A scene's notes, and the parts that they name.
#[derive(Debug)]
pub(super) struct Notes {
    folder: NotesFolder,
    parts: SceneParts,
    frame: Frame,
}

/// A person who reads and writes notes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Person {
    /// The name that the service knows.
    pub(super) name: Option<PersonName>,
    /// Whether the token lets its holder write.
    pub(super) may_write: bool,
}

/// A question about notes, or a change of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NotesQuestion {
    /// All, unless the page has the list of this tag.
    List { known: String },
    /// One, for the browser that has this key.
    One { guid: Guid, key: String },
    /// The picture of a note.
    Picture { guid: Guid },
    /// A change of a person's. Its text and its view get these GUIDs.
    Change { body: Bytes, fresh: [Guid; 2] },
    /// All as BCF.
    Export { version: BcfVersion },
    /// Those in a BCF file.
    Import { body: Bytes },
}

/// A change that a page sends.
#[derive(Debug, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase")]
enum Change {
    Write(Box<Written>),
    Reply { guid: Guid, text: String, author: String },
    Status { guid: Guid, status: Status },
    Delete { guid: Guid, key: String },
}

/// A note as a page sends it.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Written {
    text: String,
    /// The name that the person gives, if the service knows none.
    author: String,
    key: String,
    point: Option<[f64; 3]>,
    eye: [f64; 3],
    forward: [f64; 3],
    up: [f64; 3],
    #[serde(flatten)]
    lens: Lens,
    aspect: f64,
    sections: Vec<Section>,
    selected: ObjectSet,
    hidden: ObjectSet,
    /// If set, only these are shown, and `hidden` is empty.
    isolated: Option<ObjectSet>,
    /// If not those of the model.
    see_through: Option<ObjectSet>,
    /// PNG or JPEG, in base64.
    picture: Option<String>,
}

/// The list that a page gets.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct List<'l> {
    tag: &'l str,
    may_write: bool,
    you: Option<&'l PersonName>,
    damaged: &'l [String],
    notes: Vec<Summary<'l>>,
}

/// A note in the list.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Summary<'n> {
    guid: Guid,
    title: &'n str,
    text: &'n str,
    author: &'n str,
    date: &'n Date,
    status: Status,
    point: Option<[f64; 3]>,
    reply_count: usize,
}

/// A note with all that it has.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Whole<'n> {
    #[serde(flatten)]
    summary: Summary<'n>,
    replies: &'n [Reply],
    is_own: bool,
    has_picture: bool,
    view: Option<Seen>,
}

/// A view as a page can show it.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Seen {
    camera: Option<Camera>,
    sections: Vec<Section>,
    selected: ObjectSet,
    hidden: ObjectSet,
    isolated: Option<ObjectSet>,
    see_through: Option<ObjectSet>,
    /// How many sections and parts are left out: a view has few sections, and a scene not all parts.
    left_out: usize,
}

impl NotesQuestion {
    /// Parses a path and the values of a query; `None` if they are no question.
    pub(super) fn parse<'q>(path: &str, value: impl Fn(&str) -> Option<Cow<'q, str>>) -> Option<Self> {
        let guid = || value("guid")?.parse().ok();
        let text = |name| value(name).map(Cow::into_owned).unwrap_or_default();
        Some(match path {
            "/notes" => Self::List { known: text("known") },
            "/note" => Self::One { guid: guid()?, key: text("key") },
            "/note-picture" => Self::Picture { guid: guid()? },
            "/notes.bcf" => Self::Export { version: value("version")?.parse().ok()? },
            _ => return None,
        })
    }
}

impl Notes {
    pub(super) fn new(
        folder: NotesFolder,
        scene: &Arc<Scene>,
        hierarchy: &Arc<Hierarchy>,
    ) -> Result<Self, ReadError> {
        Ok(Self { folder, parts: SceneParts::new(scene, hierarchy), frame: Frame::of(scene)? })
    }

    pub(super) fn answer(&self, question: &NotesQuestion, person: &Person) -> Response<Body> {
        let may_write = person.may_write && self.folder.may_write();
        let answered = match question {
            NotesQuestion::List { known } => self.list(known, person, may_write),
            NotesQuestion::One { guid, key } => self.one(*guid, key, person),
            NotesQuestion::Picture { guid } => self.picture(*guid),
            NotesQuestion::Export { version } => self.export(*version),
            NotesQuestion::Change { .. } | NotesQuestion::Import { .. } if !may_write => {
                Err(NotesError::ReadOnly.into())
            }
            NotesQuestion::Change { body, fresh } => self.change(body, *fresh, person),
            NotesQuestion::Import { body } => self.import(body),
        };
        answered.unwrap_or_else(|Refusal(status, why)| {
            let mut response = file("text/plain; charset=utf-8", why.into());
            *response.status_mut() = status;
            response
        })
    }

    fn list(&self, known: &str, person: &Person, may_write: bool) -> Answered {
        let held = self.folder.all()?;
        let list = |tag| List {
            tag,
            may_write,
            you: person.name.as_ref(),
            damaged: &held.damaged,
            notes: held.notes.iter().map(|note| Summary::of(note)).collect(),
        };
        let tag = format!("{:032x}", xxh3_128(&serde_json::to_vec(&list(""))?));
        if tag == known { Ok(plain(StatusCode::NO_CONTENT, "")) } else { json(&list(&tag)) }
    }

    fn one(&self, guid: Guid, key: &str, person: &Person) -> Answered {
        let note = self.folder.get(guid)?;
        let view = note.views.first();
        json(&Whole {
            summary: Summary { text: &note.text, ..Summary::of(&note) },
            replies: &note.replies,
            is_own: is_own(&note, key, person),
            has_picture: view.is_some_and(|view| view.snapshot.is_some()),
            view: view.map(|view| self.seen(view)),
        })
    }

    fn seen(&self, view: &View) -> Seen {
        let mut left_out = view.sections.len().saturating_sub(Sections::MOST);
        let mut found = |parts: &[_]| {
            let (objects, missing) = self.parts.found(parts);
            left_out += missing;
            objects
        };
        let selected = found(&view.selected);
        let see_through = view.see_through.as_deref().map(&mut found);
        let exceptions = found(&view.visibility.exceptions);
        // Where no part is there, all of the model is more than nothing.
        let (hidden, isolated) = if view.visibility.default {
            (exceptions, None)
        } else {
            (ObjectSet::default(), Some(exceptions).filter(|only| !only.is_empty()))
        };
        let sections = view.sections.iter().take(Sections::MOST).copied().collect();
        Seen { camera: view.camera, sections, selected, hidden, isolated, see_through, left_out }
    }

    fn picture(&self, guid: Guid) -> Answered {
        let note = self.folder.get(guid)?;
        let of_view = note.views.first().and_then(|view| Some((view.guid, view.snapshot?)));
        let (view, kind) = of_view.ok_or(NotesError::Missing)?;
        Ok(file(kind.media_type(), self.folder.snapshot(guid, view, kind)?.bytes.into()))
    }

    fn change(&self, body: &[u8], fresh: [Guid; 2], person: &Person) -> Answered {
        let change = serde_json::from_slice(body);
        let change = change.map_err(|_| Refusal(StatusCode::BAD_REQUEST, "that is no note".to_owned()))?;
        let named = |given: String| person.name.as_ref().map_or(given, |name| name.as_str().to_owned());
        let date = Date::of(now());
        let guid = match change {
            Change::Write(written) => {
                let [guid, view] = fresh;
                let snapshot =
                    written.picture.as_deref().map(|picture| snapshot(picture, view)).transpose()?;
                let note = self.note(*written, [guid, view], snapshot.as_ref(), date, person)?;
                self.folder.add(&note, snapshot.as_slice())?;
                guid
            }
            Change::Reply { guid, text, author } => {
                if text.trim().is_empty() {
                    return Err(Refusal(StatusCode::BAD_REQUEST, "the reply is empty".to_owned()));
                }
                let [own, _] = fresh;
                let reply = Reply { guid: own, author: named(author), date, text: lines(&text), view: None };
                self.folder.change(guid, |note| note.replies.push(reply))?;
                guid
            }
            Change::Status { guid, status } => {
                self.folder.change(guid, |note| {
                    note.status = status;
                    note.topic.modified = Some(date);
                    note.topic.modified_by = person.name.as_ref().map(|name| name.as_str().to_owned());
                })?;
                guid
            }
            Change::Delete { guid, key } => {
                self.folder.delete(guid, |note| is_own(note, &key, person))?;
                guid
            }
        };
        json(&guid)
    }

    fn note(
        &self,
        written: Written,
        [guid, view]: [Guid; 2],
        snapshot: Option<&Snapshot>,
        date: Date,
        person: &Person,
    ) -> Result<Note, Refusal> {
        let Written { point, eye, forward, up, lens, aspect, sections, .. } = written;
        let named = |objects: &ObjectSet| {
            self.parts
                .named(objects)
                .map_err(|error| Refusal(StatusCode::PAYLOAD_TOO_LARGE, error.to_string()))
        };
        let visibility = match &written.isolated {
            Some(only) => Visibility { default: false, exceptions: named(only)? },
            None => Visibility { default: true, exceptions: named(&written.hidden)? },
        };
        let view = View {
            guid: view,
            camera: Some(Camera { eye, forward, up, lens, aspect }),
            sections,
            selected: named(&written.selected)?,
            visibility,
            see_through: written.see_through.as_ref().map(named).transpose()?,
            snapshot: snapshot.map(|snapshot| snapshot.kind),
        };
        let text = lines(written.text.trim());
        let (title, text) = text.split_once('\n').unwrap_or((&text, ""));
        let (author, owner) = match &person.name {
            Some(name) => (name.as_str().to_owned(), Owner::Name(name.as_str().to_owned())),
            None => (written.author, Owner::Key(hash(&written.key))),
        };
        Ok(Note {
            guid,
            title: title.to_owned(),
            text: text.to_owned(),
            author,
            date,
            status: Status::Open,
            point,
            views: vec![view],
            replies: Vec::new(),
            owner: Some(owner),
            topic: Topic::default(),
        })
    }

    fn export(&self, version: BcfVersion) -> Answered {
        let held = self.folder.all()?;
        let pictures =
            |note: &Note, view: &View| self.folder.snapshot(note.guid, view.guid, view.snapshot?).ok();
        let told = |parts: &[_]| self.parts.for_others(parts);
        let bytes = bcf::export(&held.notes, version, &self.frame, &pictures, &told);
        let bytes = bytes.map_err(|error| Refusal(StatusCode::INTERNAL_SERVER_ERROR, causes(&error)))?;
        if bytes.len() > LONGEST_BCF {
            let why = "these notes are too large for a page: `trimaran notes --export` writes them";
            return Err(Refusal(StatusCode::PAYLOAD_TOO_LARGE, why.to_owned()));
        }
        Ok(file("application/octet-stream", bytes.into()))
    }

    fn import(&self, body: &[u8]) -> Answered {
        let imported = import(body, &self.frame);
        let imported = imported.map_err(|error| Refusal(StatusCode::BAD_REQUEST, causes(&error)))?;
        let count = imported.notes.len();
        let left_out = imported.keep(&self.folder, &self.parts)?;
        json(&serde_json::json!({ "notes": count, "leftOut": left_out }))
    }
}

impl<'n> Summary<'n> {
    fn of(note: &'n Note) -> Self {
        let Note { guid, title, text, author, date, status, point, replies, .. } = note;
        let text = text.get(..text.floor_char_boundary(START)).unwrap_or(text);
        let (guid, status, point, reply_count) = (*guid, *status, *point, replies.len());
        Summary { guid, title, text, author, date, status, point, reply_count }
    }
}

/// An answer, or a refusal: a status and a sentence.
type Answered = Result<Response<Body>, Refusal>;

#[derive(Debug)]
struct Refusal(StatusCode, String);

impl From<NotesError> for Refusal {
    fn from(error: NotesError) -> Self {
        let status = match &error {
            NotesError::Missing => StatusCode::NOT_FOUND,
            NotesError::Foreign | NotesError::ReadOnly => StatusCode::CONFLICT,
            NotesError::Note(_) => StatusCode::BAD_REQUEST,
            NotesError::Full => StatusCode::INSUFFICIENT_STORAGE,
            _ => {
                tracing::info!("{}", causes(&error));
                StatusCode::INTERNAL_SERVER_ERROR
            }
        };
        Self(status, causes(&error))
    }
}

impl From<serde_json::Error> for Refusal {
    fn from(error: serde_json::Error) -> Self {
        Self(StatusCode::INTERNAL_SERVER_ERROR, error.to_string())
    }
}

fn json(answer: &impl Serialize) -> Answered {
    Ok(file("application/json", serde_json::to_vec(answer)?.into()))
}

/// The picture that a page has sent.
fn snapshot(picture: &str, view: Guid) -> Result<Snapshot, Refusal> {
    let bytes = STANDARD.decode(picture).ok();
    let known = bytes.and_then(|bytes| Some((SnapshotKind::of(&bytes)?, bytes)));
    let (kind, bytes) =
        known.ok_or_else(|| Refusal(StatusCode::BAD_REQUEST, "that is no picture".to_owned()))?;
    Ok(Snapshot { view, kind, bytes })
}

/// Whether a person may delete a note.
fn is_own(note: &Note, key: &str, person: &Person) -> bool {
    match &note.owner {
        Some(Owner::Name(name)) => person.name.as_ref().is_some_and(|person| person.as_str() == name),
        Some(Owner::Key(sha256)) => !key.is_empty() && key.len() <= LONGEST_KEY && hash(key) == *sha256,
        None => false,
    }
}

/// A note's file has no key, so that its reader cannot delete it.
fn hash(key: &str) -> String {
    format!("{:x}", Sha256::digest(key.as_bytes()))
}

/// The text with line feeds alone between its lines.
fn lines(text: &str) -> String {
    text.replace("\r\n", "\n").replace('\r', "\n")
}

#[expect(clippy::disallowed_methods, reason = "a note has a date")]
fn now() -> SystemTime {
    SystemTime::now()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    /// The lens of a note that a page sends with this field.
    fn lens(field: &str, value: Value) -> Option<Lens> {
        let mut note = json!({
            "do": "write", "text": "a", "author": "Eve", "key": "k", "point": null, "eye": [0, 1, 2],
            "forward": [0, 0, -1], "up": [0, 1, 0], "aspect": 1.5, "sections": [], "selected": [[1, 0]],
            "hidden": [], "isolated": null, "seeThrough": null, "picture": null,
        });
        note[field] = value;
        match serde_json::from_value(note).ok()? {
            Change::Write(written) => Some(written.lens),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_page_sends_a_field_of_view_or_the_height_of_a_parallel_view() {
        assert_eq!(lens("vfovDeg", json!(60)), Some(Lens::VfovDeg(60.0)));
        assert_eq!(lens("height", json!(2.5)), Some(Lens::Height(2.5)));
        assert_eq!(lens("vfovDeg", json!("wide")), None);
        assert_eq!(lens("other", json!(60)), None);
    }
}
