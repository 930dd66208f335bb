//! What others may ask for in a second.

use clap::value_parser;
use confique::Config;
use serde::Serialize;

/// What others may ask for in a second: far more than a session needs, so that a flood is noticed and nobody
/// else.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Config)]
#[config(layer_attr(derive(Debug, Clone, clap::Args)), layer_attr(serde(deny_unknown_fields)))]
pub struct LimitsConfig {
    /// How many handshakes may begin at a listener in a second; more are turned away.
    #[config(
        env = "TRIMARAN_LINK_LIMITS_HANDSHAKES_PER_S",
        default = 1000,
        validate = above_zero,
        layer_attr(arg(
            long = "limit-handshakes",
            value_name = "N",
            value_parser = value_parser!(u32).range(1..)
        ))
    )]
    pub handshakes_per_s: u32,
    /// How many of them from one address, or from one network of 64 bits of IPv6; a link over TCP takes three.
    #[config(
        env = "TRIMARAN_LINK_LIMITS_HANDSHAKES_PER_S_PER_ADDRESS",
        default = 500,
        validate = above_zero,
        layer_attr(arg(
            long = "limit-handshakes-per-address",
            value_name = "N",
            value_parser = value_parser!(u32).range(1..)
        ))
    )]
    pub handshakes_per_s_per_address: u32,
    /// How many messages a peer may send on the frames lane in a second; the link with one that sends more
    /// ends.
    #[config(
        env = "TRIMARAN_LINK_LIMITS_MESSAGES_PER_S",
        default = 1_000_000,
        validate = above_zero,
        layer_attr(arg(
            long = "limit-messages",
            value_name = "N",
            value_parser = value_parser!(u32).range(1..)
        ))
    )]
    pub messages_per_s: u32,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "as the derived code calls it")]
const fn above_zero(count: &u32) -> Result<(), &'static str> {
    if *count > 0 { Ok(()) } else { Err("give at least 1") }
}
