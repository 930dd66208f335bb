//! The other culler of the schedule `switch`: each of the two draws the other one's visible set as occluders,
//! as it comes (paper, algorithm 4.2).
//!
//! Errors between two cullers never end a session: each goes on with its own visible set.

use std::{future::pending, mem};

use trimaran_proto::{Camera, CloseCode, DrawableId, FrameNumber, RoleMessage, SentBytes, SessionKey};
use trimaran_transport::{Instant, RecvError, Traffic, causes};

use super::other_frames::OtherFrames;
use crate::{
    links::{FrameEvent, FrameStart, Link, sent_bytes},
    meeting::{MeetError, Meeting, Met},
};

/// The other culler, if there is one.
#[derive(Debug)]
pub(super) struct Switch {
    meeting: Meeting,
    /// When it may connect to another culler again.
    connects_at: Instant,
    /// Whether a failed meeting has been logged: a display may ask any number of times.
    has_warned: bool,
    drawables: u32,
    state: State,
    /// A message that the display has not got yet.
    pub(super) unsaid: Option<RoleMessage>,
}

#[derive(Debug)]
enum State {
    Single,
    Meeting {
        key: SessionKey,
        met: Met,
    },
    /// They have a link; from `first` on, if set, each draws the other one's visible set.
    Met {
        key: SessionKey,
        other: Box<Other>,
        first: Option<FrameNumber>,
    },
}

#[derive(Debug)]
struct Other {
    link: Link,
    /// Its received frames.
    frames: OtherFrames,
    /// The number of the next frame to send it.
    sent: FrameNumber,
    /// Whether a frame is being sent.
    sending: bool,
    counted: Traffic,
}

/// An event of the other culler.
pub(super) enum News {
    /// A link to it, or why there is none.
    Met(Box<Result<Link, MeetError>>),
    /// An event of one of its frames.
    Frame(Result<FrameEvent, RecvError>),
}

impl Switch {
    pub(super) fn new(meeting: Meeting, drawables: u32) -> Self {
        let connects_at = meeting.net.now();
        Self { meeting, connects_at, has_warned: false, drawables, state: State::Single, unsaid: None }
    }

    /// Waits for its next event; for ever if there is no other culler.
    pub(super) async fn news(&mut self) -> News {
        match &mut self.state {
            State::Meeting { met, .. } => {
                let met = met.await.unwrap_or(Err(MeetError::Absent));
                News::Met(Box::new(met))
            }
            State::Met { other, .. } => News::Frame(other.link.frames_rx.recv().await),
            State::Single => pending().await,
        }
    }

    pub(super) fn learn(&mut self, news: News) {
        match news {
            News::Met(met) => self.met(*met),
            News::Frame(event) => self.take(event),
        }
    }

    /// Whether there is a link to it.
    pub(super) const fn is_there(&self) -> bool {
        matches!(self.state, State::Met { .. })
    }

    /// Whether the other one supplies the occluders of this frame.
    pub(super) const fn feeds(&self, frame: FrameNumber) -> bool {
        matches!(self.state, State::Met { first: Some(first), .. } if frame.0 > first.0)
    }

    /// Whether it begins the frame before `frame`; none if unknown yet. If it begins another one, it is out
    /// of step.
    pub(super) fn begins(&mut self, frame: FrameNumber) -> Option<bool> {
        let State::Met { other, .. } = &mut self.state else { return Some(false) };
        let begun = other.frames.first_from(frame.0.saturating_sub(1))?;
        let is_due = begun.0.checked_add(1) == Some(frame.0);
        if !is_due {
            self.lose("it broke the order of frames");
        }
        Some(is_due)
    }

    /// The next ids of its frame; empty at the frame's end, none if they have not come yet.
    pub(super) fn ids(&mut self) -> Option<Vec<DrawableId>> {
        match &mut self.state {
            State::Met { other, .. } => other.frames.next(),
            _ => None,
        }
    }

    /// Begins to send it a frame; returns it if it takes one.
    pub(super) async fn begin(&mut self, camera: Camera) -> Option<&mut Self> {
        if let State::Met { other, first: Some(first), .. } = &mut self.state
            && camera.frame() >= *first
        {
            let start = FrameStart { frame: other.sent, header: camera };
            other.sent = FrameNumber(other.sent.0.wrapping_add(1));
            other.sending = true;
            if let Err(error) = other.link.frames_tx.begin(start).await {
                self.lose(&causes(&error));
            }
        }
        self.is_sending().then_some(self)
    }

