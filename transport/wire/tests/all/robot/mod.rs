//! An application for the tests, which keeps the trait's defaults where it can: a robot sends its pose, and
//! frames of the map's cells that it found taken.

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_wire::{Fixed, Protocol};

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Robot;

/// Metres, and radians.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pose {
    pub(crate) x: f32,
    pub(crate) y: f32,
    pub(crate) heading: f32,
}

/// When a frame was seen, in milliseconds.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Time(pub(crate) u64);

/// A command to a robot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) enum Command {
    Stop,
    /// The name of a place.
    GoTo(String),
}

#[derive(Debug, PartialEq, Error)]
#[error("not finite")]
pub(crate) struct NotFinite;

impl Protocol for Robot {
    const NAME: &'static str = "robot/1";
    type Hello = String;
    type Latest = Pose;
    type Header = Time;
    type Item = u32;
    type Message = Command;
}

impl Fixed for Pose {
    const SIZE: usize = 12;
    type Error = NotFinite;

    fn write(&self, out: &mut [u8]) {
        for (out, value) in out.as_chunks_mut().0.iter_mut().zip([self.x, self.y, self.heading]) {
            *out = value.to_le_bytes();
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, NotFinite> {
        let value = |at: usize| bytes[at..].first_chunk().map_or(0.0, |bytes| f32::from_le_bytes(*bytes));
        let pose = Self { x: value(0), y: value(4), heading: value(8) };
        let finite = [pose.x, pose.y, pose.heading].iter().all(|value| value.is_finite());
        if finite { Ok(pose) } else { Err(NotFinite) }
    }
}

impl Fixed for Time {
    const SIZE: usize = 8;
    type Error = NotFinite;

    fn write(&self, out: &mut [u8]) {
        out.copy_from_slice(&self.0.to_le_bytes());
    }

    fn read(bytes: &[u8]) -> Result<Self, NotFinite> {
        bytes.first_chunk().map(|bytes| Self(u64::from_le_bytes(*bytes))).ok_or(NotFinite)
    }
}
