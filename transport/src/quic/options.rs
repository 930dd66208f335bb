//! Options of QUIC connections.

use std::sync::Arc;
use std::time::Duration;

use quinn::congestion::{BbrConfig, CubicConfig, NewRenoConfig};
use quinn::{AckFrequencyConfig, IdleTimeout, MtuDiscoveryConfig, TransportConfig, VarInt};
use trimaran_wire::Format;

use super::congestion::LossTolerantConfig;
use super::datagrams;
use crate::{LinkConfig, UdpSocketOptions};

/// How many values of the latest lane may wait for their reader; the oldest are dropped first.
const VALUES: usize = 16;
/// How many lanes may each have a whole window in flight.
const LANES: u32 = 4;
/// The streams in both directions beside those of channels: control, messages, bulk.
const STREAMS: u32 = 3;
/// The window at first, bytes: 20 packets, so that a first frame of 16 kB need not wait for a round trip.
const FIRST_WINDOW: u64 = 20 * 1452;
/// The peer acknowledges each second packet at once, and any within this time.
const ACK_DELAY: Duration = Duration::from_millis(1);

/// Options of QUIC connections.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct QuicOptions {
    /// The congestion control. Default loss-tolerant.
    pub congestion: Congestion,
    /// The round trip assumed before it is measured: a third of the pause after which first packets are sent
    /// again. Default 100 ms.
    #[cfg_attr(
        feature = "config",
        serde(rename = "initial_rtt_s", with = "trimaran_net::config::seconds"),
        schemars(with = "f64")
    )]
    pub initial_rtt: Duration,
    /// How many bytes of a frame may be in flight in each direction, sent and not read, and as many of
    /// messages and of blocks; four times as many on all lanes together. Default 8 MiB.
    pub window: u32,
    /// How many frames may be in flight in each direction. Default 64.
    pub frames: u32,
    /// Hands the system several packets at once (GSO) where it can segment them. A loss may then take
    /// several. Default true.
    pub segmentation: bool,
    /// Probes for the largest packets that the path carries. Default true.
    pub mtu_discovery: bool,
    /// The UDP socket.
    pub socket: UdpSocketOptions,
}

impl QuicOptions {
    trimaran_net::setters! {
        with_congestion congestion: Congestion,
        with_initial_rtt initial_rtt: Duration,
        with_window window: u32,
        with_frames frames: u32,
        with_segmentation segmentation: bool,
        with_mtu_discovery mtu_discovery: bool,
        with_socket socket: UdpSocketOptions,
    }
}

/// The congestion control of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "config", derive(serde::Serialize, serde::Deserialize, schemars::JsonSchema))]
#[cfg_attr(feature = "config", serde(rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum Congestion {
    /// CUBIC that leaves the window alone at random losses, as `udp` does.
    #[default]
    LossTolerant,
    /// CUBIC (RFC 9438), as in most TCP.
    Cubic,
    /// BBR: based on measured bandwidth rather than on loss. Experimental in quinn.
    Bbr,
    /// New Reno (RFC 9002, section 7).
    NewReno,
}

impl Default for QuicOptions {
    fn default() -> Self {
        Self {
            congestion: Congestion::default(),
            initial_rtt: Duration::from_millis(100),
            window: 8 << 20,
            frames: 64,
            segmentation: true,
            mtu_discovery: true,
            socket: UdpSocketOptions::default(),
        }
    }
}

