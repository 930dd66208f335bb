//! The newest frames, for a reader that may be slower than its peer.

use std::collections::VecDeque;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::Notify;
use trimaran_net::{Instant, Net, until};
use trimaran_wire::Protocol;

use super::events::Events;
use super::whole::{Arrived, Gathered, Gathering};
use crate::error::RecvError;
use crate::lanes::shared::Shared;
use crate::peer::PeerName;
use crate::stats::{Counters, Skipped};

/// The frames that wait for a slow reader. The terms are those of DDS (OMG DDS 1.4, 2.2.3.16 and 2.2.3.18).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct KeepLast {
    /// How many complete frames wait for their reader at most: a new one replaces the oldest.
    pub depth: NonZeroUsize,
    /// The greatest age at which a frame is returned, if there is one. It counts from the arrival of the
    /// frame's begin. The time on the way is not part of it: over `udp` the link's own deadline bounds that.
    pub lifespan: Option<Duration>,
}

impl KeepLast {
    /// The last `depth` frames, however old.
    #[must_use]
    pub const fn new(depth: NonZeroUsize) -> Self {
        Self { depth, lifespan: None }
    }

    trimaran_net::setters! { with_lifespan lifespan: Option<Duration> }
}

/// Only the newest frame waits, at any age.
impl Default for KeepLast {
    fn default() -> Self {
        Self { depth: NonZeroUsize::MIN, lifespan: None }
    }
}

/// Receives the newest frames. A task reads the lane on, whether anyone waits for a frame or not.
#[derive(Debug)]
pub(super) struct LastFrames<P: Protocol> {
    mailbox: Arc<Mailbox<P>>,
    net: Arc<dyn Net>,
    peer: PeerName,
    lifespan: Option<Duration>,
    /// The lane, once it has ended.
    ended: Option<Events<P>>,
}

/// The frames that the task has read.
#[derive(Debug)]
struct Mailbox<P: Protocol> {
    state: Mutex<State<P>>,
    counters: Arc<Counters>,
    /// Something came, for the reader.
    came: Notify,
    /// The reader left, for the task.
    left: Notify,
}

#[derive(Debug)]
struct State<P: Protocol> {
    frames: VecDeque<Arrived<P>>,
    depth: NonZeroUsize,
    /// Since the last returned frame.
    skipped: Skipped,
    ended: Option<(RecvError, Events<P>)>,
}

impl<P: Protocol> LastFrames<P> {
    /// Begins to read.
    pub(super) fn of(events: Events<P>, KeepLast { depth, lifespan }: KeepLast) -> Self {
        let net = Arc::clone(events.net());
        let Shared { peer, counters, .. } = events.shared().clone();
        let state = State { frames: VecDeque::new(), depth, skipped: Skipped::default(), ended: None };
        let (came, left) = (Notify::new(), Notify::new());
        let mailbox = Mailbox { state: Mutex::new(state), counters, came, left };
        let mailbox = Arc::new(mailbox);
        net.spawn(Box::pin(read_on(events, Arc::clone(&mailbox))));
        Self { mailbox, net, peer, lifespan, ended: None }
    }

    /// Goes by another rule from now on.
    pub(super) fn change(&mut self, KeepLast { depth, lifespan }: KeepLast) {
        self.lifespan = lifespan;
        let mut state = self.mailbox.state.lock();
        state.depth = depth;
        self.mailbox.cut(&mut state);
    }

    /// Waits for the next frame that is young enough, until `by` at most if that is given, and returns it
    /// with the frames skipped before it. Dropping the future loses nothing.
    pub(super) async fn next(&mut self, by: Option<Instant>) -> Result<(Arrived<P>, Skipped), RecvError> {
        loop {
            if let Some(events) = &mut self.ended {
                // A lane returns its end each time.
                events.recv(by).await?;
            } else if let Some(next) = self.there() {
                return Ok(next);
            } else if let Some((end, events)) = self.mailbox.ended() {
                self.ended = Some(events);
                return Err(end);
            } else {
                let came = self.mailbox.came.notified();
                match by {
                    None => came.await,
                    Some(by) => {
                        let in_time = until(&*self.net, by, came).await;
                        in_time.ok_or_else(|| RecvError::Deadline { peer: self.peer.clone() })?;
                    }
                }
            }
        }
    }

