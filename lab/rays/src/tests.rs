use std::{
    collections::{BTreeMap, BTreeSet, HashSet},
    f64::consts::FRAC_PI_4,
    sync::Mutex,
};

use glam::{DVec2, DVec3, DVec4, Mat3, Vec3};
use trimaran_audit::{
    Placement,
    cases::{Mesh, Object, build, hard_cases, looking, plant, plant_views, with_records},
    rasterize,
};
use trimaran_cull::{LodRule, Viewport};
use trimaran_proto::{ObjectSet, Section, SectionPlane, Sections, Settings, ViewState};
use trimaran_scene::{Drawable, Level, Sides};

use super::*;

/// The result of rays for a frame.
struct Found {
    solid: Vec<DrawableId>,
    ids: BTreeSet<DrawableId>,
    /// The hits at each pixel: several if surfaces coincide.
    items: Vec<BTreeSet<DrawableId>>,
    counts: CullCounts,
}

fn cast(rays: &mut Rays, view: &View, rule: impl Into<CutRule>) -> Found {
    let (rule, mut found) = (rule.into(), Vec::new());
    let solid = rays.place(view, &rule).to_vec();
    let counts = rays.cast(view, &mut found);
    let pixels = view.viewport().width() as usize * view.viewport().height() as usize;
    let items = Mutex::new(vec![BTreeSet::new(); pixels]);
    rays.placed.cast(view, |pixel, index| {
        items.lock().unwrap()[pixel].insert(solid[index as usize]);
    });
    Found { ids: found.into_iter().collect(), items: items.into_inner().unwrap(), solid, counts }
}

fn lod(epsilon_px: f64) -> LodRule {
    LodRule::new(epsilon_px).unwrap()
}

fn small() -> Viewport {
    Viewport::new(96, 80).unwrap()
}

fn scene(objects: &[Object]) -> Arc<Scene> {
    Arc::new(build(objects, false).unwrap())
}

/// A unit crate at a place.
fn crate_at(x: f64, y: f64, z: f64) -> Object {
    Object::new(Mesh::cuboid(Vec3::splat(-0.5), Vec3::splat(0.5), 2)).at(DVec3::new(x, y, z))
}

/// From 5 metres off towards the origin, along y.
fn along_y(from: f64) -> View {
    looking(DVec3::Y * from, DVec3::ZERO, 60.0, small(), 0).unwrap()
}

/// The largest distance of a ray from a pixel's centre that still counts as the pixel's, and the relative
/// depth tolerance of hits. f32 is better than the first.
const BESIDE_PX: f64 = 1e-3;
const NEARER: f64 = 2e-6;

/// The possible first hits of a ray at a place of the picture, computed in f64 from every triangle.
fn hit_exactly(scene: &Scene, view: &View, ids: &[DrawableId], place: DVec2) -> BTreeSet<DrawableId> {
    let size = DVec2::new(f64::from(view.viewport().width()), f64::from(view.viewport().height()));
    let ray = ((place - size * 0.5) / DVec2::new(view.focal_x(), -view.focal_y())).extend(-1.0);
    let planes: Vec<DVec4> = view.section_planes().collect();
    let mut hits = Vec::new();
    for id in ids {
        let drawable = &scene.drawables()[id.index()];
        let node = &scene.nodes()[drawable.node as usize];
        let (linear, origin) = (view.to_view() * node.linear().as_dmat3(), view.world_to_view(node.origin()));
        for corners in scene.triangles(drawable) {
            let [a, b, c] = corners.map(|corner| origin + linear * corner.as_dvec3());
            // Inside, the ray passes all edges on the same side.
            let sides = [a.cross(b), b.cross(c), c.cross(a)].map(|normal| normal.dot(ray));
            let normal = (b - a).cross(c - a);
            let distance = normal.dot(a) / normal.dot(ray);
            let kept = planes.iter().all(|plane| plane.dot((ray * distance).extend(1.0)) >= 0.0);
            let inside = sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0);
            if inside && kept && distance.is_finite() && distance >= f64::from(view.camera().near()) {
                hits.push((distance, *id));
            }
        }
    }
    let first = hits.iter().map(|(distance, _)| *distance).fold(f64::INFINITY, f64::min);
    hits.retain(|(distance, _)| *distance <= first * (1.0 + NEARER));
    hits.into_iter().map(|(_, id)| id).collect()
}

