//! Pages' questions outside their links: a scene's parts, and its heightfield.

use std::{
    borrow::Cow,
    sync::{Arc, Once},
};

use hyper::{Response, StatusCode, body::Bytes};
use parking_lot::Mutex;
use serde::Serialize;
use trimaran_scene::{ReadError, Scene, heightfield::Heightfield};

use super::{
    parts::{PartId, Parts},
    server::{Body, file, plain},
    snap::Pointing,
    tiles::Tiles,
};

/// The most bytes of an answer. Longer ones are cut: see [`Parts`] and [`Heightfield::SPANS`].
const LONGEST: usize = 1 << 20;

/// A question about a scene that takes a moment to answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Question {
    Part(PartId),
    Children { group: Option<u32>, from: usize },
    Search { text: String, from: usize },
    Snap(Pointing),
    Tile { x: i32, z: i32 },
}

/// Answers questions.
#[derive(Debug)]
pub(super) struct Answers {
    scene: Arc<Scene>,
    parts: Parts,
    heightfield: Heightfield,
    tiles: Mutex<Tiles>,
    /// A damaged scene stays damaged, so the error is logged once.
    is_told: Once,
}

impl Question {
    /// Parses a path and the names and values of a query; `None` if they are no question.
    pub(super) fn parse<'q>(
        path: &str,
        query: impl IntoIterator<Item = (Cow<'q, str>, Cow<'q, str>)>,
    ) -> Option<Self> {
        let query: Vec<_> = query.into_iter().collect();
        let value = |name: &str| query.iter().find(|(known, _)| known == name).map(|(_, value)| &**value);
        let from = || value("from").map(str::parse).transpose().ok().map(Option::unwrap_or_default);
        Some(match path {
            "/part" => Self::Part(match value("group") {
                Some(group) => PartId::Group(group.parse().ok()?),
                None => PartId::Object(value("object")?.parse().ok()?),
            }),
            "/children" => {
                Self::Children { group: value("group").map(str::parse).transpose().ok()?, from: from()? }
            }
            "/search" => Self::Search { text: value("text")?.to_owned(), from: from()? },
            "/snap" => Self::Snap(Pointing::parse(|name| value(name).map(Cow::Borrowed))?),
            "/tile" => Self::Tile { x: value("x")?.parse().ok()?, z: value("z")?.parse().ok()? },
            _ => return None,
        })
    }
}

impl Answers {
    /// Answers about a scene, for eyes this high above floors.
    ///
    /// # Errors
    /// If its hierarchy cannot be read.
    pub(super) fn new(scene: &Arc<Scene>, eye_height: f64) -> Result<Self, ReadError> {
        let heightfield = Heightfield::new(scene, eye_height);
        let parts = Parts::new(Arc::clone(scene))?;
        Ok(Self {
            scene: Arc::clone(scene),
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
            Question::Search { text, from } => json(Some(self.parts.search(text, *from, is_given_up)?)),
            Question::Snap(pointing) => match pointing.snap(&self.scene) {
                // An empty answer is valid as well.
                Ok(snapped) => json(Some(snapped)),
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

    fn unread(&self, fault: &ReadError) -> Response<Body> {
        self.is_told.call_once(|| tracing::warn!("{fault}"));
        plain(StatusCode::INTERNAL_SERVER_ERROR, "the scene's file cannot be read\n")
    }
}

fn tile(bytes: Bytes) -> Response<Body> {
    file("application/octet-stream", bytes)
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
    use super::*;

    #[test]
    fn questions_are_read_from_path_and_query() {
        let ask = |path: &str, query: &str| Question::parse(path, form_urlencoded::parse(query.as_bytes()));
        assert_eq!(ask("/part", "token=x&object=7"), Some(Question::Part(PartId::Object(7))));
        assert_eq!(ask("/part", "group=0"), Some(Question::Part(PartId::Group(0))));
        let children = |group, from| Some(Question::Children { group, from });
        assert_eq!(ask("/children", "from=0"), children(None, 0));
        assert_eq!(ask("/children", "group=3&from=500"), children(Some(3), 500));
        let search = |text: &str, from| Some(Question::Search { text: text.to_owned(), from });
        assert_eq!(ask("/search", "text=P-101%20A%26B"), search("P-101 A&B", 0));
        assert_eq!(ask("/search", "from=100&text=P"), search("P", 100));
        assert_eq!(ask("/tile", "x=-3&z=0"), Some(Question::Tile { x: -3, z: 0 }));
        for (path, query) in [
            ("/part", ""),
            ("/part", "object=-1"),
            ("/part", "group=x&object=1"),
            ("/children", "group=4294967296"),
            ("/search", ""),
            ("/tile", "x=1"),
            ("/else", "x=1&z=1"),
        ] {
            assert_eq!(ask(path, query), None, "{path}?{query}");
        }
    }
}
