//! What a user sees of a scene beside the camera: the view state.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{LodRule, ObjectSet, OcclusionTestKind, RoleMessage, Sections, Settings, Viewport};

/// Which view state it is: a session's changes are counted. Version 0 is what the [`Settings`] of the
/// handshake say, with nothing cut away or hidden, and see-through what the model has so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[repr(transparent)]
pub struct ViewVersion(pub u32);

/// What a user can change while walking. A camera names the version that its frame is seen in, and OR, HC and
/// RVG of that frame obey the same one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewState {
    /// The size of the picture and of the culling depth buffer.
    pub viewport: Viewport,
    /// When a level of detail is good enough.
    pub lod: LodRule,
    /// How boxes are tested for visibility.
    pub occlusion_test: OcclusionTestKind,
    /// What is cut away.
    pub sections: Sections,
    /// Objects that are not drawn.
    pub hidden: ObjectSet,
    /// If there is one: only these objects are drawn.
    pub isolated: Option<ObjectSet>,
    /// Objects of which the rest shines through. They hide nothing. `None`: those that the model has so.
    pub see_through: Option<ObjectSet>,
}

/// How an object is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Appearance {
    /// As it is.
    Solid,
    /// What is behind it shines through.
    SeeThrough,
    /// Not at all.
    Hidden,
}

impl ViewState {
    /// How an object is drawn in it, that the model has see-through or not. What is hidden stays hidden where it
    /// is isolated.
    #[must_use]
    pub fn appearance(&self, object: u32, modelled_see_through: bool) -> Appearance {
        let isolated = self.isolated.as_ref().is_none_or(|isolated| isolated.contains(object));
        let see_through = self.see_through.as_ref().map_or(modelled_see_through, |set| set.contains(object));
        match (isolated && !self.hidden.contains(object), see_through) {
            (false, _) => Appearance::Hidden,
            (true, true) => Appearance::SeeThrough,
            (true, false) => Appearance::Solid,
        }
    }

    /// The last object that it names, of any set.
    #[must_use]
    pub fn last_named(&self) -> Option<u32> {
        let sets = [Some(&self.hidden), self.isolated.as_ref(), self.see_through.as_ref()];
        sets.into_iter().flatten().filter_map(ObjectSet::last).max()
    }

    /// Whether all objects are drawn, and solid where `modelled_solid`: the model has none see-through.
    #[must_use]
    pub fn is_all_solid(&self, modelled_solid: bool) -> bool {
        let solid = self.see_through.as_ref().map_or(modelled_solid, ObjectSet::is_empty);
        self.hidden.is_empty() && self.isolated.is_none() && solid
    }

    /// The messages that tell a peer of it, in order: a large one is cut into parts.
    ///
    /// # Errors
    /// If it is longer than [`ViewReader::MOST`] bytes.
    pub fn to_messages(&self, version: ViewVersion) -> Result<Vec<RoleMessage>, ViewStateError> {
        let bytes = postcard::to_stdvec(self).map_err(|_| ViewStateError::Unreadable)?;
        if bytes.len() > ViewReader::MOST {
            return Err(ViewStateError::TooLong { bytes: bytes.len() });
        }
        let parts = bytes.chunks(PART);
        let last = parts.len().saturating_sub(1);
        Ok(parts
            .enumerate()
            .map(|(place, part)| RoleMessage::View { version, part: part.to_vec(), last: place == last })
            .collect())
    }
}

/// Where a session begins.
impl From<Settings> for ViewState {
    fn from(settings: Settings) -> Self {
        Self {
            viewport: settings.viewport,
            lod: settings.lod,
            occlusion_test: settings.occlusion_test,
            sections: Sections::NONE,
            hidden: ObjectSet::default(),
            isolated: None,
            see_through: None,
        }
    }
}

/// Bytes of a part: a message must not be longer than 16,384.
const PART: usize = 16_000;

/// Puts the parts of a view state together.
#[derive(Debug, Default)]
pub struct ViewReader {
    begun: Option<(ViewVersion, Vec<u8>)>,
}

/// Why a view state cannot be sent or read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ViewStateError {
    /// It is longer than any.
    #[error("a view state of {bytes} bytes: {most} is the most. Hide runs of objects", most = ViewReader::MOST)]
    TooLong {
        /// As far as they have come.
        bytes: usize,
    },
    /// A part of one version came within another one.
    #[error("the parts of two view states are mixed")]
    Mixed,
    /// The bytes are no view state.
    #[error("the bytes are no view state")]
    Unreadable,
    /// It names an object that the scene lacks.
    #[error("a view state names object {object}, and the scene has {objects}")]
    Unknown {
        /// The object.
        object: u32,
        /// How many the scene has.
        objects: u32,
    },
}

