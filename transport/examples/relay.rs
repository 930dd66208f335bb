//! Frames for a thousand displays: a relay is a publisher that a subscriber feeds. This compares trees of
//! relays in virtual time.
//!
//!     cargo run --release -p trimaran-transport --features zerocopy --example relay
//!
//! Each machine has a gigabit. The walk at the root has 60 frames of 4,000 ids a second.

use std::{error::Error, fmt, ops::Range, sync::Arc, time::Duration};

use tokio::sync::{Mutex, mpsc};
use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{Simulation, Topology};
use trimaran_transport::{
    ConnectError, Endpoint, FrameNumber, FrameStart, Instant, Limits, Link, Listener, Net, Options, Plain,
    Protocol, Publisher, Reconnecting, WhenBehind, sleep_until,
};
use zerocopy::little_endian::U64;

const FRAMES_PER_S: u32 = 60;
const IDS: u32 = 4_000;
/// Links are made before, and frames are counted from here to the end.
const MEASURED: Range<Duration> = Duration::from_secs(4)..Duration::from_secs(5);

#[derive(Debug, Clone, PartialEq)]
struct Walk;

impl Protocol for Walk {
    const NAME: &'static str = "walk/1";
    type Hello = String;
    type Latest = ();
    type Header = Plain<U64>; // when the frame was published at the root: nanoseconds
    type Item = u32;
    type Message = ();
}

/// Subscribers of frames. Each link is kept as long as its peer keeps it.
struct Fan {
    net: Arc<dyn Net>,
    listener: Listener<Walk>,
    publisher: Publisher<Walk>,
    next: FrameNumber,
}

impl Fan {
    async fn at(net: Arc<dyn Net>, endpoint: &Endpoint, options: &Options) -> Result<Self, Box<dyn Error>> {
        let listener = Listener::bind(&net, endpoint, "source".to_owned(), options).await?;
        let publisher = Publisher::new(&net, &options.link);
        Ok(Self { net, listener, publisher, next: FrameNumber(0) })
    }

    /// A slow subscriber skips frames, and holds up nobody.
    fn subscribe(&mut self, link: Link<Walk>) {
        self.publisher.subscribe(link.frames_tx, WhenBehind::Skip);
        let (mut frames, rest) = (link.frames_rx, (link.latest_tx, link.messages_tx, link.bulk));
        self.net.spawn(Box::pin(async move {
            let _left = frames.recv().await;
            drop(rest);
        }));
    }

    async fn publish(&mut self, header: Plain<U64>, ids: &[u32]) -> Result<(), Box<dyn Error + Send + Sync>> {
        let start = FrameStart { frame: self.next, header };
        self.next.0 += 1;
        self.publisher.publish(start, ids).await?;
        Ok(())
    }
}

/// Publishes a walk without end.
async fn walk(mut fan: Fan) -> Result<(), Box<dyn Error + Send + Sync>> {
    let ids: Vec<u32> = (0..IDS).collect();
    let mut tick = fan.net.now();
    loop {
        tick = tick.after(Duration::from_secs(1) / FRAMES_PER_S);
        tokio::select! {
            biased;
            () = sleep_until(&*fan.net, tick) => {
                let now = fan.net.now().as_nanos();
                fan.publish(Plain(U64::new(now)), &ids).await?;
            }
            accepted = fan.listener.accept(tick) => {
                if let Ok(link) = accepted {
                    fan.subscribe(link);
                }
                continue;
            }
        }
    }
}

/// Passes on the frames of the listener at `source`. When that is lost, its subscribers wait for its return.
async fn relay(fan: Fan, source: Endpoint, options: Options) -> Result<(), ConnectError> {
    let mut upstream = Reconnecting::<Walk>::new(&fan.net, &source, "relay".to_owned(), &options);
    let fan = Mutex::new(fan);
    upstream
        .run(async |mut link| {
            let mut fan = fan.lock().await;
            loop {
                let soon = fan.net.now().after(Duration::from_secs(1));
                tokio::select! {
                    frame = link.frames_rx.frame() => {
                        let frame = frame?;
                        let ids: Vec<u32> = frame.items().collect();
                        // Its own numbers go on when the source begins anew.
                        let _full = fan.publish(frame.start.header, &ids).await;
                    }
                    accepted = fan.listener.accept(soon) => {
                        if let Ok(link) = accepted {
                            fan.subscribe(link);
                        }
                    }
                }
            }
        })
        .await
}

/// Tells the age of each whole frame when it has come.
async fn display(net: Arc<dyn Net>, source: Endpoint, options: Options, ages: mpsc::UnboundedSender<u64>) {
    let mut source = Reconnecting::<Walk>::new(&net, &source, "display".to_owned(), &options);
    let shown = source.run(async |mut link| {
        loop {
            let frame = link.frames_rx.frame().await?;
            let now = net.now().as_nanos();
            if MEASURED.contains(&Duration::from_nanos(now)) {
                let _measured = ages.send(now - frame.start.header.0.get());
            }
        }
    });
    let _: Result<(), ConnectError> = shown.await;
}

