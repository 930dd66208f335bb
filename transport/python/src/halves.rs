//! The halves of a link, whichever thread uses them, and the link put together again to close it.

use std::sync::Arc;

use tokio::sync::{Mutex, oneshot, watch};
use trimaran_transport::untyped::{RawValue, Untyped};
use trimaran_transport::{
    BlobReceiver, BlobSender, Bulk, CloseReason, FrameNumber, FrameReceiver, FrameSender, FrameStart,
    LatestReceiver, LatestSender, Link, MessageReceiver, MessageSender, SendError,
};

use crate::subscription::Subscription;

/// Half of a lane. `None` once the link is closed.
pub(crate) type Half<T> = Mutex<Option<T>>;

/// The halves of a link.
pub(crate) struct Halves {
    pub(crate) latest_tx: Half<LatestSender<Untyped>>,
    pub(crate) latest_rx: Half<LatestReceiver<Untyped>>,
    pub(crate) frames_tx: Half<Frames>,
    pub(crate) frames_rx: Half<FrameReceiver<Untyped>>,
    pub(crate) messages_tx: Half<MessageSender<Untyped>>,
    pub(crate) messages_rx: Half<MessageReceiver<Untyped>>,
    pub(crate) bulk_tx: Half<BlobSender>,
    pub(crate) bulk_rx: Half<BlobReceiver>,
    /// Whether this side closes the link: every wait ends.
    closing: watch::Sender<bool>,
}

/// The sender of frames.
pub(crate) enum Frames {
    /// It is here, and the next frame has this number if none is given.
    Here(Box<FrameSender<Untyped>>, u32),
    /// A publisher has it.
    Published(Subscription),
}

/// The reason of a close, and who waits for its end.
pub(crate) type Closing = (CloseReason, oneshot::Sender<Result<(), SendError>>);

impl Halves {
    /// `None` if this side closes the link, or has closed it.
    pub(crate) async fn until_closed<R>(&self, work: impl Future<Output = Option<R>>) -> Option<R> {
        let mut closing = self.closing.subscribe();
        tokio::select! {
            biased;
            ended = work => ended,
            _ = closing.wait_for(|closing| *closing) => None,
        }
    }
}

/// Keeps what is left of a link whose halves are spread, and puts it together again to close it.
pub(crate) async fn keep(
    mut link: Link<Untyped>,
    max_blob: u64,
    spread: oneshot::Sender<Arc<Halves>>,
    asked: oneshot::Receiver<Closing>,
) {
    let (bulk_tx, bulk_rx) = link.bulk.take().map(|bulk| (bulk.tx.blobs(), bulk.rx.blobs(max_blob))).unzip();
    let halves = Arc::new(Halves {
        latest_tx: Mutex::new(Some(link.latest_tx)),
        latest_rx: Mutex::new(Some(link.latest_rx)),
        frames_tx: Mutex::new(Some(Frames::Here(Box::new(link.frames_tx), 0))),
        frames_rx: Mutex::new(Some(link.frames_rx)),
        messages_tx: Mutex::new(Some(link.messages_tx)),
        messages_rx: Mutex::new(Some(link.messages_rx)),
        bulk_tx: Mutex::new(bulk_tx),
        bulk_rx: Mutex::new(bulk_rx),
        closing: watch::Sender::new(false),
    });
    let weak = Arc::downgrade(&halves);
    if spread.send(halves).is_err() {
        return;
    }
    let Ok((reason, closed)) = asked.await else { return };
    let Some(halves) = weak.upgrade() else { return };
    halves.closing.send_replace(true);
    let frames = match halves.frames_tx.lock().await.take() {
        Some(Frames::Here(sender, _)) => Some(*sender),
        Some(Frames::Published(subscription)) => subscription.end().await,
        None => None,
    };
    let (Some(latest_tx), Some(latest_rx), Some(frames_tx), Some(frames_rx)) = (
        halves.latest_tx.lock().await.take(),
        halves.latest_rx.lock().await.take(),
        frames,
        halves.frames_rx.lock().await.take(),
    ) else {
        // Its sender of frames has failed.
        return;
    };
    let (Some(messages_tx), Some(messages_rx)) =
        (halves.messages_tx.lock().await.take(), halves.messages_rx.lock().await.take())
    else {
        return;
    };
    let bulk = halves.bulk_tx.lock().await.take().zip(halves.bulk_rx.lock().await.take());
    (link.latest_tx, link.latest_rx, link.frames_tx, link.frames_rx) =
        (latest_tx, latest_rx, frames_tx, frames_rx);
    (link.messages_tx, link.messages_rx) = (messages_tx, messages_rx);
    link.bulk = bulk.map(|(tx, rx)| Bulk { tx: tx.into_blocks(), rx: rx.into_blocks() });
    let _nobody = closed.send(link.close(reason).await);
}

/// Sends a frame, and returns its number. The error is none if a publisher has the sender.
pub(crate) async fn send(
    frames: &mut Frames,
    number: Option<u32>,
    header: RawValue,
    items: &[u8],
) -> Result<u32, Option<SendError>> {
    let Frames::Here(sender, next) = frames else { return Err(None) };
    let number = number.unwrap_or(*next);
    sender.begin(FrameStart { frame: FrameNumber(number), header }).await.map_err(Some)?;
    *next = number.saturating_add(1);
    sender.push(items).await.map_err(Some)?;
    sender.finish().await.map_err(Some)?;
    Ok(number)
}
