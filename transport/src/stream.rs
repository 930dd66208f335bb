//! Both lanes over byte streams: TCP, and whatever else carries bytes in order.

mod desk;
mod frames;
mod handshake;
mod inlet;
mod introduce;
mod latest;
mod pulse;
mod source;

pub(crate) use desk::serve;
pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use introduce::introduce;
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use source::{Sink, Source};
