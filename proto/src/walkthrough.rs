//! What Trimaran says over its links.

use trimaran_wire::{BatchDecoder, BatchEncoder, Batching, Delivery, Protocol, Rejection};

use serde::{Deserialize, Serialize};

use crate::{Camera, DrawableId, FrameStats, IdCoding, IdDecoder, IdEncoder, Identity, coding};

/// Trimaran's protocol: cameras on the latest lane, frames of ids, and messages of what the sender did for a
/// frame.
///
/// A frame's header is the camera that it was culled for. The camera's own frame number is the one that the
/// display gave it; in live mode that may be another than the frame's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Walkthrough;

/// What roles say to each other beside cameras and ids.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum RoleMessage {
    /// What a culler did for a frame that it has sent.
    Stats(FrameStats),
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

    /// The display's settings decide.
    fn batching(ours: &Identity, theirs: &Identity) -> Option<Batching> {
        let settings = ours.settings.or(theirs.settings)?;
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
