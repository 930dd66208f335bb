//! A note: a comment with the view that it is about, and the replies to it.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_proto::{SectionBox, SectionPlane};

use super::{Date, Guid, SnapshotKind};

/// The most bytes of a title, of a name, and of a text.
pub(super) const LONGEST_TITLE: usize = 1000;
pub(super) const LONGEST_NAME: usize = 256;
pub(super) const LONGEST_TEXT: usize = 64 << 10;
/// The most replies, views, sections of a view, and parts in one of its lists.
const REPLIES: usize = 1000;
const VIEWS: usize = 64;
const SECTIONS: usize = 64;
pub(super) const PARTS: usize = 10_000;
/// The most labels, links, related topics and files of a topic.
const SHORT: usize = 200;
/// The farthest distance from the origin, metres.
const FARTHEST: f64 = 1e15;

/// A note. Lengths are metres, and places are in the scene's frame, with y up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Note {
    /// Identifies it, in BCF too.
    pub guid: Guid,
    /// The first line.
    pub title: String,
    /// The other lines.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub text: String,
    /// The name of the person who wrote it.
    pub author: String,
    /// The time of writing.
    pub date: Date,
    /// Whether there is something left to do.
    pub status: Status,
    /// The place that it is about.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point: Option<[f64; 3]>,
    /// The views that it is about. The first one is shown.
    #[serde(default)]
    pub views: Vec<View>,
    /// The replies to it, the oldest first.
    #[serde(default)]
    pub replies: Vec<Reply>,
    /// Proves who may delete it; nobody if it was imported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<Owner>,
    /// The rest of a BCF topic.
    #[serde(default)]
    pub topic: Topic,
}

/// Whether there is something left to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// Yes.
    Open,
    /// No.
    Closed,
}

/// The person who may delete a note.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Owner {
    /// One whom the service knows by this name.
    Name(String),
    /// One whose browser has the key with this SHA-256, in hexadecimal.
    Key(String),
}

/// A reply to a note.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Reply {
    /// Identifies it.
    pub guid: Guid,
    /// The name of the person who wrote it.
    pub author: String,
    /// The time of writing.
    pub date: Date,
    /// The reply.
    pub text: String,
    /// The view that it is about.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<Guid>,
}

/// A view of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct View {
    /// Identifies it.
    pub guid: Guid,
    /// Where from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// The sections that cut parts away. A view shows six at most.
    #[serde(default)]
    pub sections: Vec<Section>,
    /// The parts that it is about.
    #[serde(default)]
    pub selected: Vec<PartRef>,
    /// The parts that are shown.
    #[serde(default)]
    pub visibility: Visibility,
    /// The parts that are see-through, if not those of the model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub see_through: Option<Vec<PartRef>>,
    /// The kind of its picture, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub snapshot: Option<SnapshotKind>,
}

/// A camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Camera {
    /// The eye.
    pub eye: [f64; 3],
    /// The viewing direction, of any length.
    pub forward: [f64; 3],
    /// The direction that is up in the picture.
    pub up: [f64; 3],
    /// How much it shows.
    #[serde(flatten)]
    pub lens: Lens,
    /// The picture's width, in heights.
    pub aspect: f64,
}

/// How much a camera shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub enum Lens {
    /// A perspective one: the vertical field of view, degrees.
    VfovDeg(f64),
    /// An orthogonal one: the height of what it shows, metres.
    Height(f64),
}

/// Cuts a part of the scene away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase", tag = "kind")]
pub enum Section {
    /// One side of a plane.
    Plane {
        /// A point of the plane.
        point: [f64; 3],
        /// Towards the side that is cut away.
        direction: [f64; 3],
    },
    /// The outside of a box.
    Box {
        /// Its lower corner.
        lower: [f64; 3],
        /// Its upper corner.
        upper: [f64; 3],
    },
}

/// A part of a model, as BCF names it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct PartRef {
    /// Its `IfcGuid`, 22 characters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ifc_guid: Option<String>,
    /// The program that knows it by `id`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub system: Option<String>,
    /// Its name in that program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
}

/// The parts that are shown.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Visibility {
    /// Whether all others are.
    pub default: bool,
    /// The parts for which it is the other way round.
    pub exceptions: Vec<PartRef>,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { default: true, exceptions: Vec::new() }
    }
}

