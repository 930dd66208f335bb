//! The age of the frames that a slow reader gets: it reads 5 a second of a sender of 46 a second.
//!
//! `cargo bench -p trimaran-transport --bench slow_reader -- [SECONDS]`: 15 s for each cell, if not given. An
//! age is the time from the end of a frame at its sender to its return by the reader's call. *Every frame* is
//! a reader that gets all, the last one counts. *Newest* keeps the last whole frame.
#![allow(clippy::disallowed_methods, reason = "a measurement reads the clock")]

use std::{
    error::Error,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use tokio::{runtime::Builder, time::sleep};
use trimaran_transport::conformance::{Overhead, Pairs, Robot, points, send_frame};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{FrameSender, KeepLast, LinkConfig, Options, conformance::Joined};

type Failed = Box<dyn Error>;

/// About 100 kB, as of a lidar.
const ITEMS: u32 = 25_000;
const SENT_PER_S: u32 = 46;
const READ_PER_S: u32 = 5;

/// When each frame was sent.
type Times = Arc<Mutex<Vec<Instant>>>;

fn main() -> Result<(), Failed> {
    let seconds = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    let time = Duration::from_secs(seconds.map_or(Ok(15), |word| word.parse())?);
    let keys = Keys::generate("both".parse()?)?;
    let security = Some(Security { peers: vec![keys.public().clone().into()].into(), keys });
    let options = Options::default().with_security(security);
    let folder = tempfile::tempdir()?;
    let unix = format!("unix:{}", folder.path().join("socket").display());
    let runtime = Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    println!("| transport | every frame, s | newest, ms: median | p95 | most |");
    println!("|---|---|---|---|---|");
    for at in [
        "inproc:slow",
        &unix,
        "tcp://127.0.0.1:0",
        "ws://127.0.0.1:0/robot",
        "quic://127.0.0.1:0",
        "udp://127.0.0.1:0",
        "udp://127.0.0.1:0?mode=deadline",
    ] {
        let overhead = Overhead { header_bytes: 0, handshake: 1, coded: false };
        let pairs = Joined::at(at, options.clone(), overhead);
        let every = runtime.block_on(ages(&pairs, None, time))?;
        let newest = KeepLast::default();
        let mut newest = runtime.block_on(ages(&pairs, Some(newest), time))?;
        newest.sort();
        let (last, most) = (every.last().ok_or("none")?, newest.last().ok_or("none")?);
        let at_part = |part: usize| newest.get(newest.len() * part / 100).map_or(0.0, |age| ms(*age));
        let name = at.split_once(':').map_or(at, |(scheme, _)| scheme);
        let name = if at.ends_with("deadline") { "udp, mode=deadline" } else { name };
        println!(
            "| {name} | {:.1} | {:.0} | {:.0} | {:.0} |",
            last.as_secs_f64(),
            at_part(50),
            at_part(95),
            ms(*most)
        );
    }
    Ok(())
}

fn ms(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

/// The age of each frame read.
async fn ages(pairs: &Joined, keep: Option<KeepLast>, time: Duration) -> Result<Vec<Duration>, Failed> {
    let (arm, mut panel) = pairs.pair(LinkConfig::default()).await;
    let times = Times::default();
    let sending = tokio::spawn(send(arm.frames_tx, Arc::clone(&times)));
    if let Some(keep) = keep {
        panel.frames_rx = panel.frames_rx.keep_last(keep);
    }
    let begun = Instant::now();
    let mut ages = Vec::new();
    while begun.elapsed() < time {
        sleep(Duration::from_secs(1) / READ_PER_S).await;
        let frame = panel.frames_rx.frame().await?.start.frame.0 as usize;
        let sent = times.lock().map_err(|_| "the sender failed")?.get(frame).copied();
        // A frame that is still being sent is new.
        ages.push(sent.map_or(Duration::ZERO, |sent| sent.elapsed()));
    }
    sending.abort();
    Ok(ages)
}

/// Sends frames at their pace. A frame that has to wait delays the next ones.
async fn send(mut frames: FrameSender<Robot>, times: Times) {
    let items = points(ITEMS);
    let mut due = Instant::now();
    for frame in 0.. {
        if send_frame(&mut frames, frame, &items).await.is_err() {
            return;
        }
        if let Ok(mut times) = times.lock() {
            times.push(Instant::now());
        }
        due = (due + Duration::from_secs(1) / SENT_PER_S).max(Instant::now());
        sleep(due - Instant::now()).await;
    }
}
