//! The panel of the TypeScript package's README against a robot here.

use std::path::Path;
use std::process::{Command as Program, Stdio};
use std::{env, io};

use serde::{Deserialize, Serialize};
use trimaran_transport::{
    Fixed, FrameNumber, FrameStart, Item, Listener, Options, Protocol, RecvError, Rejection,
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

#[derive(Debug, Clone, Copy, PartialEq)]
struct Pose([f32; 3]);

#[derive(Debug, Clone, Copy, PartialEq)]
struct Point([f32; 3]);

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
enum Command {
    Stop,
    Play { sound: String },
}

impl Protocol for Robot {
    const NAME: &'static str = "robot/1";
    type Hello = Hello;
    type Latest = Pose;
    type Header = Pose;
    type Item = Point;
    type Message = Command;

    fn name(hello: &Hello) -> String {
        hello.name.clone()
    }

    fn admit(ours: &Hello, theirs: &Hello) -> Result<(), Rejection> {
        if ours.map == theirs.map { Ok(()) } else { Err(Rejection::new(1, "the maps differ")) }
    }
}

impl Fixed for Pose {
    const SIZE: usize = 12;
    type Error = io::Error;

    fn write(&self, out: &mut [u8]) {
        write(self.0, out);
    }

    fn read(bytes: &[u8]) -> io::Result<Self> {
        Ok(Self(read(bytes)))
    }
}

impl Item for Point {
    const SIZE: usize = 12;

    fn write(self, out: &mut [u8]) {
        write(self.0, out);
    }

    fn read(bytes: &[u8]) -> Self {
        Self(read(bytes))
    }
}

fn write(numbers: [f32; 3], out: &mut [u8]) {
    for (out, number) in out.chunks_exact_mut(4).zip(numbers) {
        out.copy_from_slice(&number.to_le_bytes());
    }
}

fn read(bytes: &[u8]) -> [f32; 3] {
    let mut numbers = bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    [(); 3].map(|()| numbers.next().unwrap_or_default())
}

#[tokio::test]
async fn the_panel_in_typescript_drives_the_robot() {
    let panel = Path::new(env!("CARGO_MANIFEST_DIR")).join("../roles/page/wire/target/tests/panel.mjs");
    if !panel.exists() {
        assert!(env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none(), "{} is missing", panel.display());
        println!("skipped: it takes the panel that `npm test` in roles/page makes");
        return;
    }
    let net = net();
    let (at, options) = ("ws://127.0.0.1:0/robot".parse().unwrap(), Options::default());
    let hello = Hello { name: "robot".to_owned(), map: 7 };
    let mut listener = Listener::<Robot>::bind(&net, &at, hello, &options).await.unwrap();
    let mut program = Program::new("node");
    program.arg(panel).arg(listener.local_endpoint().to_string());
    let program = program.stdout(Stdio::piped()).spawn().unwrap();

    let mut robot = listener.accept(soon(&net)).await.unwrap();
    assert_eq!(robot.peer.hello, Hello { name: "panel".to_owned(), map: 7 });
    let there = Pose([1.0, 0.0, 0.5]);
    let mut pose = robot.latest_rx.latest().await.unwrap();
    if pose == Pose([0.0; 3]) {
        pose = robot.latest_rx.latest().await.unwrap();
    }
    assert_eq!(pose, there);
    robot.frames_tx.begin(FrameStart { frame: FrameNumber(3), header: there }).await.unwrap();
    robot.frames_tx.push(&[Point([4.0, 5.0, 6.0]), Point([7.0, 8.0, 9.0])]).await.unwrap();
    robot.frames_tx.finish().await.unwrap();
    assert_eq!(robot.messages_rx.recv().await.unwrap(), Command::Play { sound: "bell".to_owned() });
    assert_eq!(robot.messages_rx.recv().await.unwrap(), Command::Stop);
    robot.messages_tx.send(&Command::Stop).await.unwrap();
    let end = robot.frames_rx.recv().await;
    let Err(RecvError::Closed { reason, .. }) = &end else { panic!("{end:?}") };
    assert_eq!(reason.to_string(), "the shift is over");

    // Node stays until the robot has ended its side as well.
    drop(robot);
    let told = tokio::task::spawn_blocking(|| program.wait_with_output()).await.unwrap().unwrap();
    assert!(told.status.success());
    let expected = "robot has map 7\nframe 3 from 1: 4 5 6,7 8 9\nthe robot answers: Stop\n\
                    the end: left, the shift is over\n";
    assert_eq!(String::from_utf8(told.stdout).unwrap(), expected);
}
