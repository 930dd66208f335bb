//! Why something visible was not drawn: the path from the root down to it, step by step, each compared with
//! the visible surface.
//!
//! The occlusion test and its depth are those of the culler of the frame (or of a repetition), and so are the
//! steps before the test: the LOD cut, the frustum test, the boxes. The reference is independent of them: the
//! missing surface by the f64 rasterizer. The traversal may go wrong at any node above a drawable, and the
//! first such step is the cause.

mod steps;
mod surface;

use std::collections::HashMap;
use std::f64::consts::SQRT_2;

use glam::{DVec3, Vec3};
use trimaran_cull::{
    Choice, CutRule, FalseCullCause as Cause, LodCut, OcclusionTest, Prepared, TestBox, View,
};
use trimaran_proto::DrawableId;
use trimaran_scene::{Level, Node, NodeId, Scene};

use steps::{CullerSteps, Steps};
use surface::{SurfacePoint, surface_of};

use crate::id_buffer::{IdBuffer, Placement, rasterize};
use crate::occlusion_test::triangles_of;
use crate::raster::rasterize_triangle;

/// Depths closer than this fraction are of the same surface.
const SAME_DEPTH: f64 = 1e-4;

/// A culler's work on a frame from which something is missing.
#[derive(Debug, Clone, Copy)]
pub struct CulledFrame<'f> {
    /// The scene.
    pub scene: &'f Scene,
    /// The frame's camera and size.
    pub view: &'f View,
    /// The inputs of its LOD cut beside the view.
    pub rule: &'f CutRule,
    /// The occluders that OR drew.
    pub occluders: &'f [DrawableId],
    /// The resulting depth, as the occlusion test had it: reversed, row by row from the top left.
    pub depth: &'f [f32],
    /// How far the occluders' depth lies behind their surfaces: by its change over this share of a pixel. 0
    /// if OR adds no bias.
    pub bias_px: f32,
    /// How many ids HC sent, if that is known.
    pub sent: Option<u64>,
    /// The drawables that RVG drew.
    pub drawn: &'f [DrawableId],
    /// Earlier frames whose cameras OR may have used by mistake: their views and drawables.
    pub before: &'f [(View, &'f [DrawableId])],
}

/// A drawable that owns pixels without culling and was not drawn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Missing {
    /// Its id.
    pub id: DrawableId,
    /// Its pixels, row by row from the top left.
    pub pixels: Vec<usize>,
}

/// The cause for each of `missing`, in order. `test` is the occlusion test of the culler, against
/// `frame.depth`.
///
/// # Errors
/// If the test fails.
pub fn causes<T: OcclusionTest>(
    frame: &CulledFrame<'_>,
    test: &mut T,
    missing: &[Missing],
) -> Result<Vec<Cause>, T::Error> {
    let steps = CullerSteps::new(frame.scene, frame.view, frame.rule, test);
    Judge::new(frame, steps).judge(missing)
}

struct Judge<'f, S> {
    frame: &'f CulledFrame<'f>,
    steps: S,
    /// Each node with a drawn level, and that level.
    drawn: Vec<(u32, Level)>,
    /// The occluders as the reference draws them; drawn on first use.
    occluders: Option<IdBuffer>,
    /// This frame's occluders from the cameras of earlier frames, and the drawables of those frames;
    /// likewise.
    stale: Option<Vec<(View, IdBuffer)>>,
}

impl<'f, S: Steps> Judge<'f, S> {
    fn new(frame: &'f CulledFrame<'f>, steps: S) -> Self {
        let level = |id: &DrawableId| {
            let drawable = frame.scene.drawables().get(id.index())?;
            Some((drawable.node, drawable.level(*id)))
        };
        let mut drawn: Vec<(u32, Level)> = frame.drawn.iter().filter_map(level).collect();
        drawn.sort_unstable_by_key(|(node, _)| *node);
        Self { frame, steps, drawn, occluders: None, stale: None }
    }

