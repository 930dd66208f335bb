//! Links with Trimaran's messages: those of `trimaran-transport` over [`Walkthrough`].

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
/// Receives messages.
pub(crate) type MessageReceiver = transport::MessageReceiver<Walkthrough>;
/// Sends messages.
pub(crate) type MessageSender = transport::MessageSender<Walkthrough>;
/// An event of a frame receiver.
pub type FrameEvent = transport::FrameEvent<Walkthrough>;
/// The beginning of a frame: its number, and the camera for which its ids were culled.
pub type FrameStart = transport::FrameStart<Camera>;

/// The traffic of a link, by kind.
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
