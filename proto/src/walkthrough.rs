//! What Trimaran says over its links.

use trimaran_wire::{BatchDecoder, BatchEncoder, Batching, Delivery, Protocol, Rejection};

use serde::{Deserialize, Serialize};

use crate::{
    Camera, DrawableId, FrameNumber, FrameStats, IdCoding, IdDecoder, IdEncoder, Identity, Role, SessionKey,
    ViewVersion, coding,
};

/// Trimaran's protocol: cameras on the latest lane, frames of ids, and messages in which roles
/// arrange how they work.
///
/// A frame's header is the camera that it was culled for, which has the display's number of the frame. The
/// lane's own numbers count what a culler has sent over the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Walkthrough;

/// What roles say to each other beside cameras and ids.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum RoleMessage {
    /// A culler says what it did for a frame that it has sent.
    Stats(FrameStats),
    /// The display asks a culler to meet another one, for the schedule `switch`.
    Meet {
        /// By what the two know each other.
        key: SessionKey,
        /// Which of the endpoints that the culler was configured with, as it is written there: it connects to
        /// no other one. Without it the other culler comes.
        at: Option<String>,
    },
    /// The culler has a link to the other one.
    Met {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The culler did not get one, or has lost it.
    Unmet {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks both cullers to draw what the other one finds (paper, algorithm 4.2).
    Switch {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
        /// From this frame on. It is the first that has no frame of the other culler before it.
        first: FrameNumber,
    },
    /// The culler does so.
    Switched {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks a culler to let the other one go: it is gone, or late.
    Part,
    /// The display tells a part of a view state, before it sends a camera that names the version.
    View {
        /// Which one.
        version: ViewVersion,
        /// The next bytes of the [`ViewState`](crate::ViewState), as postcard writes it.
        part: Vec<u8>,
        /// Whether they are the last ones.
        last: bool,
    },
    /// The culler waits for the other one, which may come now.
    Waits {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
}

impl Protocol for Walkthrough {
    const NAME: &'static str = "trimaran/1";
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

    /// A display that is started again goes on with its session.
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
