//! About what frames cost, by counts: in lockstep they decide instead of a clock.

use std::time::Duration;

use trimaran_cull::{DeviceClass, Viewport};
use trimaran_proto::FrameStats;

/// What parts of a frame cost on a class of device, in nanoseconds. Only their proportions matter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Costs {
    /// Of each frame that is culled, beside its parts: clearing, waiting.
    culled: f64,
    /// Of each pixel of its occluders' depth.
    depth_pixel: f64,
    occluder: f64,
    occluder_triangle: f64,
    /// Of each node that it visits, and of each batch of boxes.
    visited: f64,
    batch: f64,
    /// Of each drawable that is found by the frustum alone.
    in_frustum: f64,
    /// Of the picture.
    pixel: f64,
    drawable: f64,
    triangle: f64,
}

const CPU: Costs = Costs {
    culled: 1.0e6,
    depth_pixel: 1.0,
    occluder: 3_000.0,
    occluder_triangle: 60.0,
    visited: 500.0,
    batch: 50_000.0,
    in_frustum: 400.0,
    pixel: 3.0,
    drawable: 4_000.0,
    triangle: 100.0,
};

const GPU: Costs = Costs {
    culled: 0.3e6,
    depth_pixel: 0.02,
    occluder: 200.0,
    occluder_triangle: 0.5,
    visited: 100.0,
    batch: 50_000.0,
    in_frustum: 100.0,
    pixel: 0.1,
    drawable: 200.0,
    triangle: 0.5,
};

impl Costs {
    /// Those of a class of device.
    pub(super) const fn of(class: DeviceClass) -> Self {
        match class {
            DeviceClass::Cpu => CPU,
            DeviceClass::Gpu => GPU,
        }
    }

    /// Those of a frame that was found with these `stats`, and is drawn with that many drawables and
    /// triangles.
    pub(super) fn of_frame(
        &self,
        stats: &FrameStats,
        size: Viewport,
        drawables: usize,
        triangles: u64,
    ) -> Duration {
        let pixels = f64::from(size.width()) * f64::from(size.height());
        let (drawables, triangles) = (drawables as f64, triangles as f64);
        let picture = self.pixel * pixels + self.drawable * drawables + self.triangle * triangles;
        // A frame that is culled visits at least the root.
        let finding = if stats.culling.visited == 0 {
            self.in_frustum * drawables
        } else {
            self.culled
                + self.depth_pixel * pixels
                + self.occluder * f64::from(stats.occluders)
                + self.occluder_triangle * stats.occluder_triangles as f64
                + self.visited * f64::from(stats.culling.visited)
                + self.batch * f64::from(stats.culling.batches)
        };
        Duration::from_nanos((picture + finding) as u64)
    }
}