/// A tree, by how many each machine of a level feeds: `[32, 32]` has 32 relays of 32 displays each.
fn measure(tree: &[u32], scheme: &str) -> Result<Row, Box<dyn Error>> {
    let levels: Vec<u32> = tree
        .iter()
        .scan(1, |all, fan| {
            *all *= fan;
            Some(*all)
        })
        .collect();
    let name = |level: usize, of: u32| if level == 0 { "root".to_owned() } else { format!("m{level}-{of}") };
    let names: Vec<String> = std::iter::once(name(0, 0))
        .chain(levels.iter().zip(1..).flat_map(|(&count, level)| (0..count).map(move |of| name(level, of))))
        .collect();
    let line = LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(100));
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let simulation = Simulation::new(&Topology::star(&names, &line, &line), 1);
    let limits = Limits::default().with_peers(2_000).with_handshakes(8_000).with_handshakes_per_s(100_000);
    let options = Options::default().with_limits(limits);
    let net = |level, of| simulation.named(&name(level, of)).map(|net| Arc::new(net) as Arc<dyn Net>);
    let endpoint = |host: &str| format!("{scheme}://{host}:7400").parse::<Endpoint>();
    let (told, mut ages) = mpsc::unbounded_channel();
    let displays = levels.last().copied().unwrap_or(1);

    let all = async {
        let anywhere = endpoint("0.0.0.0")?;
        for (level, &count) in std::iter::once(&1).chain(&levels).enumerate() {
            for of in 0..count {
                let net = net(level, of)?;
                let source = level.checked_sub(1).map(|above| endpoint(&name(above, of / tree[above])));
                let (options, ages) = (options.clone(), told.clone());
                let task: std::pin::Pin<Box<dyn Future<Output = ()> + Send>> = match source.transpose()? {
                    None => {
                        let fan = Fan::at(Arc::clone(&net), &anywhere, &options).await?;
                        Box::pin(async move {
                            let _ended = walk(fan).await;
                        })
                    }
                    Some(source) if level < tree.len() => {
                        let fan = Fan::at(Arc::clone(&net), &anywhere, &options).await?;
                        Box::pin(async move {
                            let _ended = relay(fan, source, options).await;
                        })
                    }
                    Some(source) => Box::pin(display(Arc::clone(&net), source, options, ages)),
                };
                net.spawn(task);
            }
        }
        let clock = net(0, 0)?;
        sleep_until(&*clock, Instant::from_nanos(MEASURED.start.as_nanos() as u64)).await;
        let before = simulation.links();
        sleep_until(&*clock, Instant::from_nanos(MEASURED.end.as_nanos() as u64)).await;
        Ok::<_, Box<dyn Error>>(before)
    };
    let before = simulation.run(all)??;
    // The first direction of each machine's link leads from it, in the order of the machines.
    let sent: Vec<u64> = simulation
        .links()
        .iter()
        .zip(&before)
        .step_by(2)
        .map(|(now, before)| now.offered.bytes - before.offered.bytes)
        .collect();
    let relays = &sent[1..sent.len() - displays as usize];
    let mut late = Vec::new();
    while let Ok(age) = ages.try_recv() {
        late.push(age as f64 / 1e6);
    }
    late.sort_by(f64::total_cmp);
    let seconds = (MEASURED.end - MEASURED.start).as_secs_f64();
    let rank =
        |share: f64| late.get(((late.len() as f64 - 1.0) * share) as usize).copied().unwrap_or(f64::NAN);
    Ok(Row {
        tree: tree.iter().map(u32::to_string).collect::<Vec<_>>().join(" x "),
        displays,
        root: sent[0] as f64 / seconds / 1e6,
        relay: relays.iter().max().map(|&most| most as f64 / seconds / 1e6),
        frames: late.len() as f64 / seconds / f64::from(displays),
        ages: [0.5, 0.99, 1.0].map(rank),
    })
}

struct Row {
    tree: String,
    displays: u32,
    /// Megabytes a second that leave the root, and the busiest relay.
    root: f64,
    relay: Option<f64>,
    /// Frames a second that a display gets.
    frames: f64,
    /// Milliseconds from the root's call to the whole frame: p50, p99, slowest.
    ages: [f64; 3],
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tree, displays, root, relay, frames, ages: [p50, p99, most] } = self;
        let relay = relay.map_or_else(String::new, |relay| format!("{relay:.1}"));
        write!(
            f,
            "| {tree} | {displays} | {root:.1} | {relay} | {frames:.1} | {p50:.1} | {p99:.1} | {most:.1} |"
        )
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("| tree | displays | root, MB/s | a relay, MB/s | frames/s each | p50 ms | p99 | slowest |");
    println!("|---|---|---|---|---|---|---|---|");
    for tree in [&[1][..], &[32], &[32, 32], &[10, 10, 10]] {
        println!("{}", measure(tree, "tcp")?);
    }
    Ok(())
}
