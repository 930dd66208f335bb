//! A robot publishes the scans of two lidars and a map to three panels, which tell it where to go. One panel
//! is slow, one is killed and started again.
//!
//!     cargo run -p trimaran-transport --features zerocopy --example a_robot_and_its_panels -- ENDPOINT
//!
//! Such as `tcp://127.0.0.1:0`, `unix:/tmp/robot`, `ws://127.0.0.1:0/`, `quic://127.0.0.1:0`,
//! `udp://127.0.0.1:0`, `inproc:robot`. Over each of them the slow panel gets new scans and holds up nobody,
//! and the killed one comes back.

use std::{error::Error, sync::Arc, time::Duration};

use serde::{Deserialize, Serialize};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    BlobEvent, ConnectError, Endpoint, FrameNumber, FrameStart, KeepLast, Listener, Net, Options, Plain,
    Protocol, Publisher, Reconnecting, TokioNet, WhenBehind, sleep_until, until,
};
use zerocopy::{FromBytes, Immutable, IntoBytes, little_endian::F32, little_endian::U16};

const TICK: Duration = Duration::from_millis(20);

#[derive(Debug, Clone, PartialEq)]
struct Robot;

/// Where the robot shall go: metres, and a heading.
#[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Pose([F32; 3]);

/// The lidar of a scan: 0 in front, 1 at the back.
#[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Lidar(u8);

/// A point of a scan: distance and intensity.
#[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Point(U16, U16);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Command {
    Play { sound: String },
}

/// The pause of a panel after each scan, and how many it wants.
#[derive(Debug, Clone, Copy)]
struct Wish(Duration, u32);

/// The scans that a panel got, by lidar, and those that it was too slow for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Seen {
    front: u32,
    back: u32,
    skipped: u64,
    oldest: Duration,
    map: usize,
}

impl Protocol for Robot {
    const NAME: &'static str = "robot/2";
    type Hello = String;
    type Latest = Plain<Pose>;
    type Header = Plain<Lidar>;
    type Item = Plain<Point>;
    type Message = Command;

    fn name(hello: &String) -> String {
        hello.clone()
    }
}

/// Scans without end. Each panel gets the map, and each scan that it can take.
async fn robot(net: &Arc<dyn Net>, mut listener: Listener<Robot>) -> Result<(), Box<dyn Error>> {
    let mut publisher = Publisher::new(net, &Options::default().link);
    let points: Vec<_> = (0..5000).map(|n: u16| Plain(Point(n.into(), (n / 3).into()))).collect();
    for frame in 0.. {
        let tick = net.now().after(TICK);
        while let Some(accepted) = until(&**net, tick, listener.accept(tick)).await {
            let Ok(mut link) = accepted else { break };
            publisher.subscribe(link.frames_tx, WhenBehind::Skip);
            net.spawn(Box::pin(async move {
                let pose = link.latest_rx.latest().await;
                println!("{} goes to {pose:?}, {:?}", link.peer.hello, link.messages_rx.recv().await);
                if let Some(bulk) = link.bulk {
                    let _sent = bulk.tx.blobs().send(vec![7; 300_000].into(), |_| {}).await;
                }
            }));
        }
        let header = Plain(Lidar((frame % 2) as u8));
        publisher.publish(FrameStart { frame: FrameNumber(frame), header }, &points).await?;
    }
    Ok(())
}

/// Says where to go, gets the map, and then scans. A lost link is made again.
async fn panel(
    net: &Arc<dyn Net>,
    at: &Endpoint,
    options: &Options,
    name: &str,
    Wish(pause, scans): Wish,
) -> Result<Seen, ConnectError> {
    let mut robot = Reconnecting::<Robot>::new(net, at, name.to_owned(), options);
    robot
        .run(async |mut link| {
            link.latest_tx.publish(Plain(Pose([1.0, 0.0, 0.5].map(F32::new))))?;
            link.messages_tx.send(&Command::Play { sound: "bell".to_owned() }).await?;
            let newest = KeepLast::default();
            link.frames_rx = link.frames_rx.keep_last(newest);
            let mut seen = Seen::default();
            if let Some(bulk) = link.bulk.take() {
                let mut map = bulk.rx.blobs(1 << 20);
                while let Ok(BlobEvent::Progress { length, .. }) = map.recv().await {
                    seen.map = length as usize;
                }
            }
            while seen.front + seen.back < scans {
                let frame = link.frames_rx.frame().await?;
                seen.oldest = seen.oldest.max(frame.age);
                seen.skipped += frame.skipped.total();
                *(if frame.start.header == Plain(Lidar(0)) { &mut seen.front } else { &mut seen.back }) += 1;
                sleep_until(&**net, net.now().after(pause)).await;
            }
            Ok(seen)
        })
        .await
}

/// Walks through it over one transport: what the fast, the slow and the killed panel saw.
async fn all(endpoint: &str) -> Result<[Seen; 3], Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let keys = Keys::generate("anyone".parse()?)?;
    let security = Some(Security { peers: vec![keys.public().clone().into()], keys });
    let options = Options::default().with_security(security);
    let listener = Listener::bind(&net, &endpoint.parse()?, "robot".to_owned(), &options).await?;
    let at = listener.local_endpoint().clone();
    let killed = async {
        let long = Wish(Duration::ZERO, u32::MAX);
        let dies = net.now().after(Duration::from_millis(500));
        let _dropped = until(&*net, dies, panel(&net, &at, &options, "killed", long)).await;
        panel(&net, &at, &options, "killed", Wish(Duration::ZERO, 20)).await
    };
    let fast = panel(&net, &at, &options, "fast", Wish(Duration::ZERO, 40));
    let slow = panel(&net, &at, &options, "slow", Wish(Duration::from_millis(200), 6));
    tokio::select! {
        ended = robot(&net, listener) => Err(ended.err().unwrap_or_else(|| "the robot stopped".into())),
        seen = async { tokio::try_join!(fast, slow, killed) } => Ok(<[Seen; 3]>::from(seen?)),
    }
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let endpoint = std::env::args().nth(1).unwrap_or_else(|| "tcp://127.0.0.1:0".to_owned());
    println!("{:#?}", all(&endpoint).await?);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn the_panels_see_scans_of_both_lidars_over_each_transport() {
        let folder = tempfile::tempdir().unwrap();
        let unix = format!("unix:{}", folder.path().join("robot").display());
        let others = ["inproc:robot", "tcp://127.0.0.1:0", "ws://127.0.0.1:0/", "quic://127.0.0.1:0"];
        for endpoint in others.into_iter().chain(["udp://127.0.0.1:0", &*unix]) {
            let seen = all(endpoint).await.unwrap();
            for (seen, scans) in seen.iter().zip([40, 6, 20]) {
                assert_eq!((seen.front + seen.back, seen.map), (scans, 300_000), "{endpoint}: {seen:?}");
            }
            assert!(seen[1].skipped > 0, "{endpoint}: {seen:?}");
        }
    }
}
