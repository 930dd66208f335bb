//! The links of this project.

use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use trimaran_net::{Net, sleep_until};
use trimaran_transport::conformance::{ARM, PANEL, Robot, greeting, points, start};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::udp::{Trust, UdpOptions};
use trimaran_transport::{Endpoint, FrameEvent, FrameOutcome, Link, Listener, Options, connect};

use super::{Rival, RunFuture};
use crate::meter::{Ends, POINTS};

const PORT: u16 = 7400;

/// A kind of link.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OwnLink {
    name: &'static str,
    scheme: &'static str,
    query: &'static str,
    repair_percent: u8,
}

/// All kinds.
pub(super) const ALL: &[OwnLink] = &[
    OwnLink { name: "tcp", scheme: "tcp", query: "", repair_percent: 0 },
    OwnLink { name: "quic", scheme: "quic", query: "", repair_percent: 0 },
    OwnLink { name: "udp reliable", scheme: "udp", query: "?mode=reliable", repair_percent: 0 },
    OwnLink { name: "udp, repair", scheme: "udp", query: "?mode=reliable", repair_percent: 15 },
    OwnLink { name: "udp deadline, repair", scheme: "udp", query: "?mode=deadline", repair_percent: 15 },
];

impl OwnLink {
    fn endpoint(&self, host: &str) -> Result<Endpoint> {
        Ok(format!("{}://{host}:{PORT}{}", self.scheme, self.query).parse()?)
    }

    fn options(&self) -> Result<[Options; 2]> {
        let (a, b) = (Keys::generate("sender".parse()?)?, Keys::generate("receiver".parse()?)?);
        let udp = UdpOptions::default().with_trust(Trust::Keys).with_repair_percent(self.repair_percent);
        let with = |own: &Keys, peer: &Keys| {
            let security = Security { keys: own.clone(), peers: vec![peer.public().clone().into()].into() };
            Options::default().with_security(security).with_udp(udp.clone())
        };
        Ok([with(&a, &b), with(&b, &a)])
    }
}

impl Rival for OwnLink {
    fn name(&self) -> &'static str {
        self.name
    }

    fn run(&self, ends: Ends) -> RunFuture {
        let own = *self;
        Box::pin(async move {
            let [ours, theirs] = own.options()?;
            let anywhere = own.endpoint("0.0.0.0")?;
            let mut listener = Listener::bind(&ends.sender, &anywhere, greeting(ARM), &ours).await?;
            let soon = ends.sender.now().after(Duration::from_secs(30));
            let at = own.endpoint(ends.host)?;
            let (here, there) = tokio::join!(
                listener.accept(soon),
                connect::<Robot>(&ends.receiver, &at, greeting(PANEL), &theirs, soon),
            );
            let (mut link, far): (Link<Robot>, _) = (here?, there.context("connecting")?);
            ends.receiver.spawn(Box::pin(receive(far, ends.clone())));
            let (points, mut beat) = (points(POINTS), ends.beat());
            while let Some(due) = beat.due() {
                sleep_until(&*ends.sender, due).await;
                let number = beat.take();
                ends.meter.begin(ends.sender.now());
                link.frames_tx.begin(start(number)).await?;
                link.frames_tx.push(&points).await?;
                link.frames_tx.finish().await?;
            }
            ends.finish().await;
            Ok(())
        })
    }
}

async fn receive(mut link: Link<Robot>, ends: Ends) {
    let net: Arc<dyn Net> = Arc::clone(&ends.receiver);
    let mut number = 0;
    while let Ok(event) = link.frames_rx.recv().await {
        let FrameEvent::End(outcome) = event else { continue };
        ends.meter.came(number, net.now(), matches!(outcome, FrameOutcome::Complete(_)));
        number += 1;
    }
}
