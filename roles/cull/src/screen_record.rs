//! Boxes made ready for a device that tests them as [`HzbTest`](crate::HzbTest) does.
//!
//! All that divides is done here. What is left is to compare, add and multiply in f64, in the order in which
//! `ScreenShape` does it: a device that rounds as IEEE 754 says comes to the same answers, bit by bit.

use crate::hzb::BUDGET;
use crate::screen_box::{Linear, MARGIN_PX, Planes, ScreenProjection, grown};
use crate::{Outline, TestBox, View};

/// A box on the screen, as shaders read it.
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
    /// The most texels to look at; the box shows if they do not suffice.
    budget: u32,
}

/// What boxes and depths are grown by, the same for all boxes of a view.
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct ScreenMargins {
    /// How far outlines are grown, in pixels.
    pub grown: f64,
    /// How far around a pixel its front is looked at, in pixels.
    pub margin: f64,
    /// What depths of fronts are multiplied by.
    pub nearer: f64,
}

/// What is known of a box before any depth is looked at.
#[derive(Debug, Clone, Copy)]
pub enum OnScreen {
    /// It counts as visible: it reaches the eye's plane or is not finite.
    Shows,
    /// It shows at no pixel.
    Outside,
    /// The depth decides.
    Test(ScreenRecord),
}

/// Makes the boxes of one view ready.
#[derive(Debug, Clone, Copy)]
pub struct ScreenRecords {
    projection: ScreenProjection,
    grown: f64,
    last_level: usize,
}

impl ScreenRecords {
    /// For boxes as seen from `view`, whose outlines are grown as `outline` says, and a pyramid over its
    /// picture.
    #[must_use]
    pub fn new(view: &View, outline: Outline) -> Self {
        let longest = view.viewport().width().max(view.viewport().height());
        Self {
            projection: ScreenProjection::new(view, outline),
            grown: grown(outline),
            last_level: longest.next_power_of_two().ilog2() as usize,
        }
    }

    /// What all boxes of the view share.
    #[must_use]
    pub const fn margins(&self) -> ScreenMargins {
        ScreenMargins { grown: self.grown, margin: MARGIN_PX, nearer: self.projection.nearer }
    }

    /// What is known of a box.
    #[must_use]
    pub fn find(&self, test_box: &TestBox) -> OnScreen {
        let Some(footprint) = self.projection.footprint(test_box, self.grown) else { return OnScreen::Shows };
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