/// Drawables with at least this many pixels must be found, counting those where a ray in f64 hits them too:
/// at edges the rasterizer snaps corners to its grid. Fewer may all be at edges.
const ENOUGH_PX: usize = 4;

/// Checks the rays against the reference rasterizer. At each pixel they hit the rasterized drawable, or if
/// that differs, a possible hit of a ray in f64.
fn check(name: &str, scene: &Scene, view: &View, found: &Found) {
    let reference = rasterize(scene, view, found.solid.iter().copied(), Placement::Exact);
    let mut owned = BTreeMap::<DrawableId, usize>::new();
    let width = view.viewport().width() as usize;
    for (pixel, (hit, shown)) in found.items.iter().zip(reference.ids()).enumerate() {
        let shown: BTreeSet<DrawableId> = shown.iter().map(|shown| shown.drawable).collect();
        if *hit == shown {
            shown.iter().for_each(|id| *owned.entry(*id).or_default() += 1);
        } else {
            let centre = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let exactly = |o: DVec2| hit_exactly(scene, view, &found.solid, centre + o * BESIDE_PX);
            let at_centre = exactly(DVec2::ZERO);
            // Counted where a ray in f64 shows it as well, and not the rasterizer's grid alone.
            at_centre.intersection(&shown).for_each(|id| *owned.entry(*id).or_default() += 1);
            let around = (0..8).map(|eighth| DVec2::from_angle(f64::from(eighth) * FRAC_PI_4));
            let mut exact = std::iter::once(at_centre).chain(around.map(exactly));
            // Where two pieces of a level meet, either may be hit.
            let level = |id: &DrawableId| scene.drawables()[id.index()].level(*id);
            let mut unfound: HashSet<Level> = hit.iter().map(level).collect();
            let sound = exact.any(|hits| {
                let found: HashSet<Level> = hits.iter().map(level).collect();
                unfound.retain(|level| !found.contains(level));
                if hit.is_empty() { hits.is_empty() } else { unfound.is_empty() }
            });
            assert!(sound, "{name}: {unfound:?} of {hit:?} at {centre}, which shows {shown:?}");
        }
    }
    for (id, pixels) in owned {
        assert!(found.ids.contains(&id) || pixels < ENOUGH_PX, "{name}: {id} with {pixels} pixels is lost");
    }
    let hit: BTreeSet<DrawableId> = found.items.iter().flatten().copied().collect();
    assert_eq!(found.ids, hit, "{name}");
}

#[test]
fn rays_find_what_the_reference_shows_of_a_plant() {
    let mut hidden = 0;
    for (seed, size) in [(21, small()), (22, Viewport::new(161, 91).unwrap())] {
        let mut rays = Rays::new(&plant(seed, 300, DVec3::ZERO).unwrap());
        for view in plant_views(seed, 300, DVec3::ZERO, size, 30).unwrap() {
            for epsilon in [0.5, 6.0] {
                let found = cast(&mut rays, &view, lod(epsilon));
                check("plant", &rays.scene, &view, &found);
                hidden += found.counts.hidden as usize;
                assert_eq!(found.counts.hidden as usize, found.solid.len() - found.ids.len());
            }
        }
    }
    assert!(hidden > 2000, "{hidden}");
}

#[test]
fn rays_find_what_the_reference_shows_in_the_hard_cases() {
    for case in hard_cases().unwrap() {
        let mut rays = Rays::new(&case.scene);
        let mut views = case.views;
        views.dedup(); // some stand still
        for view in &views {
            let found = cast(&mut rays, view, lod(1.0));
            check(case.name, &case.scene, view, &found);
        }
    }
}

