//! The frames lane: begin, batches, end.

mod events;
mod last;
mod published;
mod receiver;
mod sender;
mod shared;
mod whole;

pub use last::KeepLast;
pub(crate) use published::{Assembly, PublishedFrame};
pub use receiver::FrameReceiver;
pub use sender::FrameSender;
pub use shared::{SharedFrame, SharedFrames};
pub use whole::WholeFrame;
