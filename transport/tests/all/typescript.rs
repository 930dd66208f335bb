//! The panel of the TypeScript package's README against a robot here.

use std::env;
use std::path::Path;
use std::process::{Child, Command as Program, Stdio};

use serde::{Deserialize, Serialize};
use trimaran_transport::{
    Channel, CloseReason, FrameStart, Listener, Options, Protocol, RecvError, Rejection,
};

use crate::common::{net, soon};

/// The protocol of both READMEs.
#[derive(Debug, Clone, PartialEq)]
struct Robot;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Hello {
    name: String,
    map: u32,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Command {
    Stop,
    Play { sound: String },
}

impl Protocol for Robot {
    const NAME: &'static str = "robot/2";
    type Hello = Hello;
    type Latest = [f32; 3];
    type Header = [f32; 3];
    type Item = [f32; 3];
    type Message = Command;

    fn name(hello: &Hello) -> String {
        hello.name.clone()
    }

    fn admit(ours: &Hello, theirs: &Hello) -> Result<(), Rejection> {
        if ours.map == theirs.map { Ok(()) } else { Err(Rejection::new(1, "the maps differ")) }
    }
}

/// The protocol of the channels of both READMEs.
#[derive(Debug, Clone, PartialEq)]
struct Sensors;

impl Protocol for Sensors {
    const NAME: &'static str = "sensors/1";
    const CHANNELS: &'static [Channel] = &[
        Channel::latest::<[f32; 3]>("odometry"),
        Channel::frames::<(), [u16; 2]>("front lidar"),
        Channel::frames::<(), [u16; 2]>("back lidar"),
    ];
    type Hello = String;
    type Latest = ();
    type Header = ();
    type Item = u32;
    type Message = ();
}

/// The program in TypeScript that `npm test` in roles/page makes; `None` if it did not.
fn program(name: &str) -> Option<Program> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../roles/page/wire/target/tests").join(name);
    if !path.exists() {
        assert!(env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{} is missing", path.display());
        println!("skipped: it takes {name}, which `npm test` in roles/page makes");
        return None;
    }
    let mut program = Program::new("node");
    program.arg(path).stdout(Stdio::piped());
    Some(program)
}

/// Its output, once it has ended well.
async fn told(program: Child) -> String {
    let told = tokio::task::spawn_blocking(|| program.wait_with_output()).await.unwrap().unwrap();
    assert!(told.status.success());
    String::from_utf8(told.stdout).unwrap()
}

#[tokio::test]
async fn the_panel_in_typescript_drives_the_robot() {
    let Some(mut program) = program("panel.mjs") else { return };
    let net = net();
    let (at, options) = ("ws://127.0.0.1:0/robot".parse().unwrap(), Options::default());
    let hello = Hello { name: "robot".to_owned(), map: 7 };
    let mut listener = Listener::<Robot>::bind(&net, &at, hello, &options).await.unwrap();
    let program = program.arg(listener.local_endpoint().to_string()).spawn().unwrap();

    let mut robot = listener.accept(soon(&net)).await.unwrap();
    assert_eq!(robot.peer.hello, Hello { name: "panel".to_owned(), map: 7 });
    let there = [1.0, 0.0, 0.5];
    let mut pose = robot.latest_rx.latest().await.unwrap();
    if pose == [0.0; 3] {
        pose = robot.latest_rx.latest().await.unwrap();
    }
    assert_eq!(pose, there);
    let points = [[4.0, 5.0, 6.0], [7.0, 8.0, 9.0]];
    robot.frames_tx.send(FrameStart::new(3, there), &points).await.unwrap();
    assert_eq!(robot.messages_rx.recv().await.unwrap(), Command::Play { sound: "bell".to_owned() });
    assert_eq!(robot.messages_rx.recv().await.unwrap(), Command::Stop);
    robot.messages_tx.send(&Command::Stop).await.unwrap();
    let end = robot.frames_rx.recv().await;
    let Err(RecvError::Closed { reason, .. }) = &end else { panic!("{end:?}") };
    assert_eq!(reason.to_string(), "the shift is over");

    // Node stays until the robot has ended its side as well.
    drop(robot);
    let expected = "robot has map 7\nframe 3 from 1: 4 5 6,7 8 9\nthe robot answers: Stop\n\
                    the end: left, the shift is over\n";
    assert_eq!(told(program).await, expected);
}

#[tokio::test]
async fn the_watcher_in_typescript_has_channels() {
    let Some(mut program) = program("sensors.mjs") else { return };
    let net = net();
    let (at, options) = ("ws://127.0.0.1:0/robot".parse().unwrap(), Options::default());
    let mut listener = Listener::<Sensors>::bind(&net, &at, "robot".to_owned(), &options).await.unwrap();
    let program = program.arg(listener.local_endpoint().to_string()).spawn().unwrap();

    let mut robot = listener.accept(soon(&net)).await.unwrap();
    let (mut odometry_tx, mut odometry_rx) = robot.channels.latest::<[f32; 3]>("odometry").unwrap();
    let (mut front_tx, _rx) = robot.channels.frames::<(), [u16; 2]>("front lidar").unwrap();
    let (mut back_tx, mut back_rx) = robot.channels.frames::<(), [u16; 2]>("back lidar").unwrap();
    assert_eq!(odometry_rx.latest().await.unwrap(), [1.0, 0.0, 0.5]);
    odometry_tx.publish([0.5, 2.0, 0.25]).unwrap();
    back_tx.send(FrameStart::new(8, ()), &[[1, 2]]).await.unwrap();
    front_tx.send(FrameStart::new(3, ()), &[[1000, 7], [1010, 65_535]]).await.unwrap();
    let frame = back_rx.frame().await.unwrap();
    assert_eq!(frame.items().collect::<Vec<_>>(), [[3, 4]]);
    let over = CloseReason::new(0, "the shift is over");
    let closes = async {
        odometry_tx.close(over.clone()).await.unwrap();
        front_tx.close(over.clone()).await.unwrap();
        back_tx.close(over.clone()).await.unwrap();
        robot.close(over.clone()).await.unwrap();
    };
    let ((), told) = tokio::join!(closes, told(program));
    let expected = "it is at 0.5,2,0.25\nscan 3: 1000,7 1010,65535\nscan 8: 1,2\n\
                    the end: the shift is over\n";
    assert_eq!(told, expected);
}
