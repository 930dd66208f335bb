//! A robot with an odometer, an IMU, a lidar and a radar shows three panels what it senses, and gets goals.
//! One panel is slow, one is killed and started again. The slow one gets new scans, and holds up nobody.
//!
//!     cargo run -p trimaran-transport --example a_robot_and_its_panels -- tcp://127.0.0.1:0

use std::{convert::Infallible, error::Error, sync::Arc, time::Duration};

use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    Channel, ConnectError, FrameStart, KeepLast, Link, Listener, Net, Options, Protocol, Publisher,
    Reconnecting, TokioNet, WhenBehind, sleep_until, until,
};

type Pose = [f32; 3]; // metres, metres, radians
type Motion = [f32; 6]; // accelerations and rates of rotation
type Echo = [f32; 4]; // a point of the radar: metres and metres a second

#[derive(Debug, Clone, PartialEq)]
struct Robot;

impl Protocol for Robot {
    const NAME: &'static str = "robot/3";
    const CHANNELS: &'static [Channel] =
        &[Channel::latest::<Motion>("imu"), Channel::frames::<Pose, Echo>("radar")];
    type Hello = String;
    type Latest = Pose; // where the robot is, or from a panel where it shall go
    type Header = Pose;
    type Item = [u16; 2]; // a point of the lidar: distance and intensity
    type Message = String;
}

/// Senses without end. Each panel gets the map, each scan that it can take, and the newest of the rest.
async fn robot(net: &Arc<dyn Net>, mut listener: Listener<Robot>) -> Result<Infallible, Box<dyn Error>> {
    let mut lidar = Publisher::<Robot>::new(net, &Default::default());
    let mut radar = Publisher::new(net, &Default::default());
    let (mut odometers, mut imus, mut frame) = (Vec::new(), Vec::new(), 0);
    loop {
        let tick = net.now().after(Duration::from_millis(20));
        while let Ok(mut link) = listener.accept(tick).await {
            lidar.subscribe(link.frames_tx, WhenBehind::Skip);
            radar.subscribe(link.channels.frames::<Pose, Echo>("radar")?.0, WhenBehind::Skip);
            odometers.push(link.latest_tx);
            imus.push(link.channels.latest::<Motion>("imu")?.0);
            net.spawn(Box::pin(async move {
                let goal = link.latest_rx.latest().await;
                println!("{} says {goal:?}, {:?}", link.peer.hello, link.messages_rx.recv().await);
                if let Some(bulk) = link.bulk {
                    let _sent = bulk.tx.blobs().send(vec![7; 300_000].into(), |_| {}).await;
                }
            }));
        }
        frame += 1;
        let pose = [frame as f32, 0.0, 0.0];
        odometers.retain_mut(|odometer| odometer.publish(pose).is_ok());
        imus.retain_mut(|imu| imu.publish([0.0, 0.0, 9.8, 0.0, 0.0, 0.0]).is_ok());
        lidar.publish(FrameStart::new(frame, pose), &[[1000, 7]; 5000]).await?;
        radar.publish(FrameStart::new(frame, pose), &[[1.0, 0.0, 0.0, 0.5]; 500]).await?;
    }
}

/// Sends a goal, gets the map, and then so many scans with a pause after each. A lost link is made again.
/// Returns how many scans it was too slow for.
async fn panel(net: &dyn Net, mut at: Reconnecting<Robot>, ms: u64, scans: u32) -> Result<u64, ConnectError> {
    let talk = async |mut link: Link<Robot>| {
        link.latest_tx.publish([4.0, 2.0, 0.0])?;
        link.messages_tx.send(&"ring the bell".to_owned()).await?;
        if let Some(bulk) = link.bulk {
            assert_eq!(bulk.rx.blobs(1 << 20).whole().await?, [7; 300_000][..]);
        }
        let mut lidar = link.frames_rx.keep_last(KeepLast::default());
        let mut radar = link.channels.frames::<Pose, Echo>("radar")?.1.keep_last(KeepLast::default());
        let mut imu = link.channels.latest::<Motion>("imu")?.1;
        assert_eq!(imu.latest().await?[2], 9.8);
        for _ in 0..scans {
            let points = tokio::select! {
                scan = lidar.frame() => scan?.end.items,
                scan = radar.frame() => scan?.end.items,
            };
            let pose = link.latest_rx.try_latest()?; // without waiting for the next one
            assert!(matches!(points, 500 | 5000) && pose.is_none_or(|pose| pose[0] >= 1.0), "{pose:?}");
            sleep_until(net, net.now().after(Duration::from_millis(ms))).await;
        }
        Ok(link.stats.read().skipped.total())
    };
    at.run(talk).await
}

/// Walks through it over one transport.
async fn all(endpoint: &str) -> Result<(), Box<dyn Error>> {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let options = Options::default().with_security(Security::shared(Keys::generate("anyone".parse()?)?));
    let listener = Listener::bind(&net, &endpoint.parse()?, "robot".to_owned(), &options).await?;
    let at = listener.local_endpoint().clone();
    let panel = |name: &str, ms, scans| {
        let robot = Reconnecting::new(&net, &at, name.to_owned(), &options);
        Box::pin(panel(&*net, robot, ms, scans)) // a link is large for a stack
    };
    let killed = async {
        let dies = net.now().after(Duration::from_millis(500));
        let _dropped = until(&*net, dies, panel("killed", 0, u32::MAX)).await;
        panel("killed", 0, 20).await
    };
    let (fast, slow, killed) = tokio::select! {
        ended = Box::pin(robot(&net, listener)) => match ended? {},
        missed = async { tokio::try_join!(panel("fast", 0, 40), panel("slow", 200, 6), killed) } => missed?,
    };
    println!("{endpoint}: the fast panel missed {fast} scans, the slow {slow}, the killed one {killed}");
    assert!(slow > 0);
    Ok(())
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    all(&std::env::args().nth(1).ok_or("which endpoint?")?).await
}

#[cfg(test)]
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_panels_see_everything_over_each_transport() {
    let folder = tempfile::tempdir().unwrap();
    let unix = format!("unix:{}", folder.path().join("robot").display());
    all(&unix).await.unwrap();
    all("inproc:robot").await.unwrap();
    for scheme in ["tcp", "ws", "quic", "udp"] {
        all(&format!("{scheme}://127.0.0.1:0")).await.unwrap();
    }
}
