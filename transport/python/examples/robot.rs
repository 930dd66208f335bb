//! The robot of the crate's README, as a peer for Python's tests: it answers one panel.
//!
//! ```sh
//! cargo run -p trimaran-python --example robot -- tcp://127.0.0.1:0
//! ```

use std::convert::Infallible;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use trimaran_transport::{
    BlobEvent, Bulk, CloseReason, Fixed, FrameNumber, FrameStart, Item, Listener, Net, Options, Protocol,
    RecvError, Rejection, TokioNet,
};

#[derive(Debug, Clone, PartialEq)]
struct Robot;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Hello {
    name: String,
    map: u32,
}

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
    type Latest = Point;
    type Header = Point;
    type Item = Point;
    type Message = Command;

    fn name(hello: &Hello) -> String {
        hello.name.clone()
    }

    fn admit(ours: &Hello, theirs: &Hello) -> Result<(), Rejection> {
        if ours.map == theirs.map { Ok(()) } else { Err(Rejection::new(1, "the maps differ")) }
    }
}

impl Fixed for Point {
    const SIZE: usize = 12;
    type Error = Infallible;

    fn write(&self, out: &mut [u8]) {
        for (out, number) in out.chunks_exact_mut(4).zip(self.0) {
            out.copy_from_slice(&number.to_le_bytes());
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, Infallible> {
        let mut numbers = bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        Ok(Self([(); 3].map(|()| numbers.next().unwrap_or_default())))
    }
}

impl Item for Point {
    const SIZE: usize = 12;

    fn write(self, out: &mut [u8]) {
        Fixed::write(&self, out);
    }

    fn read(bytes: &[u8]) -> Self {
        let Ok(point) = <Self as Fixed>::read(bytes);
        point
    }
}

/// Prints its endpoint. Then takes a pose, sends a frame from there, sends each frame and blob back, answers
/// `Play` by `Stop`, and ends with `Stop`.
#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let at = std::env::args().nth(1).ok_or("give an endpoint to listen at")?;
    let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
    let hello = Hello { name: "robot".to_owned(), map: 7 };
    let mut listener = Listener::<Robot>::bind(&net, &at.parse()?, hello, &Options::default()).await?;
    println!("{}", listener.local_endpoint());
    let mut panel = listener.accept(net.now().after(Duration::from_secs(60))).await?;

    let header = panel.latest_rx.latest().await?;
    panel.latest_tx.publish(header)?;
    panel.frames_tx.begin(FrameStart { frame: FrameNumber(3), header }).await?;
    let points = [Point([4.0, 5.0, 6.0]), Point([7.0, 8.0, 9.0])];
    panel.frames_tx.push(&points).await?;
    panel.frames_tx.finish().await?;

    let Bulk { tx, rx } = panel.bulk.take().ok_or("a link has a bulk lane")?;
    let (mut blobs_tx, mut blobs_rx) = (tx.blobs(), rx.blobs(1 << 30));
    loop {
        tokio::select! {
            frame = panel.frames_rx.frame() => {
                let frame = frame?;
                let items: Vec<_> = frame.items().collect();
                let start = FrameStart { frame: FrameNumber(frame.start.frame.0 + 10), ..frame.start };
                panel.frames_tx.begin(start).await?;
                panel.frames_tx.push(&items).await?;
                panel.frames_tx.finish().await?;
            }
            message = panel.messages_rx.recv() => match message {
                Ok(Command::Play { sound }) if sound == "bell" => {
                    panel.messages_tx.send(&Command::Stop).await?;
                }
                Ok(Command::Play { sound }) => return Err(format!("{sound} is no sound").into()),
                Ok(Command::Stop) => break,
                Err(RecvError::Closed { reason, .. }) => {
                    println!("{reason}");
                    return Ok(());
                }
                Err(error) => return Err(error.into()),
            },
            blob = blobs_rx.recv() => {
                if let BlobEvent::Whole(blob) = blob? {
                    blobs_tx.send(blob, |_| {}).await?;
                }
            }
        }
    }
    panel.bulk = Some(Bulk { tx: blobs_tx.into_blocks(), rx: blobs_rx.into_blocks() });
    panel.close(CloseReason::new(5, "the shift is over")).await?;
    Ok(())
}
