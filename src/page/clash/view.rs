//! A view of a clash: both objects solid, all others ghosts, and the distance between them.
//!
//! It is the text behind `#v=` in a page's address: bytes of postcard in base64, as in
//! `roles/page/src/tools/viewpoint.ts`.

use base64::{Engine as _, engine::general_purpose::URL_SAFE_NO_PAD};
use glam::DVec3;
use serde::Serialize;
use trimaran_proto::{LodRule, ObjectSet, OcclusionTestKind, Sections, ViewState, Viewport};
use trimaran_scene::{Scene, clearance::Clearance};

/// Its version, as the page has it.
const VERSION: u8 = 3;
/// The most bytes of a scene's name.
const LONGEST_NAME: usize = 100;
const VFOV_DEG: f64 = 60.0;
/// The gap between two objects takes at most this share of the picture's height.
const GAP: f64 = 0.25;
/// The smaller object takes this share, so that it is recognized by what is around it.
const SMALLER: f64 = 1.0 / 3.0;
/// Where the eye is without a gap: obliquely above.
const OBLIQUE: DVec3 = DVec3::new(0.6, 0.5, 0.62);
/// The least distance of the eye, metres.
const NEAREST: f64 = 0.05;

/// An eye that sees a clash.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClashCamera {
    /// Metres in the world, y up.
    pub eye: [f64; 3],
    /// The viewing direction, a unit vector.
    pub forward: [f64; 3],
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
}

impl ClashCamera {
    /// It looks at the middle of the closest points, across the gap and from above. It is so far away that
    /// the smaller of the objects takes a third of the picture.
    pub(super) fn of(scene: &Scene, clash: &Clearance) -> Self {
        let [from, to] = clash.points;
        let size = |object: u32| {
            let (min, max) = scene
                .objects()
                .get(object as usize)
                .and_then(|of| scene.nodes().get(of.node as usize))
                .map(trimaran_scene::Node::world_box)
                .unwrap_or_default();
            min.distance(max)
        };
        let [first, second] = clash.objects.map(size);
        let width = (first.min(second) / SMALLER).max(clash.distance / GAP);
        let across = (to - from).try_normalize().map(|gap| OBLIQUE.reject_from_normalized(gap));
        let towards = across.and_then(DVec3::try_normalize).unwrap_or(OBLIQUE.normalize());
        let away = (width / 2.0 / (VFOV_DEG.to_radians() / 2.0).tan()).max(NEAREST);
        let eye = (from + to) / 2.0 + towards * away;
        Self { eye: eye.to_array(), forward: (-towards).to_array(), vfov_deg: VFOV_DEG }
    }
}

/// The fields of a viewpoint, in the page's order.
#[derive(Serialize)]
struct Viewpoint<'v> {
    version: u8,
    fingerprint: [u8; 16],
    name: &'v str,
    mode: Mode,
    eye: [f64; 3],
    forward: [f64; 3],
    vfov_deg: f64,
    distances: Vec<[End; 2]>,
    view: ViewState,
}

/// How one moves in the page, by its number.
#[derive(Serialize)]
#[expect(dead_code, reason = "the numbers of the others keep that of orbit")]
enum Mode {
    Walk,
    Fly,
    Orbit,
}

/// An end of a distance, and its error.
#[derive(Serialize)]
struct End {
    point: [f64; 3],
    error: Option<f64>,
}

/// The text of a view, which a page's address takes behind `#v=`. `scene_name` names the model for people
/// who open it with another one.
pub(super) fn link(scene: &Scene, scene_name: &str, clash: &Clearance, camera: &ClashCamera) -> String {
    text(scene.hash().0, scene_name, scene.objects().len() as u32, clash, camera)
}

