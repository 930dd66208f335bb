//! About what frames cost, by counts: in lockstep they decide instead of a clock.

use std::time::Duration;

use trimaran_cull::{DeviceClass, Viewport};
use trimaran_proto::FrameStats;

/// The costs of a frame's parts on a class of device, in nanoseconds. Only their proportions matter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Costs {
    /// Of each frame that is culled, beside its parts: clearing, waiting.
    culled: f64,
    /// Of each pixel of its occluders' depth.
    depth_pixel: f64,
    occluder: f64,
    occluder_triangle: f64,
    /// Of each node that it visits.
    visited: f64,
    /// Of each drawable that is found by the frustum alone.
    in_frustum: f64,
    /// Of the picture.
    pixel: f64,
    drawable: f64,
    triangle: f64,
}

/// Fitted to walks on lavapipe: huldra_x14 at 10 px, the town hall at 2 px, and boxes of which none hides
/// another one, each culled and not culled. Half of the frames cost within a third of this.
const CPU: Costs = Costs {
    culled: 0.0,
    depth_pixel: 2.4,
    occluder: 0.0,
    occluder_triangle: 100.0,
    visited: 100.0,
    in_frustum: 30.0,
    pixel: 3.0,
    drawable: 300.0,
    triangle: 150.0,
};

/// Of the H200's times of `alone` and `frustum` in docs/comparison.md, divided by the medians of what these
/// walks draw and visit: huldra_x14 at 10 px draws 160 or 1,700 drawables, the city at 2 px 4,400 or 78,000.
/// Half a millisecond of a picture is waiting, and so is most of what each culled frame costs.
const GPU: Costs = Costs {
    culled: 0.76e6,
    depth_pixel: 0.0,
    occluder: 1_200.0,
    occluder_triangle: 35.0,
    visited: 860.0,
    in_frustum: 85.0,
    pixel: 0.5,
    drawable: 550.0,
    triangle: 2.0,
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
        };
        Duration::from_nanos((picture + finding) as u64)
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::CullCounts;

    use super::*;

    /// A frame of 1024x1024 pixels with these occluders, their triangles, nodes visited, drawables and
    /// triangles, in milliseconds.
    fn cost(class: DeviceClass, [occluders, hiding, visited, drawables, triangles]: [u32; 5]) -> f64 {
        let stats = FrameStats {
            occluders,
            occluder_triangles: hiding.into(),
            culling: CullCounts { visited, ..CullCounts::default() },
            ..FrameStats::default()
        };
        let size = Viewport::new(1024, 1024).unwrap();
        let cost = Costs::of(class).of_frame(&stats, size, drawables as usize, triangles.into());
        cost.as_secs_f64() * 1e3
    }

    /// Median frames of the walks, culled and not.
    const X14: [[u32; 5]; 2] = [[154, 4_233, 603, 161, 4_342], [0, 0, 0, 1_698, 42_121]];
    const CITY: [[u32; 5]; 2] = [[3_763, 90_000, 14_305, 4_407, 145_473], [0, 0, 0, 77_723, 2_511_252]];
    const OPEN: [[u32; 5]; 2] = [[3_741, 44_894, 7_021, 4_978, 59_740], [0, 0, 0, 4_978, 59_740]];

    #[test]
    fn median_frames_cost_what_was_measured() {
        let near = |walk: [[u32; 5]; 2], measured: [f64; 2]| {
            for (counts, measured) in walk.into_iter().zip(measured) {
                let estimate = cost(DeviceClass::Gpu, counts);
                assert!((0.7..1.5).contains(&(estimate / measured)), "{estimate} ms for {measured}");
            }
        };
        near(X14, [0.49 + 1.11 + 0.61, 0.26 + 1.75]);
        near(CITY, [8.3 + 12.9 + 6.0, 6.4 + 35.0]);
    }

    #[test]
    fn the_mode_that_counts_prefer_is_the_one_that_was_faster() {
        let ratio = |class, [culled, all]: [[u32; 5]; 2]| cost(class, all) / cost(class, culled);
        assert!(ratio(DeviceClass::Cpu, X14) > 1.3 && ratio(DeviceClass::Cpu, CITY) > 3.0);
        assert!(ratio(DeviceClass::Gpu, CITY) > 1.5);
        assert!(ratio(DeviceClass::Cpu, OPEN) < 0.7 && ratio(DeviceClass::Gpu, OPEN) < 0.5);
    }
}
