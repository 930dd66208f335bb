//! The subjects: links, and other ways to send the same data.

pub(crate) mod channel;
pub(crate) mod iceoryx;
pub(crate) mod link;
pub(crate) mod quic;
pub(crate) mod tcp;
pub(crate) mod threads;
pub(crate) mod udp;
pub(crate) mod zenoh;

use anyhow::{Context, Result};

use crate::measure::POINTS;

/// The bytes of a pose.
pub(crate) const POSE: usize = 72;

/// 72 bytes that carry `number`.
pub(crate) fn pose(number: u32) -> [u8; POSE] {
    let mut bytes = [0; POSE];
    bytes[..4].copy_from_slice(&number.to_le_bytes());
    bytes
}

/// A frame's bytes: its number, then its points.
pub(crate) fn frame(number: u32) -> Vec<u8> {
    std::iter::once(number).chain(0..POINTS).flat_map(u32::to_le_bytes).collect()
}

/// The number at the beginning of `bytes`.
pub(crate) fn number(bytes: &[u8]) -> Result<u32> {
    Ok(u32::from_le_bytes(*bytes.first_chunk().context("too short")?))
}
