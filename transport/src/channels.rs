//! The channels of a link, by name and type.

use std::convert::Infallible;
use std::fmt;

use bytes::Bytes;
use thiserror::Error;
use trimaran_wire::{
    Batching, Channel, CloseReason, Fixed, FixedBytes, Format, FrameMessage, FramesOf, Item, LatestOf,
    Protocol,
};

use crate::concurrent::try_all;
use crate::error::{RecvError, SendError};
use crate::lanes::ByteChannel;
use crate::lanes::ends::{Ends, Receiver, Sender};
use crate::lanes::frames::{FrameReceiver, FrameSender};
use crate::lanes::latest::{LatestReceiver, LatestSender};
use crate::rates::Messages;
use crate::transport::Capabilities;

/// The channels of a link: further lanes, as [`Protocol::CHANNELS`](crate::Protocol::CHANNELS) declares them.
/// Take out what you use, and keep or drop the rest: a channel that is not taken out holds up only its own
/// sender.
///
/// ```
/// # use trimaran_transport::{Channel, ChannelError, FrameSender, FramesOf, Link, Protocol};
/// # fn show<P: Protocol>(link: &mut Link<P>) -> Result<(), ChannelError> {
/// // const CHANNELS: &[Channel] = &[Channel::latest::<()>("alive"), Channel::frames::<(), u32>("cells")];
/// let (mut alive_tx, mut alive_rx) = link.channels.latest::<()>("alive")?;
/// let (mut cells_tx, mut cells_rx) = link.channels.frames::<(), u32>("cells")?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Channels {
    pub(crate) declared: &'static [Channel],
    /// Those that were not taken out yet.
    pub(crate) open: Vec<Option<ByteChannel>>,
    pub(crate) ends: Ends,
    pub(crate) batching: Batching,
    pub(crate) max_frame: u32,
    pub(crate) capabilities: Capabilities,
    /// The most messages a second.
    pub(crate) messages_per_s: u32,
}

/// The halves of a channel of values.
pub type LatestHalves<V> = (LatestSender<LatestOf<V>>, LatestReceiver<LatestOf<V>>);

/// The halves of a channel of frames.
pub type FrameHalves<H, I> = (FrameSender<FramesOf<H, I>>, FrameReceiver<FramesOf<H, I>>);

/// Why a channel could not be taken out.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ChannelError {
    /// The protocol has no channel of that name.
    #[error("there is no channel `{name}`; the protocol's CHANNELS are {declared}")]
    Unknown {
        /// The name.
        name: String,
        /// All channels, as code.
        declared: String,
    },
    /// The channel has another kind or other types.
    #[error("the channel `{name}` was asked for as {asked}, and CHANNELS declares {declared}")]
    Types {
        /// The name.
        name: String,
        /// The kind and types asked for, as code.
        asked: String,
        /// The declared ones.
        declared: String,
    },
    /// The channel was taken out before.
    #[error("the channel `{name}` was taken out before: it has one pair of halves on a link")]
    Taken {
        /// The name.
        name: String,
    },
}

impl Channels {
    /// Takes out the halves of the channel of values `name`.
    ///
    /// # Errors
    /// If there is none of that name and type, or it was taken out before.
    pub fn latest<V>(&mut self, name: &str) -> Result<LatestHalves<V>, ChannelError>
    where
        V: Fixed + Clone + PartialEq + fmt::Debug,
    {
        match self.take(name, &Channel::latest::<V>("asked"))? {
            ByteChannel::Latest(halves) => {
                let (tx, rx) = self.ends.wire(halves);
                Ok((LatestSender(tx), LatestReceiver(rx)))
            }
            ByteChannel::Frames(_) => Err(ChannelError::Taken { name: name.to_owned() }),
        }
    }

    /// Takes out the halves of the channel of frames `name`. Its items travel plain, in batches of the link's
    /// size.
    ///
    /// # Errors
    /// If there is none of that name and types, or it was taken out before.
    pub fn frames<H, I>(&mut self, name: &str) -> Result<FrameHalves<H, I>, ChannelError>
    where
        H: Fixed + Clone + PartialEq + fmt::Debug,
        I: Item,
    {
        self.take_frames(name, &Channel::frames::<H, I>("asked"))
    }

    /// Takes out the halves of the channel of frames `name` that is declared by [`Channel::frames_of`]. Its
    /// batches are coded where those of the link are.
    ///
    /// # Errors
    /// If there is none of that name and protocol, or it was taken out before.
    pub fn frames_of<P: Protocol>(
        &mut self,
        name: &str,
    ) -> Result<(FrameSender<P>, FrameReceiver<P>), ChannelError> {
        self.take_frames(name, &Channel::frames_of::<P>("asked"))
    }

