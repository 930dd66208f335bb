//! One link over one path, and the latencies of its frames.

use std::error::Error;
use std::fmt;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use trimaran_transport::conformance::{ARM, PANEL, Robot, finished, greeting, points, start as begin};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{
    Endpoint, FrameEvent, FrameOutcome, Instant, Link, Listener, Net, Options, TokioNet, connect, sleep_until,
};

use crate::path::{ADDRESSES, Path};
use crate::relay::{Loss, Tally, carry};

const FRAMES_A_SECOND: u32 = 60;
const POINTS: u32 = 4000;
const PORT: u16 = 7400;

/// A kind of link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    pub(crate) word: &'static str,
    pub(crate) name: &'static str,
    endpoint: &'static str,
    /// The query behind the port.
    query: &'static str,
    repair_percent: u8,
    /// The congestion control of the kernel's TCP; `None` is its own choice.
    congestion: Option<&'static str>,
}

const PLAIN: Kind = Kind { word: "", name: "", endpoint: "", query: "", repair_percent: 0, congestion: None };

/// All kinds.
pub(crate) const KINDS: &[Kind] = &[
    Kind { word: "tcp-cubic", name: "tcp, CUBIC", endpoint: "tcp", congestion: Some("cubic"), ..PLAIN },
    Kind { word: "tcp-bbr", name: "tcp, BBR", endpoint: "tcp", congestion: Some("bbr"), ..PLAIN },
    Kind { word: "quic", name: "quic", endpoint: "quic", ..PLAIN },
    Kind { word: "reliable", name: "udp reliable", query: "?mode=reliable", ..UDP },
    Kind {
        word: "reliable-repair",
        name: "udp reliable, repair",
        query: "?mode=reliable",
        repair_percent: 15,
        ..UDP
    },
    Kind { word: "deadline", name: "udp deadline", query: "?mode=deadline", ..UDP },
    Kind {
        word: "deadline-repair",
        name: "udp deadline, repair",
        query: "?mode=deadline",
        repair_percent: 15,
        ..UDP
    },
];

const UDP: Kind = Kind { endpoint: "udp", ..PLAIN };

/// The outcome for the frames.
pub(crate) struct Outcome {
    arrived: Arrived,
    sent: u32,
    bytes: u64,
    packets: u64,
    lost: u64,
}

/// The frames that a receiver saw.
struct Arrived {
    /// The latency of each frame from its beginning to its end's arrival, rising; and the first one.
    latencies: Vec<Duration>,
    first: Duration,
    /// The number of complete frames.
    complete: u32,
}

impl Outcome {
    /// Bytes of IP packets of both directions, a frame.
    pub(crate) fn kilobytes(&self) -> f64 {
        self.bytes as f64 / 1e3 / f64::from(self.sent.max(1))
    }

    /// The largest latency of this share of the frames, milliseconds.
    pub(crate) fn milliseconds(&self, share: f64) -> f64 {
        let latencies = &self.arrived.latencies;
        let last = latencies.len().saturating_sub(1);
        let index = (share * last as f64).ceil() as usize;
        latencies.get(index).map_or(f64::NAN, |latency| latency.as_secs_f64() * 1e3)
    }

    pub(crate) fn lost_percent(&self) -> f64 {
        100.0 * self.lost as f64 / self.packets.max(1) as f64
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Arrived { first, complete, .. } = &self.arrived;
        let [p50, p99, p999, slowest] = [0.5, 0.99, 0.999, 1.0].map(|share| self.milliseconds(share));
        let first = first.as_secs_f64() * 1e3;
        let complete = 100.0 * f64::from(*complete) / f64::from(self.sent.max(1));
        let kilobytes = self.kilobytes();
        write!(
            f,
            "{p50:.1} | {p99:.1} | {p999:.1} | {slowest:.1} | {first:.1} | {complete:.3} % | {kilobytes:.2}"
        )
    }
}

/// When each frame began; one clock for both ends.
type Begun = Arc<Mutex<Vec<Instant>>>;

