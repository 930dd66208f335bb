//! QUIC (quinn) with this project's repair on top: a frame is cut into shards, each of them a QUIC datagram,
//! with Reed-Solomon shards by the product's budget. The receiver asks for the shards that repair cannot
//! replace.
//!
//! quinn has the settings that were fastest: acknowledgements at once (the extension for their frequency), a
//! first window of 32 packets, MTU discovery, and either CUBIC, BBR or a controller of our own.

use std::future::poll_fn;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use anyhow::{Context, Result};
use bytes::Bytes;
use quinn::congestion::{BbrConfig, CubicConfig};
use quinn::{AckFrequencyConfig, Connection, ConnectionError, TransportConfig, VarInt};
use trimaran_net::{Instant, Net, until};

use super::{Rival, RunFuture, tls};
use crate::meter::{Beat, DEADLINE, Ends, frame_bytes};

mod receiving;
mod sending;
mod steady;
mod wire;

use receiving::Receiving;
use sending::Sending;

const PORT: u16 = 7400;
/// The window at first, which has room for a frame and its repair.
pub(super) const FIRST_WINDOW: u64 = 32 * 1452;
/// The bytes that may wait in quinn: several frames.
const BUFFER: usize = 1 << 20;

/// The most that quinn counts of an empty buffer.
const EMPTY: usize = 64;

/// The congestion control under the rival.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Control {
    Cubic,
    Bbr,
    /// Random losses leave the window alone, as in `trimaran-udp`.
    Steady,
}

/// The rival with one congestion control.
#[derive(Debug, Clone, Copy)]
pub(crate) struct QuicRepair {
    name: &'static str,
    control: Control,
    /// After this time nothing of a frame is sent again.
    deadline: Option<Duration>,
}

/// All variants.
pub(super) const ALL: &[QuicRepair] = &[
    QuicRepair { name: "quinn + repair, CUBIC", control: Control::Cubic, deadline: None },
    QuicRepair { name: "quinn + repair, BBR", control: Control::Bbr, deadline: None },
    QuicRepair { name: "quinn + repair, own control", control: Control::Steady, deadline: None },
    QuicRepair {
        name: "quinn + repair, own control, deadline",
        control: Control::Steady,
        deadline: Some(DEADLINE),
    },
];

/// quinn's settings.
pub(super) fn transport(control: Control) -> Arc<TransportConfig> {
    let mut config = TransportConfig::default();
    let mut acks = AckFrequencyConfig::default();
    // At least one acknowledgement in two packets, and none later than a millisecond.
    acks.ack_eliciting_threshold(VarInt::from_u32(1)).max_ack_delay(Some(Duration::from_millis(1)));
    config
        .ack_frequency_config(Some(acks))
        .datagram_send_buffer_size(BUFFER)
        .datagram_receive_buffer_size(Some(BUFFER))
        .send_fairness(false);
    match control {
        Control::Cubic => {
            let mut cubic = CubicConfig::default();
            cubic.initial_window(FIRST_WINDOW);
            config.congestion_controller_factory(Arc::new(cubic));
        }
        Control::Bbr => {
            let mut bbr = BbrConfig::default();
            bbr.initial_window(FIRST_WINDOW);
            config.congestion_controller_factory(Arc::new(bbr));
        }
        Control::Steady => {
            config.congestion_controller_factory(Arc::new(steady::SteadyConfig));
        }
    }
    Arc::new(config)
}

/// Connects the receiver to the sender; returns the sender's connection and the receiver's.
pub(super) async fn connect(ends: &Ends, control: Control) -> Result<[(Connection, quinn::Endpoint); 2]> {
    let (server, client) = tls::pair(&transport(control))?;
    let listening = trimaran_net::quinn::server(&ends.sender, server, ([0, 0, 0, 0], PORT).into())?;
    let mut endpoint = trimaran_net::quinn::client(&ends.receiver, ([0, 0, 0, 0], 0).into())?;
    endpoint.set_default_client_config(client);
    let to = ends.receiver.resolve(&format!("{}:{PORT}", ends.host)).await?;
    let to = *to.first().context("no address")?;
    let (here, there) =
        tokio::join!(async { anyhow::Ok(listening.accept().await.context("closed")?.await?) }, async {
            anyhow::Ok(endpoint.connect(to, tls::NAME)?.await?)
        },);
    Ok([(here?, listening), (there?, endpoint)])
}

