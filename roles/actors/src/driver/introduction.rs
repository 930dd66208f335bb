//! How a display introduces two cullers to each other, for the schedule `switch`.

use std::time::Duration;

use trimaran_proto::{RoleMessage, SessionKey};
use trimaran_transport::Instant;

use super::culler_link::CullerLink;
use crate::deal::{CullerId, Dealer};

/// The progress of the introduction.
#[derive(Debug)]
pub(super) struct Introduction {
    /// The key of the next meeting, to distinguish meetings.
    next: u64,
    state: State,
    /// The deadline of the current step.
    deadline: Option<Instant>,
}

/// How long two cullers may take to connect. They try for as long themselves.
const MEETING: Duration = Duration::from_secs(12);
/// How long they may take to get ready. Nothing is dealt meanwhile.
const SWITCHING: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
enum State {
    #[default]
    Apart,
    /// They are to connect; these have.
    Meeting {
        key: SessionKey,
        two: [CullerId; 2],
        /// Sent once one of them waits: it accepts nobody before.
        then: Option<Box<Word>>,
        met: Vec<CullerId>,
    },
    /// They are to alternate, and know the first frame; these are ready.
    Switching { key: SessionKey, two: [CullerId; 2], ready: Vec<CullerId> },
    /// They alternate.
    Switched { key: SessionKey, two: [CullerId; 2] },
}

/// A message to a culler.
pub(super) type Word = (CullerId, RoleMessage);

impl Introduction {
    pub(super) const fn new(session: SessionKey) -> Self {
        Self { next: session.0, state: State::Apart, deadline: None }
    }

    /// Messages for cullers, given the `available` ones. Nothing is dealt before the first two have
    /// connected, if the session has not begun yet.
    pub(super) fn arrange(
        &mut self,
        dealer: &mut Dealer,
        cullers: &[CullerLink],
        begun: bool,
        now: Instant,
    ) -> Vec<Word> {
        let available: Vec<_> = dealer.available().collect();
        let two = match available[..] {
            [one, other] => Some([one, other]),
            _ => None,
        };
        if two.is_some() && self.two() == two {
            return Vec::new();
        }
        let mut words = self.part(dealer, cullers);
        if let Some([one, other]) = two {
            let at = |id| cullers.iter().find(|culler| culler.id == id).and_then(|culler| culler.at.clone());
            let (who, whom, at) = match (at(one), at(other)) {
                (_, Some(at)) => (one, other, at),
                (Some(at), None) => (other, one, at),
                (None, None) => {
                    tracing::warn!("the cullers cannot meet: the display has to connect to one of them");
                    return words;
                }
            };
            self.next = self.next.wrapping_add(1);
            let key = SessionKey(self.next);
            words.push((whom, RoleMessage::Meet { key, at: None }));
            let then = Some(Box::new((who, RoleMessage::Meet { key, at: Some(at) })));
            dealer.hold(!begun);
            self.deadline = Some(now.after(MEETING));
            self.state = State::Meeting { key, two: [one, other], then, met: Vec::new() };
        }
        words
    }

    /// A culler's message that may be about it.
    pub(super) fn hear(
        &mut self,
        from: CullerId,
        message: &RoleMessage,
        dealer: &mut Dealer,
        now: Instant,
    ) -> Vec<Word> {
        match (message, &mut self.state) {
            (RoleMessage::Waits { key }, State::Meeting { key: due, then, .. }) if key == due => {
                then.take().map(|word| *word).into_iter().collect()
            }
            (RoleMessage::Met { key }, State::Meeting { key: due, two, met, .. }) if key == due => {
                met.push(from);
                if met.len() < 2 {
                    return Vec::new();
                }
                let (key, two, first) = (*key, *two, dealer.fresh());
                // The frames from now on are culled alternately.
                dealer.hold(true);
                self.deadline = Some(now.after(SWITCHING));
                self.state = State::Switching { key, two, ready: Vec::new() };
                two.map(|id| (id, RoleMessage::Switch { key, first })).into()
            }
            (RoleMessage::Switched { key }, State::Switching { key: due, two, ready }) if key == due => {
                ready.push(from);
                if ready.len() == 2 {
                    self.state = State::Switched { key: *key, two: *two };
                    dealer.hold(false);
                    self.deadline = None;
                }
                Vec::new()
            }
            (RoleMessage::Unmet { key }, state) if Some(*key) == state.key() => {
                tracing::warn!(%from, "the cullers go on by themselves: the log of this one says why");
                self.give_up(dealer);
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    /// When the two are late, if a step is under way.
    pub(super) const fn late(&self) -> Option<Instant> {
        self.deadline
    }

    /// The two are late: they go on independently.
    pub(super) fn overdue(&mut self, dealer: &mut Dealer) -> Vec<Word> {
        tracing::warn!("the cullers are late to meet, and go on by themselves");
        let two = self.state.two();
        self.give_up(dealer);
        two.into_iter().flatten().map(|id| (id, RoleMessage::Part)).collect()
    }

    /// They are not asked again until one of them reconnects.
    fn give_up(&mut self, dealer: &mut Dealer) {
        let two = self.state.two();
        self.state = two.map_or(State::Apart, |two| State::Switched { key: SessionKey(0), two });
        self.deadline = None;
        dealer.hold(false);
    }

    fn part(&mut self, dealer: &mut Dealer, cullers: &[CullerLink]) -> Vec<Word> {
        let two = std::mem::take(&mut self.state).two();
        dealer.hold(false);
        self.deadline = None;
        let left = two.into_iter().flatten().filter(|id| cullers.iter().any(|culler| culler.id == *id));
        left.map(|id| (id, RoleMessage::Part)).collect()
    }

    const fn two(&self) -> Option<[CullerId; 2]> {
        self.state.two()
    }
}

impl State {
    const fn two(&self) -> Option<[CullerId; 2]> {
        match self {
            Self::Apart => None,
            Self::Meeting { two, .. } | Self::Switching { two, .. } | Self::Switched { two, .. } => {
                Some(*two)
            }
        }
    }

    const fn key(&self) -> Option<SessionKey> {
        match self {
            Self::Apart => None,
            Self::Meeting { key, .. } | Self::Switching { key, .. } | Self::Switched { key, .. } => {
                Some(*key)
            }
        }
    }
}
