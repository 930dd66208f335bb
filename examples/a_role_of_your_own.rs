//! A display of your own: two real cullers draw occluders and cull, and the display does something else with
//! the visible sets than drawing them. This one plans the loads of a renderer that streams its geometry,
//! frame by frame; it needs no device of its own. Any program that takes frames of visible nodes fits in the
//! same place.
//!
//!     cargo run --release --example a_role_of_your_own

use std::{collections::HashSet, convert::Infallible, error::Error, sync::Arc, time::Duration};

use trimaran::vulkan::VulkanCuller;
use trimaran_actors::{BoxedError, LocalSession, Observer, PictureDevice, ShownFrame, Stop};
use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::{Image, View};
use trimaran_gpu::{Gpu, GpuOptions, GpuScene};
use trimaran_proto::{Camera, DrawableId, FrameNumber, FrameStats, LodRule, Settings, Viewport};

/// Records everything that was ever visible, like a cache of geometry without eviction.
#[derive(Default)]
struct Loader {
    loaded: HashSet<DrawableId>,
    /// How many were new in the last frame.
    new: usize,
}

impl PictureDevice for Loader {
    type Error = Infallible;

    fn draw(
        &mut self,
        _: &View,
        solid: &[DrawableId],
        see_through: &[DrawableId],
    ) -> Result<Duration, Infallible> {
        let before = self.loaded.len();
        self.loaded.extend(solid.iter().chain(see_through));
        self.new = self.loaded.len() - before;
        if self.new > 0 {
            let visible = solid.len() + see_through.len();
            println!("{visible} drawables visible, {} of them to be loaded", self.new);
        }
        Ok(Duration::ZERO) // of a device
    }

    fn read(&mut self, _: &mut Image) -> Result<(), Infallible> {
        Ok(()) // nobody asks for a picture
    }
}

/// Adds up the cullers' statistics.
#[derive(Default)]
struct Tally {
    frames: u32,
    culling: Duration,
}

impl Observer for Tally {
    fn shown(&mut self, _: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.frames += 1;
        Ok(())
    }

    fn culled(&mut self, stats: &FrameStats) {
        self.culling += Duration::from_nanos(stats.hc_end_ns - stats.hc_start_ns);
    }
}

/// A walk along the plant's side, looking across it.
fn along_the_side(frame: FrameNumber) -> Camera {
    let looking_east = [0.0, -std::f64::consts::FRAC_1_SQRT_2, 0.0, std::f64::consts::FRAC_1_SQRT_2];
    let eye = [1.0, 1.7, 2.0 + 0.25 * f64::from(frame.0)];
    Camera::new(eye, looking_east, 0.5, 0.1, frame).unwrap_or_else(|_| unreachable!("all numbers are finite"))
}

fn main() -> Result<(), Box<dyn Error>> {
    let model = plant(&PlantOptions { seed: 1, objects: 1_000, triangles: 100_000 });
    let scene = Arc::new(cook(&model, &CookOptions::default(), &())?);

    // The cullers' devices are real, and may be the same one.
    let settings = Settings::new(Viewport::new(512, 512)?, LodRule::new(2.0)?);
    let drawn = GpuScene::new(&Gpu::open(&GpuOptions::default())?, &scene)?;
    let culler = |_| Ok(VulkanCuller::new(&drawn, settings.viewport, settings.occlusion_test)?);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let (_stopper, stop) = Stop::new();
    let mut tally = Tally::default();
    let session = LocalSession::new(&scene, settings, 60);
    session.run(culler, Loader::default(), &mut along_the_side, &mut tally, runtime.handle(), &stop)?;
    println!(
        "{} frames of a scene of {} drawables, culled in {:?}",
        tally.frames,
        scene.drawables().len(),
        tally.culling
    );
    Ok(())
}
