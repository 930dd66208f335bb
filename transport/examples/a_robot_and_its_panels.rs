//! A robot with an IMU, an odometer and two lidars shows three panels what it senses, and gets goals.
//! One panel is slow, one is killed and started again.
//!
//!     cargo run -p trimaran-transport --features zerocopy --example a_robot_and_its_panels -- ENDPOINT
//!
//! Such as `tcp://127.0.0.1:0`, `unix:/tmp/robot`, `ws://127.0.0.1:0/`, `quic://127.0.0.1:0`,
//! `udp://127.0.0.1:0`, `inproc:robot`. The slow panel gets new scans, and holds up nobody.

use std::{error::Error, sync::Arc, time::Duration};

use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    BlobEvent, Channel, ConnectError, Endpoint, FrameNumber, FrameStart, KeepLast, Listener, Net, Options,
    Plain, Protocol, Publisher, Reconnecting, TokioNet, WhenBehind, sleep_until, until,
};
use zerocopy::{FromBytes, Immutable, IntoBytes, little_endian::F32, little_endian::U16};

const TICK: Duration = Duration::from_millis(20);

/// A pose (metres and radians), or the acceleration that the IMU measures (m/s²).
#[derive(Debug, Clone, Copy, Default, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Vector([F32; 3]);

/// A point of a scan: distance and intensity.
#[derive(Debug, Clone, Copy, PartialEq, FromBytes, IntoBytes, Immutable)]
#[repr(C)]
struct Point(U16, U16);

#[derive(Debug, Clone, PartialEq)]
struct Robot;

impl Protocol for Robot {
    const NAME: &'static str = "robot/3";
    const CHANNELS: &'static [Channel] = &[
        Channel::latest::<Plain<Vector>>("imu"),
        Channel::latest::<Plain<Vector>>("odometry"),
        Channel::frames::<(), Plain<Point>>("front lidar"),
        Channel::frames::<(), Plain<Point>>("back lidar"),
    ];
    type Hello = String;
    type Latest = Plain<Vector>; // the goal
    type Header = ();
    type Item = u32;
    type Message = String;

    fn name(hello: &String) -> String {
        hello.clone()
    }
}

/// Senses without end. Each panel gets the map, each scan that it can take, and the newest of the rest.
async fn robot(net: &Arc<dyn Net>, mut listener: Listener<Robot>) -> Result<(), Box<dyn Error>> {
    let mut lidars =
        ["front lidar", "back lidar"].map(|name| (name, Publisher::new(net, &Default::default())));
    let (mut imus, mut odometers) = (Vec::new(), Vec::new());
    let points: Vec<_> = (0..5000).map(|n: u16| Plain(Point(n.into(), (n / 3).into()))).collect();
    for frame in 0.. {
        let tick = net.now().after(TICK);
        while let Some(accepted) = until(&**net, tick, listener.accept(tick)).await {
            let Ok(mut link) = accepted else { break };
            for (name, publisher) in &mut lidars {
                publisher.subscribe(link.channels.frames(name)?.0, WhenBehind::Skip);
            }
            imus.push(link.channels.latest("imu")?.0);
            odometers.push(link.channels.latest("odometry")?.0);
            net.spawn(Box::pin(async move {
                let goal = link.latest_rx.latest().await;
                println!("{} says {goal:?}, {:?}", link.peer.hello, link.messages_rx.recv().await);
                if let Some(bulk) = link.bulk {
                    let _sent = bulk.tx.blobs().send(vec![7; 300_000].into(), |_| {}).await;
                }
            }));
        }
        let sensed = Plain(Vector([frame as f32, 0.0, 9.8].map(F32::new)));
        imus.retain_mut(|imu| imu.publish(sensed).is_ok());
        odometers.retain_mut(|odometer| odometer.publish(sensed).is_ok());
        for (_, publisher) in &mut lidars {
            publisher.publish(FrameStart { frame: FrameNumber(frame), header: () }, &points).await?;
        }
    }
    Ok(())
}

/// The panel's part: the scans by lidar, those that it was too slow for, the bytes of the map, and the newest
/// of the rest.
#[derive(Debug, Default)]
struct Seen {
    scans: [u32; 2],
    skipped: u64,
    map: u64,
    newest: [Vector; 2],
}

