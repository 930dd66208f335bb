//! The view states that a role received.

use std::{collections::VecDeque, sync::Arc};

use trimaran_proto::{Settings, ViewReader, ViewState, ViewStateError, ViewVersion};

/// How many are kept: a camera names the last one, or an earlier one if its frame is dealt again.
const KEPT: usize = 4;

/// The last view states that a role received from one peer, the newest last.
#[derive(Debug)]
pub(crate) struct Views {
    /// How many objects the scene has, which limits the memory of a set.
    objects: u32,
    known: VecDeque<(ViewVersion, Arc<ViewState>)>,
    reader: ViewReader,
}

impl Views {
    /// Begins with the view state of the handshake.
    pub(crate) fn new(settings: Settings, objects: u32) -> Self {
        let first = (ViewVersion(0), Arc::new(settings.into()));
        Self { known: [first].into(), ..Self::none(objects) }
    }

    /// Begins with none: the peer tells all of them.
    pub(crate) fn none(objects: u32) -> Self {
        Self { objects, known: VecDeque::new(), reader: ViewReader::default() }
    }

    /// Takes a part of a view state. Returns the state once all of it has come.
    pub(crate) fn take(
        &mut self,
        version: ViewVersion,
        part: &[u8],
        last: bool,
    ) -> Result<Option<Arc<ViewState>>, ViewStateError> {
        let Some(state) = self.reader.take(version, part, last)? else { return Ok(None) };
        if let Some(object) = state.last_named().filter(|object| *object >= self.objects) {
            return Err(ViewStateError::Unknown { object, objects: self.objects });
        }
        let state = Arc::new(state);
        self.known.retain(|(known, _)| *known != version);
        self.known.push_back((version, Arc::clone(&state)));
        if self.known.len() > KEPT {
            self.known.pop_front();
        }
        Ok(Some(state))
    }

    pub(crate) fn get(&self, version: ViewVersion) -> Option<&Arc<ViewState>> {
        self.known.iter().find(|(known, _)| *known == version).map(|(_, state)| state)
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{LodRule, RoleMessage, Viewport};

    use super::*;

    #[test]
    fn the_last_four_are_known_whichever_came_again() {
        let settings = Settings::new(Viewport::new(8, 8).unwrap(), LodRule::new(1.0).unwrap());
        let state = |side| ViewState { viewport: Viewport::new(side, side).unwrap(), ..settings.into() };
        let mut views = Views::new(settings, 0);
        let mut tell = |version: u32| {
            for message in state(version + 8).to_messages(ViewVersion(version)).unwrap() {
                let RoleMessage::View { version, part, last } = message else { panic!("{message:?}") };
                views.take(version, &part, last).unwrap();
            }
            (0..9)
                .filter(|version| {
                    let known = views.get(ViewVersion(*version));
                    assert!(known.is_none_or(|known| **known == state(version + 8)));
                    known.is_some()
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(tell(1), [0, 1]);
        assert_eq!(tell(3), [0, 1, 3]);
        assert_eq!(tell(0), [0, 1, 3]);
        assert_eq!(tell(4), [0, 1, 3, 4]);
        assert_eq!(tell(5), [0, 3, 4, 5], "1 was told first");
    }
}
