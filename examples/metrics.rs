//! The traffic of links for Prometheus: counters of any links, served by this program.
//!
//!     cargo run --example metrics                      # sends some frames, reads its own metrics once
//!     cargo run --example metrics -- 127.0.0.1:9100    # goes on until Ctrl-C: curl http://127.0.0.1:9100/metrics

use std::{error::Error, net::SocketAddr, sync::Arc, time::Duration};

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran::metrics::{LinkMetrics, Metrics};
use trimaran_actors::{FrameEvent, FrameStart, Link};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::{LinkConfig, Net, TokioNet, inproc, sleep_until, ws::WsOptions};

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let address: Option<SocketAddr> = std::env::args().nth(1).map(|arg| arg.parse()).transpose()?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let identity = |role| Identity { role, scene: Some(SceneHash(0x1234).into()), session: None };
    let config = LinkConfig::default();
    let (culler, display) =
        inproc::pair::<Walkthrough>(&net, identity(Role::Culler), identity(Role::Display), &config)?;

    // Counting costs next to nothing. The metrics can be read at any time, with the links alive or not.
    let metrics = LinkMetrics::of([&culler]);
    let any = SocketAddr::from(([127, 0, 0, 1], 0));
    let serving = Metrics::of("example", metrics.clone()).serve(
        address.unwrap_or(any),
        &WsOptions::default(),
        &tokio::runtime::Handle::current(),
    )?;
    println!("http://{}/metrics, and /links as JSON", serving.address());

    let frames = if address.is_some() { u32::MAX } else { 30 };
    tokio::select! {
        sent = send(&*net, culler, frames) => sent?,
        received = receive(display) => received?,
        stop = tokio::signal::ctrl_c() => stop?,
    }
    let carried = &metrics.read()[0].sent;
    println!("{} frames, {} ids, {} bytes were sent", carried.frames, carried.ids, carried.total_bytes());
    println!("{}", fetch(serving.address()).await?);
    Ok(())
}

/// Thirty frames a second.
async fn send(net: &dyn Net, mut link: Link, frames: u32) -> Result<(), Box<dyn Error>> {
    let ids: Vec<DrawableId> = (0..500).map(DrawableId).collect();
    for frame in 0..frames {
        let camera = Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(frame))?;
        link.frames_tx.begin(FrameStart { frame: FrameNumber(frame), header: camera }).await?;
        link.frames_tx.push(&ids).await?;
        link.frames_tx.finish().await?;
        sleep_until(net, net.now().after(Duration::from_millis(33))).await;
    }
    Ok(())
}

async fn receive(mut link: Link) -> Result<(), Box<dyn Error>> {
    loop {
        if let FrameEvent::End(outcome) = link.frames_rx.recv().await? {
            tracing::debug!(?outcome, "a frame has ended");
        }
    }
}

/// Fetches the metrics like a scraper.
async fn fetch(from: SocketAddr) -> Result<String, Box<dyn Error>> {
    let mut stream = tokio::net::TcpStream::connect(from).await?;
    stream.write_all(b"GET /metrics HTTP/1.0\r\nHost: localhost\r\n\r\n").await?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await?;
    Ok(answer.split_once("\r\n\r\n").map_or(answer.clone(), |(_, body)| body.to_owned()))
}
