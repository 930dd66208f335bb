//! All rivals: one file each.

use std::pin::Pin;

use anyhow::Result;

use crate::meter::Ends;

mod budget;
mod driver;
mod enet;
mod kcp;
mod link;
mod quic_repair;
mod quic_streams;
mod srt;
mod tls;
mod zenoh;

/// A run of both ends.
pub(crate) type RunFuture = Pin<Box<dyn Future<Output = Result<()>>>>;

/// A way to send frames.
pub(crate) trait Rival: Send + Sync {
    /// Its name in tables.
    fn name(&self) -> &'static str;

    /// Whether it takes the kernel's sockets and clock: then it runs over loopback alone.
    fn has_own_sockets(&self) -> bool {
        false
    }

    /// Connects both ends, and sends all frames.
    fn run(&self, ends: Ends) -> RunFuture;
}

/// All of them, in the order of the table.
pub(crate) fn all() -> Vec<Box<dyn Rival>> {
    let mut all: Vec<Box<dyn Rival>> = Vec::new();
    all.extend(link::ALL.iter().map(|link| Box::new(*link) as Box<dyn Rival>));
    all.extend(quic_repair::ALL.iter().map(|quic| Box::new(*quic) as Box<dyn Rival>));
    all.push(Box::new(quic_streams::QuicStreams));
    all.push(Box::new(kcp::KcpRival));
    all.push(Box::new(enet::EnetRival));
    all.push(Box::new(srt::SrtRival));
    all.push(Box::new(zenoh::ZenohRival));
    all
}
