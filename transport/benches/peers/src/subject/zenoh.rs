//! Zenoh between two peers over TCP: poses, frames and answers each have a key, and nothing is held back for
//! batching.

use std::net::TcpListener;
use std::sync::{Arc, mpsc};

use anyhow::{Result, anyhow};
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;
use zenoh::{Config, Session};

use super::{frame, number, pose};
use crate::measure::{Arrivals, Far, Near, Subject};
use config::config;

mod config;

/// Two zenoh sessions.
pub(crate) struct Zenoh;

pub(crate) struct End {
    session: Session,
    poses: Publisher<'static>,
    frames: Publisher<'static>,
    received: Subscriber<FifoChannelHandler<Sample>>,
    frame: Vec<u8>,
}

impl End {
    async fn open(config: Config, sends: &'static str, receives: &'static str) -> Result<Self> {
        let session = zenoh::open(config).await.map_err(|e| anyhow!(e))?;
        let publisher = async |key: String| {
            session
                .declare_publisher(key)
                .express(true)
                .congestion_control(CongestionControl::Block)
                .await
                .map_err(|e| anyhow!(e))
        };
        let (poses, frames) =
            (publisher(format!("{sends}/pose")).await?, publisher(format!("{sends}/frame")).await?);
        let received = session.declare_subscriber(format!("{receives}/**")).await.map_err(|e| anyhow!(e))?;
        Ok(Self { session, poses, frames, received, frame: frame(0) })
    }

    /// Waits until the other end listens.
    async fn meet(&self) -> Result<()> {
        while !self.poses.matching_status().await.map_err(|e| anyhow!(e))?.matching() {
            tokio::time::sleep(std::time::Duration::from_millis(10)).await;
        }
        Ok(())
    }

    async fn receive(&self) -> Result<Sample> {
        self.received.recv_async().await.map_err(|e| anyhow!(e))
    }

    async fn send_pose(&self, number: u32) -> Result<()> {
        self.poses.put(pose(number).as_slice()).await.map_err(|e| anyhow!(e))
    }
}

impl Subject for Zenoh {
    type Near = End;
    type Far = End;
    const HAS_THREADS: bool = true;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let free = TcpListener::bind("127.0.0.1:0")?.local_addr()?.to_string();
        let end = End::open(config("listen/endpoints", &free)?, "near", "far").await?;
        whereabouts.send(free)?;
        end.meet().await?;
        Ok(end)
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        let end = End::open(config("connect/endpoints", whereabouts)?, "far", "near").await?;
        end.meet().await?;
        Ok(end)
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        self.send_pose(number).await
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.frame[..4].copy_from_slice(&number.to_le_bytes());
        self.frames.put(self.frame.as_slice()).await.map_err(|e| anyhow!(e))
    }

    async fn answer(&mut self) -> Result<u32> {
        number(&self.receive().await?.payload().to_bytes())
    }

    async fn close(self) -> Result<()> {
        self.send_pose(u32::MAX).await?;
        self.answer_to_end().await;
        self.session.close().await.map_err(|e| anyhow!(e))
    }
}

impl End {
    /// Waits until the other end has read the end.
    async fn answer_to_end(&self) {
        let _last = self.receive().await;
    }
}

impl Far for End {
    async fn serve(self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            let sample = self.receive().await?;
            let bytes = sample.payload().to_bytes();
            if bytes.len() > super::POSE {
                arrivals.mark();
            }
            let number = number(&bytes)?;
            self.send_pose(number).await?;
            if number == u32::MAX {
                return self.session.close().await.map_err(|e| anyhow!(e));
            }
        }
    }
}
