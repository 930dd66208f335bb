//! The culls, bytes and latency that a relay adds, for one display that leads and many that watch.
//!
//! `cargo bench --bench relay -- X.scene [SECONDS [PROGRAM]]`: 10 s for each row, and the program of this
//! build, if not given. The leader walks an automatic path of 120 poses over tcp, 30 a second, first without
//! a relay. Latency is from its camera until a display has the whole frame. Displays draw nothing, and share
//! one thread.
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

mod common;

use std::{
    cell::{Cell, RefCell},
    io::{Read, Write},
    net::TcpStream,
    sync::Arc,
    time::{Duration, Instant},
};

use serde_json::Value;
use tokio::runtime::Builder;
use trimaran_actors::Link;
use trimaran_proto::{FrameNumber, RoleMessage};
use trimaran_transport::{Net, TokioNet, sleep_until};

use common::{Failed, Walk, port};

const HZ: u32 = 30;
/// Frames before those that count.
const EARLY: u32 = 60;

fn main() -> Result<(), Failed> {
    let Some(walk) = Walk::of_args("relay", 10)? else { return Ok(()) };
    print!("| relays | watchers | culls a frame | bytes a frame, culler | leader ms: p50 | p99 ");
    println!("| watchers ms: p50 | p99 | frames missed |");
    println!("|---|---|---|---|---|---|---|---|---|");
    for (relays, watchers) in [(0, 0), (1, 0), (1, 16), (1, 64), (2, 64)] {
        measure(&walk, relays, watchers)?;
    }
    Ok(())
}

/// The notes of displays about frames.
#[derive(Default)]
struct Notes {
    /// When the leader asked for each.
    asked: RefCell<Vec<Instant>>,
    /// From then until they have come, of the frames that count: milliseconds.
    led: RefCell<Vec<f64>>,
    watched: RefCell<Vec<f64>>,
    culls: Cell<u32>,
}

impl Notes {
    fn age(&self, frame: FrameNumber) -> Option<f64> {
        let asked = *self.asked.borrow().get(frame.0 as usize)?;
        (frame.0 >= EARLY).then(|| asked.elapsed().as_secs_f64() * 1e3)
    }
}

fn measure(walk: &Walk, relays: usize, watchers: u32) -> Result<(), Failed> {
    let (culler, mut at) = walk.culler()?;
    let (mut processes, mut metrics) = (vec![culler], Vec::new());
    for _ in 0..relays {
        let shown = port()?.to_string();
        let (relay, listens) = walk.start("relay", &["--upstream", &at.to_string(), "--metrics", &shown])?;
        processes.push(relay);
        metrics.push(shown);
        at = listens;
    }
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let notes = Notes::default();
    let (frames, direct) = runtime.block_on(async {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let mut watching = Vec::new();
        for _ in 0..watchers {
            watching.push(walk.join(&net, &at, None).await?);
        }
        let mut leader = walk.join(&net, &at, Some(1)).await?;
        let stats = leader.stats.clone();
        let watch = futures_util::future::join_all(watching.into_iter().map(|link| watch(link, &notes)));
        tokio::select! {
            frames = lead(walk, &net, &mut leader, &notes) => {
                let carried = stats.read();
                let bytes = carried.received.begin.bytes + carried.received.batches.bytes
                    + carried.received.end.bytes + carried.received.header_bytes;
                Ok::<_, Failed>((frames?, bytes))
            }
            _ = watch, if watchers > 0 => Err("the watchers were let go".into()),
        }
    })?;
    let upstream = metrics.first().map(|shown| read(shown)).transpose()?;
    let bytes = upstream.unwrap_or(direct) as f64 / f64::from(frames);
    let counted = f64::from(frames - EARLY) * f64::from(watchers);
    let (mut led, mut watched) = (notes.led.into_inner(), notes.watched.into_inner());
    let missed = (counted - watched.len() as f64).max(0.0);
    let [led50, led99] = ranks(&mut led);
    let [watched50, watched99] = ranks(&mut watched);
    let culls = f64::from(notes.culls.get()) / f64::from(frames);
    print!("| {relays} | {watchers} | {culls:.2} | {bytes:.0} | {led50} | {led99} ");
    println!("| {watched50} | {watched99} | {missed:.0} of {counted:.0} |");
    Ok(())
}

/// Asks for each pose at its time. Returns how many.
async fn lead(walk: &Walk, net: &Arc<dyn Net>, link: &mut Link, notes: &Notes) -> Result<u32, Failed> {
    let frames = EARLY + walk.seconds * HZ;
    let mut tick = net.now();
    for frame in (0..frames).map(FrameNumber) {
        notes.asked.borrow_mut().push(Instant::now());
        link.latest_tx.publish(walk.camera(frame.0, 1.0, frame.0)?)?;
        let mut is_due = true;
        tick = tick.after(Duration::from_secs(1) / HZ);
        loop {
            tokio::select! {
                biased;
                whole = link.frames_rx.frame(), if is_due => {
                    is_due = whole?.start.header.frame() != frame;
                    notes.led.borrow_mut().extend(notes.age(frame));
                }
                message = link.messages_rx.recv() => if let RoleMessage::Stats(stats) = message? {
                    let culled = stats.hc_end_ns > stats.or_start_ns;
                    notes.culls.set(notes.culls.get() + u32::from(culled));
                },
                () = sleep_until(&**net, tick), if !is_due => break,
            }
        }
    }
    Ok(frames)
}

/// Notes each frame of a watcher, until it is let go.
async fn watch(mut link: Link, notes: &Notes) {
    loop {
        tokio::select! {
            frame = link.frames_rx.frame() => match frame {
                Ok(frame) => notes.watched.borrow_mut().extend(notes.age(frame.start.header.frame())),
                Err(_) => return,
            },
            message = link.messages_rx.recv() => if message.is_err() { return },
        }
    }
}

/// The median and the 99th percentile, as they are printed. Blank without ages.
fn ranks(ages: &mut [f64]) -> [String; 2] {
    ages.sort_by(f64::total_cmp);
    [0.5, 0.99]
        .map(|share| ages.get(((ages.len().max(1) - 1) as f64 * share) as usize))
        .map(|age| age.map_or_else(String::new, |age| format!("{age:.2}")))
}

/// The bytes that a relay has received from its culler.
fn read(at: &str) -> Result<u64, Failed> {
    let mut stream = TcpStream::connect(at)?;
    write!(stream, "GET /links HTTP/1.1\r\nHost: {at}\r\nConnection: close\r\n\r\n")?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer)?;
    let (_, body) = answer.split_once("\r\n\r\n").ok_or("no answer of the relay")?;
    let links: Value = serde_json::from_str(body)?;
    let culler = links.as_array().into_iter().flatten().find(|link| link["peer"] == "culler 1");
    let received = culler.and_then(|link| link["received"].as_object()).ok_or("the relay has no culler")?;
    let of_frames = ["begin_bytes", "id_bytes", "end_bytes", "header_bytes"];
    Ok(of_frames.iter().filter_map(|key| received.get(*key)?.as_u64()).sum())
}