type There<'a> = (&'a Arc<dyn Net>, &'a Endpoint, &'a Options);

/// Sends a goal, gets the map, and then `wanted` scans with a pause after each. A lost link is made again.
async fn panel(there: There<'_>, name: &str, pause: Duration, wanted: u32) -> Result<Seen, ConnectError> {
    let (net, at, options) = there;
    let talk = async |mut link: trimaran_transport::Link<Robot>| {
        link.latest_tx.publish(Plain(Vector::default()))?;
        link.messages_tx.send(&"ring the bell".to_owned()).await?;
        let newest = KeepLast::default();
        let (_front_tx, front) = link.channels.frames::<(), Plain<Point>>("front lidar")?;
        let (_back_tx, back) = link.channels.frames::<(), Plain<Point>>("back lidar")?;
        let (mut front, mut back) = (front.keep_last(newest), back.keep_last(newest));
        let (_imu_tx, mut imu) = link.channels.latest::<Plain<Vector>>("imu")?;
        let (_odometry_tx, mut odometry) = link.channels.latest::<Plain<Vector>>("odometry")?;
        let mut seen = Seen::default();
        if let Some(bulk) = link.bulk.take() {
            let mut map = bulk.rx.blobs(1 << 20);
            while let Ok(BlobEvent::Progress { length, .. }) = map.recv().await {
                seen.map = length;
            }
        }
        while seen.scans.iter().sum::<u32>() < wanted {
            let (scan, lidar) = tokio::select! {
                scan = front.frame() => (scan?, 0),
                scan = back.frame() => (scan?, 1),
            };
            seen.scans[lidar] += 1;
            seen.skipped += scan.skipped.total();
            seen.newest = [imu.latest().await?.0, odometry.latest().await?.0];
            sleep_until(&**net, net.now().after(pause)).await;
        }
        Ok(seen)
    };
    Reconnecting::<Robot>::new(net, at, name.to_owned(), options).run(talk).await
}

/// Walks through it over one transport: the parts of the fast, the slow and the killed panel.
async fn all(endpoint: &str) -> Result<[Seen; 3], Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let keys = Keys::generate("anyone".parse()?)?;
    let security = Some(Security { peers: vec![keys.public().clone().into()], keys });
    let options = Options::default().with_security(security);
    let listener = Listener::bind(&net, &endpoint.parse()?, "robot".to_owned(), &options).await?;
    let at = listener.local_endpoint().clone();
    let there = (&net, &at, &options);
    // Links are large: on the heap they need no large stack.
    let panel = |name, pause, wanted| Box::pin(panel(there, name, pause, wanted));
    let killed = async {
        let dies = net.now().after(Duration::from_millis(500));
        let _dropped = until(&*net, dies, panel("killed", Duration::ZERO, u32::MAX)).await;
        panel("killed", Duration::ZERO, 20).await
    };
    let fast = panel("fast", Duration::ZERO, 40);
    let slow = panel("slow", Duration::from_millis(200), 6);
    tokio::select! {
        ended = Box::pin(robot(&net, listener)) => {
            Err(ended.err().unwrap_or_else(|| "the robot stopped".into()))
        }
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
    async fn the_panels_see_everything_over_each_transport() {
        let folder = tempfile::tempdir().unwrap();
        let unix = format!("unix:{}", folder.path().join("robot").display());
        let others = ["inproc:robot", "tcp://127.0.0.1:0", "ws://127.0.0.1:0/", "quic://127.0.0.1:0"];
        for endpoint in others.into_iter().chain(["udp://127.0.0.1:0", &*unix]) {
            let seen = all(endpoint).await.unwrap();
            for (seen, wanted) in seen.iter().zip([40, 6, 20]) {
                assert_eq!((seen.scans.iter().sum(), seen.map), (wanted, 300_000), "{endpoint}: {seen:?}");
                assert!(seen.newest.iter().all(|newest| newest.0[2] == 9.8), "{endpoint}: {seen:?}");
            }
            assert!(seen[1].skipped > 0, "{endpoint}: {seen:?}");
        }
    }
}