    fn judge(&mut self, missing: &[Missing]) -> Result<Vec<Cause>, S::Error> {
        missing.iter().map(|missing| self.cause(missing)).collect()
    }

    fn cause(&mut self, missing: &Missing) -> Result<Cause, S::Error> {
        let scene = self.frame.scene;
        let Some(drawable) = scene.drawables().get(missing.id.index()) else {
            return Ok(Cause::Unattributed);
        };
        let target = NodeId(drawable.node);
        if let Some(cause) = self.replaced(target, drawable.level(missing.id)) {
            return Ok(cause);
        }
        let node = scene.nodes().get(target.0 as usize);
        let slack = node.map_or(f64::NAN, |node| self.steps.slack(node));
        let surface = surface_of(missing, scene, self.frame.view, slack);
        let up: Vec<_> = scene.ancestors(target).collect();
        for (_, node) in up.into_iter().rev() {
            if let Some(cause) = self.step(node, &surface)? {
                return Ok(cause);
            }
        }
        if let Some((_, part)) = scene.part(missing.id).filter(|(drawable, _)| drawable.pieces > 1)
            && let Some(cause) = self.step(&part, &surface)?
        {
            return Ok(cause);
        }
        let arrived = self.frame.drawn.len() as u64;
        let lost = self.frame.sent.is_some_and(|sent| sent > arrived);
        Ok(if lost { Cause::LostIds } else { Cause::Unattributed })
    }

    /// Whether the node's level was replaced: by another of its levels, by an ancestor or by descendants.
    fn replaced(&self, target: NodeId, own: Level) -> Option<Cause> {
        let scene = self.frame.scene;
        let was_drawn = |node: NodeId| self.drawn.binary_search_by_key(&node.0, |(node, _)| *node).is_ok();
        if scene.ancestors(target).skip(1).any(|(above, _)| was_drawn(above)) {
            let rule = self.frame.rule.lod().stops_at_few_pixels();
            return Some(if rule { Cause::PixelCountRule } else { Cause::LevelMismatch });
        }
        let below = |&(node, level): &(u32, Level)| {
            level != own && scene.ancestors(NodeId(node)).any(|(above, _)| above == target)
        };
        self.drawn.iter().any(below).then_some(Cause::LevelMismatch)
    }

    /// The error at one node on the path down, if any.
    fn step(&mut self, node: &Node, surface: &[SurfacePoint]) -> Result<Option<Cause>, S::Error> {
        let prepared = if self.steps.outside(node) { Prepared::Outside } else { self.steps.prepare(node) };
        let test_box = match prepared {
            Prepared::Visible(_) => return Ok(None),
            Prepared::Outside => {
                let holds = self.holds(node, surface);
                return Ok(Some(if holds { Cause::OutsideFrustum } else { Cause::BoxTooSmall }));
            }
            Prepared::Test(test_box) => test_box,
        };
        if self.steps.shows(test_box)? {
            return Ok(None);
        }
        let near = f64::from(self.frame.view.camera().near());
        Ok(Some(if !(self.holds(node, surface) && self.box_holds(&test_box, surface)) {
            Cause::BoxTooSmall
        } else if nearest(&test_box) <= near {
            Cause::NearPlane
        } else {
            let bare = self.steps.bare(node).unwrap_or(test_box);
            self.hidden(&test_box, &bare, surface)
        }))
    }

    /// Why a box that contains the surface was found hidden; `bare` is the same without its half pixel.
    fn hidden(&mut self, test_box: &TestBox, bare: &TestBox, surface: &[SurfacePoint]) -> Cause {
        let tested =
            |point: &SurfacePoint| f64::from(self.frame.depth.get(point.pixel).copied().unwrap_or_default());
        let open: Vec<&SurfacePoint> =
            surface.iter().filter(|point| tested(point) <= point.depth * (1.0 + point.tolerance)).collect();
        if open.is_empty() {
            return self.covered(surface);
        }
        let covered = covered(self.frame.view, test_box);
        if !open.iter().any(|point| covered.contains_key(&point.pixel)) {
            return Cause::MissedSamples;
        }
        let fronts = self::covered(self.frame.view, bare);
        let CulledFrame { scene, view, bias_px, .. } = *self.frame;
        let occluders = self.occluders();
        let clearly = open.iter().any(|point| {
            let front = fronts.get(&point.pixel).map_or(point.depth, |front| front.max(point.depth));
            let bias = f64::from(bias_px) * occluders.slope(scene, view, point.pixel);
            front > (tested(point) + bias) * (1.0 + 2.0 * point.tolerance)
        });
        if clearly { Cause::TestHid } else { Cause::DepthTie }
    }

