//! Boxes prepared for a device that tests them like [`HzbTest`](crate::HzbTest).
//!
//! All divisions are done here. The rest is comparisons, sums and products in f64, in the order of
//! `ScreenShape`: a device with IEEE 754 rounding gets the same answers, bit by bit.

use crate::hzb::BUDGET;
use crate::screen_box::{Linear, Planes, ScreenProjection};
use crate::{Outline, TestBox, View};

/// A box on the screen, in the shaders' layout.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ScreenRecord {
    /// Planes of faces: first those that face the eye.
    planes: [Linear; 6],
    /// Reversed depths.
    nearest: f64,
    farthest: f64,
    /// The rectangle of pixels: first and last column, first and last row.
    pixels: [u32; 4],
    fronts: u32,
    backs: u32,
    /// The level of the pyramid to start at.
    level: u32,
    /// The most texels to read; if they do not suffice, the box is visible.
    budget: u32,
}

/// The growth of boxes and depths, the same for all boxes of a view.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ScreenMargins {
    /// How far outlines are grown, in pixels.
    pub grown: f64,
    /// The margin around a pixel in which its front is evaluated, in pixels.
    pub margin: f64,
    /// The factor for depths of fronts.
    pub nearer: f64,
}

/// The classification of a box before any depth is read.
#[derive(Debug, Clone, Copy)]
pub enum OnScreen {
    /// Visible: it reaches the eye's plane or is not finite.
    Shows,
    /// Visible at no pixel.
    Outside,
    /// The depth decides.
    Test(ScreenRecord),
}

/// Prepares the boxes of one view.
#[derive(Debug, Clone, Copy)]
pub struct ScreenRecords {
    projection: ScreenProjection,
    last_level: usize,
}

impl ScreenRecords {
    /// For boxes of `view` with outlines grown as `outline` says, and a pyramid over its picture.
    #[must_use]
    pub fn new(view: &View, outline: Outline) -> Self {
        let longest = view.viewport().width().max(view.viewport().height());
        Self {
            projection: ScreenProjection::new(view, outline),
            last_level: longest.next_power_of_two().ilog2() as usize,
        }
    }

    /// Shared by all boxes of the view.
    #[must_use]
    pub const fn margins(&self) -> ScreenMargins {
        let ScreenProjection { grown, margin, nearer, .. } = self.projection;
        ScreenMargins { grown, margin, nearer }
    }

    pub(crate) const fn projection(&self) -> &ScreenProjection {
        &self.projection
    }

    /// The coarsest level of a pyramid over the picture.
    pub(crate) const fn last_level(&self) -> usize {
        self.last_level
    }

    /// Classifies a box.
    #[must_use]
    pub fn find(&self, test_box: &TestBox) -> OnScreen {
        let Some(footprint) = self.projection.footprint(test_box, self.projection.grown) else {
            return OnScreen::Shows;
        };
        let Some(pixels) = footprint.pixels else { return OnScreen::Outside };
        let Planes { fronts, backs } = Planes::new(&self.projection, test_box, pixels.middle());
        let mut planes = [Linear::default(); 6];
        for (slot, plane) in planes.iter_mut().zip(fronts.iter().chain(backs.iter())) {
            *slot = *plane;
        }
        OnScreen::Test(ScreenRecord {
            planes,
            nearest: footprint.nearest,
            farthest: footprint.farthest,
            pixels: [pixels.x0, pixels.x1, pixels.y0, pixels.y1].map(|pixel| pixel as u32),
            fronts: fronts.iter().count() as u32,
            backs: backs.iter().count() as u32,
            level: pixels.coarse_level().min(self.last_level) as u32,
            budget: BUDGET,
        })
    }
}
