//! Clearances: the shortest distances between objects, and clashes, where objects are too near each other.
//!
//! Distances are those of surfaces at full detail, computed in double precision. The search goes down the
//! trees of boxes of two objects together. It leaves out each pair of boxes that is farther apart than the
//! shortest distance so far (branch and bound; Larsen, Gottschalk, Lin and Manocha 1999).
//!
//! - Surfaces that touch or intersect are at distance 0. How deep they penetrate is not computed.
//! - **A solid within another one,** such as a pump in a room, is as far from it as their surfaces are. An
//!   object has no inside here, as many of a plant's surfaces are not closed.
//! - Coordinates are stored as 32-bit numbers about an origin of each object. [`Clearance::rounding`] bounds
//!   what that makes of a distance: micrometres for a pipe. Surfaces that touch in the model may be so far
//!   apart here, so a distance within the rounding counts as [hard](Clearance::is_hard).

mod boxes;
mod clashes;
mod objects;
mod pieces;
mod triangles;

use glam::DVec3;
use thiserror::Error;

use crate::{ReadError, Scene};

pub use clashes::{ClashRule, Clashes, Watch};
use pieces::Pieces;

/// Finds clearances in a scene. Threads can share it: it has the geometry that was used lately, at most
/// 256 MiB.
#[derive(Debug)]
pub struct Clearances<'s> {
    scene: &'s Scene,
    pieces: Pieces,
}

/// The shortest distance between two objects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clearance {
    /// The numbers of the objects.
    pub objects: [u32; 2],
    /// Metres; 0 if they touch or intersect.
    pub distance: f64,
    /// A closest point of each: metres in the world.
    pub points: [DVec3; 2],
    /// The error of the distance due to rounded coordinates, metres.
    pub rounding: f64,
}

impl Clearance {
    /// Whether the surfaces intersect, or touch but for rounding.
    #[must_use]
    pub fn is_hard(&self) -> bool {
        self.distance <= self.rounding
    }
}

/// Why a search found no answer.
#[derive(Debug, Clone, Error)]
#[non_exhaustive]
pub enum ClearanceError {
    /// A part of the scene cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It was stopped.
    #[error("the search was stopped")]
    Stopped,
    /// There are more clashes than were asked for.
    #[error("there are more than {most} clashes")]
    TooMany {
        /// The most that were asked for.
        most: usize,
    },
}

impl<'s> Clearances<'s> {
    /// Of this scene.
    #[must_use]
    pub fn new(scene: &'s Scene) -> Self {
        Self { scene, pieces: Pieces::default() }
    }
}

#[cfg(test)]
mod tests;
