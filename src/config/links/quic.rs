//! What QUIC connections can be told.

use confique::Config;
use serde::Serialize;
use trimaran_transport::{
    UdpSocketOptions,
    quic::{Congestion, QuicOptions},
};

/// How QUIC connections are set up.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct QuicConfig {
    /// How the connection shares the way with others: `cubic`, `bbr` or `new-reno`.
    #[config(
        env = "TRIMARAN_LINK_QUIC_CONGESTION",
        default = "cubic",
        layer_attr(arg(long = "quic-congestion", id = "quic_congestion", value_name = "NAME"))
    )]
    pub congestion: Congestion,
    /// How many bytes may be under way in each direction, sent and not read.
    #[config(
        env = "TRIMARAN_LINK_QUIC_WINDOW",
        default = 8_388_608,
        layer_attr(arg(long = "quic-window", id = "quic_window", value_name = "BYTES"))
    )]
    pub window: u32,
    /// The send and the receive buffer that the system is asked for, bytes each; it may grant less.
    #[config(
        env = "TRIMARAN_LINK_QUIC_SOCKET_BUFFER",
        default = 4_194_304,
        layer_attr(arg(long = "quic-socket-buffer", id = "quic_socket_buffer", value_name = "BYTES"))
    )]
    pub socket_buffer: usize,
}

impl QuicConfig {
    pub(super) fn options(&self) -> QuicOptions {
        let buffer = Some(self.socket_buffer);
        QuicOptions {
            congestion: self.congestion,
            window: self.window,
            socket: UdpSocketOptions { send_buffer: buffer, recv_buffer: buffer },
            ..QuicOptions::default()
        }
    }
}
