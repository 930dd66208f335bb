//! A link between two peers after the handshake.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use trimaran_net::{Net, until};
use trimaran_wire::{Batching, CloseReason, Format, Protocol};

use crate::application::whole;
use crate::channels::Channels;
use crate::config::link::LinkConfig;
use crate::error::{ProtocolError, RecvError, SendError};
use crate::lanes::bulk::{BulkReceiver, BulkSender};
use crate::lanes::ends::Ends;
use crate::lanes::frames::{FrameReceiver, FrameSender};
use crate::lanes::latest::{LatestReceiver, LatestSender};
use crate::lanes::local::LocalLanes;
use crate::lanes::messages::{MessageReceiver, MessageSender};
use crate::lanes::records::RecordReceiver;
use crate::lanes::shared::Shared;
use crate::parts::{Lanes, LinkParts};
use crate::peer::{PeerAddress, PeerInfo};
use crate::rates::Messages;
use crate::stats::StatsHandle;
use crate::transport::Capabilities;

/// How long a closing peer waits for the other one to close as well.
const LINGER: Duration = Duration::from_millis(500);

/// A link to a peer: a lane for the latest value, a lane for frames of items, a lane for messages and, behind
/// these, a lane for blocks of bytes; each in both directions.
///
/// The halves are independent: take the struct apart and use each on any thread. Waiting calls work inside a
/// runtime as well as under `Handle::block_on` on a thread of the caller's.
///
/// A link that is dropped without [`Link::close`] looks to the peer like a crash.
#[derive(Debug)]
pub struct Link<P: Protocol> {
    /// The other end.
    pub peer: PeerInfo<P>,
    /// Publishes the latest value.
    pub latest_tx: LatestSender<P>,
    /// Reads the newest value.
    pub latest_rx: LatestReceiver<P>,
    /// Sends frames of items.
    pub frames_tx: FrameSender<P>,
    /// Receives frames of items.
    pub frames_rx: FrameReceiver<P>,
    /// Sends messages.
    pub messages_tx: MessageSender<P>,
    /// Receives messages.
    pub messages_rx: MessageReceiver<P>,
    /// Blocks of bytes that hold up nothing else. A task of its own may take it out.
    pub bulk: Option<Bulk>,
    /// Further lanes with types of their own, by name.
    pub channels: Channels,
    /// Traffic counters, readable at any time.
    pub stats: StatsHandle,
    pub(crate) capabilities: Capabilities,
    net: Arc<dyn Net>,
}

/// Both halves of a bulk lane.
#[derive(Debug)]
pub struct Bulk {
    /// Sends blocks.
    pub tx: BulkSender,
    /// Receives blocks.
    pub rx: BulkReceiver,
}

impl<P: Protocol> Link<P> {
    /// The guarantees of the link's transport.
    #[must_use]
    pub const fn capabilities(&self) -> Capabilities {
        self.capabilities
    }

    /// Closes the link on each lane. Then waits at most half a second for the peer to close as well, or, if
    /// the peer has left already, for the close to arrive. Data that still comes is discarded.
    ///
    /// A bulk lane that was taken out stays open: put it back first. Channels that were taken out stay open
    /// as well: close or drop them first.
    ///
    /// Dropping the future drops the link: the close may reach the peer on some lanes or none, and the peer
    /// then takes this side for lost.
    ///
    /// # Errors
    /// If the peer is gone without a close of its own, or takes nothing within the link's timeout.
    pub async fn close(self, reason: CloseReason) -> Result<(), SendError> {
        let Self { peer, latest_tx, mut latest_rx, frames_tx, mut frames_rx, .. } = self;
        let (messages_tx, mut messages_rx, net) = (self.messages_tx, self.messages_rx, self.net);
        let (channels_tx, channels_rx) = self.channels.rest();
        let (bulk_tx, mut bulk_rx) = self.bulk.map(|Bulk { tx, rx }| (tx, rx)).unzip();
        let say = async {
            let (frames, latest, messages, channels, bulk) = tokio::join!(
                frames_tx.close(reason.clone()),
                latest_tx.close(reason.clone()),
                messages_tx.close(reason.clone()),
                channels_tx.close(&reason),
                async {
                    match bulk_tx {
                        Some(bulk) => bulk.close(reason.clone()).await,
                        None => Ok(()),
                    }
                }
            );
            frames.and(latest).and(messages).and(channels).and(bulk)
        };
        // A connection that is closed while it holds unread data is reset, and on some systems the reset
        // overtakes the close on the peer's side. So everything is read until the peer closes.
        let hear = async {
            let (frames, latest, messages, channels, bulk) = tokio::join!(
                frames_rx.drain(),
                latest_rx.drain(),
                messages_rx.0.drain(),
                channels_rx.drain(),
                async {
                    match &mut bulk_rx {
                        Some(bulk) => Some(bulk.0.drain().await),
                        None => None,
                    }
                }
            );
            let lanes = [Some(frames), Some(latest), Some(messages), bulk];
            let mut ends = lanes.into_iter().flatten().chain(channels);
            (ends.any(|end| matches!(end, RecvError::Closed { .. })), latest_rx)
        };
        let (mut say, mut hear) = (pin!(say), pin!(hear));
        let soon = || net.now().after(LINGER);
        let (said, heard) = tokio::select! {
            biased;
            said = &mut say => {
                if said.is_ok() && peer.address == PeerAddress::InProcess {
                    return Ok(());
                }
                (said, until(&*net, soon(), hear).await)
            }
            heard = &mut hear => {
                let said = match heard {
                    // It may be unable to tell that all has arrived. The rest would not be read.
                    (true, _) => until(&*net, soon(), say).await.unwrap_or(Ok(())),
                    (false, _) => say.await,
                };
                (said, Some(heard))
            }
        };
        let Some((has_left, lane)) = heard else { return said };
        lane.0.part().await;
        // The peer may leave between the close on one lane and that on the other.
        if has_left { Ok(()) } else { said }
    }
}