    /// The time by the link's clock.
    pub(super) fn now(&self) -> Instant {
        self.net.now()
    }

    /// The next frame that waits and is young enough.
    fn there(&self) -> Option<(Arrived<P>, Skipped)> {
        let mut state = self.mailbox.state.lock();
        let now = self.net.now();
        while let Some(frame) = state.frames.pop_front() {
            if self.lifespan.is_none_or(|lifespan| frame.age(now) <= lifespan) {
                return Some((frame, std::mem::take(&mut state.skipped)));
            }
            self.mailbox.skip(&mut state, Skipped::EXPIRED);
        }
        None
    }
}

impl<P: Protocol> Drop for LastFrames<P> {
    fn drop(&mut self) {
        self.mailbox.left.notify_one();
    }
}

impl<P: Protocol> Mailbox<P> {
    fn put(&self, frame: Arrived<P>) {
        let mut state = self.state.lock();
        state.frames.push_back(frame);
        self.cut(&mut state);
    }

    /// Drops the oldest frames beyond the depth.
    fn cut(&self, state: &mut State<P>) {
        while state.frames.len() > state.depth.get() {
            state.frames.pop_front();
            self.skip(state, Skipped::REPLACED);
        }
    }

    /// The end of the lane, once.
    fn ended(&self) -> Option<(RecvError, Events<P>)> {
        self.state.lock().ended.take()
    }

    fn skip(&self, state: &mut State<P>, skipped: Skipped) {
        state.skipped = state.skipped + skipped;
        self.counters.skip(skipped);
    }
}

/// Reads frames until the lane ends, or the reader leaves.
async fn read_on<P: Protocol>(mut events: Events<P>, mailbox: Arc<Mailbox<P>>) {
    let mut gathering = Gathering::default();
    let end = loop {
        let event = tokio::select! {
            biased;
            () = mailbox.left.notified() => return,
            event = events.recv(None) => event,
        };
        match event.map(|event| gathering.take(event, events.net().now())) {
            Ok(Gathered::Part) => {}
            Ok(Gathered::Whole(frame)) => {
                mailbox.put(frame);
                mailbox.came.notify_one();
            }
            Ok(Gathered::Incomplete) => mailbox.skip(&mut mailbox.state.lock(), Skipped::INCOMPLETE),
            Err(end) => break end,
        }
    };
    mailbox.state.lock().ended = Some((end, events));
    mailbox.came.notify_one();
}

