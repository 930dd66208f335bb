//! The halves of lanes as a link holds them: their waits are bounded, and their errors name the peer.

use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use trimaran_net::{Instant, Net};
use trimaran_wire::CloseReason;

use super::half::{Duplex, Half, LaneTx, Rx, Tx};
use super::shared::Shared;
use crate::error::{LaneError, Loss, ProtocolError, RecvError, SendError};
use crate::rates::Messages;
use crate::timeouts::Timeouts;

/// Makes the halves of a link.
#[derive(Debug)]
pub(crate) struct Ends {
    pub(crate) net: Arc<dyn Net>,
    pub(crate) shared: Shared,
    pub(crate) timeout: Duration,
    pub(crate) idle_timeout: Option<Duration>,
}

impl Ends {
    /// Halves over bytes.
    pub(crate) fn wire<L, W>(&self, (tx, rx): Duplex<W>) -> (Sender<L, W>, Receiver<L, W>) {
        self.both(AnyTx::Wire(tx), AnyRx::Wire(rx))
    }

    /// The same over values within this process.
    pub(crate) fn local<L, W>(&self, (tx, rx): Duplex<L>) -> (Sender<L, W>, Receiver<L, W>) {
        self.both(AnyTx::Local(tx), AnyRx::Local(rx))
    }

    fn both<L, W>(&self, tx: AnyTx<L, W>, rx: AnyRx<L, W>) -> (Sender<L, W>, Receiver<L, W>) {
        let timeouts = || Timeouts::new(&self.net, self.timeout, self.idle_timeout);
        let (ours, theirs) = (self.shared.clone(), self.shared.clone());
        (
            Sender { lane: tx, shared: ours, timeouts: timeouts() },
            Receiver { lane: rx, shared: theirs, timeouts: timeouts() },
        )
    }
}

/// A sending half: of values within this process, or of their bytes.
#[derive(Debug)]
pub(crate) enum AnyTx<L, W> {
    Local(Box<dyn Tx<L>>),
    Wire(Box<dyn Tx<W>>),
}

/// A receiving half: of values within this process, or of their bytes.
#[derive(Debug)]
pub(crate) enum AnyRx<L, W> {
    Local(Box<dyn Rx<L>>),
    Wire(Box<dyn Rx<W>>),
}

/// An item of such a lane.
pub(crate) enum Came<L, W> {
    Local(L),
    Wire(W),
}

/// The sending half of a lane.
#[derive(Debug)]
pub(crate) struct Sender<L, W> {
    pub(crate) lane: AnyTx<L, W>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

/// The receiving half of a lane.
#[derive(Debug)]
pub(crate) struct Receiver<L, W> {
    pub(crate) lane: AnyRx<L, W>,
    pub(crate) shared: Shared,
    pub(crate) timeouts: Timeouts,
}

impl<L, W> AnyTx<L, W> {
    fn half(&mut self) -> &mut dyn LaneTx {
        match self {
            Self::Local(lane) => &mut **lane,
            Self::Wire(lane) => &mut **lane,
        }
    }
}

impl<L, W> Sender<L, W> {
    /// Passes on what is staged, and waits for room. Any progress restarts the timeout.
    pub(crate) async fn send_staged(&mut self) -> Result<(), SendError> {
        let Self { lane, shared, timeouts } = self;
        let mut turn = Turn { half: lane.half(), waits: false };
        loop {
            let sent = timeouts.wait_while_alive(
                &mut turn,
                |turn| turn.half.heard(),
                |turn, cx| turn.noted(|half| half.poll_send(cx)),
            );
            match sent.await {
                Ok(Ok(true)) => return Ok(()),
                Ok(Ok(false)) => {}
                Ok(Err(loss)) => return Err(lost(loss, shared)),
                Err(end) => return Err(end.sending(&shared.peer, timeouts.limit())),
            }
        }
    }

    /// Closes the lane once there is room.
    pub(crate) async fn close(mut self, reason: CloseReason) -> Result<(), SendError> {
        self.send_staged().await?;
        self.stage_close(reason)?;
        self.closed().await
    }

    pub(crate) fn stage_close(&mut self, reason: CloseReason) -> Result<(), SendError> {
        self.lane.half().close(reason).map_err(|loss| lost(loss, &self.shared))
    }

