//! A transport from outside the crate with lanes of its own: queues of messages within this process, as a
//! radio or shared memory may have them.
//!
//! ```sh
//! cargo run -p trimaran-transport --features conformance --example lanes_of_your_own
//! ```

use std::collections::{BTreeMap, VecDeque};
use std::fmt::Debug;
use std::io;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker, ready};

use bytes::Bytes;
use tokio::sync::{mpsc, oneshot};
use tokio_util::sync::PollSender;
use trimaran_net::BoxFuture;
use trimaran_transport::conformance::{ARM, PANEL, Robot, finished, greeting, points, pose, receive, start};
use trimaran_transport::{
    Acceptor, AttemptError, ByteLanes, Capabilities, CloseReason, Counters, Duplex, Endpoint, Half,
    HandshakeError, Introduction, Kind, Lane, LaneError, LaneTransport, LaneTx, Lanes, LinkParts,
    ListenFault, Listened, Loss, Net, Options, PeerAddress, Refusal, Rx, TokioNet, Tx,
};
use trimaran_wire::{Accept, FixedBytes, FrameMessage, Hello};

type Listener = trimaran_transport::Listener<Robot>;

/// How many messages may wait in a queue.
const QUEUE: usize = 256;

const CAPABILITIES: Capabilities =
    Capabilities { reliable: true, ordered: true, encrypted: false, local: true };

/// The lanes of one end, and the counters of their traffic.
type End = (ByteLanes, Arc<Counters>);

/// A peer that wants a link, and the answer to it.
struct Call {
    hello: Hello,
    answer: oneshot::Sender<Result<(Accept, End), Refusal>>,
}

/// Queues: endpoints are written `queues://number`. A listener chooses its number.
#[derive(Debug, Default)]
struct Queues {
    next: AtomicU32,
    listeners: Mutex<BTreeMap<String, mpsc::Sender<Call>>>,
}

impl LaneTransport for Queues {
    fn scheme(&self) -> &'static str {
        "queues"
    }

    fn connect<'a>(
        &'a self,
        _net: &'a Arc<dyn Net>,
        address: &'a str,
        introduction: &'a Introduction<'_>,
    ) -> BoxFuture<'a, Result<LinkParts, AttemptError>> {
        Box::pin(async move {
            let failed = |cause| AttemptError::Handshake { address: address.to_owned(), cause };
            let listener = locked(&self.listeners).get(address).cloned();
            let (answer, answered) = oneshot::channel();
            let call = Call { hello: introduction.hello(Lane::Frames), answer };
            match listener {
                Some(listener) => drop(listener.send(call).await),
                None => drop(call),
            }
            let answer = answered.await.map_err(|_| failed(HandshakeError::Unanswered))?;
            let (accept, (lanes, counters)) = answer.map_err(|e| failed(HandshakeError::Refused(e)))?;
            let peer = introduction.recognize(&accept).map_err(failed)?;
            let (session, at) = (introduction.session, PeerAddress::InProcess);
            Ok(LinkParts::new(lanes, peer, session, at, CAPABILITIES, counters))
        })
    }

    fn listen<'a>(
        &'a self,
        _address: &'a str,
        acceptor: &'a Arc<Acceptor>,
    ) -> BoxFuture<'a, Result<Listened, ListenFault>> {
        Box::pin(async move {
            let address = self.next.fetch_add(1, Ordering::Relaxed).to_string();
            let (listener, calls) = mpsc::channel(QUEUE);
            locked(&self.listeners).insert(address.clone(), listener);
            acceptor.net().spawn(Box::pin(serve(Arc::clone(acceptor), calls)));
            Ok(address.into())
        })
    }
}

/// Answers calls until nobody accepts links any more.
async fn serve(acceptor: Arc<Acceptor>, mut calls: mpsc::Receiver<Call>) {
    loop {
        let call = tokio::select! {
            () = acceptor.closed() => return,
            call = calls.recv() => call,
        };
        let Some(Call { hello, answer }) = call else { return };
        let (peer, place) = match acceptor.enter(&hello) {
            Ok(entered) => entered,
            Err(refusal) => {
                acceptor.failed(&"a caller", HandshakeError::Refused(refusal.clone()));
                let _gone = answer.send(Err(refusal));
                continue;
            }
        };
        let [(lanes, counters), theirs] = ends();
        let at = PeerAddress::InProcess;
        let accept = acceptor.answer(&peer);
        let parts = LinkParts::new(lanes, peer, hello.session, at, CAPABILITIES, counters);
        if answer.send(Ok((accept, theirs))).is_ok() {
            acceptor.hand_out(parts.holding(place)).await;
        }
    }
}