/// The same for a scene with this fingerprint and so many objects.
fn text(fingerprint: u128, scene_name: &str, count: u32, clash: &Clearance, camera: &ClashCamera) -> String {
    let [first, second] = clash.objects;
    let (low, high) = (first.min(second), first.max(second));
    // Runs of numbers around the two objects, as gaps and lengths less one.
    let runs = [0..low, low + 1..high, high + 1..count];
    let mut coded = Vec::new();
    let mut least = 0;
    for run in runs.into_iter().filter(|run| !run.is_empty()) {
        coded.push((run.start - least, run.end - run.start - 1));
        least = run.end + 1;
    }
    let ghosts = ObjectSet::try_from(coded).unwrap_or_default();
    // Each page has its own size and error bound.
    let Ok(lod) = LodRule::new(1.0) else { return String::new() };
    let view = ViewState {
        viewport: Viewport::LARGEST,
        lod,
        occlusion_test: OcclusionTestKind::Hzb,
        sections: Sections::NONE,
        hidden: ObjectSet::default(),
        isolated: None,
        see_through: Some(ghosts),
    };
    let end = |point: DVec3| End { point: point.to_array(), error: Some(clash.rounding / 2.0) };
    let viewpoint = Viewpoint {
        version: VERSION,
        fingerprint: fingerprint.to_le_bytes(),
        name: scene_name.get(..scene_name.floor_char_boundary(LONGEST_NAME)).unwrap_or_default(),
        mode: Mode::Orbit,
        eye: camera.eye,
        forward: camera.forward,
        vfov_deg: camera.vfov_deg,
        distances: vec![clash.points.map(end)],
        view,
    };
    // Numbers and a short text always fit.
    postcard::to_stdvec(&viewpoint).map(|bytes| URL_SAFE_NO_PAD.encode(bytes)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use trimaran_audit::cases::{Mesh, Object, build};

    use super::*;

    fn boxes() -> Scene {
        let cube = |half: f32, at: f64| {
            Object::new(Mesh::cuboid(Vec3::splat(-half), Vec3::splat(half), 1)).at(DVec3::X * at)
        };
        build(&[cube(0.5, 0.0), cube(0.5, 9.0), cube(0.25, 1.0), cube(0.5, 12.0)], true).unwrap()
    }

    fn clash(objects: [u32; 2], points: [[f64; 3]; 2]) -> Clearance {
        let points = points.map(DVec3::from_array);
        Clearance { objects, distance: points[0].distance(points[1]), points, rounding: 1e-6 }
    }

    #[test]
    fn the_eye_looks_across_the_gap_from_above() {
        let clash = clash([0, 2], [[0.5, 0.1, 0.0], [0.75, 0.1, 0.0]]);
        let camera = ClashCamera::of(&boxes(), &clash);
        let (eye, forward) = (DVec3::from_array(camera.eye), DVec3::from_array(camera.forward));
        assert!(forward.is_normalized() && forward.x.abs() < 1e-12 && forward.y < 0.0, "{forward}");
        let middle = DVec3::new(0.625, 0.1, 0.0);
        // The diagonal of a cube of half a metre takes a third of 60 degrees.
        assert!((eye.distance(middle) - 2.25).abs() < 1e-6, "{eye}");
        assert!((middle - eye).normalize().distance(forward) < 1e-12);
    }

    /// A gap along the oblique direction, none at all, and a gap far larger than the objects.
    #[test]
    fn there_is_always_an_eye() {
        let along = OBLIQUE.to_array();
        for points in [[[0.0; 3], along], [[1e7; 3]; 2], [[0.0; 3], [500.0, 0.0, 0.0]]] {
            let clash = clash([0, 1], points);
            let camera = ClashCamera::of(&boxes(), &clash);
            let forward = DVec3::from_array(camera.forward);
            assert!(DVec3::from_array(camera.eye).is_finite() && forward.is_normalized(), "{camera:?}");
        }
        let clash = clash([0, 1], [[0.0; 3], [500.0, 0.0, 0.0]]);
        let away = DVec3::from_array(ClashCamera::of(&boxes(), &clash).eye).distance(DVec3::X * 250.0);
        // The gap takes a quarter of the height.
        assert!((away - 1000.0 * 3_f64.sqrt()).abs() < 1e-6, "the whole gap shows: {away}");
        // Objects without a size.
        let clash = self::clash([90, 91], [[0.0; 3]; 2]);
        let away = DVec3::from_array(ClashCamera::of(&boxes(), &clash).eye).length();
        assert!((away - 0.05).abs() < 1e-12, "{away}");
    }

    /// The page's own test reads the same text: `roles/page/tests/clearance.test.ts`.
    #[test]
    fn a_link_is_what_the_page_reads() {
        let clash = clash([2, 0], [[0.75, 0.0, 0.0], [0.5, 0.0, 0.0]]);
        let camera = ClashCamera { eye: [1.0, 2.0, 3.0], forward: [0.0, 0.0, -1.0], vfov_deg: 60.0 };
        assert_eq!(text(1, "boxes", 4, &clash, &camera), LINK);
        let scene = boxes();
        let link = |name: &str| link(&scene, name, &clash, &camera);
        assert_eq!(link("boxes"), text(scene.hash().0, "boxes", 4, &clash, &camera));
        assert!(link(&"å".repeat(80)).len() < 400);
    }

    const LINK: &str = concat!(
        "AwEAAAAAAAAAAAAAAAAAAAAFYm94ZXMCAAAAAAAA8D8AAAAAAAAAQAAAAAAAAAhAAAAAAAAAAAAAAAAAAAAAAAAAAA",
        "AAAPC_AAAAAAAATkABAAAAAAAA6D8AAAAAAAAAAAAAAAAAAAAAAY3ttaD3xqA-AAAAAAAA4D8AAAAAAAAAAAAAAAAA",
        "AAAAAY3ttaD3xqA-gIAEgIAEAAAAAAAA8D8AAgAAAAECAQAAAA"
    );
}
