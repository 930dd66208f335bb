//! A display's end of the bulk lane: a task that takes what comes while the display draws.

use std::{collections::VecDeque, sync::Arc};

use bytes::Bytes;
use futures_util::FutureExt;
use parking_lot::Mutex;
use tokio::sync::{mpsc, oneshot};
use trimaran_proto::{Demand, DrawableId, FrameNumber, NumberList, put_item};
use trimaran_transport::{Bulk, Net, RecvError};

use super::holdings::{Arriving, Holdings, SupplyError};

/// So many blocks wait at most for a culler that takes nothing: more than what a display can have at first.
const MOST_UNSAID: usize = 4_096;

/// What a display holds of the task. The task ends when this is dropped.
#[derive(Debug)]
pub(crate) struct DisplayEnd {
    demands: mpsc::UnboundedSender<Demand>,
    /// Bytes of blocks that were taken.
    taken: Arc<Mutex<u64>>,
    over: oneshot::Receiver<(Bulk, Option<SupplyError>)>,
    /// What is left of a task that has ended by itself: the lane, unless it broke off.
    ended: Option<Option<Bulk>>,
}

impl DisplayEnd {
    /// Takes what the culler at the other end of `bulk` sends.
    pub(crate) fn start(net: &Arc<dyn Net>, bulk: Bulk, holdings: &Arc<Holdings>) -> Self {
        let (demands, due) = mpsc::unbounded_channel();
        let (gives, over) = oneshot::channel();
        let taken = Arc::new(Mutex::new(0));
        net.spawn(Box::pin(take(bulk, Arc::clone(holdings), due, Arc::clone(&taken), gives)));
        Self { demands, taken, over, ended: None }
    }

    /// Asks for what becomes visible, but what is there; for coarser drawables first, if it is to, and for so
    /// many bytes before a frame needs them.
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

    /// Asks for nothing more.
    pub(crate) fn end(&self) {
        self.say(Demand::End);
    }

    /// A frame needs these, which are not all there. They were looked for after [`taken`](Self::taken).
    pub(crate) fn lacks(&self, frame: FrameNumber, taken: u64, ids: &[DrawableId]) {
        for drawables in NumberList::of(ids.iter().map(|id| id.0).collect()).parts() {
            self.say(Demand::Lacks { frame, taken, drawables });
        }
    }

    /// These were thrown away.
    pub(crate) fn dropped(&self, geometries: &NumberList) {
        for geometries in geometries.parts() {
            self.say(Demand::Dropped { geometries });
        }
    }

    /// A frame was shown.
    pub(crate) fn shown(&self, frame: FrameNumber) {
        self.say(Demand::Shown { frame });
    }

    /// Bytes of blocks that were taken so far.
    pub(crate) fn taken(&self) -> u64 {
        *self.taken.lock()
    }

    /// Waits until what came cannot be taken. Dropping the future loses nothing.
    pub(crate) async fn failed(&mut self) -> SupplyError {
        if self.ended.is_none() {
            let (bulk, error) =
                (&mut self.over).await.map_or((None, None), |(bulk, error)| (Some(bulk), error));
            self.ended = Some(bulk);
            if let Some(error) = error {
                return error;
            }
        }
        // That the culler is gone is noticed where its frames are waited for.
        std::future::pending().await
    }

    /// Ends the task; gives the lane back.
    pub(crate) async fn give_back(self) -> Option<Bulk> {
        let Self { demands, over, ended, .. } = self;
        drop(demands);
        match ended {
            Some(bulk) => bulk,
            None => over.await.ok().map(|(bulk, _)| bulk),
        }
    }

    fn say(&self, demand: Demand) {
        // Who is gone is noticed elsewhere.
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
        let say = async {
            match unsaid.front() {
                Some(block) => tx.send(block.clone()).await,
                None => std::future::pending().await,
            }
        };
        let room = holdings.room.notified();
        let has_room = holdings.has_room();
        tokio::select! {
            biased;
            said = say => match said {
                Ok(()) => drop(unsaid.pop_front()),
                Err(_) => break None,
            },
            demand = due.recv() => {
                let Some(demand) = demand else { break None };
                // All that is to be said goes together.
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
                Err(RecvError::Silent { .. }) => {}
                Err(_) => break None,
            },
            () = room, if !has_room => {}
        }
    };
    let _nobody = gives.send((bulk, error));
}

/// Writes demands to as few blocks as they fit.
fn blocks_of(demands: impl IntoIterator<Item = Demand>) -> Vec<Bytes> {
    let (mut blocks, mut block) = (Vec::new(), Vec::new());
    for demand in demands {
        if !put_item(&mut block, &demand) {
            blocks.push(Bytes::from(std::mem::take(&mut block)));
            // It fits into a block of its own: lists are parted.
            let _fits = put_item(&mut block, &demand);
        }
    }
    if !block.is_empty() {
        blocks.push(block.into());
    }
    blocks
}
