//! A subscriber of a publisher.

use std::sync::Arc;

use parking_lot::Mutex;
use tokio::sync::Notify;
use trimaran_net::Net;
use trimaran_wire::{FrameNumber, Protocol};

use super::{Left, WhenBehind};
use crate::error::SendError;
use crate::lanes::frames::{FrameSender, PublishedFrame};

/// The frames of a subscriber.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SubscriberStats {
    /// Frames passed to its link.
    pub sent: u64,
    /// Frames that it was too slow for.
    pub skipped: u64,
    /// Whether its link still has a frame to take.
    pub is_behind: bool,
}

/// A subscriber, shared with the task that sends what its link does not take at once.
#[derive(Debug)]
pub(super) struct Subscriber<P: Protocol> {
    state: Mutex<State<P>>,
    when_behind: WhenBehind,
    /// There is something to send, for the task.
    work: Notify,
    /// There may be room, for the publisher.
    room: Notify,
}

#[derive(Debug)]
struct State<P: Protocol> {
    sender: Place<P>,
    /// The frame to send once the link has taken those before.
    next: Option<Arc<PublishedFrame<P>>>,
    /// The last frame passed to the link, and the first one of those without a gap up to it.
    last: Option<(FrameNumber, FrameNumber)>,
    stats: SubscriberStats,
    /// Nothing more comes for it.
    leaves: bool,
}

/// Where the sender is.
#[derive(Debug)]
enum Place<P: Protocol> {
    /// Here, with nothing to send.
    Idle(Box<FrameSender<P>>),
    /// Here, for the task to take.
    Due(Box<FrameSender<P>>),
    /// At the task.
    Away,
    /// It was taken back, or has failed.
    Gone(Option<Left>),
}

impl<P: Protocol> Subscriber<P> {
    pub(super) fn new(net: &Arc<dyn Net>, sender: FrameSender<P>, when_behind: WhenBehind) -> Arc<Self> {
        let sender = Place::Idle(Box::new(sender));
        let stats = SubscriberStats::default();
        let state = State { sender, next: None, last: None, stats, leaves: false };
        let (work, room) = (Notify::new(), Notify::new());
        let subscriber = Arc::new(Self { state: Mutex::new(state), when_behind, work, room });
        net.spawn(Box::pin(Arc::clone(&subscriber).send_on()));
        subscriber
    }

    pub(super) fn stats(&self) -> SubscriberStats {
        let state = self.state.lock();
        SubscriberStats { is_behind: matches!(state.sender, Place::Due(_) | Place::Away), ..state.stats }
    }

    /// Whether it lacks a frame since this one, and so cannot read coded batches.
    pub(super) fn lacks(&self, since: FrameNumber) -> bool {
        self.state.lock().last.is_none_or(|(_, first)| first > since)
    }

    /// Waits until it has room for a frame, if frames wait for it.
    pub(super) async fn has_room(&self) {
        while self.when_behind == WhenBehind::Wait && self.state.lock().next.is_some() {
            self.room.notified().await;
        }
    }

    /// Passes it a frame, or keeps the frame until there is room.
    pub(super) fn put(&self, frame: &Arc<PublishedFrame<P>>) {
        let mut state = self.state.lock();
        match std::mem::replace(&mut state.sender, Place::Gone(None)) {
            Place::Idle(mut sender) => {
                let sent = state.stage(&mut sender, frame).and_then(|()| sender.try_send_staged());
                state.sender = match sent {
                    Ok(true) => Place::Idle(sender),
                    Ok(false) => {
                        self.work.notify_one();
                        Place::Due(sender)
                    }
                    Err(error) => Place::Gone(Some(Left::Failed(error))),
                };
            }
            Place::Due(_) | Place::Away if self.when_behind == WhenBehind::Disconnect => {
                state.sender = Place::Gone(Some(Left::Behind));
                self.work.notify_one();
            }
            behind @ (Place::Due(_) | Place::Away) => {
                state.sender = behind;
                if state.next.replace(Arc::clone(frame)).is_some() {
                    state.stats.skipped += 1;
                }
            }
            gone @ Place::Gone(_) => state.sender = gone,
        }
    }

    /// Why it is gone, if it is.
    pub(super) fn left(&self) -> Option<Left> {
        match &mut self.state.lock().sender {
            Place::Gone(left) => left.take(),
            _ => None,
        }
    }