#[cfg(all(test, feature = "conformance", feature = "inproc"))]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

    use super::*;
    use crate::conformance::{ARM, PANEL, Robot, finished, greeting, points, send_frame};
    use crate::{FrameEvent, FrameNumber, FrameReceiver, Link, LinkConfig, TokioNet, inproc};
    use trimaran_net::sleep_until;

    const SECOND: Duration = Duration::from_secs(1);

    /// A robot, and a panel that keeps this many frames, for five seconds.
    fn pair(depth: usize) -> (Arc<dyn Net>, Link<Robot>, Link<Robot>) {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let (arm, mut panel) =
            inproc::pair::<Robot>(&net, greeting(ARM), greeting(PANEL), &LinkConfig::default()).unwrap();
        let rule = KeepLast { depth: NonZeroUsize::new(depth).unwrap(), lifespan: Some(5 * SECOND) };
        panel.frames_rx = panel.frames_rx.keep_last(rule);
        (net, arm, panel)
    }

    /// Sends these frames, a second apart, and waits a second.
    async fn send(net: &Arc<dyn Net>, arm: &mut Link<Robot>, frames: std::ops::Range<u32>) {
        for frame in frames {
            send_frame(&mut arm.frames_tx, frame, &points(frame)).await.unwrap();
            sleep_until(&**net, net.now().after(SECOND)).await;
        }
    }

    async fn next(frames: &mut FrameReceiver<Robot>) -> (u32, u64, Skipped) {
        let frame = frames.frame().await.unwrap();
        assert_eq!(frame.items().collect::<Vec<_>>(), points(frame.start.frame.0));
        (frame.start.frame.0, frame.age.as_secs(), frame.skipped)
    }

    #[tokio::test(start_paused = true)]
    async fn the_newest_frames_wait_and_are_as_old_as_they_say() {
        let (net, mut arm, mut panel) = pair(3);
        send(&net, &mut arm, 0..7).await;
        let replaced = Skipped { replaced: 4, ..Skipped::default() };
        assert_eq!(next(&mut panel.frames_rx).await, (4, 3, replaced));
        assert_eq!(next(&mut panel.frames_rx).await, (5, 2, Skipped::default()));
        assert_eq!(next(&mut panel.frames_rx).await, (6, 1, Skipped::default()));
        assert_eq!(panel.stats.read().skipped, replaced);
    }

    #[tokio::test(start_paused = true)]
    async fn a_frame_that_has_waited_longer_than_its_lifespan_is_not_returned() {
        let (net, mut arm, mut panel) = pair(9);
        send(&net, &mut arm, 0..7).await;
        let expired = Skipped { expired: 2, ..Skipped::default() };
        assert_eq!(next(&mut panel.frames_rx).await, (2, 5, expired));
        sleep_until(&*net, net.now().after(9 * SECOND)).await;
        let by = net.now().after(SECOND);
        let none = panel.frames_rx.frame_by(by).await;
        assert!(matches!(none, Err(RecvError::Deadline { .. })), "{none:?}");
        assert_eq!(net.now(), by);
        assert_eq!(panel.stats.read().skipped.expired, 6);
        send(&net, &mut arm, 7..8).await;
        assert_eq!(next(&mut panel.frames_rx).await.2.expired, 4, "those since the last returned one");
    }

    #[tokio::test(start_paused = true)]
    async fn another_rule_holds_for_the_frames_that_wait() {
        let (net, mut arm, mut panel) = pair(9);
        send(&net, &mut arm, 0..7).await;
        let rule = KeepLast { depth: NonZeroUsize::new(3).unwrap(), lifespan: Some(2 * SECOND) };
        panel.frames_rx = panel.frames_rx.keep_last(rule);
        let skipped = Skipped { replaced: 4, expired: 1, incomplete: 0 };
        assert_eq!(next(&mut panel.frames_rx).await, (5, 2, skipped));
    }

    #[tokio::test(start_paused = true)]
    async fn kept_frames_come_as_events_as_well() {
        let (net, mut arm, mut panel) = pair(1);
        send(&net, &mut arm, 0..4).await;
        let FrameEvent::Begin(start) = panel.frames_rx.recv().await.unwrap() else { panic!("no begin") };
        assert_eq!((start.frame, panel.frames_rx.open_frame()), (FrameNumber(3), Some(FrameNumber(3))));
        let mut items = Vec::new();
        loop {
            match panel.frames_rx.try_recv().unwrap().unwrap() {
                FrameEvent::Batch(batch) => items.extend(batch.iter()),
                FrameEvent::End(end) => break assert!(matches!(end, crate::FrameOutcome::Complete(_))),
                FrameEvent::Begin(start) => panic!("{start:?} within a frame"),
            }
        }
        assert_eq!((items, panel.frames_rx.open_frame()), (points(3), None));
        assert!(panel.frames_rx.try_recv().unwrap().is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn frames_that_came_before_the_end_are_returned_before_it() {
        let (net, mut arm, mut panel) = pair(2);
        send(&net, &mut arm, 0..3).await;
        arm.close(finished()).await.unwrap();
        assert_eq!(next(&mut panel.frames_rx).await.0, 1);
        assert_eq!(next(&mut panel.frames_rx).await.0, 2);
        for _ in 0..3 {
            let end = panel.frames_rx.frame().await;
            assert!(matches!(end, Err(RecvError::Closed { .. })), "{end:?}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn the_peer_learns_that_the_reader_is_gone() {
        let (net, mut arm, panel) = pair(1);
        send(&net, &mut arm, 0..2).await;
        drop(panel);
        sleep_until(&*net, net.now().after(SECOND)).await;
        assert!(send_frame(&mut arm.frames_tx, 2, &points(9)).await.is_err());
    }
}