impl QuicOptions {
    pub(crate) fn transport(&self, link: &LinkConfig, format: &Format) -> Arc<TransportConfig> {
        // Room for the one waiting value of each lane: the next one replaces it. quinn adds 32 bytes of its
        // own a datagram.
        let datagram: usize = datagrams::sizes(format).map(|bytes| bytes + size_of::<bytes::Bytes>()).sum();
        let channels = format.channels.len() as u32;
        let mut config = TransportConfig::default();
        // A hundred years of silence are long enough.
        let idle = IdleTimeout::try_from(link.idle_timeout).ok();
        config
            .max_idle_timeout(idle)
            .keep_alive_interval(Some(link.idle_timeout / 4))
            .initial_rtt(self.initial_rtt)
            .stream_receive_window(VarInt::from_u32(self.window))
            // Unread frames, messages and blocks, or those in flight, leave room for the others.
            .receive_window(VarInt::from_u32(self.window.saturating_mul(LANES + channels)))
            .send_window(u64::from(LANES + channels) * u64::from(self.window))
            .max_concurrent_bidi_streams(VarInt::from_u32(STREAMS + channels))
            .max_concurrent_uni_streams(VarInt::from_u32(self.frames))
            .datagram_send_buffer_size(datagram)
            .datagram_receive_buffer_size(Some(datagram * VALUES))
            .enable_segmentation_offload(self.segmentation)
            .mtu_discovery_config(self.mtu_discovery.then(MtuDiscoveryConfig::default));
        let mut acks = AckFrequencyConfig::default();
        acks.ack_eliciting_threshold(VarInt::from_u32(1)).max_ack_delay(Some(ACK_DELAY));
        config.ack_frequency_config(Some(acks));
        let mut cubic = CubicConfig::default();
        cubic.initial_window(FIRST_WINDOW);
        match self.congestion {
            Congestion::LossTolerant => {
                config.congestion_controller_factory(Arc::new(LossTolerantConfig(Arc::new(cubic))))
            }
            Congestion::Cubic => config.congestion_controller_factory(Arc::new(cubic)),
            Congestion::Bbr => {
                let mut bbr = BbrConfig::default();
                bbr.initial_window(FIRST_WINDOW);
                config.congestion_controller_factory(Arc::new(bbr))
            }
            Congestion::NewReno => {
                let mut reno = NewRenoConfig::default();
                reno.initial_window(FIRST_WINDOW);
                config.congestion_controller_factory(Arc::new(reno))
            }
        };
        Arc::new(config)
    }
}

#[cfg(test)]
mod tests {
    use std::pin::pin;
    use std::task::{Context, Poll, Waker};

    use quinn::congestion::{Bbr, Cubic, NewReno};
    use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
    use quinn::{ClientConfig, Connection, Endpoint, SendStream, ServerConfig};
    use trimaran_wire::{Format, Protocol, ProtocolName};

    use super::*;
    use crate::TokioNet;
    use crate::conformance::Robot;
    use crate::keys::Keys;
    use crate::quic::congestion::LossTolerant;
    use crate::quic::connect::endpoint;
    use crate::quic::tls::{self, Verifier};
    use trimaran_net::{Net, sleep_until};

    /// A connection from an end with `ours` to one with `theirs`; the endpoints keep it alive.
    async fn connected(
        ours: QuicOptions,
        theirs: QuicOptions,
        link: LinkConfig,
    ) -> [(Connection, Endpoint); 2] {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let [a, b] = ["a", "b"].map(|name| Keys::generate(name.parse().unwrap()).unwrap());
        let protocol = ProtocolName::new(Robot::NAME);
        let crypto = tls::server(&b, &Verifier::new(&[a.public().clone().into()]), &protocol).unwrap();
        let mut server = ServerConfig::with_crypto(Arc::new(QuicServerConfig::try_from(crypto).unwrap()));
        server.transport_config(theirs.transport(&link, &Format::of::<Robot>()));
        let crypto = tls::client(&a, &Verifier::new(&[b.public().clone().into()]), &protocol).unwrap();
        let mut client = ClientConfig::new(Arc::new(QuicClientConfig::try_from(crypto).unwrap()));
        client.transport_config(ours.transport(&link, &Format::of::<Robot>()));
        let loopback = "127.0.0.1:0".parse().unwrap();
        let (there, at) =
            endpoint(&net, net.bind_udp(loopback, theirs.socket).unwrap(), Some((server, b.quic().unwrap())))
                .unwrap();
        let (here, _) = endpoint(&net, net.bind_udp(loopback, ours.socket).unwrap(), None).unwrap();
        let (ours, theirs) = tokio::join!(here.connect_with(client, at, "trimaran").unwrap(), async {
            there.accept().await.unwrap().await
        });
        [(ours.unwrap(), here), (theirs.unwrap(), there)]
    }