    fn take_frames<P: Protocol>(
        &mut self,
        name: &str,
        asked: &Channel,
    ) -> Result<(FrameSender<P>, FrameReceiver<P>), ChannelError> {
        match self.take(name, asked)? {
            ByteChannel::Frames(halves) => {
                let (tx, rx) = self.ends.wire(halves);
                let batching = Batching {
                    size: self.batching.size,
                    coded: self.batching.coded && asked.count_coded().is_some(),
                };
                let format = Format::of::<P>();
                Ok((
                    FrameSender::new(batching, self.max_frame, self.capabilities, &format, tx),
                    FrameReceiver::new(self.max_frame, &format, rx, Messages::new(self.messages_per_s)),
                ))
            }
            ByteChannel::Latest(_) => Err(ChannelError::Taken { name: name.to_owned() }),
        }
    }

    /// The channels of the protocol, in their order.
    #[must_use]
    pub const fn declared(&self) -> &'static [Channel] {
        self.declared
    }

    fn take(&mut self, name: &str, asked: &Channel) -> Result<ByteChannel, ChannelError> {
        let name_of = || name.to_owned();
        let mut channels = self.declared.iter().zip(&mut self.open);
        let Some((channel, open)) = channels.find(|(channel, _)| channel.name() == name) else {
            let code = |channel: &Channel| format!("{}({:?})", channel.declared(), channel.name());
            let all: Vec<_> = self.declared.iter().map(code).collect();
            let declared = if all.is_empty() { "none".to_owned() } else { all.join(", ") };
            return Err(ChannelError::Unknown { name: name_of(), declared });
        };
        if !channel.is_like(asked) {
            let (asked, declared) = (asked.declared(), channel.declared());
            return Err(ChannelError::Types { name: name_of(), asked, declared });
        }
        open.take().ok_or_else(|| ChannelError::Taken { name: name_of() })
    }

    /// The halves of those that were not taken out.
    pub(crate) fn rest(self) -> (Unsent, Unread) {
        let Self { open, ends, .. } = self;
        let (mut unsent, mut unread) = (Unsent(Vec::new()), Unread(Vec::new()));
        for channel in open.into_iter().flatten() {
            let (tx, rx) = match channel {
                ByteChannel::Latest(halves) => {
                    let (tx, rx) = ends.wire(halves);
                    (RawTx::Latest(tx), RawRx::Latest(rx))
                }
                ByteChannel::Frames(halves) => {
                    let (tx, rx) = ends.wire(halves);
                    (RawTx::Frames(tx), RawRx::Frames(rx))
                }
            };
            unsent.0.push(tx);
            unread.0.push(rx);
        }
        (unsent, unread)
    }
}

/// The sending halves of channels that nobody uses.
pub(crate) struct Unsent(Vec<RawTx>);

/// The receiving halves of channels that nobody uses.
pub(crate) struct Unread(Vec<RawRx>);

enum RawTx {
    Latest(Sender<Bytes, FixedBytes>),
    Frames(Sender<Bytes, FrameMessage>),
}

enum RawRx {
    Latest(Receiver<Bytes, FixedBytes>),
    Frames(Receiver<Bytes, FrameMessage>),
}

impl Unsent {
    /// Closes all of them. Returns an error if one could not be closed, once the others are.
    pub(crate) async fn close(self, reason: &CloseReason) -> Result<(), SendError> {
        let close = async |tx| Ok::<_, Infallible>(close(tx, reason).await);
        let closed = try_all(self.0.into_iter().map(close)).await.unwrap_or_default();
        closed.into_iter().collect()
    }
}

async fn close(tx: RawTx, reason: &CloseReason) -> Result<(), SendError> {
    match tx {
        RawTx::Latest(tx) => tx.close(reason.clone()).await,
        RawTx::Frames(mut tx) => {
            tx.stage_close(reason.clone())?;
            tx.send_staged().await?;
            tx.closed().await
        }
    }
}

impl Unread {
    /// Discards everything until each has ended.
    pub(crate) async fn drain(self) -> Vec<RecvError> {
        let drain = async |rx| {
            Ok::<_, Infallible>(match rx {
                RawRx::Latest(rx) => rx.drain().await,
                RawRx::Frames(rx) => rx.drain().await,
            })
        };
        try_all(self.0.into_iter().map(drain)).await.unwrap_or_default()
    }
}
