//! Links that carry what Trimaran says: those of `trimaran-transport` over [`Walkthrough`].

use trimaran_proto::{Camera, SentBytes, Walkthrough};
use trimaran_transport::{self as transport, Traffic};

/// A link between two roles.
pub type Link = transport::Link<Walkthrough>;
/// Takes roles that connect.
pub type Listener = transport::Listener<Walkthrough>;
/// Publishes cameras.
pub type LatestSender = transport::LatestSender<Walkthrough>;
/// Reads the newest camera.
pub type LatestReceiver = transport::LatestReceiver<Walkthrough>;
/// Sends frames of ids.
pub type FrameSender = transport::FrameSender<Walkthrough>;
/// Receives frames of ids.
pub type FrameReceiver = transport::FrameReceiver<Walkthrough>;
/// Sends messages.
pub(crate) type MessageSender = transport::MessageSender<Walkthrough>;
/// What a receiver of frames learns.
pub type FrameEvent = transport::FrameEvent<Walkthrough>;
/// How a frame begins: its number, and the camera that its ids were culled for.
pub type FrameStart = transport::FrameStart<Camera>;

/// What a link carried, by kind.
#[must_use]
pub const fn sent_bytes(traffic: Traffic) -> SentBytes {
    SentBytes {
        camera: traffic.latest.bytes,
        begin: traffic.begin.bytes,
        ids: traffic.batches.bytes,
        end: traffic.end.bytes,
        control: traffic.control.bytes + traffic.messages.bytes,
        geometry: traffic.bulk.bytes,
        headers: traffic.header_bytes,
        messages: traffic.latest.messages
            + traffic.begin.messages
            + traffic.batches.messages
            + traffic.end.messages
            + traffic.messages.messages
            + traffic.bulk.messages
            + traffic.control.messages,
    }
}
