//! The view state: how a user sees a scene, apart from the camera.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{LodRule, ObjectSet, OcclusionTestKind, RoleMessage, Sections, Settings, ViewVersion, Viewport};

/// The settings that a user can change in a walkthrough. A camera names the version of its frame; OR, HC and
/// RVG of that frame use the same one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewState {
    /// The size of the picture and of the culling depth buffer.
    pub viewport: Viewport,
    /// The LOD selection rule.
    pub lod: LodRule,
    /// The occlusion test.
    pub occlusion_test: OcclusionTestKind,
    /// The sections that cut the scene.
    pub sections: Sections,
    /// Objects that are not drawn.
    pub hidden: ObjectSet,
    /// If set, only these objects are drawn.
    pub isolated: Option<ObjectSet>,
    /// Objects drawn see-through. They hide nothing. `None` means those of the model.
    pub see_through: Option<ObjectSet>,
}

/// How an object is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Appearance {
    /// Nothing shines through.
    Solid,
    /// Objects behind it shine through.
    SeeThrough,
    /// Not drawn.
    Hidden,
}

impl ViewState {
    /// How an object is drawn; `modelled_see_through` says how the model has it. A hidden object stays hidden
    /// even if it is isolated.
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

    /// The largest object number in any of its sets.
    #[must_use]
    pub fn last_named(&self) -> Option<u32> {
        let sets = [Some(&self.hidden), self.isolated.as_ref(), self.see_through.as_ref()];
        sets.into_iter().flatten().filter_map(ObjectSet::last).max()
    }

    /// Whether all objects are drawn solid; `modelled_solid`: the model has no see-through objects.
    #[must_use]
    pub fn is_all_solid(&self, modelled_solid: bool) -> bool {
        let solid = self.see_through.as_ref().map_or(modelled_solid, ObjectSet::is_empty);
        self.hidden.is_empty() && self.isolated.is_none() && solid
    }

    /// The messages that send it to a peer, in order. A large state is split into parts.
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

/// The state at the start of a session.
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
    /// It is too long.
    #[error("a view state of {bytes} bytes: {most} is the most. Hide runs of objects", most = ViewReader::MOST)]
    TooLong {
        /// The bytes so far.
        bytes: usize,
    },
    /// A part of one version came within another one.
    #[error("the parts of two view states are mixed")]
    Mixed,
    /// The bytes are not a view state.
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

    /// Takes the next part. Returns the view state once all parts have arrived.
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

    /// Encodes a state and reads it back. Returns the number of parts and the result.
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
        // A run costs two bytes.
        let of_runs =
            |runs: usize| ViewState { hidden: (0..2 * runs as u32).step_by(2).collect(), ..state() };
        let length = |state: &ViewState| postcard::to_stdvec(state).unwrap().len();
        let more = (ViewReader::MOST - length(&of_runs(1_000_000))) / 2;
        let longest = of_runs(1_000_000 + more);
        assert_eq!(length(&longest), ViewReader::MOST);
        assert_eq!(read_back(&longest, ViewVersion(1)).1, longest);
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
        assert_eq!([&all, &some, &isolated].map(ViewState::last_named), [None, Some(3), Some(3)]);
        assert_eq!(ViewState { isolated: Some(set(&[9, 12])), ..some }.last_named(), Some(12));
    }
}