    /// Why the tested depth lies in front of the surface at all its pixels.
    fn covered(&mut self, surface: &[SurfacePoint]) -> Cause {
        let frame = self.frame;
        let occluders = self.occluders();
        let cut = LodCut::new(frame.scene, frame.view, frame.rule);
        let foreign = |point: &SurfacePoint| {
            let shown = occluders.ids().get(point.pixel).copied().flatten();
            let before = occluders.depth().get(point.pixel).is_some_and(|&depth| depth > point.depth);
            before && shown.is_some_and(|shown| !is_of_cut(frame.scene, &cut, shown.drawable))
        };
        if surface.iter().any(foreign) {
            return Cause::LevelMismatch;
        }
        let hidden = |point: &SurfacePoint| {
            let before = occluders.depth().get(point.pixel);
            before.is_some_and(|&depth| depth > point.depth * (1.0 + point.tolerance))
        };
        if !surface.is_empty() && surface.iter().all(hidden) {
            return Cause::HiddenInF64;
        }
        let draw = |view: &View, ids: &[DrawableId]| {
            rasterize(frame.scene, view, ids.iter().copied(), Placement::Exact)
        };
        let stale = self.stale.get_or_insert_with(|| {
            let moved = frame.before.iter().filter(|(view, _)| {
                view.viewport() == frame.view.viewport() && pose(view) != pose(frame.view)
            });
            moved
                .flat_map(|(view, drawn)| [drawn, frame.occluders].map(|ids| (*view, draw(view, ids))))
                .collect()
        });
        // At most points: along edges a device may round to another surface. The depth of a large triangle is
        // interpolated less precisely than the missing surface's own tolerance.
        let same = |(view, buffer): &(View, IdBuffer)| {
            let equal = |point: &&SurfacePoint| {
                let tested = frame.depth.get(point.pixel).copied().map(f64::from);
                let drawn = buffer.depth().get(point.pixel);
                drawn.zip(tested).is_some_and(|(drawn, tested)| {
                    // Devices may combine the slopes along x and y differently.
                    let bias = f64::from(frame.bias_px) * buffer.slope(frame.scene, view, point.pixel);
                    let (same, farther) = (tested * SAME_DEPTH, drawn - tested);
                    farther.abs() <= same || (bias - same..=bias * SQRT_2 + same).contains(&farther)
                })
            };
            surface.iter().filter(equal).count() * 2 > surface.len()
        };
        if stale.iter().any(same) { Cause::StaleCamera } else { Cause::OccluderTooNear }
    }

    fn occluders(&mut self) -> &IdBuffer {
        let CulledFrame { scene, view, occluders, .. } = *self.frame;
        let draw = || rasterize(scene, view, occluders.iter().copied(), Placement::Exact);
        self.occluders.get_or_insert_with(draw)
    }

    /// Whether the node's own boxes contain every point of the surface.
    fn holds(&self, node: &Node, surface: &[SurfacePoint]) -> bool {
        let view = self.frame.view;
        let (min, max) = node.world_box();
        let (local_min, local_max) = node.local_box();
        let linear = node.linear().as_dmat3();
        let to_local = (linear.determinant() != 0.0).then(|| linear.inverse());
        surface.iter().all(|point| {
            let slack = point.leeway(view);
            let from_eye = view.to_view().transpose() * point.place;
            let world = view.eye() + from_eye;
            let in_world = (min - slack).cmple(world).all() && world.cmple(max + slack).all();
            // A frame without thickness cannot be inverted; its world box must do.
            let in_local = to_local.is_none_or(|to_local| {
                let local = to_local * (world - node.origin());
                let slack = DVec3::from_array(
                    [to_local.row(0), to_local.row(1), to_local.row(2)].map(|row| row.length() * slack),
                );
                let (low, high) = (local_min.as_dvec3() - slack, local_max.as_dvec3() + slack);
                low.cmple(local).all() && local.cmple(high).all()
            });
            in_world && in_local
        })
    }

