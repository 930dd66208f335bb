//! Culling with an occlusion test of your own. This one hides boxes wholly beyond a distance, like fog: not
//! exact, but a few lines. Anything that can answer "is this box visible?" fits in the same place: a GPU, a
//! pyramid of depths, a potentially visible set computed beforehand.
//!
//!     cargo run --release --example an_occlusion_test_of_your_own

use std::{convert::Infallible, error::Error, sync::Arc};

use trimaran_cook::{
    CookOptions, cook,
    generate::{PlantOptions, plant},
};
use trimaran_cull::{Culler, LodRule, NoOccluders, OcclusionTest, TestBox, View, Viewport};
use trimaran_proto::{Camera, CullCounts, FrameNumber};

/// Hides boxes with no corner nearer than this many metres.
struct Fog {
    metres: f32,
}

impl OcclusionTest for Fog {
    type Error = Infallible;

    fn test(&mut self, _: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        visible.clear();
        visible.extend(boxes.iter().map(|b| {
            let radius = b.axes.iter().map(|axis| axis.length_squared()).sum::<f32>().sqrt();
            let nearest = b.centre.length() - radius; // view space: the eye is the origin
            u32::from(nearest <= self.metres)
        }));
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let model = plant(&PlantOptions { seed: 1, objects: 1_000, triangles: 100_000 });
    let scene = Arc::new(cook(&model, &CookOptions::default(), &())?);
    let looking_south = [0.0, 1.0, 0.0, 0.0]; // half a turn about the vertical, from -z to +z
    let camera = Camera::new([4.0, 1.7, 4.0], looking_south, 0.5, 0.1, FrameNumber(0))?;
    let view = View::new(camera, Viewport::new(512, 512)?);
    let rule = LodRule::new(2.0)?;
    let mut culler = Culler::new(scene);

    let clear = culler.cull(&view, rule, &mut NoOccluders, |_| {})?;
    say("without occluders", clear.counts);
    for metres in [15.0, 10.0, 5.0] {
        let mut drawn = Vec::new();
        let stats = culler.cull(&view, rule, &mut Fog { metres }, |ids| drawn.extend_from_slice(ids))?;
        say(&format!("fog at {metres} m"), stats.counts);
    }
    Ok(())
}

fn say(what: &str, CullCounts { visited, hidden, emitted, .. }: CullCounts) {
    println!("{what:18} {visited:4} nodes visited, {hidden:4} hidden, {emitted:4} drawn");
}
