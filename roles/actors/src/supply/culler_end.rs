//! A culler's end of the bulk lane: a task that sends what is due while the culler computes.

use std::{future::pending, sync::Arc};

use parking_lot::Mutex;
use tokio::sync::{Notify, oneshot};
use trimaran_cull::View;
use trimaran_proto::{Demand, DrawableId, ViewState, items};
use trimaran_scene::Scene;
use trimaran_transport::{Bulk, Net, RecvError};

use super::supplier::{Supplier, SupplyFault};

/// What a culler's session holds of the task. The task ends when this is dropped.
#[derive(Debug)]
pub(crate) struct CullerEnd {
    net: Arc<dyn Net>,
    shared: Arc<Shared>,
    stop: oneshot::Sender<()>,
    over: oneshot::Receiver<Bulk>,
}

#[derive(Debug)]
struct Shared {
    supplier: Mutex<Supplier>,
    /// Something is due.
    news: Notify,
    /// Why the task ended early.
    fault: Mutex<Option<SupplyFault>>,
}

impl CullerEnd {
    /// Begins to serve the display at the other end of `bulk`.
    pub(crate) fn start(net: &Arc<dyn Net>, bulk: Bulk, scene: &Arc<Scene>) -> Self {
        let shared = Arc::new(Shared {
            supplier: Mutex::new(Supplier::new(scene)),
            news: Notify::new(),
            fault: Mutex::new(None),
        });
        let ((stop, stopped), (gives, over)) = (oneshot::channel(), oneshot::channel());
        let task = serve(Arc::clone(net), bulk, Arc::clone(&shared), stopped, gives);
        net.spawn(Box::pin(task));
        Self { net: Arc::clone(net), shared, stop, over }
    }

    /// Frames are culled in this view state from now on.
    pub(crate) fn change_view(&self, state: &ViewState) {
        self.shared.supplier.lock().change_view(state);
    }

    /// These were found visible from `view`.
    ///
    /// # Errors
    /// Why the task has ended, if it has failed.
    pub(crate) fn found(&self, view: &View, ids: &[DrawableId]) -> Result<(), SupplyFault> {
        if let Some(fault) = self.shared.fault.lock().take() {
            return Err(fault);
        }
        if self.shared.supplier.lock().found(view, ids, self.net.now()) {
            self.shared.news.notify_one();
        }
        Ok(())
    }

    /// Ends the task; gives the lane back.
    pub(crate) async fn give_back(self) -> Option<Bulk> {
        drop(self.stop);
        self.over.await.ok()
    }
}

async fn serve(
    net: Arc<dyn Net>,
    mut bulk: Bulk,
    shared: Arc<Shared>,
    mut stopped: oneshot::Receiver<()>,
    gives: oneshot::Sender<Bulk>,
) {
    let mut unsent = None;
    let Bulk { tx, rx } = &mut bulk;
    let fault = loop {
        if unsent.is_none() {
            let next = shared.supplier.lock().next_block(net.now());
            match next {
                Ok(block) => unsent = block,
                Err(fault) => break Some(fault),
            }
        }
        let send = async {
            match &unsent {
                Some(block) => tx.send(block.clone()).await,
                None => pending().await,
            }
        };
        let heard = tokio::select! {
            biased;
            _ = &mut stopped => break None,
            heard = rx.recv() => heard,
            sent = send => {
                unsent = None;
                match sent {
                    Ok(()) => continue,
                    Err(error) => break Some(SupplyFault::Lane(error)),
                }
            }
            () = shared.news.notified() => continue,
        };
        let demands = match heard {
            Ok(block) => items::<Demand>(&block),
            Err(RecvError::Silent { .. }) => continue,
            // Who is gone is noticed where cameras are waited for.
            Err(_) => break None,
        };
        let now = net.now();
        let heard = demands.map_err(SupplyFault::from).and_then(|demands| {
            let mut supplier = shared.supplier.lock();
            demands.into_iter().try_for_each(|demand| supplier.hear(demand, now))
        });
        if let Err(fault) = heard {
            break Some(fault);
        }
    };
    *shared.fault.lock() = fault;
    let _nobody = gives.send(bulk);
}