/// Both ends of new lanes.
fn ends() -> [End; 2] {
    let [here, there] = [Counters::unframed(), Counters::unframed()];
    let ways = [&here, &there];
    let [latest, their_latest] = latest(ways);
    let [frames, their_frames] = queues(ways, |message: &FrameMessage| (message.kind(), message.payload()));
    let [messages, their_messages] = queues(ways, |message: &Bytes| (Kind::Message, message.len()));
    let [bulk, their_bulk] = queues(ways, |block: &Bytes| (Kind::Block, block.len()));
    let theirs =
        Lanes { latest: their_latest, frames: their_frames, messages: their_messages, bulk: their_bulk };
    [(Lanes { latest, frames, messages, bulk }, here), (theirs, there)]
}

/// An entry of a queue.
#[derive(Debug)]
enum Said<T> {
    Data(T),
    Close(CloseReason),
}

/// The kind of an entry, and its bytes.
type Weigh<T> = fn(&T) -> (Kind, usize);

/// Both ends of a lane of queues.
fn queues<T: Debug + Send + 'static>([here, there]: [&Arc<Counters>; 2], weigh: Weigh<T>) -> [Duplex<T>; 2] {
    let way = |from: &Arc<Counters>, to: &Arc<Counters>| {
        let (sender, receiver) = mpsc::channel(QUEUE);
        let (from, to) = (Arc::clone(from), Arc::clone(to));
        let sends = Sends { queue: PollSender::new(sender), staged: VecDeque::new(), weigh, counters: from };
        (Box::new(sends), Box::new(Receives { queue: receiver, closed: None, weigh, counters: to }))
    };
    let ((tx, their_rx), (their_tx, rx)) = (way(here, there), way(there, here));
    [(tx, rx), (their_tx, their_rx)]
}

#[derive(Debug)]
struct Sends<T> {
    queue: PollSender<Said<T>>,
    staged: VecDeque<Said<T>>,
    weigh: Weigh<T>,
    counters: Arc<Counters>,
}

impl<T: Debug + Send + 'static> Sends<T> {
    /// Stages an entry, and sends it if there is room.
    fn put(&mut self, said: Said<T>, kind: Kind, bytes: usize) -> Result<(), Loss> {
        self.counters.sent.count(kind, bytes);
        self.staged.push_back(said);
        match self.poll_send(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(sent) => sent.map(|_| ()),
            Poll::Pending => Ok(()),
        }
    }
}

impl<T: Debug + Send + 'static> Half for Sends<T> {}

impl<T: Debug + Send + 'static> LaneTx for Sends<T> {
    fn poll_send(&mut self, cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        loop {
            ready!(self.queue.poll_reserve(cx)).map_err(|_| Loss::Closed)?;
            let Some(said) = self.staged.pop_front() else { return Poll::Ready(Ok(true)) };
            self.queue.send_item(said).map_err(|_| Loss::Closed)?;
        }
    }

    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.put(Said::Close(reason), Kind::Close, 0)
    }
}

impl<T: Debug + Send + 'static> Tx<T> for Sends<T> {
    fn stage(&mut self, data: T) -> Result<(), Loss> {
        let (kind, bytes) = (self.weigh)(&data);
        self.put(Said::Data(data), kind, bytes)
    }
}

#[derive(Debug)]
struct Receives<T> {
    queue: mpsc::Receiver<Said<T>>,
    closed: Option<CloseReason>,
    weigh: Weigh<T>,
    counters: Arc<Counters>,
}

impl<T: Debug + Send> Half for Receives<T> {}

impl<T: Debug + Send> Rx<T> for Receives<T> {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<T>, LaneError>> {
        if let Some(reason) = &self.closed {
            return Poll::Ready(Err(LaneError::Closed(reason.clone())));
        }
        Poll::Ready(match ready!(self.queue.poll_recv(cx)) {
            Some(Said::Data(data)) => {
                let (kind, bytes) = (self.weigh)(&data);
                self.counters.received.count(kind, bytes);
                Ok(Some(data))
            }
            Some(Said::Close(reason)) => {
                self.counters.received.count(Kind::Close, 0);
                self.closed = Some(reason.clone());
                Err(LaneError::Closed(reason))
            }
            None => Err(LaneError::Lost(Loss::Closed)),
        })
    }
}

