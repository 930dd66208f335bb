//! Lanes within this process: values are passed on without encoding.

mod frames;
mod latest;
mod records;

use std::sync::Arc;
use std::task::{Context, Poll, ready};

use bytes::Bytes;
use trimaran_wire::{
    Channel, ChannelSizes, CloseReason, FixedBytes, Format, FrameEvent, FrameMessage, Kind, Protocol,
};

use super::queue::Receiver;
use super::records::{Measured, RecordLane};
use super::{ByteChannel, Lanes};
use crate::error::{LaneError, Loss};
use crate::stats::Counters;

/// Lanes of an application's values.
pub(crate) type LocalLanes<P> =
    Lanes<<P as Protocol>::Latest, FrameEvent<P>, Measured<<P as Protocol>::Message>, Measured<Bytes>>;

/// Both ends of such lanes, which count their traffic there.
pub(crate) fn pair<P: Protocol>(format: &Format, counters: [&Arc<Counters>; 2]) -> [LocalLanes<P>; 2] {
    let [here, there] = counters;
    let (ways, back) = ([here, there], [there, here]);
    let latest = |ways| latest::latest(format, ways);
    let frames = |ways| frames::frames(format, ways, frames::weight::<P>);
    let ((latest_a, latest_rx_b), (latest_b, latest_rx_a)) = (latest(ways), latest(back));
    let ((frames_a, frames_rx_b), (frames_b, frames_rx_a)) = (frames(ways), frames(back));
    let [messages_a, messages_b] = records::records(RecordLane::Messages, ways);
    let [bulk_a, bulk_b] = records::records(RecordLane::Bulk, ways);
    [
        Lanes {
            latest: (Box::new(latest_a), Box::new(latest_rx_a)),
            frames: (Box::new(frames_a), Box::new(frames_rx_a)),
            messages: messages_a,
            bulk: bulk_a,
        },
        Lanes {
            latest: (Box::new(latest_b), Box::new(latest_rx_b)),
            frames: (Box::new(frames_b), Box::new(frames_rx_b)),
            messages: messages_b,
            bulk: bulk_b,
        },
    ]
}

/// Both ends of a channel, which count their traffic there. Values and headers are bytes already.
#[cfg_attr(not(feature = "inproc"), allow(dead_code, reason = "only inproc calls it"))]
pub(crate) fn channel(declared: &Channel, [here, there]: [&Arc<Counters>; 2]) -> [ByteChannel; 2] {
    let (ways, back, format) = ([here, there], [there, here], &Format::of_channel(declared));
    match declared.sizes() {
        ChannelSizes::Latest { .. } => {
            let of = |ways| latest::latest::<FixedBytes>(format, ways);
            let ((near_tx, far_rx), (far_tx, near_rx)) = (of(ways), of(back));
            [(near_tx, near_rx), (far_tx, far_rx)]
                .map(|(tx, rx)| ByteChannel::Latest((Box::new(tx), Box::new(rx))))
        }
        ChannelSizes::Frames { .. } => {
            let weight = |message: &FrameMessage, _: usize| (message.kind(), message.payload());
            let of = |ways| frames::frames(format, ways, weight);
            let ((near_tx, far_rx), (far_tx, near_rx)) = (of(ways), of(back));
            [(near_tx, near_rx), (far_tx, far_rx)]
                .map(|(tx, rx)| ByteChannel::Frames((Box::new(tx), Box::new(rx))))
        }
    }
}

/// Entries of a queue.
#[derive(Debug)]
enum Said<T> {
    Data(T),
    Close(CloseReason),
}

/// The next data of a lane, up to its close.
fn poll_next<T>(
    queue: &mut Receiver<Said<T>>,
    closed: &mut Option<CloseReason>,
    counters: &Counters,
    cx: &Context<'_>,
) -> Poll<Result<T, LaneError>> {
    if let Some(reason) = closed {
        return Poll::Ready(Err(LaneError::Closed(reason.clone())));
    }
    Poll::Ready(match ready!(queue.poll_recv(cx)) {
        Some(Said::Data(data)) => Ok(data),
        Some(Said::Close(reason)) => {
            counters.received.count(Kind::Close, 0);
            *closed = Some(reason.clone());
            Err(LaneError::Closed(reason))
        }
        None => Err(LaneError::Lost(Loss::Closed)),
    })
}
