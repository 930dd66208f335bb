//! The protocol of the suite: a robot receives poses, and sends the points it sees.

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_wire::{BatchDecoder, BatchEncoder, BatchSize, Batching, Delivery, Fixed, Protocol, Rejection};

use super::coding::{Decoder, Encoder, count};

/// A protocol of robots: poses on the latest lane, frames of point numbers.
///
/// Its batches have a coded form, so that the suite covers that too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Robot;

/// The hello of a peer of [`Robot`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Greeting {
    /// Its name.
    pub name: String,
    /// The role that it claims, if any.
    pub role: Option<String>,
    /// Its map: peers with different maps refuse each other.
    pub map: u64,
    /// The number of points that it wants in a batch, if any.
    pub batch: Option<BatchSize>,
}

/// The target of a robot: 36 bytes, little-endian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Counts poses.
    pub number: u32,
    /// Metres, from the map's origin.
    pub position: [f64; 3],
    /// Radians, from the map's x axis.
    pub heading: f64,
}

/// A pose with a coordinate that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("a coordinate of the pose is not finite")]
pub struct PoseError;

/// Messages between a robot and its panel, beside poses and points.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Command {
    /// Counts commands.
    pub number: u32,
    /// The program to run.
    pub program: String,
}

/// Why a peer of [`Robot`] is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum RejectionCode {
    /// The maps differ.
    Map = 1,
    /// The listener has the role itself.
    Role = 2,
    /// Both want a batch size, and they differ.
    Batch = 3,
}

impl Protocol for Robot {
    const NAME: &'static str = "robot/1";
    type Hello = Greeting;
    type Latest = Pose;
    type Header = Pose;
    type Item = u32;
    type Message = Command;

    fn name(hello: &Greeting) -> String {
        hello.name.clone()
    }

    fn admit(ours: &Greeting, theirs: &Greeting) -> Result<(), Rejection> {
        if ours.map != theirs.map {
            let why =
                format!("the listener has map {:#x}, the connecting peer map {:#x}", ours.map, theirs.map);
            return Err(Rejection::new(RejectionCode::Map as u16, &why));
        }
        if let Some(role) = ours.role.as_ref().filter(|role| theirs.role.as_ref() == Some(role)) {
            return Err(Rejection::new(
                RejectionCode::Role as u16,
                &format!("the listener is {role} itself"),
            ));
        }
        match (ours.batch, theirs.batch) {
            (Some(a), Some(b)) if a != b => {
                let why = format!(
                    "the listener wants batches of {}, the connecting peer of {}",
                    a.items(),
                    b.items()
                );
                Err(Rejection::new(RejectionCode::Batch as u16, &why))
            }
            _ => Ok(()),
        }
    }

    fn role(hello: &Greeting) -> Option<String> {
        hello.role.clone()
    }

    fn batching(ours: &Greeting, theirs: &Greeting) -> Option<Batching> {
        Some(Batching { size: ours.batch.or(theirs.batch)?, coded: false })
    }

    fn encoder(delivery: Delivery) -> Option<Box<dyn BatchEncoder<u32>>> {
        Some(Box::new(Encoder::new(delivery)))
    }

    fn decoder(max_items: u32) -> Option<Box<dyn BatchDecoder<u32>>> {
        Some(Box::new(Decoder::new(max_items)))
    }

    fn count_coded(bytes: &[u8]) -> Option<usize> {
        count(bytes)
    }
}

impl Fixed for Pose {
    const SIZE: usize = 36;
    type Error = PoseError;

    fn write(&self, out: &mut [u8]) {
        let [x, y, z] = self.position;
        let coordinates = [x, y, z, self.heading];
        let bytes =
            self.number.to_le_bytes().into_iter().chain(coordinates.into_iter().flat_map(f64::to_le_bytes));
        for (out, byte) in out.iter_mut().zip(bytes) {
            *out = byte;
        }
    }

    fn read(bytes: &[u8]) -> Result<Self, PoseError> {
        let (number, rest) = bytes.split_first_chunk().ok_or(PoseError)?;
        let mut coordinates = rest.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes));
        let mut next = || coordinates.next().filter(|coordinate| coordinate.is_finite()).ok_or(PoseError);
        let position = [next()?, next()?, next()?];
        Ok(Self { number: u32::from_le_bytes(*number), position, heading: next()? })
    }
}