#[test]
fn an_empty_cut_shows_nothing() {
    let mut rays = Rays::new(&scene(&[crate_at(0.0, 9.0, 0.0)]));
    let away = looking(DVec3::ZERO, DVec3::NEG_Y, 60.0, small(), 0).unwrap();
    let found = cast(&mut rays, &away, lod(1.0));
    assert!(found.solid.is_empty() && found.ids.is_empty());
    assert!(found.items.len() == 96 * 80 && found.items.iter().all(BTreeSet::is_empty));
    assert_eq!(found.counts, CullCounts::default());
}

#[test]
fn far_from_the_origin_rays_hit_the_same_at_every_pixel() {
    let items = |origin: DVec3| {
        let mut rays = Rays::new(&plant(5, 120, origin).unwrap());
        let views = plant_views(5, 120, origin, small(), 5).unwrap();
        views.iter().map(|view| cast(&mut rays, view, lod(1.0)).items).collect::<Vec<_>>()
    };
    let near = items(DVec3::ZERO);
    assert!(near.iter().flatten().flatten().count() > 5000);
    assert_eq!(items(DVec3::new(1e6, -1e6, 5e5)), near);
}

#[test]
fn of_solids_the_front_alone_is_hit_however_they_are_turned() {
    let turned_round = Mat3::from_rotation_z(std::f32::consts::PI);
    for (linear, faces_back) in [
        (Mat3::IDENTITY, false),
        (Mat3::from_diagonal(Vec3::new(-1.0, 1.0, 1.0)), false),
        (Mat3::from_diagonal(Vec3::new(3.0, 1.0, 2.0)), false),
        (Mat3::from_diagonal(Vec3::new(1e3, 1.0, 1.0)), false),
        (Mat3::from_diagonal(Vec3::new(-1e3, 1.0, 1.0)), false),
        (Mat3::from_diagonal(Vec3::splat(1e-12)), false),
        (Mat3::from_diagonal(Vec3::splat(1e12)), false),
        (turned_round, true),
        (turned_round * Mat3::from_diagonal(Vec3::new(1.0, 1.0, -1e3)), true),
    ] {
        // It faces -y, unless it is turned round.
        let sides = (Vec3::X / linear.x_axis.length(), Vec3::Z / linear.z_axis.length());
        let square = Object::new(Mesh::rectangle(Vec3::ZERO, sides.0, sides.1, 1)).turned(linear);
        let square = build(&[square], false).unwrap();
        let hits = |sides: Sides, view: &View| {
            let drawables = square.drawables().iter().map(|drawable| Drawable { sides, ..*drawable });
            let scene = with_records(&square, square.nodes().to_vec(), drawables.collect()).unwrap();
            !cast(&mut Rays::new(&Arc::new(scene)), view, lod(1.0)).ids.is_empty()
        };
        // Above the square's middle.
        let plane = Section::Plane(SectionPlane::new([0.0, 0.0, 0.1], [0.0, 0.0, 1.0]).unwrap());
        let cut_open = Sections::new(&[plane]).unwrap();
        for (from, shows) in [(-5.0, !faces_back), (5.0, faces_back)] {
            let view = along_y(from);
            assert_eq!(hits(Sides::FRONT, &view), shows, "{linear} from {from}");
            assert!(hits(Sides::BOTH, &view) && hits(Sides::FRONT, &view.with_sections(cut_open)));
        }
    }
}

#[test]
fn triangles_without_an_area_hide_and_show_nothing() {
    let corner = |x: f32, z: f32| Vec3::new(x, 0.0, z);
    // A point, one twice over, a line, and a line there and back; then one with an area, two thousand times.
    let positions = vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(2.0, 0.0), corner(0.0, 1.0)];
    let flat = [0, 0, 0, 1, 1, 2, 0, 1, 2, 0, 3, 0];
    let nothing = Mesh { positions: positions.clone(), indices: flat.to_vec() };
    let indices = flat.into_iter().chain([0, 1, 3].repeat(2000)).collect();
    let something = Object::new(Mesh { positions, indices }).at(DVec3::new(0.0, 1.0, 0.0));
    let mut rays = Rays::new(&scene(&[Object::new(nothing), something]));
    for from in [-5.0, 5.0] {
        let found = cast(&mut rays, &along_y(from), lod(1.0));
        assert_eq!((found.solid.len(), found.ids.len()), (2, 1));
        check("without an area", &rays.scene, &along_y(from), &found);
    }
}