/// All else that BCF says of a topic. It is kept, and goes back to the tool that wrote it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Topic {
    /// `TopicType`.
    pub kind: Option<String>,
    /// `TopicStatus`, which may say more than open or closed.
    pub status: Option<String>,
    /// `ServerAssignedId`.
    pub server_id: Option<String>,
    /// `Priority`.
    pub priority: Option<String>,
    /// `Index`.
    pub index: Option<i32>,
    /// `Labels`.
    pub labels: Vec<String>,
    /// `ReferenceLinks`.
    pub links: Vec<String>,
    /// `ModifiedDate`.
    pub modified: Option<Date>,
    /// `ModifiedAuthor`.
    pub modified_by: Option<String>,
    /// `DueDate`.
    pub due: Option<Date>,
    /// `AssignedTo`.
    pub assigned_to: Option<String>,
    /// `Stage`.
    pub stage: Option<String>,
    /// `RelatedTopics`.
    pub related: Vec<Guid>,
    /// The files of the `Header`.
    pub files: Vec<HeaderFile>,
}

/// A file that a BCF topic is about.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct HeaderFile {
    /// `IfcProject`.
    pub project: Option<String>,
    /// `IfcSpatialStructureElement`.
    pub element: Option<String>,
    /// `IsExternal`.
    pub is_external: Option<bool>,
    /// `Filename`.
    pub name: Option<String>,
    /// `Date`.
    pub date: Option<Date>,
    /// `Reference`.
    pub reference: Option<String>,
}