impl Rival for QuicRepair {
    fn name(&self) -> &'static str {
        self.name
    }

    fn run(&self, ends: Ends) -> RunFuture {
        let own = *self;
        Box::pin(async move {
            let [(here, _listening), (there, endpoint)] = connect(&ends, own.control).await?;
            ends.receiver.spawn(Box::pin(receive(there, endpoint, ends.clone(), own.deadline)));
            // As with links, the first frame follows the answer.
            let beat = ends.beat();
            send(&here, &ends, beat, own.deadline).await
        })
    }
}

/// Sends all frames, and what the receiver asks for.
async fn send(
    connection: &Connection,
    ends: &Ends,
    mut beat: Beat,
    deadline: Option<Duration>,
) -> Result<()> {
    let net = &*ends.sender;
    let mut sending = Sending::new(deadline);
    let (mut last, mut out) = (None, Vec::new());
    loop {
        while let Some(number) = beat.due().filter(|due| *due <= net.now()).map(|_| beat.take()) {
            ends.meter.begin(net.now());
            sending.frame(net.now(), number, frame_bytes(number), &connection.stats().path, &mut out);
        }
        for datagram in out.drain(..) {
            connection.send_datagram(datagram)?;
        }
        if beat.due().is_none() {
            let last = *last.get_or_insert_with(|| net.now().after(Duration::from_secs(5)));
            if ends.meter.count() == ends.frames as usize || net.now() > last {
                return Ok(());
            }
        }
        let soon = net.now().after(Duration::from_millis(50));
        let wake = [beat.due(), sending.wake()].into_iter().flatten().fold(soon, Ord::min);
        let came = datagram(net, connection, wake).await;
        // Nothing is sent again while quinn has not sent all of it once.
        let is_sent = connection.datagram_send_buffer_space() + EMPTY >= BUFFER;
        match came {
            Some(status) => sending.status(net.now(), &status?, connection.rtt(), is_sent, &mut out),
            None => sending.on_time(net.now(), connection.rtt(), is_sent, &mut out),
        }
    }
}

/// The next datagram, if one comes by then. One that is there needs no timer.
async fn datagram(
    net: &dyn Net,
    connection: &Connection,
    by: Instant,
) -> Option<Result<Bytes, ConnectionError>> {
    let mut next = pin!(connection.read_datagram());
    match poll_fn(|cx| Poll::Ready(next.as_mut().poll(cx))).await {
        Poll::Ready(came) => Some(came),
        Poll::Pending => until(net, by, next).await,
    }
}

/// Receives frames until the connection ends.
async fn receive(connection: Connection, _endpoint: quinn::Endpoint, ends: Ends, deadline: Option<Duration>) {
    let net: &dyn Net = &*ends.receiver;
    let mut receiving = Receiving::new(deadline);
    loop {
        let idle = net.now().after(Duration::from_secs(1));
        let wake = receiving.wake().unwrap_or(idle).min(idle);
        match datagram(net, &connection, wake).await {
            Some(Ok(datagram)) => receiving.shard(net.now(), datagram, connection.rtt()),
            Some(Err(_)) => return,
            None => {}
        }
        receiving.on_time(net.now(), connection.rtt());
        for (number, complete) in receiving.done.drain(..) {
            ends.meter.came(number, net.now(), complete);
        }
        if let Some(status) = receiving.status()
            && connection.send_datagram(status).is_err()
        {
            return;
        }
    }
}
