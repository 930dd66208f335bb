//! The same frames over every transport: the value of one flag is all that changes. The times and the
//! guarantees differ.
//!
//!     cargo run --release --example swap_by_flag                 # all of them, one after another
//!     cargo run --release --example swap_by_flag -- --link udp   # one of inproc, unix, tcp, quic, udp

use std::{error::Error, sync::Arc, time::Duration};

use clap::{Parser, ValueEnum};
use trimaran_actors::{FrameEvent, FrameStart, Link, Listener};
use trimaran_proto::{Camera, CloseCode, DrawableId, FrameNumber, Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, Net, Options, TokioNet, connect};

#[derive(Debug, Parser)]
struct Args {
    /// Which transport; all of them without this flag.
    #[arg(long)]
    link: Option<Transport>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Transport {
    Inproc,
    Unix,
    Tcp,
    Quic,
    Udp,
}

const FRAMES: u32 = 100;

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let chosen = Args::parse().link;
    for transport in Transport::value_variants() {
        if chosen.is_none() || chosen.map(|link| link as u8) == Some(*transport as u8) {
            show(*transport).await?;
        }
    }
    Ok(())
}

/// The culler's endpoint: the only code that knows of transports.
fn endpoint(transport: Transport) -> Result<Endpoint, Box<dyn Error>> {
    Ok(match transport {
        Transport::Inproc => "inproc:culler".parse()?,
        Transport::Unix => {
            format!("unix:{}/trimaran-swap-{}.sock", std::env::temp_dir().display(), std::process::id())
                .parse()?
        }
        Transport::Tcp => "tcp://127.0.0.1:0".parse()?,
        Transport::Quic => "quic://127.0.0.1:0".parse()?,
        Transport::Udp => "udp://127.0.0.1:0".parse()?,
    })
}

/// Sends frames of 4,000 ids to a display, which answers each with a camera.
async fn show(transport: Transport) -> Result<(), Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let (mut culler, mut display) = links(&net, &endpoint(transport)?).await?;
    let (promises, sent) = (culler.capabilities(), culler.stats.clone());
    let start = net.now();
    let shows = async {
        for _ in 0..FRAMES {
            while !matches!(display.frames_rx.recv().await?, FrameEvent::End(_)) {}
            display.latest_tx.publish(camera(0)?)?;
        }
        Ok::<_, Box<dyn Error>>(())
    };
    let ids: Vec<DrawableId> = (0..4000).map(DrawableId).collect();
    let sends = async {
        for frame in 0..FRAMES {
            culler.frames_tx.begin(FrameStart { frame: FrameNumber(frame), header: camera(frame)? }).await?;
            culler.frames_tx.push(&ids).await?;
            culler.frames_tx.finish().await?;
            culler.latest_rx.latest().await?;
        }
        Ok::<_, Box<dyn Error>>(())
    };
    let (sent_all, shown_all) = tokio::join!(sends, shows);
    sent_all.and(shown_all)?;
    let micros = net.now().since(start).as_micros() / u128::from(FRAMES);
    let (encrypted, local) = (promises.encrypted, promises.local);
    println!(
        "{transport:?}: {micros} us a frame and its answer, {} bytes a frame, encrypted: {encrypted}, local: {local}",
        sent.read().sent.total_bytes() / u64::from(FRAMES)
    );
    let (_, _) =
        tokio::join!(culler.close(CloseCode::Finished.reason()), display.close(CloseCode::Finished.reason()));
    Ok(())
}

fn camera(frame: u32) -> Result<Camera, trimaran_proto::CameraError> {
    Camera::new([0.0, 1.7, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.1, FrameNumber(frame))
}

/// Both ends of a link: the culler's, then the display's. Each knows the other's public keys, which QUIC and
/// UDP need; normally `trimaran keys new` makes them and they are read from files.
async fn links(net: &Arc<dyn Net>, endpoint: &Endpoint) -> Result<(Link, Link), Box<dyn Error>> {
    let (culler, display) = (Keys::generate("culler".parse()?)?, Keys::generate("display".parse()?)?);
    let options = |own: &Keys, other: &Keys| {
        Options::default()
            .with_security(Security { keys: own.clone(), peers: vec![other.public().clone().into()].into() })
    };
    let identity = |role| Identity { role, scene: Some(SceneHash(0x1234).into()), session: None };
    let (here, there) = (options(&culler, &display), options(&display, &culler));
    let deadline = net.now().after(Duration::from_secs(10));
    let mut listener = Listener::bind(net, endpoint, identity(Role::Culler), &here).await?;
    let place = listener.local_endpoint().clone();
    let (display, culler) = tokio::join!(
        connect::<Walkthrough>(net, &place, identity(Role::Display), &there, deadline),
        listener.accept(deadline)
    );
    Ok((culler?, display?))
}