#[test]
fn what_a_section_cuts_away_neither_shows_nor_hides() {
    let mut rays = Rays::new(&plant(23, 300, DVec3::ZERO).unwrap());
    let (mut cut_away, mut kept) = (0, 0);
    for view in plant_views(23, 300, DVec3::ZERO, small(), 26).unwrap() {
        let uncut = cast(&mut rays, &view, lod(1.0));
        // Cuts away the left half of the view, and everything near.
        let ahead = view.to_view().transpose() * DVec3::NEG_Z;
        let left = view.to_view().transpose() * DVec3::NEG_X;
        let planes = [(view.eye() + ahead, -ahead), (view.eye(), left)].map(|(location, direction)| {
            Section::Plane(SectionPlane::new(location.to_array(), direction.to_array()).unwrap())
        });
        let view = view.with_sections(Sections::new(&planes).unwrap());
        let found = cast(&mut rays, &view, lod(1.0));
        check("section", &rays.scene, &view, &found);
        for (pixel, (item, before)) in found.items.iter().zip(&uncut.items).enumerate() {
            assert!(item.is_empty() || pixel % 96 >= 48, "left of the plane");
            cut_away += usize::from(item != before);
            kept += usize::from(!item.is_empty() && item == before);
        }
    }
    assert!(cut_away > 100_000 && kept > 10_000, "{cut_away} {kept}");
}

#[test]
fn what_is_seen_through_is_found_and_hides_nothing() {
    let row = [crate_at(0.0, -2.0, 0.0), crate_at(0.0, 0.0, 0.0), crate_at(0.0, 2.0, 0.0)];
    let mut rays = Rays::new(&scene(&row));
    let state = ViewState {
        see_through: Some(ObjectSet::from_iter([0, 2])),
        ..Settings::new(small(), lod(1.0)).into()
    };
    let rule = CutRule::new(&rays.scene, &state);
    let found = cast(&mut rays, &along_y(-5.0), rule);
    assert_eq!((found.solid.len(), found.ids.len()), (1, 3));
    assert!(found.items.contains(&[found.solid[0]].into()), "the middle one, past the first");
    assert_eq!(found.counts.emitted, 3);
}

#[test]
fn of_two_in_the_same_place_both_are_hit() {
    let turn = Mat3::from_rotation_y(0.4) * Mat3::from_rotation_z(0.7);
    let twice = [0.5, 2.0].map(|size| {
        let mesh = Mesh::cuboid(Vec3::splat(-size), Vec3::splat(size), 3);
        Object::new(mesh).at(DVec3::new(0.3, 0.0, 0.1)).turned(turn * (0.7 / size))
    });
    let mut rays = Rays::new(&scene(&twice));
    let found = cast(&mut rays, &along_y(-5.0), lod(1.0));
    assert_eq!(found.ids.len(), 2);
    check("in the same place", &rays.scene, &along_y(-5.0), &found);
    let hits: Vec<usize> = found.items.iter().map(BTreeSet::len).collect();
    assert!(hits.iter().filter(|hits| **hits == 2).count() > 500 && !hits.contains(&1), "{hits:?}");
}

#[test]
fn what_is_too_large_for_f32_is_found_untested() {
    let far = crate_at(0.0, 1e13, 0.0);
    let mut rays = Rays::new(&scene(&[crate_at(0.0, 0.0, 0.0), far]));
    let found = cast(&mut rays, &along_y(-5.0), lod(1.0));
    assert_eq!((found.solid.len(), found.ids.len()), (2, 2));
    assert_eq!((found.counts.tested, found.counts.not_finite, found.counts.hidden), (1, 1, 0));
}
