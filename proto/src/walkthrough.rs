//! Trimaran's protocol over its links.

use trimaran_wire::{BatchDecoder, BatchEncoder, Batching, Delivery, Protocol, Rejection};

use serde::{Deserialize, Serialize};

use crate::{
    Camera, DrawableId, FrameNumber, FrameStats, IdCoding, IdDecoder, IdEncoder, Identity, Role, SessionKey,
    ViewVersion, coding,
};

/// Trimaran's protocol: cameras on the latest lane, frames of ids, and messages between roles.
///
/// A frame's header is its camera, which has the display's number of the frame. The lane's own numbers count
/// the frames that a culler has sent over the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Walkthrough;

/// Messages between roles, beside cameras and ids.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum RoleMessage {
    /// A culler's statistics for a frame that it has sent.
    Stats(FrameStats),
    /// The display asks a culler to meet another one, for the schedule `switch`.
    Meet {
        /// The key by which the two recognize each other.
        key: SessionKey,
        /// The endpoint to connect to, as written in the culler's configuration; it connects to no others.
        /// `None`: the other culler connects.
        at: Option<String>,
    },
    /// The culler has a link to the other one.
    Met {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The culler got no such link, or has lost it.
    Unmet {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks both cullers to draw each other's visible drawables (paper, algorithm 4.2).
    Switch {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
        /// The first frame of this schedule: it has no frame of the other culler before it.
        first: FrameNumber,
    },
    /// The culler has switched.
    Switched {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks a culler to drop the other one, which is gone or late.
    Part,
    /// The display sends a part of a view state, before a camera that names the version.
    View {
        /// The version.
        version: ViewVersion,
        /// The next bytes of the [`ViewState`](crate::ViewState), encoded by postcard.
        part: Vec<u8>,
        /// Whether this part is the last.
        last: bool,
    },
    /// The culler waits for the other one, which may connect now.
    Waits {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
}

impl Protocol for Walkthrough {
    const NAME: &'static str = "trimaran/2";
    type Hello = Identity;
    type Latest = Camera;
    type Header = Camera;
    type Item = DrawableId;
    type Message = RoleMessage;

    fn name(hello: &Identity) -> String {
        hello.role.to_string()
    }

    fn admit(ours: &Identity, theirs: &Identity) -> Result<(), Rejection> {
        ours.admits(theirs)
    }

    fn role(hello: &Identity) -> Option<String> {
        Some(hello.role.to_string())
    }

    /// A restarted display continues its session.
    fn place(hello: &Identity) -> Option<u64> {
        let (key, _) = hello.session.filter(|_| hello.role == Role::Display)?;
        Some(key.0)
    }

    /// The display's settings decide.
    fn batching(ours: &Identity, theirs: &Identity) -> Option<Batching> {
        let (_, settings) = ours.session.or(theirs.session)?;
        Some(Batching { size: settings.batch, coded: settings.coding == IdCoding::Changes })
    }

    fn encoder(delivery: Delivery) -> Option<Box<dyn BatchEncoder<DrawableId>>> {
        Some(Box::new(IdEncoder::new(delivery)))
    }

    fn decoder(max_items: u32) -> Option<Box<dyn BatchDecoder<DrawableId>>> {
        Some(Box::new(IdDecoder::new(max_items)))
    }

    fn count_coded(bytes: &[u8]) -> Option<usize> {
        coding::count(bytes).ok()
    }
}
