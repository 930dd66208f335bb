//! QUIC (quinn), a stream for each frame as the product's `quic`, but with the settings of the rival with
//! repair: unordered reads, acknowledgements at once, and a controller that leaves the window alone where
//! losses are random. Only QUIC itself sends lost data again.

use std::sync::Arc;

use quinn::{Connection, RecvStream};
use trimaran_net::sleep_until;

use super::quic_repair::{Control, connect};
use super::{Rival, RunFuture};
use crate::meter::{Ends, frame_bytes, frame_number};

/// The rival.
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuicStreams;

impl Rival for QuicStreams {
    fn name(&self) -> &'static str {
        "quinn streams, own control"
    }

    fn run(&self, ends: Ends) -> RunFuture {
        Box::pin(async move {
            let [(here, _listening), (there, endpoint)] = connect(&ends, Control::Steady).await?;
            ends.receiver.spawn(Box::pin(receive(there, endpoint, ends.clone())));
            let mut beat = ends.beat();
            while let Some(due) = beat.due() {
                sleep_until(&*ends.sender, due).await;
                let number = beat.take();
                ends.meter.begin(ends.sender.now());
                let mut stream = here.open_uni().await?;
                stream.set_priority(-i32::try_from(number)?)?;
                stream.write_all(&frame_bytes(number)).await?;
                stream.finish()?;
            }
            ends.finish().await;
            Ok(())
        })
    }
}

async fn receive(connection: Connection, _endpoint: quinn::Endpoint, ends: Ends) {
    while let Ok(stream) = connection.accept_uni().await {
        let net = Arc::clone(&ends.receiver);
        let ends = ends.clone();
        net.spawn(Box::pin(async move {
            if let Some(number) = frame(stream).await {
                ends.meter.came(number, ends.receiver.now(), true);
            }
        }));
    }
}

/// Reads a frame in whatever order its bytes come.
async fn frame(mut stream: RecvStream) -> Option<u32> {
    let mut bytes = Vec::new();
    while let Some(chunk) = stream.read_chunk(usize::MAX, false).await.ok()? {
        let from = usize::try_from(chunk.offset).ok()?;
        let to = from + chunk.bytes.len();
        bytes.resize(bytes.len().max(to), 0);
        bytes.get_mut(from..to)?.copy_from_slice(&chunk.bytes);
    }
    frame_number(&bytes)
}
