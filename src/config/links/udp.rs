//! What connections over datagrams can be told.

use std::time::Duration;

use clap::{ValueEnum, value_parser};
use confique::Config;
use serde::{Deserialize, Serialize};
use trimaran_transport::{
    UdpMode, UdpSocketOptions,
    udp::{Congestion, MIN_DATAGRAM, Repair, Trust, UdpOptions},
};

use super::super::positive;

/// How connections over datagrams are set up.
#[derive(Debug, Clone, PartialEq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct UdpConfig {
    /// What becomes of frames sent from here that do not arrive in time: `reliable` sends them again until
    /// they do, `deadline` gives them up. An endpoint may say it too, and then counts:
    /// `udp://host:port?mode=deadline`.
    #[config(
        env = "TRIMARAN_LINK_UDP_MODE",
        default = "reliable",
        layer_attr(arg(long = "udp-mode", id = "udp_mode", value_enum))
    )]
    pub mode: FrameMode,
    /// How long after its end a frame may arrive where the mode is `deadline`, milliseconds.
    #[config(
        env = "TRIMARAN_LINK_UDP_DEADLINE_MS",
        default = 50.0,
        validate = deadline,
        layer_attr(arg(
            long = "udp-deadline-ms",
            value_name = "MS",
            value_parser = positive,
            allow_negative_numbers = true
        ))
    )]
    pub deadline_ms: f64,
    /// When frames sent from here get repair, with which most losses cost no time: `auto` while packets are
    /// lost, `on` always, `off` never.
    #[config(
        env = "TRIMARAN_LINK_UDP_REPAIR",
        default = "auto",
        layer_attr(arg(long = "udp-repair", id = "udp_repair", value_enum))
    )]
    pub repair: RepairMode,
    /// How many bytes of repair may be sent, percent of the frames' own, 1 to 100.
    #[config(
        env = "TRIMARAN_LINK_UDP_REPAIR_PERCENT",
        default = 15,
        validate((1..=100).contains(repair_percent), "give 1 to 100, or repair = \"off\""),
        layer_attr(arg(
            long = "udp-repair-percent",
            value_name = "N",
            value_parser = value_parser!(u8).range(1..=100)
        ))
    )]
    pub repair_percent: u8,
    /// What makes the two ends trust each other: their `keys`, or nothing: `plain` hides nothing and checks
    /// nobody, and is for trusted networks. The same at both ends.
    #[config(
        env = "TRIMARAN_LINK_UDP_TRUST",
        default = "keys",
        layer_attr(arg(long = "udp-trust", id = "udp_trust", value_enum))
    )]
    pub trust: UdpTrust,
    /// How a connection shares its path with others: `cubic` or `new-reno`.
    #[config(
        env = "TRIMARAN_LINK_UDP_CONGESTION",
        default = "cubic",
        layer_attr(arg(long = "udp-congestion", id = "udp_congestion", value_enum))
    )]
    pub congestion: UdpCongestion,
    /// How many packets may be under way at first, 2 to 100. Ten leave at once, those behind them over the
    /// round trip. A frame of 4,000 ids and its repair are 17 packets; RFC 9002 recommends 10.
    #[config(
        env = "TRIMARAN_LINK_UDP_INITIAL_WINDOW",
        default = 20,
        validate((2..=100).contains(initial_window), "give 2 to 100 packets"),
        layer_attr(arg(
            long = "udp-initial-window",
            value_name = "PACKETS",
            value_parser = value_parser!(u16).range(2..=100)
        ))
    )]
    pub initial_window: u16,
    /// Whether datagrams of more than 1,200 bytes are tried, up to what Ethernet carries.
    #[config(
        env = "TRIMARAN_LINK_UDP_PMTU",
        default = true,
        layer_attr(arg(
            long = "udp-pmtu",
            id = "udp_pmtu",
            num_args = 0..=1,
            default_missing_value = "true",
            value_name = "BOOL"
        ))
    )]
    pub pmtu: bool,
    /// How many bytes of frames may be under way in each direction, sent and not read. The same at both
    /// ends.
    #[config(
        env = "TRIMARAN_LINK_UDP_WINDOW",
        default = 4_194_304,
        layer_attr(arg(long = "udp-window", id = "udp_window", value_name = "BYTES"))
    )]
    pub window: u32,
    /// How many bytes of frames this side keeps until they are acknowledged.
    #[config(
        env = "TRIMARAN_LINK_UDP_SEND_BUFFER",
        default = 4_194_304,
        layer_attr(arg(long = "udp-send-buffer", id = "udp_send_buffer", value_name = "BYTES"))
    )]
    pub send_buffer: usize,
    /// The send and the receive buffer that the system is asked for, bytes each; it may grant less.
    #[config(
        env = "TRIMARAN_LINK_UDP_SOCKET_BUFFER",
        default = 4_194_304,
        layer_attr(arg(long = "udp-socket-buffer", id = "udp_socket_buffer", value_name = "BYTES"))
    )]
    pub socket_buffer: usize,
}

/// What becomes of frames that do not arrive in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum FrameMode {
    /// They are sent until they arrive.
    Reliable,
    /// They are given up.
    Deadline,
}

/// When frames get repair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum RepairMode {
    /// While packets are lost.
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

/// What makes the ends of a connection trust each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum UdpTrust {
    /// Each knows the other's public keys.
    Keys,
    /// Nothing: anybody may come, and anybody may read.
    Plain,
}

/// How a connection shares its path with others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum UdpCongestion {
    /// As most TCP does (RFC 9438).
    Cubic,
    /// As RFC 9002 does.
    NewReno,
}

/// A deadline that can be met.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "as the derived code calls it")]
fn deadline(milliseconds: &f64) -> Result<(), &'static str> {
    let sound = *milliseconds > 0.0 && *milliseconds <= 86_400_000.0;
    if sound { Ok(()) } else { Err("give milliseconds above 0") }
}

impl UdpConfig {
    pub(super) fn options(&self) -> UdpOptions {
        let buffer = Some(self.socket_buffer);
        let defaults = UdpOptions::default();
        UdpOptions {
            trust: match self.trust {
                UdpTrust::Keys => Trust::Keys,
                UdpTrust::Plain => Trust::Plaintext,
            },
            mode: match self.mode {
                FrameMode::Reliable => UdpMode::Reliable,
                FrameMode::Deadline => UdpMode::Deadline,
            },
            deadline: Duration::try_from_secs_f64(self.deadline_ms / 1e3).unwrap_or_default(),
            repair: match self.repair {
                RepairMode::Auto => Repair::Auto,
                RepairMode::On => Repair::On,
                RepairMode::Off => Repair::Off,
            },
            repair_percent: self.repair_percent,
            congestion: match self.congestion {
                UdpCongestion::Cubic => Congestion::Cubic,
                UdpCongestion::NewReno => Congestion::NewReno,
            },
            initial_window: self.initial_window,
            max_datagram: if self.pmtu { defaults.max_datagram } else { MIN_DATAGRAM },
            window: self.window,
            send_buffer: self.send_buffer,
            socket: UdpSocketOptions { send_buffer: buffer, recv_buffer: buffer },
        }
    }
}
