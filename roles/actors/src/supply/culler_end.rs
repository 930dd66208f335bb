//! A culler's end of the bulk lane: a task that sends geometry while the culler computes.

use std::{
    collections::VecDeque,
    mem,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use bytes::Bytes;
use futures_util::future::OptionFuture;
use parking_lot::Mutex;
use tokio::sync::{Notify, oneshot};
use trimaran_cull::View;
use trimaran_proto::{Demand, DrawableId, ViewState, items};
use trimaran_scene::Scene;
use trimaran_transport::{Bulk, Instant, Net};

use super::{
    packed::Packed,
    supplier::{Supplier, SupplyFault},
};

/// The most frames kept for the task.
const FRAMES: usize = 64;

/// A culler session's handle of the task. Dropping it ends the task.
#[derive(Debug)]
pub(crate) struct CullerEnd {
    net: Arc<dyn Net>,
    shared: Arc<Shared>,
    stop: oneshot::Sender<()>,
    over: oneshot::Receiver<Bulk>,
}

#[derive(Debug)]
struct Shared {
    news: Mutex<News>,
    /// Signals news.
    told: Notify,
    /// Whether the display has requested anything. Until then only the newest frame is kept.
    has_begun: AtomicBool,
    /// Why the task ended early.
    fault: Mutex<Option<SupplyFault>>,
    failed: Notify,
    /// The most ids kept beside those of the newest frame.
    most: usize,
}

/// Changes since the task last looked.
#[derive(Debug, Default)]
struct News {
    /// The view state, if it has changed.
    state: Option<Arc<ViewState>>,
    /// Whether the display follows another one, if that has changed.
    follows: Option<bool>,
    found: VecDeque<Found>,
    /// How many ids were found.
    ids: usize,
}

/// Ids found from a view, with the time of the first.
#[derive(Debug)]
struct Found {
    view: View,
    ids: Vec<DrawableId>,
    at: Instant,
}

impl CullerEnd {
    /// Begins to serve the display at the other end of `bulk`.
    pub(crate) fn start(net: &Arc<dyn Net>, bulk: Bulk, scene: &Arc<Scene>, packed: &Packed) -> Self {
        let shared = Arc::new(Shared {
            news: Mutex::default(),
            told: Notify::new(),
            has_begun: AtomicBool::new(false),
            fault: Mutex::new(None),
            failed: Notify::new(),
            most: scene.drawables().len(),
        });
        let ((stop, stopped), (gives, over)) = (oneshot::channel(), oneshot::channel());
        let (supplier, clock) = (Supplier::new(scene, packed), Arc::clone(net));
        let end = Arc::clone(&shared);
        net.spawn(Box::pin(async move {
            let mut bulk = bulk;
            if let Err(fault) = serve(&clock, &mut bulk, &end, supplier, stopped).await {
                *end.fault.lock() = Some(fault);
                end.failed.notify_one();
            }
            let _nobody = gives.send(bulk);
        }));
        Self { net: Arc::clone(net), shared, stop, over }
    }

    /// Uses this view state for frames from now on.
    pub(crate) fn change_view(&self, state: &Arc<ViewState>) {
        self.shared.news.lock().state = Some(Arc::clone(state));
    }

    /// The display follows another one from now on, or does no longer.
    pub(crate) fn change_following(&self, follows: bool) {
        self.shared.news.lock().follows = Some(follows);
    }

    /// These were found visible from `view`.
    ///
    /// # Errors
    /// The error of the task, if it has failed.
    pub(crate) fn found(&self, view: &View, ids: &[DrawableId]) -> Result<(), SupplyFault> {
        if let Some(fault) = self.shared.fault.lock().take() {
            return Err(fault);
        }
        let has_begun = self.shared.has_begun.load(Ordering::Relaxed);
        let most = if has_begun { self.shared.most } else { 0 };
        self.shared.news.lock().add(view, ids, self.net.now(), most);
        if has_begun {
            self.shared.told.notify_one();
        }
        Ok(())
    }

    /// Waits until the task fails. Dropping the future loses nothing.
    pub(crate) async fn failed(&self) -> SupplyFault {
        loop {
            if let Some(fault) = self.shared.fault.lock().take() {
                return fault;
            }
            self.shared.failed.notified().await;
        }
    }

    /// Ends the task; returns the lane.
    pub(crate) async fn give_back(self) -> Option<Bulk> {
        drop(self.stop);
        self.over.await.ok()
    }
}

impl News {
    /// Beyond the limit the oldest frames are dropped: the display requests their missing geometry itself.
    fn add(&mut self, view: &View, ids: &[DrawableId], now: Instant, most: usize) {
        match self.found.back_mut().filter(|found| found.view == *view) {
            Some(found) => found.ids.extend_from_slice(ids),
            None => self.found.push_back(Found { view: *view, ids: ids.to_vec(), at: now }),
        }
        self.ids += ids.len();
        while (self.ids > most || self.found.len() > FRAMES)
            && self.found.len() > 1
            && let Some(oldest) = self.found.pop_front()
        {
            self.ids -= oldest.ids.len();
        }
    }
}

/// A piece of blocking work, off the runtime's threads: it reads the scene from disk, unpacks it, and
/// searches it for stand-ins.
struct Work {
    supplier: Supplier,
    news: News,
    demands: Vec<Demand>,
    /// Whether the lane has room for a block.
    has_room: bool,
    now: Instant,
}

impl Work {
    /// Returns the next block, if one is due and the lane has room.
    fn run(mut self) -> (Supplier, Result<Option<Bytes>, SupplyFault>) {
        let block = self.next_block();
        (self.supplier, block)
    }

    fn next_block(&mut self) -> Result<Option<Bytes>, SupplyFault> {
        let Self { supplier, news, demands, has_room, now } = self;
        if let Some(state) = &news.state {
            supplier.change_view(state);
        }
        if let Some(follows) = news.follows {
            supplier.change_following(follows);
        }
        for Found { view, ids, at } in &news.found {
            supplier.found(view, ids, *at);
        }
        demands.drain(..).try_for_each(|demand| supplier.hear(demand, *now))?;
        if *has_room { supplier.next_block(*now) } else { Ok(None) }
    }
}

async fn serve(
    net: &Arc<dyn Net>,
    bulk: &mut Bulk,
    shared: &Shared,
    mut supplier: Supplier,
    mut stopped: oneshot::Receiver<()>,
) -> Result<(), SupplyFault> {
    let (mut unsent, mut demands) = (None, Vec::new());
    let Bulk { tx, rx } = bulk;
    loop {
        let work = Work {
            supplier,
            news: mem::take(&mut *shared.news.lock()),
            demands: mem::take(&mut demands),
            has_room: unsent.is_none(),
            now: net.now(),
        };
        let (says, done) = oneshot::channel();
        net.spawn_blocking(Box::new(move || {
            let _nobody = says.send(work.run());
        }));
        let block;
        (supplier, block) = tokio::select! {
            biased;
            _ = &mut stopped => return Ok(()),
            // It breaks off if it panics, or its runtime ends.
            done = done => done.map_err(|_| SupplyFault::BrokeOff)?,
        };
        unsent = block?.or(unsent);
        shared.has_begun.store(supplier.has_begun(), Ordering::Relaxed);
        let send = unsent.clone().map(|block| tx.send(block));
        tokio::select! {
            biased;
            _ = &mut stopped => return Ok(()),
            heard = rx.recv() => match heard {
                Ok(block) => demands = items(&block)?,
                // A lost display is noticed by the receiver of cameras.
                Err(_) => return Ok(()),
            },
            Some(sent) = OptionFuture::from(send) => {
                sent.map_err(SupplyFault::Lane)?;
                unsent = None;
            }
            () = shared.told.notified() => {}
        }
    }
}

#[cfg(test)]
#[path = "culler_end_tests.rs"]
mod tests;
