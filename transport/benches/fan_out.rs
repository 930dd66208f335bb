//! The cost of many subscribers over tcp: CPU time of the sending thread for a frame of 4,000 items.
//!
//! `cargo bench -p trimaran-transport --bench fan_out -- [FRAMES]`: 500 frames, if not given. *Loop* sends
//! each frame on each link. *Floor* writes the same bytes to as many bare sockets. The rows of a number of
//! subscribers follow each other. The time of sending over loopback has the kernel's receiving in it.
#![allow(clippy::disallowed_methods, clippy::unwrap_used, reason = "a measurement on real sockets")]

use std::{
    any::Any,
    error::Error,
    fs,
    io::{Read, Write},
    net::{TcpListener, TcpStream},
    sync::Arc,
    thread,
};

use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use trimaran_transport::conformance::{ARM, PANEL, Robot, greeting, points, start};
use trimaran_transport::{
    BatchSize, Batching, Limits, Link, LinkConfig, Listener, Net, Options, Publisher, TokioNet, WhenBehind,
    connect,
};

type Failed = Box<dyn Error>;

const ITEMS: u32 = 4000;

fn main() -> Result<(), Failed> {
    let frames = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    let frames: u32 = frames.map_or(Ok(500), |word| word.parse())?;
    println!("| subscribers | publisher, us a frame | loop | floor | publisher / one | publisher / floor |");
    println!("|---|---|---|---|---|---|");
    let mut one = None;
    for subscribers in [1, 4, 16, 64, 256] {
        let us = |ns: u64| ns as f64 / 1e3 / f64::from(frames);
        let published = us(linked(subscribers, frames, publish)?);
        let looped = us(linked(subscribers, frames, send_each)?);
        let floor = us(bare(subscribers, frames)?);
        let one = *one.get_or_insert(published);
        println!(
            "| {subscribers} | {published:.1} | {looped:.1} | {floor:.1} | {:.1} | {:.1} |",
            published / one,
            published / floor
        );
    }
    Ok(())
}

/// The CPU time of sending, and the links, which the readers need until they have read all.
type Sent = (u64, Box<dyn Any>);

/// The CPU time of this thread so far, in nanoseconds.
fn cpu_ns() -> Result<u64, Failed> {
    let schedstat = fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(schedstat.split_whitespace().next().ok_or("an empty schedstat")?.parse()?)
}

fn options() -> Options {
    let batching = Batching { size: BatchSize::new(ITEMS).unwrap_or_default(), coded: false };
    let link = LinkConfig::default().with_batching(batching);
    let (handshakes_per_s, handshakes_per_s_per_address) = (100_000, 100_000);
    let limits = Limits::default()
        .with_peers(300)
        .with_handshakes_per_s(handshakes_per_s)
        .with_handshakes_per_s_per_address(handshakes_per_s_per_address);
    Options::default().with_link(link).with_limits(limits)
}

fn runtime() -> Result<Runtime, Failed> {
    Ok(Builder::new_current_thread().enable_all().build()?)
}

/// Sends frames over links to readers on another thread. Returns the CPU time of sending.
fn linked(
    subscribers: u32,
    frames: u32,
    send: impl AsyncFn(Vec<Link<Robot>>, u32) -> Result<Sent, Failed>,
) -> Result<u64, Failed> {
    let runtime = runtime()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
    runtime.block_on(async {
        let at = "tcp://127.0.0.1:0".parse()?;
        let mut listener = Listener::<Robot>::bind(&net, &at, greeting(ARM), &options()).await?;
        let at = listener.local_endpoint().clone();
        let (done, over) = oneshot::channel();
        let readers = thread::spawn(move || {
            let runtime = self::runtime().unwrap();
            let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.handle().clone()));
            runtime.block_on(async {
                let mut readers = Vec::new();
                for _ in 0..subscribers {
                    let deadline = net.now().after(std::time::Duration::from_secs(60));
                    let mut link =
                        connect::<Robot>(&net, &at, greeting(PANEL), &options(), deadline).await.unwrap();
                    readers.push(tokio::spawn(async move {
                        while link.frames_rx.frame().await.unwrap().start.frame.0 + 1 < frames {}
                        link
                    }));
                }
                let mut links = Vec::new();
                for reader in readers {
                    links.push(reader.await.unwrap());
                }
                let _all_read = done.send(());
                links
            })
        });
        let mut links = Vec::new();
        for _ in 0..subscribers {
            links.push(listener.accept(net.now().after(std::time::Duration::from_secs(60))).await?);
        }
        let (took, _links) = send(links, frames).await?;
        over.await?;
        drop(readers);
        Ok(took)
    })
}

async fn publish(links: Vec<Link<Robot>>, frames: u32) -> Result<Sent, Failed> {
    let (net, items): (Arc<dyn Net>, _) = (Arc::new(TokioNet::current()?), points(ITEMS));
    let mut publisher = Publisher::<Robot>::new(&net, &options().link);
    let mut others = Vec::new();
    for Link { frames_tx, frames_rx, latest_tx, latest_rx, .. } in links {
        publisher.subscribe(frames_tx, WhenBehind::Wait);
        others.push((frames_rx, latest_tx, latest_rx));
    }
    let begun = cpu_ns()?;
    for frame in 0..frames {
        publisher.publish(start(frame), &items).await?;
    }
    let took = cpu_ns()? - begun;
    while publisher.subscribers().any(|(_, stats)| stats.is_behind) {
        tokio::task::yield_now().await;
    }
    Ok((took, Box::new((publisher, others))))
}

async fn send_each(mut links: Vec<Link<Robot>>, frames: u32) -> Result<Sent, Failed> {
    let items = points(ITEMS);
    let begun = cpu_ns()?;
    for frame in 0..frames {
        for link in &mut links {
            link.frames_tx.begin(start(frame)).await?;
            link.frames_tx.push(&items).await?;
            link.frames_tx.finish().await?;
        }
    }
    let took = cpu_ns()? - begun;
    Ok((took, Box::new(links)))
}

/// Writes as many bytes to bare sockets.
fn bare(subscribers: u32, frames: u32) -> Result<u64, Failed> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let (mut sockets, mut readers) = (Vec::new(), Vec::new());
    for _ in 0..subscribers {
        sockets.push(TcpStream::connect(listener.local_addr()?)?);
        readers.push(listener.accept()?.0);
    }
    let bytes = vec![7; ITEMS as usize * 4 + 100];
    let length = bytes.len();
    let reads = thread::spawn(move || {
        let mut buffer = vec![0; length];
        for _ in 0..frames {
            for reader in &mut readers {
                reader.read_exact(&mut buffer).unwrap();
            }
        }
    });
    let begun = cpu_ns()?;
    for _ in 0..frames {
        for socket in &mut sockets {
            socket.write_all(&bytes)?;
        }
    }
    let took = cpu_ns()? - begun;
    reads.join().map_err(|_| "a reader failed")?;
    Ok(took)
}
