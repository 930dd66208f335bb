//! Two peers, one link: a camera goes one way, a frame of ids the other. The transport is an argument; the
//! rest is the same.
//!
//!     cargo run --example a_link -- inproc:culler
//!     cargo run --example a_link -- unix:/tmp/culler.sock
//!     cargo run --example a_link -- tcp://localhost:0

use std::{error::Error, sync::Arc, time::Duration};

use trimaran_actors::{FrameEvent, FrameStart, Link, Listener};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::{Endpoint, Net, Options, TokioNet, connect};

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let endpoint = std::env::args().nth(1).unwrap_or_else(|| "inproc:culler".to_owned()).parse()?;
    let (mut culler, mut display) = links(&net, &endpoint).await?;

    // The latest lane: publishing never waits, and reading gives the newest.
    let camera = Camera::new([0.0, 1.7, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(0))?;
    display.latest_tx.publish(camera)?;
    let camera = culler.latest_rx.latest().await?;
    println!("the culler sees from {:?}", camera.eye());

    // The frames lane: begin, any number of ids, finish. The reader learns whether it has all.
    culler.frames_tx.begin(FrameStart { frame: FrameNumber(0), header: camera }).await?;
    culler.frames_tx.push(&[3, 14, 15].map(DrawableId)).await?;
    culler.frames_tx.finish().await?;
    loop {
        match display.frames_rx.recv().await? {
            FrameEvent::Batch(ids) => println!("the display draws {:?}", ids.iter().collect::<Vec<_>>()),
            FrameEvent::End(outcome) => break println!("the frame ends: {outcome:?}"),
            _ => {}
        }
    }
    Ok(())
}

/// Both ends of a link: the culler's, then the display's.
async fn links(net: &Arc<dyn Net>, endpoint: &Endpoint) -> Result<(Link, Link), Box<dyn Error>> {
    let identity = |role| Identity { role, scene: Some(SceneHash(0x1234).into()), session: None };
    let (options, deadline) = (Options::default(), net.now().after(Duration::from_secs(10)));
    let mut listener = Listener::bind(net, endpoint, identity(Role::Culler), &options).await?;
    let there = listener.local_endpoint().clone();
    let (display, culler) = tokio::join!(
        connect::<Walkthrough>(net, &there, identity(Role::Display), &options, deadline), // tries again until the deadline
        listener.accept(deadline)
    );
    Ok((culler?, display?))
}
