//! Two peers, one link: a camera goes one way, a frame of ids the other. The transport is an argument; the rest is the same.
//!
//!     cargo run --example a_link -- inproc
//!     cargo run --example a_link -- tcp

use std::{error::Error, sync::Arc, time::Duration};

use trimaran_proto::{Camera, DrawableId, FrameEvent, FrameNumber, FrameStart, Identity, Role, SceneHash};
use trimaran_transport::{Link, LinkConfig, Net, TokioNet, inproc, tcp};

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let transport = std::env::args().nth(1).unwrap_or_else(|| "inproc".to_owned());
    let (mut machine, mut display) = links(&net, &transport).await?;

    // The latest lane: publishing never waits, and reading gives the newest.
    let camera = Camera::new([0.0, 1.7, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(0))?;
    display.latest_tx.publish(camera)?;
    let camera = machine.latest_rx.latest().await?;
    println!("the machine sees from {:?}", camera.eye());

    // The frames lane: begin, any number of ids, finish. The reader learns whether it has all.
    machine.frames_tx.begin(FrameStart { frame: FrameNumber(0), camera }).await?;
    machine.frames_tx.push(&[3, 14, 15].map(DrawableId)).await?;
    machine.frames_tx.finish().await?;
    loop {
        match display.frames_rx.recv().await? {
            FrameEvent::Ids(ids) => println!("the display draws {:?}", ids.iter().collect::<Vec<_>>()),
            FrameEvent::End(outcome) => break println!("the frame ends: {outcome:?}"),
            _ => {}
        }
    }
    Ok(())
}

/// Both ends of a link: the machine's, then the display's.
async fn links(net: &Arc<dyn Net>, transport: &str) -> Result<(Link, Link), Box<dyn Error>> {
    let identity = |role| Identity { role, scene: SceneHash(0x1234), settings: None };
    let (machine, display) = (identity(Role::SwitchA), identity(Role::Display));
    match transport {
        "inproc" => Ok(inproc::pair(net, display, machine, &LinkConfig::default())
            .map(|(displays, machines)| (machines, displays))
            .map_err(|refusal| refusal.to_string())?),
        "tcp" => {
            let (options, deadline) = (tcp::Options::default(), net.now().after(Duration::from_secs(10)));
            let mut listener = tcp::Listener::bind(net, "localhost:0", display, &options).await?;
            let address = listener.local_addr().to_string();
            let (machines, displays) = tokio::join!(
                tcp::connect(net, &address, machine, &options, deadline),
                listener.accept(deadline)
            );
            Ok((machines?, displays?))
        }
        other => Err(format!("no transport {other:?}; give inproc or tcp").into()),
    }
}