    /// The output of `future` if it needs no waiting.
    fn at_once<F: Future>(future: F) -> Option<F::Output> {
        match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(output) => Some(output),
            Poll::Pending => None,
        }
    }

    /// How many bytes a stream takes without waiting.
    fn fill(stream: &mut SendStream) -> usize {
        std::iter::from_fn(|| at_once(stream.write(&[7; 1000]))).map(Result::unwrap).sum()
    }

    /// How many bytes streams take in all without a reader: as many as the peer allows, once everything has
    /// arrived.
    async fn fill_all(streams: &mut [SendStream]) -> usize {
        let net = TokioNet::current().unwrap();
        let (mut all, mut idle) = (0, 0);
        while idle < 20 {
            let more: usize = streams.iter_mut().map(fill).sum();
            all += more;
            idle = if more > 0 { 0 } else { idle + 1 };
            sleep_until(&net, net.now().after(Duration::from_millis(10))).await;
        }
        all
    }

    #[tokio::test]
    async fn both_ends_have_the_congestion_control_that_was_asked_for() {
        let all = [Congestion::LossTolerant, Congestion::Cubic, Congestion::Bbr, Congestion::NewReno];
        for congestion in all {
            let options = QuicOptions { congestion, ..QuicOptions::default() };
            for (connection, _) in connected(options, options, LinkConfig::default()).await {
                let control = connection.congestion_state().into_any();
                let found = [
                    control.is::<LossTolerant>(),
                    control.is::<Cubic>(),
                    control.is::<Bbr>(),
                    control.is::<NewReno>(),
                ];
                let asked = all.map(|it| it == congestion);
                assert_eq!(found, asked, "{congestion:?}");
            }
        }
    }

    #[tokio::test]
    async fn the_window_bounds_a_stream_all_streams_and_what_a_sender_keeps() {
        const SMALL: u32 = 20_000;
        const LARGE: u32 = 4 << 20;
        let with = |window| QuicOptions { window, ..QuicOptions::default() };
        // More than the default of one stream in quinn, and less.
        for (window, streams, all) in [(SMALL, 1, SMALL), (SMALL, 5, 4 * SMALL), (LARGE, 1, LARGE)] {
            let [(ours, _here), (_theirs, _there)] =
                connected(with(LARGE), with(window), LinkConfig::default()).await;
            let mut open = Vec::new();
            for _ in 0..streams {
                open.push(ours.open_uni().await.unwrap());
            }
            assert_eq!(fill_all(&mut open).await, all as usize, "{streams} streams");
        }
        let [(ours, _here), _there] = connected(with(SMALL), with(LARGE), LinkConfig::default()).await;
        assert_eq!(
            fill(&mut ours.open_uni().await.unwrap()),
            4 * SMALL as usize,
            "before anything was acknowledged"
        );
    }

    #[tokio::test]
    async fn as_many_frames_are_under_way_as_was_set_and_three_streams_in_both_directions() {
        for frames in [3, 100] {
            let theirs = QuicOptions { frames, ..QuicOptions::default() };
            let [(ours, _here), _there] =
                connected(QuicOptions::default(), theirs, LinkConfig::default()).await;
            let opened = std::iter::from_fn(|| at_once(ours.open_uni())).take(1000).count();
            assert_eq!(opened, frames as usize);
            assert_eq!(std::iter::from_fn(|| at_once(ours.open_bi())).take(1000).count(), 3);
        }
    }
}