    /// Ends its task once it has sent what is staged.
    pub(super) fn leave(&self) {
        let mut state = self.state.lock();
        (state.next, state.leaves) = (None, true);
        if let Place::Idle(_) = state.sender {
            state.sender = Place::Gone(None);
        }
        drop(state);
        self.work.notify_one();
    }

    /// Takes the sender back once its link has taken everything; none if it has failed.
    pub(super) async fn give_back(&self) -> Option<FrameSender<P>> {
        loop {
            {
                let mut state = self.state.lock();
                match std::mem::replace(&mut state.sender, Place::Gone(None)) {
                    Place::Idle(sender) => {
                        self.work.notify_one();
                        return Some(*sender);
                    }
                    Place::Gone(_) => return None,
                    behind => state.sender = behind,
                }
            }
            self.room.notified().await;
        }
    }

    /// Ends once the subscriber is gone, although its sender is at the task.
    async fn gone(&self) {
        while !matches!(self.state.lock().sender, Place::Gone(_)) {
            self.work.notified().await;
        }
    }

    /// Sends what the link did not take at once, until the subscriber is gone.
    async fn send_on(self: Arc<Self>) {
        loop {
            self.work.notified().await;
            let Some(mut sender) = self.state.lock().take_due() else { return };
            loop {
                let _tells = Tells(&self.room);
                let sent = tokio::select! {
                    biased;
                    sent = sender.send_staged() => sent,
                    () = self.gone() => return,
                };
                let mut state = self.state.lock();
                // In place of `Away` another end was noted meanwhile.
                if state.leaves || !matches!(state.sender, Place::Away) {
                    return;
                }
                let next = sent.and_then(|()| match state.next.take() {
                    Some(frame) => state.stage(&mut sender, &frame).map(|()| true),
                    None => Ok(false),
                });
                match next {
                    Ok(true) => {}
                    Ok(false) => {
                        state.sender = Place::Idle(sender);
                        break;
                    }
                    Err(error) => {
                        (state.next, state.sender) = (None, Place::Gone(Some(Left::Failed(error))));
                        return;
                    }
                }
            }
        }
    }
}

/// Tells the publisher at the end of a scope that there may be room.
struct Tells<'n>(&'n Notify);

impl Drop for Tells<'_> {
    fn drop(&mut self) {
        self.0.notify_one();
    }
}

impl<P: Protocol> State<P> {
    fn take_due(&mut self) -> Option<Box<FrameSender<P>>> {
        match std::mem::replace(&mut self.sender, Place::Away) {
            Place::Due(sender) => Some(sender),
            other => {
                self.sender = other;
                None
            }
        }
    }

    fn stage(&mut self, sender: &mut FrameSender<P>, frame: &PublishedFrame<P>) -> Result<(), SendError> {
        let number = frame.number();
        let first = match self.last {
            Some((last, first)) if frame.before == Some(last) => first,
            _ => number,
        };
        self.last = Some((number, first));
        self.stats.sent += 1;
        sender.stage_whole(frame, number, first)
    }
}

#[cfg(all(test, feature = "inproc"))]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

    use super::*;
    use crate::conformance::{ARM, PANEL, Robot, greeting, points, start};
    use crate::{FrameEvent, LinkConfig, Loss, Publisher, RecvError, TokioNet, inproc};

    /// Its peer gets no end of the frame that it was too slow for, and no more of it.
    #[tokio::test(start_paused = true)]
    async fn a_subscriber_that_is_cut_off_gets_no_more() {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let config = LinkConfig::default();
        let (arm, mut panel) = inproc::pair::<Robot>(&net, greeting(ARM), greeting(PANEL), &config).unwrap();
        let mut publisher = Publisher::new(&net, &config);
        publisher.subscribe(arm.frames_tx, WhenBehind::Disconnect);
        // More batches than wait for a reader.
        let many = points(1 << 20);
        assert!(publisher.publish(start(0), &many).await.unwrap().left.is_empty());
        // The task takes the frame.
        tokio::task::yield_now().await;
        let left = publisher.publish(start(1), &many).await.unwrap().left;
        assert!(matches!(left[..], [(_, Left::Behind)]), "{left:?}");
        tokio::task::yield_now().await;
        let end = loop {
            match panel.frames_rx.recv().await {
                Ok(FrameEvent::End(end)) => unreachable!("{end:?}"),
                Ok(_) => {}
                Err(end) => break end,
            }
        };
        assert!(matches!(end, RecvError::Lost { cause: Loss::Closed, .. }), "{end:?}");
    }
}
