//! SRT, a protocol of video, by the crate `srt-protocol`.
//!
//! By itself it delivers everything after the same delay. Here it has none, and gives nothing up, which is
//! its fastest setting. Its handshake, which takes two round trips, is left out, and so is its encryption.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use bytes::{Bytes, BytesMut};
use srt_protocol::connection::{Action, Connection, ConnectionSettings, DuplexConnection, Input};
use srt_protocol::options::{LiveBandwidthMode, PacketCount, PacketSize};
use srt_protocol::packet::{Packet, SeqNumber, SocketId};
use srt_protocol::protocol::handshake::Handshake;

use super::{Rival, RunFuture, driver};
use crate::meter::Ends;

/// The payload of the largest datagram over Ethernet, behind SRT's header.
const PAYLOAD: PacketSize = PacketSize(1456);
/// Packets in buffers and in flight.
const PACKETS: PacketCount = PacketCount(8192);
/// The first number of either direction.
const FIRST: SeqNumber = SeqNumber(1);
const LONG: Duration = Duration::from_secs(3600);

/// The rival.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SrtRival;

impl Rival for SrtRival {
    fn name(&self) -> &'static str {
        "SRT, no delay"
    }

    fn run(&self, ends: Ends) -> RunFuture {
        let origin = origin();
        driver::run(ends, move |[sender, receiver]| {
            let ids = [SocketId(1), SocketId(2)];
            let [ours, theirs] = ids;
            Ok([Machine::new(origin, receiver, [ours, theirs]), Machine::new(origin, sender, [theirs, ours])])
        })
    }
}

#[allow(clippy::disallowed_methods, reason = "a fixed point that the time of the network is counted from")]
fn origin() -> Instant {
    Instant::now()
}

struct Machine {
    connection: DuplexConnection,
    origin: Instant,
    peer: SocketAddr,
    /// When it wants to be called.
    wake: Duration,
    /// Data that has come, or is to be sent.
    inputs: Vec<Input>,
}

impl Machine {
    fn new(origin: Instant, peer: SocketAddr, [own, other]: [SocketId; 2]) -> Self {
        let settings = ConnectionSettings {
            remote: peer,
            remote_sockid: other,
            local_sockid: own,
            socket_start_time: origin,
            rtt: Duration::from_millis(10),
            init_seq_num: FIRST,
            max_packet_size: PAYLOAD,
            max_flow_size: PACKETS,
            send_tsbpd_latency: Duration::ZERO,
            recv_tsbpd_latency: Duration::ZERO,
            too_late_packet_drop: false,
            peer_idle_timeout: Duration::from_secs(10),
            recv_buffer_size: PACKETS,
            send_buffer_size: PACKETS,
            cipher: None,
            stream_id: None,
            bandwidth: LiveBandwidthMode::Unlimited,
            statistics_interval: LONG,
        };
        let connection = DuplexConnection::new(Connection { settings, handshake: Handshake::Connector });
        Self { connection, origin, peer, wake: Duration::ZERO, inputs: Vec::new() }
    }
}

impl driver::Machine for Machine {
    fn send(&mut self, now: Duration, frame: Vec<u8>) {
        self.inputs.push(Input::Data(Some((self.origin + now, Bytes::from(frame)))));
    }

    fn input(&mut self, _now: Duration, datagram: &[u8]) {
        let mut datagram = datagram;
        let packet = Packet::parse(&mut datagram, false);
        self.inputs.push(Input::Packet(packet.map(|packet| (packet, self.peer)).map_err(Into::into)));
    }

    fn advance(&mut self, now: Duration, out: &mut Vec<Vec<u8>>, frames: &mut Vec<Vec<u8>>) {
        let time = self.origin + now;
        let mut inputs = self.inputs.drain(..);
        let mut input = inputs.next().unwrap_or(Input::Timer);
        loop {
            input = match self.connection.handle_input(time, input) {
                Action::SendPacket((packet, _)) => {
                    let mut bytes = BytesMut::new();
                    packet.serialize(&mut bytes);
                    out.push(bytes.to_vec());
                    Input::PacketSent
                }
                Action::ReleaseData((_, frame)) => {
                    frames.push(frame.to_vec());
                    Input::DataReleased
                }
                Action::UpdateStatistics(_) => Input::StatisticsUpdated,
                Action::WaitForData(wait) => {
                    self.wake = now + wait.max(Duration::from_micros(100));
                    match inputs.next() {
                        Some(input) => input,
                        None => return,
                    }
                }
                Action::Close => return,
            };
        }
    }

    fn wake(&self, _now: Duration) -> Duration {
        self.wake
    }
}
