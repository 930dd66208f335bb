//! View states under the relay's own versions, which go on when another display leads.

use std::{collections::VecDeque, sync::Arc};

use trimaran_proto::{RoleMessage, ViewState, ViewStateError, ViewVersion};

/// How many are kept: frames under way name the last one, or an earlier one.
const KEPT: usize = 4;

/// The last view states told to watchers, the newest last.
#[derive(Debug, Clone, Default)]
pub(super) struct ToldViews {
    known: VecDeque<(ViewVersion, Arc<[RoleMessage]>)>,
    last: ViewVersion,
}

impl ToldViews {
    /// Adds one. Returns its version.
    pub(super) fn add(&mut self, state: &ViewState) -> Result<ViewVersion, ViewStateError> {
        let version = ViewVersion(self.last.0.wrapping_add(1));
        let messages = state.to_messages(version)?;
        self.last = version;
        keep(&mut self.known, (version, messages.into()));
        Ok(version)
    }

    /// The messages of those added after `last`, and the newest version.
    pub(super) fn since(&self, last: ViewVersion) -> (Vec<Arc<[RoleMessage]>>, ViewVersion) {
        let newer = self.known.iter().filter(|(version, _)| *version > last);
        (newer.map(|(_, messages)| Arc::clone(messages)).collect(), self.last)
    }
}

/// The relay's versions for those of one source: a leader, or a relay upstream.
#[derive(Debug, Default)]
pub(super) struct Names(VecDeque<(ViewVersion, ViewVersion)>);

impl Names {
    /// From now on the source's version `theirs` is `ours`.
    pub(super) fn put(&mut self, theirs: ViewVersion, ours: ViewVersion) {
        self.0.retain(|(known, _)| *known != theirs);
        keep(&mut self.0, (theirs, ours));
    }

    pub(super) fn get(&self, theirs: ViewVersion) -> Option<ViewVersion> {
        self.0.iter().find(|(known, _)| *known == theirs).map(|(_, ours)| *ours)
    }
}

fn keep<T>(known: &mut VecDeque<T>, newest: T) {
    if known.len() == KEPT {
        known.pop_front();
    }
    known.push_back(newest);
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{LodRule, Settings, Viewport};

    use super::*;

    fn state(side: u32) -> ViewState {
        Settings::new(Viewport::new(side, side).unwrap(), LodRule::new(1.0).unwrap()).into()
    }

    #[test]
    fn each_view_state_has_a_version_of_its_own_and_the_last_four_are_told() {
        let mut views = ToldViews::default();
        for side in 1..=6 {
            assert_eq!(views.add(&state(side)), Ok(ViewVersion(side)));
        }
        let versions = |last| {
            let (messages, newest) = views.since(ViewVersion(last));
            let of = |message: &RoleMessage| match message {
                RoleMessage::View { version, .. } => version.0,
                other => panic!("{other:?}"),
            };
            (messages.iter().map(|messages| of(&messages[0])).collect::<Vec<_>>(), newest.0)
        };
        assert_eq!(versions(0), (vec![3, 4, 5, 6], 6));
        assert_eq!(versions(4), (vec![5, 6], 6));
        assert_eq!(versions(6), (vec![], 6));
    }

    #[test]
    fn a_version_told_again_has_the_newer_name() {
        let mut names = Names::default();
        for (theirs, ours) in [(0, 5), (1, 6), (0, 7)] {
            names.put(ViewVersion(theirs), ViewVersion(ours));
        }
        let name = |theirs| names.get(ViewVersion(theirs)).map(|ours| ours.0);
        assert_eq!([name(0), name(1), name(2)], [Some(7), Some(6), None]);
    }
}