    /// Waits until the peer has everything.
    pub(crate) async fn closed(&mut self) -> Result<(), SendError> {
        let Self { lane, shared, timeouts } = self;
        let closed = timeouts.wait(poll_fn(|cx| lane.half().poll_closed(cx))).await;
        closed.map_err(|end| end.sending(&shared.peer, timeouts.limit()))?.map_err(|loss| lost(loss, shared))
    }
}

/// The error of a sender whose connection is gone.
pub(crate) fn lost(cause: Loss, shared: &Shared) -> SendError {
    SendError::Lost { peer: shared.peer.clone(), cause }
}

impl<L, W> Receiver<L, W> {
    /// Waits for the next item, until `by` at most if that is given. Dropping the future loses nothing.
    pub(crate) async fn next(&mut self, by: Option<Instant>) -> Result<Came<L, W>, RecvError> {
        let Self { lane, shared, timeouts } = self;
        match lane {
            AnyRx::Local(lane) => next(&mut **lane, by, shared, timeouts).await.map(Came::Local),
            AnyRx::Wire(lane) => next(&mut **lane, by, shared, timeouts).await.map(Came::Wire),
        }
    }

    /// The next item if it has arrived. A peer that hangs is not noticed this way.
    pub(crate) fn try_next(&mut self) -> Result<Option<Came<L, W>>, RecvError> {
        let Self { lane, shared, timeouts } = self;
        match lane {
            AnyRx::Local(lane) => try_next(&mut **lane, timeouts).map(|came| came.map(Came::Local)),
            AnyRx::Wire(lane) => try_next(&mut **lane, timeouts).map(|came| came.map(Came::Wire)),
        }
        .map_err(|e| e.receiving(&shared.peer))
    }

    /// Discards everything until the lane ends, and returns how it ended.
    pub(crate) async fn drain(mut self) -> RecvError {
        loop {
            if let Err(end) = self.next(None).await {
                return end;
            }
        }
    }

    /// Counts a message against its limit.
    pub(crate) fn count(&self, rate: &mut Messages) -> Result<(), ProtocolError> {
        rate.count(|| self.timeouts.now()).map_err(|e| {
            self.shared.counters.flooded();
            ProtocolError::TooMany(e)
        })
    }

    /// Tells the peer's machine that this side is gone.
    pub(crate) async fn part(mut self) {
        poll_fn(|cx| match &mut self.lane {
            AnyRx::Local(lane) => lane.poll_part(cx),
            AnyRx::Wire(lane) => lane.poll_part(cx),
        })
        .await;
    }
}

async fn next<T>(
    lane: &mut (dyn Rx<T> + 'static),
    by: Option<Instant>,
    shared: &Shared,
    timeouts: &mut Timeouts,
) -> Result<T, RecvError> {
    let mut turn = Turn { half: lane, waits: false };
    loop {
        match timeouts.hear(by, poll_fn(|cx| turn.noted(|half| half.poll_next(cx)))).await {
            Ok(Ok(Some(item))) => return Ok(item),
            Ok(Ok(None)) => {}
            Ok(Err(e)) => return Err(e.receiving(&shared.peer)),
            Err(end) => return Err(end.receiving(&shared.peer)),
        }
    }
}

fn try_next<T>(lane: &mut (dyn Rx<T> + 'static), timeouts: &mut Timeouts) -> Result<Option<T>, LaneError> {
    let came = at_once(poll_fn(|cx| lane.poll_next(cx)))?;
    match came {
        Some(_) => timeouts.heard(),
        None => lane.rest(),
    }
    Ok(came.flatten())
}

/// An owner's turn: a half whose wait is given up is told.
struct Turn<'h, H: Half + ?Sized> {
    half: &'h mut H,
    waits: bool,
}

impl<H: Half + ?Sized> Turn<'_, H> {
    fn noted<T>(&mut self, poll: impl FnOnce(&mut H) -> Poll<T>) -> Poll<T> {
        let polled = poll(self.half);
        self.waits = polled.is_pending();
        polled
    }
}

impl<H: Half + ?Sized> Drop for Turn<'_, H> {
    fn drop(&mut self) {
        if self.waits {
            self.half.rest();
        }
    }
}

/// The output of `next` if it needs no waiting, for callers that poll. It ignores the runtime's budget of a
/// task, which would show a full queue as empty to a loop that never yields.
pub(crate) fn at_once<T, E>(next: impl Future<Output = Result<T, E>>) -> Result<Option<T>, E> {
    match pin!(tokio::task::unconstrained(next)).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(came) => came.map(Some),
        Poll::Pending => Ok(None),
    }
}
