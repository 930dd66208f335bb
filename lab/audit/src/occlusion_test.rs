//! The reference occlusion test: boxes rasterized in f64 against depth.

use std::convert::Infallible;

use glam::{DVec3, Vec3};
use trimaran_cull::{Answer, OcclusionTest, TestBox, View};

use crate::id_buffer::IdBuffer;
use crate::raster::rasterize_triangle;

/// Rasterizes boxes against an ID buffer's depth and counts the pixels at which a box is in front of it or
/// level with it: the same as precise occlusion queries with `GREATER_OR_EQUAL` and back faces culled.
#[derive(Debug)]
pub struct ReferenceTest<'p> {
    occluders: &'p IdBuffer,
    /// For each pixel the last box that counted it, so that a pixel on two faces counts once.
    counted: Vec<usize>,
    boxes: usize,
}

impl<'p> ReferenceTest<'p> {
    /// Tests against `occluders`.
    #[must_use]
    pub fn new(occluders: &'p IdBuffer) -> Self {
        let counted = vec![0; occluders.depth().len()];
        Self { occluders, counted, boxes: 0 }
    }

    /// The number of pixels at which the box is visible.
    pub fn count(&mut self, view: &View, test_box: &TestBox) -> u32 {
        self.boxes += 1;
        let mut pixels = 0;
        for corners in triangles_of(test_box) {
            rasterize_triangle(view, corners, |hit| {
                let (Some(&depth), Some(counted)) =
                    (self.occluders.depth().get(hit.pixel), self.counted.get_mut(hit.pixel))
                else {
                    return;
                };
                if hit.depth >= depth && *counted != self.boxes {
                    *counted = self.boxes;
                    pixels += 1;
                }
            });
        }
        pixels
    }
}

impl OcclusionTest for ReferenceTest<'_> {
    type Error = Infallible;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        visible.clear();
        visible.extend(boxes.iter().map(|test_box| self.count(view, test_box)));
        Ok(())
    }

    fn answer(&self) -> Answer {
        Answer::PixelCount
    }
}

/// The twelve triangles of a box, in view space.
pub(crate) fn triangles_of(test_box: &TestBox) -> impl Iterator<Item = [DVec3; 3]> + use<> {
    let centre = test_box.centre.as_dvec3();
    let axes = test_box.axes.map(Vec3::as_dvec3);
    (0..6).flat_map(move |face: usize| {
        let [a, b, c] = [axes[face % 3], axes[(face + 1) % 3], axes[(face + 2) % 3]];
        let middle = if face < 3 { centre + a } else { centre - a };
        let corners = [middle - b - c, middle + b - c, middle + b + c, middle - b + c];
        [[corners[0], corners[1], corners[2]], [corners[0], corners[2], corners[3]]]
    })
}
