//! The baseline of links over UDP: one socket a side, frames in datagrams of 1,200 bytes, no
//! acknowledgements, no repair.

use std::sync::{Arc, mpsc};

use anyhow::{Context, Result};
use tokio::net::UdpSocket;

use super::{POSE, pose, frame, number};
use crate::measure::{Arrivals, Far, Near, Subject};

/// Bytes of a frame in a datagram, behind the numbers of the frame and of the datagram.
const PART: usize = 1192;
/// In place of a datagram's number: a pose; the last of a frame; the end.
const SINGLE: u32 = u32::MAX;
const LAST: u32 = u32::MAX - 1;
const END: u32 = u32::MAX - 2;

/// UDP sockets.
pub(crate) struct Bare;

pub(crate) struct End {
    socket: UdpSocket,
    points: Vec<u8>,
    datagram: Vec<u8>,
}

impl End {
    fn new(socket: UdpSocket) -> Self {
        Self { socket, points: frame(0), datagram: Vec::new() }
    }

    async fn send(&mut self, number: u32, part: u32, payload: &[u8]) -> Result<()> {
        self.datagram.clear();
        self.datagram.extend(number.to_le_bytes());
        self.datagram.extend(part.to_le_bytes());
        self.datagram.extend(payload);
        self.socket.send(&self.datagram).await?;
        Ok(())
    }

    /// The next datagram's frame and part.
    async fn receive(&mut self) -> Result<(u32, u32)> {
        let mut bytes = [0; 1500];
        let length = self.socket.recv(&mut bytes).await?;
        let bytes = bytes.get(..length).context("too long")?;
        Ok((number(bytes)?, number(bytes.get(4..).context("too short")?)?))
    }
}

impl Subject for Bare {
    type Near = End;
    type Far = End;

    async fn near(&self, whereabouts: mpsc::Sender<String>) -> Result<End> {
        let socket = UdpSocket::bind("127.0.0.1:0").await?;
        whereabouts.send(socket.local_addr()?.to_string())?;
        let (_, from) = socket.recv_from(&mut [0; 8]).await?;
        socket.connect(from).await?;
        Ok(End::new(socket))
    }

    async fn far(&self, whereabouts: &str) -> Result<End> {
        let socket = UdpSocket::bind("127.0.0.1:0").await?;
        socket.connect(whereabouts).await?;
        socket.send(b"hello").await?;
        Ok(End::new(socket))
    }
}

impl Near for End {
    async fn pose(&mut self, number: u32) -> Result<()> {
        self.send(number, SINGLE, &pose(number)[..POSE - 8]).await
    }

    async fn frame(&mut self, number: u32) -> Result<()> {
        let points = std::mem::take(&mut self.points);
        let count = points.len().div_ceil(PART);
        for (part, bytes) in points.chunks(PART).enumerate() {
            self.send(number, if part + 1 == count { LAST } else { part as u32 }, bytes).await?;
        }
        self.points = points;
        Ok(())
    }

    async fn answer(&mut self) -> Result<u32> {
        Ok(self.receive().await?.0)
    }

    async fn close(mut self) -> Result<()> {
        self.send(0, END, &[]).await
    }
}

impl Far for End {
    async fn serve(mut self, arrivals: Arc<Arrivals>) -> Result<()> {
        loop {
            let (number, part) = self.receive().await?;
            match part {
                END => return Ok(()),
                SINGLE => self.pose(number).await?,
                LAST => {
                    arrivals.mark();
                    self.pose(number).await?;
                }
                _ => {}
            }
        }
    }
}
