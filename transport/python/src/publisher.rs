//! One sender of frames, many subscribers.

use std::collections::HashMap;
use std::sync::Arc;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use tokio::sync::Mutex;
use trimaran_transport::untyped::RawValue;
use trimaran_transport::{FrameNumber, FrameOrderError, FrameStart, SubscriberStats, WhenBehind, causes};

use crate::errors;
use crate::halves::Frames;
use crate::link::Link;
use crate::runtime::engine;
use crate::setup::Setup;
use crate::subscription::{Published, Subscription};

/// Sends frames to subscribers, which have numbers here.
#[pyclass(frozen, module = "trimaran_transport._native")]
pub(crate) struct Publisher(Arc<Mutex<Published>>);

/// Frames sent, frames skipped, and whether it is behind.
type Stats = (u64, u64, bool);

#[pymethods]
impl Publisher {
    #[new]
    fn new(setup: &Setup) -> PyResult<Self> {
        let (net, format) = (&engine()?.net, setup.hello.format());
        let publisher = trimaran_transport::Publisher::of_format(net, &setup.options.link, &format);
        let published = Published { publisher, subscribers: HashMap::new(), next_id: 0, next: 0 };
        Ok(Self(Arc::new(Mutex::new(published))))
    }

    /// Takes the frames of a link over. Returns the number of the subscriber.
    fn subscribe(&self, py: Python<'_>, link: Bound<'_, Link>, when_behind: &str) -> PyResult<u64> {
        let when_behind = match when_behind {
            "wait" => WhenBehind::Wait,
            "skip" => WhenBehind::Skip,
            "disconnect" => WhenBehind::Disconnect,
            other => {
                let text = format!("when_behind={other:?}: give \"wait\", \"skip\" or \"disconnect\"");
                return Err(PyValueError::new_err(text));
            }
        };
        let halves = Arc::clone(&link.get().halves);
        let subscribed = engine()?.run(py, async {
            // In this order everywhere.
            let mut frames = halves.frames_tx.lock().await;
            let mut published = self.0.lock().await;
            match frames.take() {
                Some(Frames::Here(sender, _)) => {
                    let number = published.next_id;
                    published.next_id += 1;
                    let id = published.publisher.subscribe(*sender, when_behind);
                    published.subscribers.insert(id, number);
                    *frames = Some(Frames::Published(Subscription { publisher: Arc::clone(&self.0), id }));
                    Ok(number)
                }
                Some(taken) => {
                    *frames = Some(taken);
                    Err(errors::other("a publisher sends the frames of this link already"))
                }
                None => Err(errors::closed_here()),
            }
        });
        subscribed?
    }

    /// Gives the frames of a link back to it. Returns whether its link still works.
    fn unsubscribe(&self, py: Python<'_>, link: Bound<'_, Link>) -> PyResult<bool> {
        let halves = Arc::clone(&link.get().halves);
        engine()?.run(py, async {
            let mut frames = halves.frames_tx.lock().await;
            match frames.take() {
                Some(Frames::Published(subscription)) if Arc::ptr_eq(&subscription.publisher, &self.0) => {
                    let next = subscription.publisher.lock().await.next;
                    *frames = subscription.end().await.map(|sender| Frames::Here(Box::new(sender), next));
                    frames.is_some()
                }
                other => {
                    *frames = other;
                    false
                }
            }
        })
    }

    /// Sends a frame to all. Returns its number, and who has left, and why.
    fn publish(
        &self,
        py: Python<'_>,
        number: Option<u32>,
        header: &[u8],
        items: PyBackedBytes,
    ) -> PyResult<(u32, Vec<(u64, String)>)> {
        let header = RawValue::from(header);
        let published = engine()?.run(py, async {
            let Published { publisher, subscribers, next, .. } = &mut *self.0.lock().await;
            let number = number.unwrap_or(*next);
            let start = FrameStart { frame: FrameNumber(number), header };
            let left = publisher.publish(start, &items).await?.left;
            *next = number.saturating_add(1);
            let left = left.iter().filter_map(|(id, why)| Some((subscribers.remove(id)?, causes(why))));
            Ok((number, left.collect()))
        })?;
        published.map_err(|e: FrameOrderError| errors::mistake(&e))
    }

    /// The subscribers by their numbers.
    fn subscribers(&self, py: Python<'_>) -> PyResult<HashMap<u64, Stats>> {
        engine()?.run(py, async {
            let Published { publisher, subscribers, .. } = &*self.0.lock().await;
            let stats = publisher.subscribers().filter_map(|(id, stats)| {
                let SubscriberStats { sent, skipped, is_behind, .. } = stats;
                Some((*subscribers.get(&id)?, (sent, skipped, is_behind)))
            });
            stats.collect()
        })
    }
}
