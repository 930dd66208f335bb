//! The baseline of links over TCP: one connection, each message a length and its bytes, written at once.

use std::sync::{Arc, mpsc};

use anyhow::Result;
use tokio::io::{AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::{TcpListener, TcpStream};

use super::{POSE, pose, frame, number};
use crate::measure::{Arrivals, Far, Near, Subject};

/// A TCP connection.
pub(crate) struct Bare;

pub(crate) struct End {
    stream: BufReader<TcpStream>,
    frame: Vec<u8>,
}

impl End {
    fn new(stream: TcpStream) -> Result<Self> {
        stream.set_nodelay(true)?;
        let mut bytes = frame(0);
        let length = u32::try_from(bytes.len())?;
        bytes.splice(0..0, length.to_le_bytes());
        Ok(Self { stream: BufReader::with_capacity(64 * 1024, stream), frame: bytes })
    }

    async fn send_pose(&mut self, number: u32) -> Result<()> {
        let mut bytes = [0; 4 + POSE];
        bytes[..4].copy_from_slice(&(POSE as u32).to_le_bytes());
        bytes[4..].copy_from_slice(&pose(number));
        Ok(self.stream.write_all(&bytes).await?)
    }
}

impl Subject for Bare {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let listener = TcpListener::bind("127.0.0.1:0").await?;
        whereabouts.send(listener.local_addr()?.to_string())?;
        End::new(listener.accept().await?.0)
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        End::new(TcpStream::connect(whereabouts).await?)
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        self.send_pose(number).await
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        self.frame[4..8].copy_from_slice(&number.to_le_bytes());
        Ok(self.stream.get_mut().write_all(&self.frame).await?)
    }

    async fn answer(&mut self) -> Result<u32> {
        let mut bytes = [0; 4 + POSE];
        self.stream.read_exact(&mut bytes).await?;
        number(&bytes[4..])
    }

    async fn close(mut self) -> Result<()> {
        Ok(self.stream.shutdown().await?)
    }
}

impl Far for End {
    async fn serve(mut self, arrivals: Arc<Arrivals>) -> Result<()> {
        let mut bytes = Vec::new();
        while let Ok(length) = self.stream.read_u32_le().await {
            bytes.resize(length as usize, 0);
            self.stream.read_exact(&mut bytes).await?;
            if bytes.len() > POSE {
                arrivals.mark();
            }
            self.send_pose(number(&bytes)?).await?;
        }
        Ok(())
    }
}
