//! A protocol of the suite with channels: values and frames of several types and sizes.

use std::convert::Infallible;

use trimaran_wire::{Channel, Fixed, Item, Protocol};

use super::robot::{Pose, Robot};

/// A protocol with two channels of values and two of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rover;

/// The same but for the last channel, whose items are longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OtherRover;

/// A protocol with a channel whose batches may be coded, beside one whose batches never are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Crawler;

/// A time in ticks: 8 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticks(pub u64);

/// A measured distance: 3 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Distance(pub [u8; 3]);

const ODOMETRY: Channel = Channel::latest::<Pose>("odometry");
const IMU: Channel = Channel::latest::<Ticks>("imu");
const FRONT: Channel = Channel::frames::<(), u32>("front");

impl Protocol for Rover {
    const NAME: &'static str = "rover/1";
    const CHANNELS: &'static [Channel] = &[ODOMETRY, IMU, FRONT, Channel::frames::<Ticks, Distance>("back")];
    type Hello = String;
    type Latest = Pose;
    type Header = ();
    type Item = u32;
    type Message = ();
}

impl Protocol for OtherRover {
    const NAME: &'static str = Rover::NAME;
    const CHANNELS: &'static [Channel] = &[ODOMETRY, IMU, FRONT, Channel::frames::<Ticks, u32>("back")];
    type Hello = String;
    type Latest = Pose;
    type Header = ();
    type Item = u32;
    type Message = ();
}

impl Protocol for Crawler {
    const NAME: &'static str = "crawler/1";
    const CHANNELS: &'static [Channel] = &[FRONT, Channel::frames_of::<Robot>("arm")];
    type Hello = String;
    type Latest = ();
    type Header = ();
    type Item = u32;
    type Message = ();
}

impl Fixed for Ticks {
    const SIZE: usize = 8;
    type Error = Infallible;

    fn write(&self, out: &mut [u8]) {
        out.copy_from_slice(&self.0.to_le_bytes());
    }

    fn read(bytes: &[u8]) -> Result<Self, Infallible> {
        Ok(Self(bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))))
    }
}

impl Item for Distance {
    const SIZE: usize = 3;

    fn write(self, out: &mut [u8]) {
        out.copy_from_slice(&self.0);
    }

    fn read(bytes: &[u8]) -> Self {
        Self(bytes.first_chunk().copied().unwrap_or_default())
    }
}