    pub(super) async fn push(&mut self, ids: &[DrawableId]) {
        if let State::Met { other, .. } = &mut self.state
            && other.sending
            && let Err(error) = other.link.frames_tx.push(ids).await
        {
            self.lose(&causes(&error));
        }
    }

    /// Ends the frame that is sent to it; returns the bytes sent for it.
    pub(super) async fn finish(&mut self) -> SentBytes {
        let State::Met { other, .. } = &mut self.state else { return SentBytes::default() };
        if !mem::take(&mut other.sending) {
            return SentBytes::default();
        }
        let ended = other.link.frames_tx.finish().await;
        let sent = other.link.stats.read().sent;
        let since = sent_bytes(sent - mem::replace(&mut other.counted, sent));
        if let Err(error) = ended {
            self.lose(&causes(&error));
        }
        since
    }

    /// Leaves it.
    pub(super) fn part(&mut self) {
        if let State::Met { other, .. } = mem::replace(&mut self.state, State::Single) {
            // The close is not waited for.
            self.meeting.net.spawn(Box::pin(async move {
                let _unheard = other.link.close(CloseCode::Finished.reason()).await;
            }));
        }
    }

    const fn is_sending(&self) -> bool {
        match &self.state {
            State::Met { other, .. } => other.sending,
            _ => false,
        }
    }

    /// Handles the display's message about it.
    pub(super) fn hear(&mut self, message: RoleMessage) {
        match (message, &mut self.state) {
            (RoleMessage::Meet { key, at }, _) => {
                self.part();
                let met = match at {
                    Some(at) => {
                        let met = self.meeting.connect(key, &at, self.connects_at);
                        self.connects_at = self.meeting.next_at(self.connects_at);
                        met
                    }
                    None => {
                        self.unsaid = Some(RoleMessage::Waits { key });
                        self.meeting.wait(key)
                    }
                };
                self.state = State::Meeting { key, met };
            }
            (RoleMessage::Switch { key, first: due }, State::Met { key: met, first, .. }) if key == *met => {
                *first = Some(due);
                self.unsaid = Some(RoleMessage::Switched { key });
            }
            (RoleMessage::Part, _) => self.part(),
            // It belongs to an earlier meeting.
            _ => {}
        }
    }

    fn met(&mut self, met: Result<Link, MeetError>) {
        let State::Meeting { key, .. } = self.state else { return };
        match met {
            Ok(link) => {
                let counted = link.stats.read().sent;
                let (frames, sent) = (OtherFrames::of(self.drawables), FrameNumber(0));
                let other = Box::new(Other { link, frames, sent, sending: false, counted });
                self.state = State::Met { key, other, first: None };
                self.unsaid = Some(RoleMessage::Met { key });
            }
            Err(error) => {
                if !mem::replace(&mut self.has_warned, true) {
                    tracing::warn!("does not meet the other culler: {}", causes(&error));
                }
                self.unmet(key);
            }
        }
    }

    /// Takes an event of a frame of the other one.
    fn take(&mut self, event: Result<FrameEvent, RecvError>) {
        match (event, &mut self.state) {
            (Ok(event), State::Met { other, .. }) => {
                if let Err(error) = other.frames.take(event) {
                    self.lose(&causes(&error));
                }
            }
            (Err(end), _) => self.ended(&end),
            (Ok(_), _) => {}
        }
    }

    /// The link to it has ended. One of two cullers hears first that the session is over.
    fn ended(&mut self, end: &RecvError) {
        let over = match end {
            RecvError::Closed { reason, .. } => CloseCode::of(reason) == Some(CloseCode::Finished),
            _ => false,
        };
        if let (true, State::Met { key, .. }) = (over, &self.state) {
            let key = *key;
            self.part();
            self.unmet(key);
        } else {
            self.lose(&causes(end));
        }
    }

    fn lose(&mut self, why: &str) {
        if let State::Met { key, .. } = self.state {
            tracing::warn!(why, "goes on without the other culler");
            self.part();
            self.unmet(key);
        }
    }

    /// Tells the display of the failure without the reason, which may reveal a foreign network.
    fn unmet(&mut self, key: SessionKey) {
        self.state = State::Single;
        self.unsaid = Some(RoleMessage::Unmet { key });
    }
}
