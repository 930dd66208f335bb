//! A display's end of the bulk lane: a task that receives geometry while the display draws.

use std::{collections::VecDeque, sync::Arc};

use bytes::Bytes;
use futures_util::{FutureExt, future::OptionFuture};
use parking_lot::Mutex;
use tokio::sync::{mpsc, oneshot};
use trimaran_proto::{Demand, DrawableId, FrameNumber, NumberList, put_item};
use trimaran_transport::{Bulk, Net};

use super::holdings::{Arriving, Holdings, SupplyError};

/// The most blocks that wait for a stalled culler: more than a display has at the start.
const MOST_UNSAID: usize = 4_096;

/// A display's handle of the task. Dropping it ends the task.
#[derive(Debug)]
pub(crate) struct DisplayEnd {
    demands: mpsc::UnboundedSender<Demand>,
    /// Bytes of received blocks.
    taken: Arc<Mutex<u64>>,
    over: oneshot::Receiver<(Bulk, Option<SupplyError>)>,
    /// The lane of a task that has ended by itself, unless it broke off.
    ended: Option<Option<Bulk>>,
}

impl DisplayEnd {
    /// Receives from the culler at the other end of `bulk`.
    pub(crate) fn start(net: &Arc<dyn Net>, bulk: Bulk, holdings: &Arc<Holdings>) -> Self {
        let (demands, due) = mpsc::unbounded_channel();
        let (gives, over) = oneshot::channel();
        let taken = Arc::new(Mutex::new(0));
        net.spawn(Box::pin(take(bulk, Arc::clone(holdings), due, Arc::clone(&taken), gives)));
        Self { demands, taken, over, ended: None }
    }

    /// Requests visible geometry that is not here yet: optionally coarser drawables first, and this many
    /// bytes ahead of need.
    pub(crate) fn begin(&self, holdings: &Holdings, coarser_first: bool, ahead: u64) {
        let [drawables, geometries] = holdings.all();
        for drawables in drawables.parts() {
            self.say(Demand::Holds { drawables, geometries: NumberList::default() });
        }
        for geometries in geometries.parts() {
            self.say(Demand::Holds { drawables: NumberList::default(), geometries });
        }
        self.say(Demand::Begin { coarser_first, ahead });
    }

    /// Stops requesting.
    pub(crate) fn end(&self) {
        self.say(Demand::End);
    }

    /// A frame lacks these. They were looked up after [`taken`](Self::taken).
    pub(crate) fn lacks(&self, frame: FrameNumber, taken: u64, ids: &[DrawableId]) {
        for drawables in NumberList::of(ids.iter().map(|id| id.0).collect()).parts() {
            self.say(Demand::Lacks { frame, taken, drawables });
        }
    }

    /// These were evicted.
    pub(crate) fn dropped(&self, geometries: &NumberList) {
        for geometries in geometries.parts() {
            self.say(Demand::Dropped { geometries });
        }
    }

    /// A frame was shown.
    pub(crate) fn shown(&self, frame: FrameNumber) {
        self.say(Demand::Shown { frame });
    }

    /// Bytes of blocks received so far.
    pub(crate) fn taken(&self) -> u64 {
        *self.taken.lock()
    }

    /// Waits for an error in received data. Dropping the future loses nothing.
    pub(crate) async fn failed(&mut self) -> SupplyError {
        if self.ended.is_none() {
            let (bulk, error) =
                (&mut self.over).await.map_or((None, None), |(bulk, error)| (Some(bulk), error));
            self.ended = Some(bulk);
            if let Some(error) = error {
                return error;
            }
        }
        // A lost culler is noticed by the receiver of its frames.
        std::future::pending().await
    }

    /// Ends the task; returns the lane.
    pub(crate) async fn give_back(self) -> Option<Bulk> {
        let Self { demands, over, ended, .. } = self;
        drop(demands);
        match ended {
            Some(bulk) => bulk,
            None => over.await.ok().map(|(bulk, _)| bulk),
        }
    }

    fn say(&self, demand: Demand) {
        // A lost task is noticed elsewhere.
        let _unheard = self.demands.send(demand);
    }
}

async fn take(
    mut bulk: Bulk,
    holdings: Arc<Holdings>,
    mut due: mpsc::UnboundedReceiver<Demand>,
    taken: Arc<Mutex<u64>>,
    gives: oneshot::Sender<(Bulk, Option<SupplyError>)>,
) {
    let mut arriving = Arriving::default();
    let mut unsaid: VecDeque<Bytes> = VecDeque::new();
    let mut confirmed = 0;
    let Bulk { tx, rx } = &mut bulk;
    let error = loop {
        let bytes = *taken.lock();
        if unsaid.is_empty() && bytes != confirmed {
            confirmed = bytes;
            unsaid.extend(blocks_of([Demand::Taken { bytes }]));
        }
        let say = unsaid.front().map(|block| tx.send(block.clone()));
        let room = holdings.room.notified();
        let has_room = holdings.has_room();
        tokio::select! {
            biased;
            Some(sent) = OptionFuture::from(say) => match sent {
                Ok(()) => drop(unsaid.pop_front()),
                Err(_) => break None,
            },
            demand = due.recv() => {
                let Some(demand) = demand else { break None };
                // Sends all pending demands together.
                let more = std::iter::from_fn(|| due.recv().now_or_never().flatten());
                unsaid.extend(blocks_of(std::iter::once(demand).chain(more)));
                if unsaid.len() > MOST_UNSAID {
                    break Some(SupplyError::Unheard);
                }
            }
            block = rx.recv(), if has_room => match block {
                Ok(block) => {
                    if let Err(error) = holdings.take(&block, &mut arriving) {
                        break Some(error);
                    }
                    *taken.lock() += block.len() as u64;
                }
                Err(_) => break None,
            },
            () = room, if !has_room => {}
        }
    };
    let _nobody = gives.send((bulk, error));
}

/// Writes demands to as few blocks as possible.
fn blocks_of(demands: impl IntoIterator<Item = Demand>) -> Vec<Bytes> {
    let (mut blocks, mut block) = (Vec::new(), Vec::new());
    for demand in demands {
        if !put_item(&mut block, &demand) {
            blocks.push(Bytes::from(std::mem::take(&mut block)));
            // It fits into a block of its own: lists are split.
            let _fits = put_item(&mut block, &demand);
        }
    }
    if !block.is_empty() {
        blocks.push(block.into());
    }
    blocks
}
