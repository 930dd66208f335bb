//! How a display introduces two cullers to each other, for the schedule `switch`.

use std::time::Duration;

use trimaran_proto::{RoleMessage, SessionKey};
use trimaran_transport::Instant;

use super::culler_link::CullerLink;
use crate::deal::{CullerId, Dealer};

/// How far the two are.
#[derive(Debug)]
pub(super) struct Introduction {
    /// The key of the next meeting, so that cullers can tell one from another.
    next: u64,
    state: State,
    /// Until when the two may take for what they have been asked.
    deadline: Option<Instant>,
}

/// How long two cullers may take to meet. They try for as long themselves.
const MEETING: Duration = Duration::from_secs(12);
/// How long they may take to say that they are ready. Nothing is dealt meanwhile.
const SWITCHING: Duration = Duration::from_secs(1);

#[derive(Debug, Default)]
enum State {
    #[default]
    Apart,
    /// They are to meet; these have.
    Meeting {
        key: SessionKey,
        two: [CullerId; 2],
        /// What is said as soon as one of them waits: it takes nobody before.
        then: Option<Box<Word>>,
        met: Vec<CullerId>,
    },
    /// They are to draw what the other one finds, and know from which frame on; these do.
    Switching { key: SessionKey, two: [CullerId; 2], ready: Vec<CullerId> },
    /// They do.
    Switched { key: SessionKey, two: [CullerId; 2] },
}

/// Something to say to a culler.
pub(super) type Word = (CullerId, RoleMessage);

impl Introduction {
    pub(super) const fn new(session: SessionKey) -> Self {
        Self { next: session.0, state: State::Apart, deadline: None }
    }

    /// Says what cullers are to be told, now that these are `available`. Nothing is dealt before the first
    /// two have met, if the session has not begun yet.
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

    /// A culler has said something that may be about it.
    pub(super) fn hear(
        &mut self,
        from: CullerId,
        said: &RoleMessage,
        dealer: &mut Dealer,
        now: Instant,
    ) -> Vec<Word> {
        match (said, &mut self.state) {
            (RoleMessage::Waits { key }, State::Meeting { key: due, then, .. }) if key == due => {
                then.take().map(|word| *word).into_iter().collect()
            }
            (RoleMessage::Met { key }, State::Meeting { key: due, two, met, .. }) if key == due => {
                met.push(from);
                if met.len() < 2 {
                    return Vec::new();
                }
                let (key, two, first) = (*key, *two, dealer.fresh());
                // What is dealt from now on the two cull in turn.
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

    /// When the two are late, if they have been asked for something.
    pub(super) const fn late(&self) -> Option<Instant> {
        self.deadline
    }

    /// The two are late: they go on by themselves.
    pub(super) fn overdue(&mut self, dealer: &mut Dealer) -> Vec<Word> {
        tracing::warn!("the cullers are late to meet, and go on by themselves");
        let two = self.state.two();
        self.give_up(dealer);
        two.into_iter().flatten().map(|id| (id, RoleMessage::Part)).collect()
    }

    /// They are not asked again until one of them comes anew.
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
