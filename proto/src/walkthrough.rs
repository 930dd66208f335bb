//! Trimaran's protocol over its links.

use trimaran_wire::{BatchDecoder, BatchEncoder, Batching, Delivery, Protocol, Rejection};

use crate::{
    BatchSize, Camera, DrawableId, IdCoding, IdDecoder, IdEncoder, Identity, Role, RoleMessage, coding,
};

/// Trimaran's protocol: cameras on the latest lane, frames of ids, and messages between roles.
///
/// A frame's header is its camera, which has the display's number of the frame. The lane's own numbers count
/// the frames that a culler has sent over the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Walkthrough;

impl Walkthrough {
    /// The batches that a relay sends to displays that watch.
    #[must_use]
    pub fn relayed() -> Batching {
        Batching { size: BatchSize::default(), coded: true }
    }
}

impl Protocol for Walkthrough {
    const NAME: &'static str = "trimaran/4";
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

    /// To a display, a relay is its culler, and has a culler's key.
    fn role(hello: &Identity) -> Option<String> {
        let role = if hello.role == Role::Relay { Role::Culler } else { hello.role };
        Some(role.to_string())
    }

    /// A restarted display continues its session.
    fn place(hello: &Identity) -> Option<u64> {
        let (key, _) = hello.session.filter(|_| hello.role == Role::Display)?;
        Some(key.0)
    }

    /// The display's settings decide. One that watches has none: a relay sends it changes.
    fn batching(ours: &Identity, theirs: &Identity) -> Option<Batching> {
        let Some((_, settings)) = ours.session.or(theirs.session) else {
            let is_relayed = [ours.role, theirs.role].contains(&Role::Relay);
            return is_relayed.then(Self::relayed);
        };
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
