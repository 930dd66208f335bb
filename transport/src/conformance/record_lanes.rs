//! The two lanes of records behind one trait, so that each case covers both.

use std::fmt;

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_wire::{MAX_BLOCK, MAX_MESSAGE};

use super::robot::{Command, Robot};
use super::talk::{block, command};
use crate::{
    BulkReceiver, BulkSender, FrameReceiver, FrameSender, LatestReceiver, LatestSender, Link,
    MessageReceiver, MessageSender, RecvError, SendError,
};

/// A lane of records, as the cases use it.
pub(super) trait Lane: Sized {
    /// The other lane of records.
    type Other: Lane;
    type Tx;
    type Rx;
    type Record: PartialEq + fmt::Debug;
    /// The most bytes of a record.
    const MOST: usize;

    /// The lane's halves, and those of the other lane.
    fn halves(link: &mut Link<Robot>) -> Halves<'_, Self>;

    /// Drops the lane's halves, and returns the rest.
    fn without(link: Link<Robot>) -> impl Sized;

    /// A record of this number: some are long.
    fn record(number: u32) -> Self::Record;

    /// A record of so many bytes, if its number is below 128.
    fn of_length(number: u32, bytes: usize) -> Self::Record;

    fn send(tx: &mut Self::Tx, record: &Self::Record) -> impl Future<Output = Result<(), SendError>>;

    /// Receives, until `by` if that is given.
    fn recv(rx: &mut Self::Rx, by: Option<Instant>) -> impl Future<Output = Result<Self::Record, RecvError>>;

    fn try_recv(rx: &mut Self::Rx) -> Result<Option<Self::Record>, RecvError>;
}

pub(super) struct Halves<'l, L: Lane> {
    pub(super) tx: &'l mut L::Tx,
    pub(super) rx: &'l mut L::Rx,
    pub(super) frames_tx: &'l mut FrameSender<Robot>,
    pub(super) frames_rx: &'l mut FrameReceiver<Robot>,
    pub(super) latest_tx: &'l mut LatestSender<Robot>,
    pub(super) latest_rx: &'l mut LatestReceiver<Robot>,
}

pub(super) struct Messages;

impl Lane for Messages {
    type Other = Bulk;
    type Tx = MessageSender<Robot>;
    type Rx = MessageReceiver<Robot>;
    type Record = Command;
    const MOST: usize = MAX_MESSAGE;

    fn halves(link: &mut Link<Robot>) -> Halves<'_, Self> {
        let Link { messages_tx: tx, messages_rx: rx, frames_tx, frames_rx, latest_tx, latest_rx, .. } = link;
        Halves { tx, rx, frames_tx, frames_rx, latest_tx, latest_rx }
    }

    fn without(link: Link<Robot>) -> impl Sized {
        let Link { latest_tx, latest_rx, frames_tx, frames_rx, bulk, .. } = link;
        (latest_tx, latest_rx, frames_tx, frames_rx, bulk)
    }

    fn record(number: u32) -> Command {
        command(number)
    }

    fn of_length(number: u32, bytes: usize) -> Command {
        // A number of one byte, and a length of two.
        Command { number, program: "x".repeat(bytes - 3) }
    }

    async fn send(tx: &mut Self::Tx, record: &Command) -> Result<(), SendError> {
        tx.send(record).await
    }

    async fn recv(rx: &mut Self::Rx, by: Option<Instant>) -> Result<Command, RecvError> {
        match by {
            Some(by) => rx.recv_by(by).await,
            None => rx.recv().await,
        }
    }

    fn try_recv(rx: &mut Self::Rx) -> Result<Option<Command>, RecvError> {
        rx.try_recv()
    }
}

pub(super) struct Bulk;

impl Lane for Bulk {
    type Other = Messages;
    type Tx = BulkSender;
    type Rx = BulkReceiver;
    type Record = Bytes;
    const MOST: usize = MAX_BLOCK;

    fn halves(link: &mut Link<Robot>) -> Halves<'_, Self> {
        let Link { bulk, frames_tx, frames_rx, latest_tx, latest_rx, .. } = link;
        let crate::Bulk { tx, rx } = bulk.as_mut().unwrap();
        Halves { tx, rx, frames_tx, frames_rx, latest_tx, latest_rx }
    }

    fn without(link: Link<Robot>) -> impl Sized {
        let Link { latest_tx, latest_rx, frames_tx, frames_rx, messages_tx, messages_rx, .. } = link;
        (latest_tx, latest_rx, frames_tx, frames_rx, messages_tx, messages_rx)
    }

    fn record(number: u32) -> Bytes {
        block(number)
    }

    fn of_length(number: u32, bytes: usize) -> Bytes {
        number.to_le_bytes().into_iter().cycle().take(bytes).collect()
    }

    async fn send(tx: &mut Self::Tx, record: &Bytes) -> Result<(), SendError> {
        tx.send(record.clone()).await
    }

    async fn recv(rx: &mut Self::Rx, by: Option<Instant>) -> Result<Bytes, RecvError> {
        match by {
            Some(by) => rx.recv_by(by).await,
            None => rx.recv().await,
        }
    }

    fn try_recv(rx: &mut Self::Rx) -> Result<Option<Bytes>, RecvError> {
        rx.try_recv()
    }
}
