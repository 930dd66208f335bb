//! Zenoh between two peers over TCP. It has sockets, threads and a clock of its own, so it runs over loopback
//! alone.

use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use anyhow::anyhow;
use trimaran_net::sleep_until;
use zenoh::handlers::FifoChannelHandler;
use zenoh::pubsub::Subscriber;
use zenoh::qos::CongestionControl;
use zenoh::sample::Sample;

use super::{Rival, RunFuture};
use crate::meter::{Ends, frame_bytes, frame_number};

#[path = "../../../src/subject/zenoh/config.rs"]
mod config;

const KEY: &str = "frame";

/// The rival.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ZenohRival;

impl Rival for ZenohRival {
    fn name(&self) -> &'static str {
        "zenoh over TCP"
    }

    fn has_own_sockets(&self) -> bool {
        true
    }

    fn run(&self, ends: Ends) -> RunFuture {
        Box::pin(async move {
            let free = TcpListener::bind("127.0.0.1:0")?.local_addr()?.to_string();
            let open = async |key| zenoh::open(config::config(key, &free)?).await.map_err(|e| anyhow!(e));
            let (sender, receiver) = (open("listen/endpoints").await?, open("connect/endpoints").await?);
            let publisher = sender.declare_publisher(KEY).express(true);
            let publisher = publisher.congestion_control(CongestionControl::Block).await;
            let publisher = publisher.map_err(|e| anyhow!(e))?;
            let subscriber = receiver.declare_subscriber(KEY).await.map_err(|e| anyhow!(e))?;
            while !publisher.matching_status().await.map_err(|e| anyhow!(e))?.matching() {
                sleep_until(&*ends.sender, ends.sender.now().after(Duration::from_millis(10))).await;
            }
            ends.receiver.spawn(Box::pin(receive(subscriber, ends.clone())));
            let mut beat = ends.beat();
            while let Some(due) = beat.due() {
                sleep_until(&*ends.sender, due).await;
                let number = beat.take();
                ends.meter.begin(ends.sender.now());
                publisher.put(frame_bytes(number)).await.map_err(|e| anyhow!(e))?;
            }
            ends.finish().await;
            for session in [receiver, sender] {
                session.close().await.map_err(|e| anyhow!(e))?;
            }
            Ok(())
        })
    }
}

async fn receive(subscriber: Subscriber<FifoChannelHandler<Sample>>, ends: Ends) {
    let net = Arc::clone(&ends.receiver);
    while let Ok(sample) = subscriber.recv_async().await {
        if let Some(number) = frame_number(&sample.payload().to_bytes()) {
            ends.meter.came(number, net.now(), true);
        }
    }
}
