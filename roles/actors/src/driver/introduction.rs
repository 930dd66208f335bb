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
    pair: Option<Pair>,
    /// The deadline of the current step.
    deadline: Option<Instant>,
}

/// How long two cullers may take to connect. They try for as long themselves.
const MEETING: Duration = Duration::from_secs(12);
/// How long they may take to get ready. Nothing is dealt meanwhile.
const SWITCHING: Duration = Duration::from_secs(1);

/// Two cullers that the display has introduced to each other.
#[derive(Debug)]
struct Pair {
    key: SessionKey,
    two: [CullerId; 2],
    step: Step,
}

#[derive(Debug)]
enum Step {
    /// They are to connect; these have.
    Meeting {
        /// Sent once one of them waits: it accepts nobody before.
        then: Option<Box<Word>>,
        met: Vec<CullerId>,
    },
    /// They are to alternate, and know the first frame; these are ready.
    Switching { ready: Vec<CullerId> },
    /// They alternate, or have given up.
    Settled,
}

/// A message to a culler.
pub(super) type Word = (CullerId, RoleMessage);

impl Introduction {
    pub(super) const fn new(session: SessionKey) -> Self {
        Self { next: session.0, pair: None, deadline: None }
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
            let step = Step::Meeting { then, met: Vec::new() };
            self.pair = Some(Pair { key, two: [one, other], step });
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
        let Some(Pair { key: due, two, step }) = &mut self.pair else { return Vec::new() };
        match (message, &mut *step) {
            (RoleMessage::Waits { key }, Step::Meeting { then, .. }) if key == due => {
                then.take().map(|word| *word).into_iter().collect()
            }
            (RoleMessage::Met { key }, Step::Meeting { met, .. }) if key == due => {
                met.push(from);
                if met.len() < 2 {
                    return Vec::new();
                }
                let (key, first) = (*key, dealer.fresh());
                // The frames from now on are culled alternately.
                dealer.hold(true);
                self.deadline = Some(now.after(SWITCHING));
                *step = Step::Switching { ready: Vec::new() };
                two.map(|id| (id, RoleMessage::Switch { key, first })).into()
            }
            (RoleMessage::Switched { key }, Step::Switching { ready }) if key == due => {
                ready.push(from);
                if ready.len() == 2 {
                    *step = Step::Settled;
                    dealer.hold(false);
                    self.deadline = None;
                }
                Vec::new()
            }
            (RoleMessage::Unmet { key }, _) if key == due => {
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
        self.give_up(dealer);
        self.two().into_iter().flatten().map(|id| (id, RoleMessage::Part)).collect()
    }

    /// They are not asked again until one of them reconnects.
    fn give_up(&mut self, dealer: &mut Dealer) {
        if let Some(Pair { key, step, .. }) = &mut self.pair {
            (*key, *step) = (SessionKey(0), Step::Settled);
        }
        self.deadline = None;
        dealer.hold(false);
    }

    fn part(&mut self, dealer: &mut Dealer, cullers: &[CullerLink]) -> Vec<Word> {
        let two = self.pair.take().map(|pair| pair.two);
        dealer.hold(false);
        self.deadline = None;
        let left = two.into_iter().flatten().filter(|id| cullers.iter().any(|culler| culler.id == *id));
        left.map(|id| (id, RoleMessage::Part)).collect()
    }

    fn two(&self) -> Option<[CullerId; 2]> {
        self.pair.as_ref().map(|pair| pair.two)
    }
}
