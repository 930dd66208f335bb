//! Links: cameras and answers on the latest lane, frames on the frames lane.

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

use anyhow::Result;
use trimaran_proto::{
    Camera, DrawableId, FrameEvent, FrameNumber, FrameOutcome, FrameStart, Goodbye, IdCoding, Identity, Role,
    SceneHash,
};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, Link, Listener, Net, Options, TokioNet, connect};

use crate::measure::{Arrivals, Far, IDS, Near, Subject};

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
            options.link.coding = IdCoding::Plain;
            options.security = Some(Security { keys: own.clone(), peers: vec![other.public().clone().into()] });
            options
        };
        Ok(Self { endpoint: endpoint.parse()?, near: options(&near, &far), far: options(&far, &near) })
    }
}

pub(crate) struct End {
    link: Link,
    ids: Vec<DrawableId>,
}

impl End {
    fn new(link: Link) -> Self {
        Self { link, ids: (0..IDS).map(DrawableId).collect() }
    }
}

fn identity(role: Role) -> Identity {
    Identity { role, scene: SceneHash(1), settings: None }
}

fn camera(number: u32) -> Result<Camera> {
    Ok(Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(number))?)
}

impl Subject for Linked {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let deadline = net.now().after(Duration::from_secs(10));
        let mut listener = Listener::bind(&net, &self.endpoint, identity(Role::SwitchA), &self.near).await?;
        whereabouts.send(listener.local_endpoint().to_string())?;
        Ok(End::new(listener.accept(deadline).await?))
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
        let deadline = net.now().after(Duration::from_secs(10));
        let link = connect(&net, &whereabouts.parse()?, identity(Role::Display), &self.far, deadline).await?;
        Ok(End::new(link))
    }
}

impl Near for End {
    async fn camera(&mut self, number: u32) -> Result<()> {
        Ok(self.link.latest_tx.publish(camera(number)?)?)
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        let frames = &mut self.link.frames_tx;
        frames.begin(FrameStart { frame: FrameNumber(number), camera: camera(number)? }).await?;
        frames.push(&self.ids).await?;
        frames.finish().await?;
        Ok(())
    }

    async fn answer(&mut self) -> Result<u32> {
        Ok(self.link.latest_rx.latest().await?.frame().0)
    }

    async fn close(self) -> Result<()> {
        self.link.goodbye(Goodbye::Finished).await?;
        Ok(())
    }
}

/// Looks at what a frame brought; the number of a frame that has ended.
fn ended(event: FrameEvent) -> Option<FrameNumber> {
    match event {
        FrameEvent::Ids(ids) => {
            for id in ids.iter() {
                std::hint::black_box(id);
            }
            None
        }
        FrameEvent::End(FrameOutcome::Complete(end)) => Some(end.frame),
        FrameEvent::End(FrameOutcome::Incomplete { frame, .. }) => Some(frame),
        FrameEvent::Begin(_) | FrameEvent::Stats(_) => None,
    }
}

impl Far for End {
    async fn serve(mut self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            tokio::select! {
                camera = self.link.latest_rx.latest() => match camera {
                    Ok(camera) => self.link.latest_tx.publish(camera)?,
                    Err(_) => break,
                },
                event = self.link.frames_rx.recv() => match event.map(ended) {
                    Ok(Some(frame)) => {
                        arrivals.mark();
                        self.link.latest_tx.publish(camera(frame.0)?)?;
                    }
                    Ok(None) => {}
                    Err(_) => break,
                },
            }
        }
        // Both leave: the other end waits for it.
        let _gone_first = self.link.goodbye(Goodbye::Finished).await;
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
    async fn camera(&mut self, number: u32) -> Result<()> {
        self.0.camera(number).await
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.0.frame(number).await
    }

    async fn answer(&mut self) -> Result<u32> {
        loop {
            if let Some(camera) = self.0.link.latest_rx.try_latest()? {
                return Ok(camera.frame().0);
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
                Ok(Some(camera)) => link.latest_tx.publish(camera)?,
                Ok(None) => {}
                Err(_) => break,
            }
            match link.frames_rx.try_recv() {
                Ok(Some(event)) => {
                    if let Some(frame) = ended(event) {
                        arrivals.mark();
                        link.latest_tx.publish(camera(frame.0)?)?;
                    }
                }
                Ok(None) => std::hint::spin_loop(),
                Err(_) => break,
            }
        }
        let _gone_first = link.goodbye(Goodbye::Finished).await;
        Ok(())
    }
}
