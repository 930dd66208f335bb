//! The datagrams of a connection, shared out among its lanes of values.
//!
//! Without channels there is one such lane. With channels the first byte of a datagram says whose it is: 0
//! for the latest lane, and from 1 on for channels, by their numbers.

use std::sync::Arc;

use bytes::{Buf, Bytes};
use futures_util::stream::{self, BoxStream, StreamExt};
use quinn::{Connection, ConnectionError};
use tokio::sync::watch;
use trimaran_net::Net;
use trimaran_wire::{ChannelNumber, ChannelSizes, Format, Numbered, Serial};

/// The datagrams of one lane, without the byte that says whose they are.
pub(super) type Datagrams = BoxStream<'static, Result<Bytes, ConnectionError>>;

/// The newest datagram of a lane.
type Newest = Option<(Serial, Bytes)>;

/// The first byte of the datagrams of a lane of values, where there are channels.
pub(super) const fn mark(format: &Format, channel: Option<ChannelNumber>) -> Option<u8> {
    match channel {
        _ if format.channels.is_empty() => None,
        None => Some(0),
        Some(ChannelNumber(number)) => Some(number + 1),
    }
}

/// The bytes of the datagrams of each lane of values.
pub(super) fn sizes(format: &Format) -> impl Iterator<Item = usize> {
    let values = format.channels.iter().filter_map(|channel| match channel.sizes() {
        ChannelSizes::Latest { value } => Some(usize::from(value)),
        ChannelSizes::Frames { .. } => None,
    });
    let beside = usize::from(!format.channels.is_empty()) + Numbered::NUMBER_BYTES;
    [format.latest].into_iter().chain(values).map(move |value| beside + value)
}

/// The datagrams of the latest lane, and of each channel.
pub(super) fn share(net: &Arc<dyn Net>, connection: &Connection, format: &Format) -> Vec<Datagrams> {
    if format.channels.is_empty() {
        let read = |connection: Connection| async { Some((connection.read_datagram().await, connection)) };
        return vec![stream::unfold(connection.clone(), read).boxed()];
    }
    let (cells, lanes): (Vec<_>, Vec<_>) =
        (0..=format.channels.len()).map(|_| watch::channel(Newest::None)).unzip();
    net.spawn(Box::pin(sort(connection.clone(), cells)));
    let read = |(mut lane, connection): (watch::Receiver<Newest>, Connection)| async {
        let came = lane.changed().await;
        let newest = lane.borrow_and_update().clone();
        let read = match (came, newest) {
            (Ok(()), Some((_, datagram))) => Ok(datagram),
            _ => Err(connection.close_reason().unwrap_or(ConnectionError::LocallyClosed)),
        };
        Some((read, (lane, connection)))
    };
    lanes.into_iter().map(|lane| stream::unfold((lane, connection.clone()), read).boxed()).collect()
}

/// Puts each datagram into the cell of its lane, unless a newer one is there. A datagram of no lane goes to
/// the first, whose reader refuses it.
async fn sort(connection: Connection, cells: Vec<watch::Sender<Newest>>) {
    while let Ok(mut datagram) = connection.read_datagram().await {
        let cell = datagram.first().and_then(|mark| cells.get(usize::from(*mark)));
        let number = datagram.get(1..).and_then(|rest| rest.first_chunk().copied());
        match (cell, number) {
            (Some(cell), Some(number)) => {
                datagram.advance(1);
                let number = Serial(u32::from_le_bytes(number));
                cell.send_if_modified(|newest| {
                    let is_newer = newest.as_ref().is_none_or(|(last, _)| number.is_after(*last));
                    if is_newer {
                        *newest = Some((number, datagram));
                    }
                    is_newer
                });
            }
            _ => {
                if let Some(first) = cells.first() {
                    first.send_replace(Some((Serial::default(), Bytes::new())));
                }
            }
        }
    }
}
