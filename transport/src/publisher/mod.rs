//! One sender of frames, many subscribers.

mod subscriber;

use std::sync::Arc;

use thiserror::Error;
use trimaran_net::Net;
use trimaran_wire::{Format, FrameEnd, FrameOrderError, FrameStart, Protocol};

use crate::config::link::LinkConfig;
use crate::error::SendError;
use crate::lanes::frames::{Assembly, FrameSender, PublishedFrame};
use subscriber::Subscriber;
pub use subscriber::SubscriberStats;

/// Sends each frame to many subscribers, over links of any transports. A frame is put together and coded
/// once, and its bytes are shared.
///
/// A subscriber whose link does not take a frame at once is [behind](WhenBehind). It never delays the others.
///
/// ```
/// # use std::sync::Arc;
/// # use trimaran_transport::{FrameStart, Link, LinkConfig, Net, Protocol, Publisher, WhenBehind};
/// # async fn show<P: Protocol>(
/// #     net: Arc<dyn Net>, links: Vec<Link<P>>, start: FrameStart<P::Header>, items: Vec<P::Item>,
/// # ) -> Result<(), Box<dyn std::error::Error>> {
/// let mut publisher = Publisher::<P>::new(&net, &LinkConfig::default());
/// for link in links {
///     publisher.subscribe(link.frames_tx, WhenBehind::Skip);
/// }
/// publisher.publish(start, &items).await?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct Publisher<P: Protocol> {
    net: Arc<dyn Net>,
    assembly: Assembly<P>,
    subscribers: Vec<(SubscriberId, Arc<Subscriber<P>>)>,
    ids: u64,
    /// For subscribers to come.
    last: Option<Arc<PublishedFrame<P>>>,
}

/// A subscriber of one publisher.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SubscriberId(u64);

/// The treatment of a subscriber that has not taken a frame when the next one is published.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum WhenBehind {
    /// [`Publisher::publish`] waits for it: it gets every frame.
    Wait,
    /// It gets the newest frame once it has room, and none of those before.
    Skip,
    /// It leaves with [`Left::Behind`], and its half of the link is dropped. The peer sees that once the rest
    /// of the link is dropped or closed.
    Disconnect,
}

/// Why a subscriber has left.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Left {
    /// Its link has failed.
    #[error(transparent)]
    Failed(SendError),
    /// It was behind, and [`WhenBehind::Disconnect`] was chosen for it.
    #[error("it was too slow for the frames published")]
    Behind,
}

/// The result of publishing a frame.
#[derive(Debug)]
#[non_exhaustive]
pub struct Published {
    /// The frame's totals.
    pub end: FrameEnd,
    /// The subscribers that have left since the last frame, and why.
    pub left: Vec<(SubscriberId, Left)>,
}

impl<P: Protocol> Publisher<P> {
    /// Without subscribers. Of the `config` it uses `batching` and `max_frame`.
    #[must_use]
    pub fn new(net: &Arc<dyn Net>, config: &LinkConfig) -> Self {
        Self::of_format(net, config, &Format::of::<P>())
    }

    /// The same for a protocol whose sizes are known only at run time, by [`Protocol::format`].
    #[must_use]
    pub fn of_format(net: &Arc<dyn Net>, config: &LinkConfig, format: &Format) -> Self {
        let assembly = Assembly::new(config.batching, config.max_frame, format.item);
        Self { net: Arc::clone(net), assembly, subscribers: Vec::new(), ids: 0, last: None }
    }

    /// Adds a subscriber. It gets the last published frame at once, if there is one.
    pub fn subscribe(&mut self, frames: FrameSender<P>, when_behind: WhenBehind) -> SubscriberId {
        let subscriber = Subscriber::new(&self.net, frames, when_behind);
        if let Some(last) = &self.last {
            subscriber.put(last);
        }
        let id = SubscriberId(self.ids);
        self.ids += 1;
        self.subscribers.push((id, subscriber));
        id
    }

    /// Removes a subscriber, and returns its half of the link once that has taken all of its frames. `None`
    /// if there is no such subscriber, or its link has failed.
    ///
    /// From then on the link carries items plain. Dropping the future drops that half.
    pub async fn unsubscribe(&mut self, id: SubscriberId) -> Option<FrameSender<P>> {
        let place = self.subscribers.iter().position(|(known, _)| *known == id)?;
        let (_, subscriber) = self.subscribers.swap_remove(place);
        let given_back = GivenBack(&subscriber);
        given_back.0.give_back().await
    }

    /// Sends a frame to all subscribers. Waits only for those of [`WhenBehind::Wait`] that are behind by two
    /// frames, within their links' timeouts. Subscribers that have left are removed.
    ///
    /// If the future is dropped while it waits, the frame is not published.
    ///
    /// # Errors
    /// If the frame's number is not above the last one's, or the frame has too many items.
    pub async fn publish(
        &mut self,
        start: FrameStart<P::Header>,
        items: &[P::Item],
    ) -> Result<Published, FrameOrderError> {
        // Once there is room, only the next frame takes it.
        for (_, subscriber) in &self.subscribers {
            subscriber.has_room().await;
        }
        let lacking = match self.assembly.since() {
            Some(since) => self.subscribers.iter().any(|(_, subscriber)| subscriber.lacks(since)),
            None => false,
        };
        let frame = Arc::new(self.assembly.put(start, items, lacking)?);
        let mut left = Vec::new();
        self.subscribers.retain(|(id, subscriber)| {
            subscriber.put(&frame);
            let leaves = subscriber.left().map(|why| left.push((*id, why)));
            leaves.is_none()
        });
        let end = frame.end;
        self.last = Some(frame);
        Ok(Published { end, left })
    }

    /// The subscribers, with the counts of their frames.
    pub fn subscribers(&self) -> impl ExactSizeIterator<Item = (SubscriberId, SubscriberStats)> + '_ {
        self.subscribers.iter().map(|(id, subscriber)| (*id, subscriber.stats()))
    }
}

/// Subscribers still get what was passed to their links.
impl<P: Protocol> Drop for Publisher<P> {
    fn drop(&mut self) {
        self.subscribers.iter().for_each(|(_, subscriber)| subscriber.leave());
    }
}

/// A subscriber that leaves, also if nobody waits for its half of the link.
struct GivenBack<'s, P: Protocol>(&'s Subscriber<P>);

impl<P: Protocol> Drop for GivenBack<'_, P> {
    fn drop(&mut self) {
        self.0.leave();
    }
}