/// Why a note cannot be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NoteFault {
    /// A text that is needed has nothing in it.
    #[error("{0} is empty")]
    Empty(&'static str),
    /// A text is too long.
    #[error("{0} has more than {1} bytes")]
    Long(&'static str, usize),
    /// A text has characters that XML cannot have.
    #[error("{0} has control characters")]
    Control(&'static str),
    /// A list is too long.
    #[error("there are more than {1} {0}")]
    Many(&'static str, usize),
    /// Two have the same GUID.
    #[error("two {0} have the same GUID")]
    Twice(&'static str),
    /// Numbers are no place, no direction or no field of view.
    #[error("{0} is not valid")]
    Number(&'static str),
}

impl Note {
    /// Checks the sizes of all that it has, and its numbers.
    ///
    /// # Errors
    /// The first fault.
    pub fn check(&self) -> Result<(), NoteFault> {
        filled("the title", &self.title, LONGEST_TITLE)?;
        short("the text", &self.text, LONGEST_TEXT)?;
        filled("the author", &self.author, LONGEST_NAME)?;
        if !self.point.is_none_or(is_place) {
            return Err(NoteFault::Number("the point"));
        }
        most("replies", self.replies.len(), REPLIES)?;
        for reply in &self.replies {
            filled("the author of a reply", &reply.author, LONGEST_NAME)?;
            short("a reply", &reply.text, LONGEST_TEXT)?;
        }
        most("views", self.views.len(), VIEWS)?;
        self.views.iter().try_for_each(View::check)?;
        let views: BTreeSet<Guid> = self.views.iter().map(|view| view.guid).collect();
        if views.len() < self.views.len() {
            return Err(NoteFault::Twice("views"));
        }
        self.topic.check()
    }
}

impl View {
    fn check(&self) -> Result<(), NoteFault> {
        if !self.camera.as_ref().is_none_or(Camera::is_sound) {
            return Err(NoteFault::Number("the camera"));
        }
        most("sections", self.sections.len(), SECTIONS)?;
        if !self.sections.iter().all(Section::is_sound) {
            return Err(NoteFault::Number("a section"));
        }
        let see_through = self.see_through.as_deref().unwrap_or_default();
        for parts in [&self.selected, &self.visibility.exceptions, see_through] {
            most("parts in a list", parts.len(), PARTS)?;
            for text in parts.iter().flat_map(|part| [&part.ifc_guid, &part.system, &part.id]).flatten() {
                short("the name of a part", text, LONGEST_TEXT)?;
            }
        }
        Ok(())
    }
}

impl Camera {
    fn is_sound(&self) -> bool {
        let Self { eye, forward, up, lens, aspect } = *self;
        let is_lens = match lens {
            Lens::VfovDeg(degrees) => degrees > 0.0 && degrees < 180.0,
            Lens::Height(metres) => metres > 0.0 && metres <= FARTHEST,
        };
        is_place(eye)
            && is_direction(forward)
            && is_direction(up)
            && is_lens
            && (1e-3..=1e3).contains(&aspect)
    }
}

impl Section {
    fn is_sound(&self) -> bool {
        match *self {
            Self::Plane { point, direction } => {
                is_place(point) && is_direction(direction) && SectionPlane::new(point, direction).is_ok()
            }
            Self::Box { lower, upper } => {
                is_place(lower) && is_place(upper) && SectionBox::new(lower, upper).is_ok()
            }
        }
    }
}

impl Topic {
    fn check(&self) -> Result<(), NoteFault> {
        let Self { labels, links, related, files, .. } = self;
        for (what, count) in [
            ("labels", labels.len()),
            ("links", links.len()),
            ("files", files.len()),
            ("topics", related.len()),
        ] {
            most(what, count, SHORT)?;
        }
        let own = [&self.kind, &self.status, &self.server_id, &self.priority, &self.modified_by];
        let more = [&self.assigned_to, &self.stage];
        let of_files =
            files.iter().flat_map(|file| [&file.project, &file.element, &file.name, &file.reference]);
        let mut texts = own.into_iter().chain(more).chain(of_files).flatten().chain(labels).chain(links);
        texts.try_for_each(|text| short("a text of the topic", text, LONGEST_TEXT))
    }
}

fn is_place(point: [f64; 3]) -> bool {
    point.iter().all(|x| x.abs() <= FARTHEST)
}

fn is_direction(direction: [f64; 3]) -> bool {
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    (1e-6..=1e6).contains(&length)
}

fn most(what: &'static str, count: usize, most: usize) -> Result<(), NoteFault> {
    if count > most { Err(NoteFault::Many(what, most)) } else { Ok(()) }
}

fn filled(what: &'static str, text: &str, most: usize) -> Result<(), NoteFault> {
    if text.trim().is_empty() {
        return Err(NoteFault::Empty(what));
    }
    short(what, text, most)
}

fn short(what: &'static str, text: &str, most: usize) -> Result<(), NoteFault> {
    if text.len() > most {
        Err(NoteFault::Long(what, most))
    } else if !text.chars().all(is_character) {
        Err(NoteFault::Control(what))
    } else {
        Ok(())
    }
}

/// Whether XML 1.0 (production 2) can have it, and keeps it: carriage returns become line feeds.
fn is_character(c: char) -> bool {
    matches!(c, '\t' | '\n' | '\u{20}'..='\u{fffd}' | '\u{10000}'..)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::{super::guid::tests::guid, *};

    /// A note with a bit of everything.
    pub(crate) fn full(number: u128) -> Note {
        let part = |id: &str| PartRef {
            ifc_guid: None,
            system: Some("Trimaran".to_owned()),
            id: Some(id.to_owned()),
        };
        let date = |text: &str| text.parse::<Date>().unwrap();
        let view = View {
            guid: guid(number + 1),
            camera: Some(Camera {
                eye: [1.5, -2.25, 1e3],
                forward: [0.6, 0.0, -0.8],
                up: [0.0, 1.0, 0.0],
                lens: Lens::VfovDeg(60.0),
                aspect: 1.5,
            }),
            sections: vec![
                Section::Plane { point: [0.0, 30.0, 0.0], direction: [0.0, 1.0, 0.0] },
                Section::Box { lower: [-1.0, -2.0, -3.0], upper: [4.0, 5.0, 6.0] },
            ],
            selected: vec![part("plant.RVM>/ZONE-1>PIPE[2]")],
            visibility: Visibility { default: true, exceptions: vec![part("plant.RVM>/ZONE-2")] },
            see_through: None,
            snapshot: None,
        };
        Note {
            guid: guid(number),
            title: "Flange <leaks> & drips".to_owned(),
            text: "Second line.\n\"Third\"".to_owned(),
            author: "Ada L.".to_owned(),
            date: date("2026-11-30T13:05:00Z"),
            status: Status::Open,
            point: Some([1.0, 2.0, -3.5]),
            views: vec![view],
            replies: vec![Reply {
                guid: guid(number + 2),
                author: "Bob".to_owned(),
                date: date("2026-12-01T08:00:00Z"),
                text: "Seen.".to_owned(),
                view: Some(guid(number + 1)),
            }],
            owner: Some(Owner::Name("Ada L.".to_owned())),
            topic: Topic::default(),
        }
    }

    #[test]
    fn a_note_is_read_as_it_was_written() {
        let note = full(7 << 100);
        let json = serde_json::to_string_pretty(&note).unwrap();
        assert_eq!(serde_json::from_str::<Note>(&json).unwrap(), note, "{json}");
        assert!(json.contains("\"vfovDeg\": 60.0") && json.contains("\"kind\": \"box\""), "{json}");
    }

    #[test]
    fn what_no_page_and_no_xml_can_show_is_refused() {
        let note = full(1);
        assert_eq!(note.check(), Ok(()));
        let with = |change: &dyn Fn(&mut Note)| {
            let mut changed = note.clone();
            change(&mut changed);
            changed.check()
        };
        assert_eq!(with(&|note| note.title = " \n".to_owned()), Err(NoteFault::Empty("the title")));
        assert_eq!(with(&|note| note.author.clear()), Err(NoteFault::Empty("the author")));
        assert_eq!(with(&|note| note.text = "a\u{1b}[2J".to_owned()), Err(NoteFault::Control("the text")));
        assert_eq!(with(&|note| note.title = "a\u{ffff}".to_owned()), Err(NoteFault::Control("the title")));
        assert_eq!(
            with(&|note| note.text = "x".repeat(LONGEST_TEXT + 1)),
            Err(NoteFault::Long("the text", LONGEST_TEXT))
        );
        assert_eq!(
            with(&|note| note.replies = vec![note.replies[0].clone(); REPLIES + 1]),
            Err(NoteFault::Many("replies", REPLIES))
        );
        assert_eq!(with(&|note| note.views = vec![note.views[0].clone(); 2]), Err(NoteFault::Twice("views")));
        assert_eq!(
            with(&|note| note.views[0].selected = vec![PartRef::default(); PARTS + 1]),
            Err(NoteFault::Many("parts in a list", PARTS))
        );
        assert_eq!(with(&|note| note.point = Some([1e300, 0.0, 0.0])), Err(NoteFault::Number("the point")));
        let camera =
            |change: &dyn Fn(&mut Camera)| with(&|note| change(note.views[0].camera.as_mut().unwrap()));
        for wrong in [
            camera(&|camera| camera.eye[1] = f64::NAN),
            camera(&|camera| camera.forward = [0.0; 3]),
            camera(&|camera| camera.up = [1e200, 0.0, 0.0]),
            camera(&|camera| camera.lens = Lens::VfovDeg(180.0)),
            camera(&|camera| camera.lens = Lens::VfovDeg(0.0)),
            camera(&|camera| camera.lens = Lens::Height(0.0)),
            camera(&|camera| camera.lens = Lens::Height(-1.0)),
            camera(&|camera| camera.lens = Lens::Height(2.0 * FARTHEST)),
            camera(&|camera| camera.aspect = 0.0),
            camera(&|camera| camera.aspect = 1001.0),
        ] {
            assert_eq!(wrong, Err(NoteFault::Number("the camera")));
        }
        // Just within the limits.
        for right in [
            with(&|note| note.title = "x".repeat(1000)),
            with(&|note| note.author = "x".repeat(256)),
            with(&|note| note.text = "\t\u{fffd}\u{10000}".to_owned()),
            with(&|note| note.replies = vec![note.replies[0].clone(); 1000]),
            with(&|note| note.views[0].sections = vec![note.views[0].sections[0]; 64]),
            with(&|note| note.point = Some([1e15, -1e15, 0.0])),
            camera(&|camera| camera.forward = [0.0, 2e-6, 0.0]),
            camera(&|camera| camera.lens = Lens::VfovDeg(179.9)),
            camera(&|camera| camera.lens = Lens::Height(1e15)),
            camera(&|camera| camera.aspect = 1000.0),
            camera(&|camera| camera.aspect = 1e-3),
        ] {
            assert_eq!(right, Ok(()));
        }
        let too_many = with(&|note| note.views[0].sections = vec![note.views[0].sections[0]; 65]);
        assert_eq!(too_many, Err(NoteFault::Many("sections", 64)));
        assert_eq!(
            with(&|note| note.topic.labels = vec![String::new(); 201]),
            Err(NoteFault::Many("labels", 200))
        );
        let stage = with(&|note| note.topic.stage = Some("\u{1b}".to_owned()));
        assert_eq!(stage, Err(NoteFault::Control("a text of the topic")));
        let section = |section| with(&|note| note.views[0].sections = vec![section]);
        for wrong in [
            Section::Plane { point: [0.0; 3], direction: [0.0; 3] },
            Section::Box { lower: [0.0; 3], upper: [1.0, 0.0, 1.0] },
        ] {
            assert_eq!(section(wrong), Err(NoteFault::Number("a section")));
        }
    }
}
