//! Links: poses and answers on the latest lane, frames on the frames lane.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use anyhow::Result;
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{
    CloseReason, Endpoint, Fixed, FrameEvent, FrameNumber, FrameOutcome, FrameStart, Link, Listener, Net, Options,
    Protocol, TokioNet, connect,
};

use super::{POSE, number, pose};

use crate::measure::{Arrivals, Far, POINTS, Near, Subject};

/// Poses of 72 bytes, frames of points.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Peers;

impl Protocol for Peers {
    const NAME: &'static str = "peers/1";
    type Hello = String;
    type Latest = Pose;
    type Header = Pose;
    type Item = u32;
    type Message = ();
}

/// A number and zeros.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose(u32);

impl Fixed for Pose {
    const SIZE: usize = POSE;
    type Error = std::io::Error;

    fn write(&self, out: &mut [u8]) {
        out.copy_from_slice(&pose(self.0));
    }

    fn read(bytes: &[u8]) -> std::io::Result<Self> {
        number(bytes).map(Self).map_err(std::io::Error::other)
    }
}

/// A link over one of the transports.
pub(crate) struct Linked {
    endpoint: Endpoint,
    near: Options,
    far: Options,
}

impl Linked {
    pub(crate) fn inproc() -> Result<Self> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        Self::over(&format!("inproc:peers-{}", NUMBER.fetch_add(1, Ordering::Relaxed)))
    }

    pub(crate) fn unix() -> Result<Self> {
        let folder = std::env::temp_dir();
        Self::over(&format!("unix:{}/trimaran-peers-{}.sock", folder.display(), std::process::id()))
    }

    pub(crate) fn tcp() -> Result<Self> {
        Self::over("tcp://127.0.0.1:0")
    }

    pub(crate) fn udp() -> Result<Self> {
        Self::over("udp://127.0.0.1:0")
    }

    pub(crate) fn quic() -> Result<Self> {
        Self::over("quic://127.0.0.1:0")
    }

    fn over(endpoint: &str) -> Result<Self> {
        let (near, far) = (Keys::generate("near".parse()?)?, Keys::generate("far".parse()?)?);
        let options = |own: &Keys, other: &Keys| {
            let mut options = Options::default();
            options.security = Some(Security { keys: own.clone(), peers: vec![other.public().clone().into()].into() });
            options
        };
        Ok(Self { endpoint: endpoint.parse()?, near: options(&near, &far), far: options(&far, &near) })
    }
}

pub(crate) struct End {
    link: Link<Peers>,
    points: Vec<u32>,
}

impl End {
    fn new(link: Link<Peers>) -> Self {
        Self { link, points: (0..POINTS).collect() }
    }
}

impl Subject for Linked {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let deadline = net.now().after(Duration::from_secs(10));
        let mut listener = Listener::bind(&net, &self.endpoint, "near".to_owned(), &self.near).await?;
        whereabouts.send(listener.local_endpoint().to_string())?;
        Ok(End::new(listener.accept(deadline).await?))
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let deadline = net.now().after(Duration::from_secs(10));
        let link = connect(&net, &whereabouts.parse()?, "far".to_owned(), &self.far, deadline).await?;
        Ok(End::new(link))
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        Ok(self.link.latest_tx.publish(Pose(number))?)
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        let frames = &mut self.link.frames_tx;
        frames.begin(FrameStart { frame: FrameNumber(number), header: Pose(number) }).await?;
        frames.push(&self.points).await?;
        frames.finish().await?;
        Ok(())
    }

    async fn answer(&mut self) -> Result<u32> {
        Ok(self.link.latest_rx.latest().await?.0)
    }

    async fn close(self) -> Result<()> {
        self.link.close(CloseReason::new(0, "all is measured")).await?;
        Ok(())
    }
}

/// Looks at a frame event; returns the number of a frame that has ended.
fn ended(event: FrameEvent<Peers>) -> Option<FrameNumber> {
    match event {
        FrameEvent::Batch(points) => {
            for point in points.iter() {
                std::hint::black_box(point);
            }
            None
        }
        FrameEvent::End(FrameOutcome::Complete(end)) => Some(end.frame),
        FrameEvent::End(FrameOutcome::Incomplete { frame, .. }) => Some(frame),
        FrameEvent::Begin(_) => None,
    }
}

impl Far for End {
    async fn serve(mut self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            tokio::select! {
                pose = self.link.latest_rx.latest() => match pose {
                    Ok(pose) => self.link.latest_tx.publish(pose)?,
                    Err(_) => break,
                },
                event = self.link.frames_rx.recv() => match event.map(ended) {
                    Ok(Some(frame)) => {
                        arrivals.mark();
                        self.link.latest_tx.publish(Pose(frame.0))?;
                    }
                    Ok(None) => {}
                    Err(_) => break,
                },
            }
        }
        // Both ends close: the other one waits for it.
        let _gone_first = self.link.close(CloseReason::new(0, "all is measured")).await;
        Ok(())
    }
}

/// A link within the process whose readers poll instead of sleeping.
pub(crate) struct Polled(Linked);

impl Polled {
    pub(crate) fn new() -> Result<Self> {
        Linked::inproc().map(Self)
    }
}

pub(crate) struct PolledEnd(End);

impl Subject for Polled {
    type Near = PolledEnd;
    type Far = PolledEnd;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<PolledEnd> {
        self.0.near(whereabouts).await.map(PolledEnd)
    }

    async fn far(&self, whereabouts: &str) -> Result<PolledEnd> {
        self.0.far(whereabouts).await.map(PolledEnd)
    }
}

impl Near for PolledEnd {
    async fn pose(&mut self, number: u32) -> Result<()> {
        self.0.pose(number).await
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.0.frame(number).await
    }

    async fn answer(&mut self) -> Result<u32> {
        loop {
            if let Some(pose) = self.0.link.latest_rx.try_latest()? {
                return Ok(pose.0);
            }
            std::hint::spin_loop();
        }
    }

    async fn close(self) -> Result<()> {
        self.0.close().await
    }
}

impl Far for PolledEnd {
    async fn serve(self, arrivals: Arc<Arrivals>) -> Result<()> {
        let mut link = self.0.link;
        loop {
            match link.latest_rx.try_latest() {
                Ok(Some(pose)) => link.latest_tx.publish(pose)?,
                Ok(None) => {}
                Err(_) => break,
            }
            match link.frames_rx.try_recv() {
                Ok(Some(event)) => {
                    if let Some(frame) = ended(event) {
                        arrivals.mark();
                        link.latest_tx.publish(Pose(frame.0))?;
                    }
                }
                Ok(None) => std::hint::spin_loop(),
                Err(_) => break,
            }
        }
        let _gone_first = link.close(CloseReason::new(0, "all is measured")).await;
        Ok(())
    }
}
