//! The place of a link at its publisher.

use std::collections::HashMap;
use std::sync::Arc;

use tokio::sync::Mutex;
use trimaran_transport::untyped::Untyped;
use trimaran_transport::{FrameSender, Publisher, SubscriberId};

/// A publisher, and its subscribers.
pub(crate) struct Published {
    pub(crate) publisher: Publisher<Untyped>,
    pub(crate) subscribers: HashMap<SubscriberId, u64>,
    /// The number of the next subscriber.
    pub(crate) next_id: u64,
    /// The number of the next frame, if none is given.
    pub(crate) next: u32,
}

/// The place of a link at its publisher.
pub(crate) struct Subscription {
    pub(crate) publisher: Arc<Mutex<Published>>,
    pub(crate) id: SubscriberId,
}

impl Subscription {
    /// Takes the sender back. None if it has failed.
    pub(crate) async fn end(self) -> Option<FrameSender<Untyped>> {
        let mut published = self.publisher.lock().await;
        published.subscribers.remove(&self.id);
        published.publisher.unsubscribe(self.id).await
    }
}