    /// Whether the tested box contains every point of the surface.
    fn box_holds(&self, test_box: &TestBox, surface: &[SurfacePoint]) -> bool {
        surface.iter().all(|point| {
            let offset = point.place - test_box.centre.as_dvec3();
            test_box.axes.map(Vec3::as_dvec3).iter().all(|axis| {
                axis.dot(offset).abs()
                    <= axis.length_squared() + axis.length() * point.leeway(self.frame.view)
            })
        })
    }
}

/// The position and orientation of a view.
fn pose(view: &View) -> ([f64; 3], [f64; 4]) {
    (view.camera().eye(), view.camera().orientation())
}

fn is_of_cut(scene: &Scene, cut: &LodCut<'_>, id: DrawableId) -> bool {
    let Some(drawable) = scene.drawables().get(id.index()) else { return false };
    scene.ancestors(NodeId(drawable.node)).all(|(at, node)| {
        let chosen = cut.choose(at, node);
        if at.0 == drawable.node {
            chosen == Choice::Draw(drawable.level(id))
        } else {
            chosen == Choice::Refine
        }
    })
}

/// The smallest depth in a box, metres.
fn nearest(test_box: &TestBox) -> f64 {
    let thickness: f64 = test_box.axes.iter().map(|axis| f64::from(axis.z.abs())).sum();
    -f64::from(test_box.centre.z) - thickness
}

