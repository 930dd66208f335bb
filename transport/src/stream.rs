//! Both lanes over byte streams: TCP, and whatever else carries bytes in order.

mod frames;
mod latest;
mod source;

pub(crate) use frames::{FrameRx, FrameTx};
pub(crate) use latest::{LatestRx, LatestTx};
pub(crate) use source::{Sink, Source};