/// The cell of a latest lane: a value replaces the one before.
#[derive(Debug, Default)]
struct Cell {
    value: Option<FixedBytes>,
    closed: Option<CloseReason>,
    /// One of the ends is gone.
    ended: bool,
    reader: Option<Waker>,
}

/// Both ends of a latest lane.
fn latest([here, there]: [&Arc<Counters>; 2]) -> [Duplex<FixedBytes>; 2] {
    let way = |from: &Arc<Counters>, to: &Arc<Counters>| {
        let cell = Arc::<Mutex<Cell>>::default();
        let tx = Box::new(Publishes { cell: Arc::clone(&cell), counters: Arc::clone(from) });
        (tx, Box::new(Looks { cell, counters: Arc::clone(to) }))
    };
    let ((tx, their_rx), (their_tx, rx)) = (way(here, there), way(there, here));
    [(tx, rx), (their_tx, their_rx)]
}

#[derive(Debug)]
struct Publishes {
    cell: Arc<Mutex<Cell>>,
    counters: Arc<Counters>,
}

impl Publishes {
    fn change(&self, change: impl FnOnce(&mut Cell)) -> Result<(), Loss> {
        let mut cell = locked(&self.cell);
        if cell.ended {
            return Err(Loss::Closed);
        }
        change(&mut cell);
        if let Some(reader) = cell.reader.take() {
            reader.wake();
        }
        Ok(())
    }
}

impl Half for Publishes {}

impl LaneTx for Publishes {
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss> {
        self.counters.sent.count(Kind::Close, 0);
        self.change(|cell| cell.closed = Some(reason))
    }
}

impl Tx<FixedBytes> for Publishes {
    fn stage(&mut self, value: FixedBytes) -> Result<(), Loss> {
        self.counters.sent.count(Kind::Latest, value.len());
        self.change(|cell| cell.value = Some(value))
    }
}

impl Drop for Publishes {
    fn drop(&mut self) {
        let _gone = self.change(|cell| cell.ended = true);
    }
}

#[derive(Debug)]
struct Looks {
    cell: Arc<Mutex<Cell>>,
    counters: Arc<Counters>,
}

impl Half for Looks {}

impl Rx<FixedBytes> for Looks {
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<FixedBytes>, LaneError>> {
        let mut cell = locked(&self.cell);
        if let Some(value) = cell.value.take() {
            self.counters.received.count(Kind::Latest, value.len());
            return Poll::Ready(Ok(Some(value)));
        }
        match &cell.closed {
            Some(reason) => Poll::Ready(Err(LaneError::Closed(reason.clone()))),
            None if cell.ended => Poll::Ready(Err(LaneError::Lost(Loss::Closed))),
            None => {
                cell.reader = Some(cx.waker().clone());
                Poll::Pending
            }
        }
    }
}

impl Drop for Looks {
    fn drop(&mut self) {
        locked(&self.cell).ended = true;
    }
}

/// A panic elsewhere leaves whole entries.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn options() -> Options {
    Options::default().with_lane_transports(vec![Arc::new(Queues::default())])
}

/// The rest is the same over any transport.
#[tokio::main]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (net, options): (Arc<dyn Net>, _) = (Arc::new(TokioNet::current()?), options());
    let soon = net.now().after(std::time::Duration::from_secs(5));

    let mut listener = Listener::bind(&net, &Endpoint::other("queues", ""), greeting(ARM), &options).await?;
    let at = listener.local_endpoint().clone();
    let (arm, panel) = tokio::join!(
        listener.accept(soon),
        trimaran_transport::connect::<Robot>(&net, &at, greeting(PANEL), &options, soon),
    );
    let (mut arm, mut panel) = (arm?, panel?);
    println!("linked with {} over {at}", arm.peer.name);

    panel.latest_tx.publish(pose(7))?;
    println!("the newest pose: {:?}", arm.latest_rx.latest().await?);
    arm.frames_tx.begin(start(0)).await?;
    arm.frames_tx.push(&points(1000)).await?;
    arm.frames_tx.finish().await?;
    println!("a frame of {} points", receive(&mut panel.frames_rx).await?.points.len());

    let (left, heard) = tokio::join!(arm.close(finished()), panel.close(finished()));
    left.and(heard).map_err(io::Error::other)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use trimaran_transport::conformance::{Joined, Overhead};

    use super::*;

    const OVERHEAD: Overhead = Overhead { header_bytes: 0, handshake: 0, coded: true };

    trimaran_transport::conformance!(Joined::over(Endpoint::other("queues", ""), options(), OVERHEAD));
}