/// The pixels that a box covers, with the reversed depth of its front.
fn covered(view: &View, test_box: &TestBox) -> HashMap<usize, f64> {
    let mut fronts = HashMap::new();
    for corners in triangles_of(test_box) {
        rasterize_triangle(view, corners, |hit| {
            let front = fronts.entry(hit.pixel).or_insert(hit.depth);
            *front = hit.depth.max(*front);
        });
    }
    fronts
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use trimaran_cull::Viewport;

    use super::*;
    use crate::cases::{Mesh, Object, build, looking};
    use crate::id_buffer::unproject;

    /// Steps with the same answer at every node.
    struct Told {
        outside: bool,
        prepared: Prepared,
        shows: bool,
    }

    impl Steps for Told {
        type Error = Infallible;

        fn outside(&self, _: &Node) -> bool {
            self.outside
        }

        fn prepare(&self, _: &Node) -> Prepared {
            self.prepared
        }

        fn shows(&mut self, _: TestBox) -> Result<bool, Infallible> {
            Ok(self.shows)
        }

        fn bare(&self, _: &Node) -> Option<TestBox> {
            None
        }

        fn slack(&self, _: &Node) -> f64 {
            1e-6
        }
    }

    /// A plate 0.5 m high and wide, 4 m ahead, at about 10 x 10 pixels: the missing drawable.
    struct Plate {
        scene: Scene,
        view: View,
        missing: Missing,
        truth: IdBuffer,
    }

    impl Plate {
        fn new() -> Self {
            let plate = Mesh::rectangle(Vec3::Y * 4.0, Vec3::X * 0.25, Vec3::Z * 0.25, 1);
            let scene = build(&[Object::new(plate)], false).unwrap();
            let view = looking(DVec3::ZERO, DVec3::Y, 60.0, Viewport::new(96, 96).unwrap(), 0).unwrap();
            let id = DrawableId(0);
            let truth = rasterize(&scene, &view, [id], Placement::Exact);
            let pixels = (0..truth.ids().len()).filter(|&p| truth.ids()[p].is_some()).collect();
            Self { scene, view, missing: Missing { id, pixels }, truth }
        }

        /// A box about the plate, thicker and larger by this to each side, metres.
        fn grown(&self, more: f32) -> Prepared {
            let axes = [Vec3::X * (0.25 + more), Vec3::Y * (0.25 + more), Vec3::Z * more];
            Prepared::Test(TestBox { centre: Vec3::NEG_Z * 4.0, axes })
        }

        /// The cause if the occlusion test answers `shows`, and the tested depth is `nearer` times the
        /// plate's at its pixels.
        fn cause(&self, outside: bool, prepared: Prepared, shows: bool, nearer: f64) -> Cause {
            let depth: Vec<f32> = self.truth.depth().iter().map(|d| (d * nearer) as f32).collect();
            self.cause_of(Told { outside, prepared, shows }, &depth, Some(0), &self.missing)
        }

        fn cause_of(&self, told: Told, depth: &[f32], sent: Option<u64>, missing: &Missing) -> Cause {
            let frame = CulledFrame {
                scene: &self.scene,
                view: &self.view,
                rule: &trimaran_cull::LodRule::new(1.0).unwrap().into(),
                occluders: &[DrawableId(0)],
                depth,
                sent,
                drawn: &[],
                bias_px: 0.0,
                before: &[],
            };
            Judge::new(&frame, told).judge(std::slice::from_ref(missing)).unwrap()[0]
        }
    }

    #[test]
    fn each_step_that_goes_wrong_is_named() {
        let plate = Plate::new();
        assert_eq!(plate.missing.pixels.len(), 100);
        let right = plate.grown(1e-6);
        assert_eq!(plate.cause(true, right, true, 0.0), Cause::OutsideFrustum);
        assert_eq!(plate.cause(false, Prepared::Outside, true, 0.0), Cause::OutsideFrustum);
        assert_eq!(plate.cause(false, plate.grown(-0.05), false, 0.0), Cause::BoxTooSmall);
        assert_eq!(plate.cause(false, plate.grown(5.0), false, 0.0), Cause::NearPlane);
        assert_eq!(plate.cause(false, right, false, 0.0), Cause::TestHid);
        assert_eq!(plate.cause(false, right, false, 0.99), Cause::TestHid);
        assert_eq!(plate.cause(false, plate.grown(0.01), false, 1.0), Cause::TestHid);
        assert_eq!(plate.cause(false, right, false, 1.0), Cause::DepthTie);
        assert_eq!(plate.cause(false, right, false, 1.01), Cause::OccluderTooNear);
        assert_eq!(plate.cause(false, right, true, 1.0), Cause::Unattributed);
    }

    #[test]
    fn a_box_between_the_samples_is_named() {
        let plate = Plate::new();
        let pixel = plate.missing.pixels[0];
        let missing = Missing { id: DrawableId(0), pixels: vec![pixel] };
        let place = unproject(&plate.view, pixel, plate.truth.depth()[pixel]);
        let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * 1e-5);
        let prepared = Prepared::Test(TestBox { centre: place.as_vec3(), axes });
        let told = Told { outside: false, prepared, shows: false };
        assert_eq!(plate.cause_of(told, &[], None, &missing), Cause::MissedSamples);
    }

    #[test]
    fn an_id_that_was_sent_and_not_drawn_is_lost() {
        let plate = Plate::new();
        let told = || Told { outside: false, prepared: plate.grown(0.01), shows: true };
        assert_eq!(plate.cause_of(told(), &[], Some(1), &plate.missing), Cause::LostIds);
        assert_eq!(plate.cause_of(told(), &[], None, &plate.missing), Cause::Unattributed);
    }

    #[test]
    fn a_surface_is_found_again_from_its_depth() {
        let plate = Plate::new();
        for &pixel in &plate.missing.pixels {
            let place = unproject(&plate.view, pixel, plate.truth.depth()[pixel]);
            assert!((place.z + 4.0).abs() < 1e-9 && place.x.abs() < 0.25 && place.y.abs() < 0.25, "{place}");
        }
    }
}