impl LinkParts {
    /// The link, if its peer speaks `P`, which the handshake has ensured.
    pub(crate) fn into_link<P: Protocol>(
        self,
        net: &Arc<dyn Net>,
        config: &LinkConfig,
        format: &Format,
    ) -> Option<Link<P>> {
        let Self { lanes, channels, peer, session, address, capabilities, counters, .. } = self;
        let (idle_timeout, place) = (self.idle_timeout, self.place);
        let fit = channels.len() == P::CHANNELS.len()
            && channels.iter().zip(P::CHANNELS).all(|(channel, declared)| channel.fits(declared));
        if !fit {
            return None;
        }
        let hello = postcard::from_bytes(&peer.hello).ok()?;
        let local = address == PeerAddress::InProcess;
        let most = if local { u32::MAX } else { config.messages_per_s };
        let batching = peer.batching.unwrap_or(config.batching);
        let stats = counters.handle();
        let shared = Shared { peer: peer.name.clone(), counters, _place: place };
        let ends = Ends { net: Arc::clone(net), shared, timeout: config.timeout, idle_timeout };
        let (latest, frames, messages, bulk) = match lanes {
            Lanes::Wire(lanes) => (
                ends.wire(lanes.latest),
                ends.wire(lanes.frames),
                ends.wire(lanes.messages),
                ends.wire(lanes.bulk),
            ),
            Lanes::Local(lanes) => {
                let lanes = *lanes.downcast::<LocalLanes<P>>().ok()?;
                (
                    ends.local(lanes.latest),
                    ends.local(lanes.frames),
                    ends.local(lanes.messages),
                    ends.local(lanes.bulk),
                )
            }
        };
        let (max_frame, rate) = (config.max_frame, || Messages::new(most));
        Some(Link {
            peer: PeerInfo { name: peer.name, hello, session, address, version: peer.version },
            capabilities,
            net: Arc::clone(net),
            stats,
            latest_tx: LatestSender(latest.0),
            latest_rx: LatestReceiver(latest.1),
            frames_tx: FrameSender::new(batching, max_frame, capabilities, format, frames.0),
            frames_rx: FrameReceiver::new(max_frame, format, frames.1, rate()),
            messages_tx: MessageSender(messages.0),
            messages_rx: MessageReceiver(RecordReceiver {
                lane: messages.1,
                rate: Some(rate()),
                read: |bytes| whole(&bytes).map_err(ProtocolError::Message),
            }),
            channels: Channels {
                declared: P::CHANNELS,
                open: channels.into_iter().map(Some).collect(),
                ends,
                // Nothing is coded within one process.
                batching: Batching { coded: batching.coded && !local, ..batching },
                max_frame,
                capabilities,
                messages_per_s: most,
            },
            bulk: Some(Bulk {
                tx: BulkSender(bulk.0),
                rx: BulkReceiver(RecordReceiver { lane: bulk.1, rate: None, read: Ok }),
            }),
        })
    }
}