impl ViewReader {
    /// The most bytes of a view state: enough to hide every second of two million objects.
    pub const MOST: usize = 4 << 20;

    /// Takes the next part. Gives the view state once all parts are there.
    ///
    /// # Errors
    /// If the parts are no view state.
    pub fn take(
        &mut self,
        version: ViewVersion,
        part: &[u8],
        last: bool,
    ) -> Result<Option<ViewState>, ViewStateError> {
        let (begun, bytes) = self.begun.get_or_insert_with(|| (version, Vec::new()));
        if *begun != version {
            return Err(ViewStateError::Mixed);
        }
        bytes.extend_from_slice(part);
        if bytes.len() > Self::MOST {
            return Err(ViewStateError::TooLong { bytes: bytes.len() });
        }
        if !last {
            return Ok(None);
        }
        let state = postcard::from_bytes(bytes).map_err(|_| ViewStateError::Unreadable)?;
        self.begun = None;
        Ok(Some(state))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> ViewState {
        let (viewport, lod) = (Viewport::new(640, 480).unwrap(), LodRule::new(2.0).unwrap());
        ViewState::from(Settings::new(viewport, lod))
    }

    /// Takes what was made of a state; says in how many parts, and what was read.
    fn read_back(state: &ViewState, version: ViewVersion) -> (usize, ViewState) {
        let (mut reader, mut read) = (ViewReader::default(), None);
        let messages = state.to_messages(version).unwrap();
        for message in &messages {
            let RoleMessage::View { version: of, part, last } = message else { panic!("{message:?}") };
            assert_eq!((*of, read.is_some()), (version, false));
            read = reader.take(*of, part, *last).unwrap();
        }
        (messages.len(), read.unwrap())
    }

    #[test]
    fn a_view_state_travels_in_parts() {
        assert_eq!(read_back(&state(), ViewVersion(3)), (1, state()));
        let every_other = ViewState { hidden: (0..80_000).step_by(2).collect(), ..state() };
        assert_eq!(read_back(&every_other, ViewVersion(4)), (6, every_other));
    }

    #[test]
    fn what_no_display_sends_is_refused() {
        let mut reader = ViewReader::default();
        assert_eq!(reader.take(ViewVersion(1), &[0; 9], false), Ok(None));
        assert_eq!(reader.take(ViewVersion(2), &[0; 9], false), Err(ViewStateError::Mixed));
        assert_eq!(
            ViewReader::default().take(ViewVersion(1), &[0; 9], true),
            Err(ViewStateError::Unreadable)
        );
        let mut reader = ViewReader::default();
        let part = vec![1; ViewReader::MOST];
        assert_eq!(reader.take(ViewVersion(1), &part, false), Ok(None));
        let bytes = ViewReader::MOST + 1;
        assert_eq!(reader.take(ViewVersion(1), &[1], false), Err(ViewStateError::TooLong { bytes }));
        let long = ViewState { hidden: (0..5_000_000).step_by(2).collect(), ..state() };
        assert!(matches!(long.to_messages(ViewVersion(1)), Err(ViewStateError::TooLong { .. })));
    }

    #[test]
    fn who_is_hidden_is_not_shown_whatever_else_is_said() {
        let set = |objects: &[u32]| objects.iter().copied().collect::<ObjectSet>();
        let all = state();
        assert!(all.is_all_solid(true) && !all.is_all_solid(false));
        let solid = ViewState { see_through: Some(set(&[])), ..all.clone() };
        assert!(solid.is_all_solid(false));
        let some = ViewState { hidden: set(&[1, 3]), see_through: Some(set(&[2, 3])), ..all.clone() };
        let isolated = ViewState { isolated: Some(set(&[0, 1, 2])), ..some.clone() };
        use Appearance::{Hidden, SeeThrough, Solid};
        let appearances =
            |state: &ViewState| [0, 1, 2, 3, 4].map(|object| state.appearance(object, object == 4));
        assert_eq!(appearances(&all), [Solid, Solid, Solid, Solid, SeeThrough]);
        assert_eq!(appearances(&some), [Solid, Hidden, SeeThrough, Hidden, Solid]);
        assert_eq!(appearances(&isolated), [Solid, Hidden, SeeThrough, Hidden, Hidden]);
        assert!(!some.is_all_solid(true) && !isolated.is_all_solid(true));
    }
}