/// Runs a link of `kind` for so many seconds.
pub(crate) fn run(kind: &Kind, loss: Loss, seconds: u32) -> Result<Outcome, Box<dyn Error>> {
    let path = Arc::new(Path::lay(kind.congestion)?);
    let tally = Arc::new(Tally::default());
    let [a, b] = &path.devices;
    carry(Arc::clone(a), Arc::clone(b), loss, 1, Arc::clone(&tally));
    carry(Arc::clone(b), Arc::clone(a), loss, 2, Arc::clone(&tally));
    let frames = seconds * FRAMES_A_SECOND;
    let (begun, origin) = (Begun::default(), Builder::new_multi_thread().enable_all().build()?);
    // One clock: both ends' `Net` begin at the same time only if they are clones.
    let clock: Arc<dyn Net> = Arc::new(TokioNet::new(origin.handle().clone()));
    let (ours, theirs) = options(kind)?;
    let arrived = thread::scope(|scope| {
        let sender = scope.spawn({
            let (path, begun, clock) = (Arc::clone(&path), Arc::clone(&begun), Arc::clone(&clock));
            move || -> Result<(), String> {
                let runtime = runtime_in(&path, 0).map_err(|e| e.to_string())?;
                runtime.block_on(send(kind, &ours, frames, &begun, &*clock)).map_err(|e| e.to_string())
            }
        });
        let receiver = scope.spawn({
            let path = Arc::clone(&path);
            move || -> Result<Arrived, String> {
                let runtime = runtime_in(&path, 1).map_err(|e| e.to_string())?;
                runtime.block_on(receive(kind, &theirs, &begun, &*clock)).map_err(|e| e.to_string())
            }
        });
        let sent = sender.join().map_err(|_| "the sender panicked".to_owned())?;
        let received = receiver.join().map_err(|_| "the receiver panicked".to_owned())?;
        sent.and(received)
    })?;
    Ok(Outcome {
        arrived,
        sent: frames,
        bytes: tally.bytes.load(Ordering::Relaxed),
        packets: tally.packets.load(Ordering::Relaxed),
        lost: tally.lost.load(Ordering::Relaxed),
    })
}

/// A runtime with only this thread, whose sockets are in the namespace of an end.
fn runtime_in(path: &Path, end: usize) -> std::io::Result<Runtime> {
    path.enter(end)?;
    Builder::new_current_thread().enable_all().build()
}

/// Options of sender and receiver.
fn options(kind: &Kind) -> Result<(Options, Options), Box<dyn Error>> {
    let (a, b) = (Keys::generate("sender".parse()?)?, Keys::generate("receiver".parse()?)?);
    let with = |own: &Keys, peer: &Keys| {
        Options::default()
            .with_security(Security { keys: own.clone(), peers: vec![peer.public().clone().into()].into() })
            .with_udp(UdpOptions::default().with_trust(Trust::Keys).with_repair_percent(kind.repair_percent))
    };
    Ok((with(&a, &b), with(&b, &a)))
}

fn endpoint(kind: &Kind) -> Result<Endpoint, Box<dyn Error>> {
    Ok(format!("{}://{}:{PORT}{}", kind.endpoint, ADDRESSES[0], kind.query).parse()?)
}

async fn send(
    kind: &Kind,
    options: &Options,
    frames: u32,
    begun: &Begun,
    clock: &dyn Net,
) -> Result<(), Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let soon = net.now().after(Duration::from_secs(30));
    let mut listener = Listener::bind(&net, &endpoint(kind)?, greeting(ARM), options).await?;
    let mut link: Link<Robot> = listener.accept(soon).await?;
    let points = points(POINTS);
    let start = net.now();
    for frame in 0..frames {
        let due = start.after(Duration::from_secs(1) * frame / FRAMES_A_SECOND);
        sleep_until(&*net, due).await;
        begun.lock().unwrap_or_else(PoisonError::into_inner).push(clock.now());
        link.frames_tx.begin(begin(frame)).await?;
        link.frames_tx.push(&points).await?;
        link.frames_tx.finish().await?;
    }
    leave(link, &*net).await;
    Ok(())
}

async fn receive(
    kind: &Kind,
    options: &Options,
    begun: &Begun,
    clock: &dyn Net,
) -> Result<Arrived, Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let soon = net.now().after(Duration::from_secs(30));
    let mut link: Link<Robot> = connect(&net, &endpoint(kind)?, greeting(PANEL), options, soon).await?;
    let (mut latencies, mut complete) = (Vec::new(), 0);
    while let Ok(event) = link.frames_rx.recv().await {
        let FrameEvent::End(outcome) = event else { continue };
        let now = clock.now();
        complete += u32::from(matches!(outcome, FrameOutcome::Complete(_)));
        let begun = begun.lock().unwrap_or_else(PoisonError::into_inner);
        latencies.extend(begun.get(latencies.len()).map(|begun| now.since(*begun)));
    }
    leave(link, &*net).await;
    let first = *latencies.first().ok_or("no frame arrived")?;
    latencies.sort_unstable();
    Ok(Arrived { latencies, first, complete })
}

/// Closes, and stays a moment: the runtime ends with this thread, and a lost close may have to be sent again.
async fn leave(link: Link<Robot>, net: &dyn Net) {
    let _gone = link.close(finished()).await;
    sleep_until(net, net.now().after(Duration::from_millis(500))).await;
}
