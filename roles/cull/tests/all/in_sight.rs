//! Drawables removed because a narrower picture does not show them.

use std::collections::BTreeSet;

use glam::DVec3;
use trimaran_audit::{
    Placement,
    cases::{plant, plant_views},
    rasterize,
};
use trimaran_cull::{LodRule, View, Viewport, draw_order, lod_cut, retain_in_sight};
use trimaran_proto::{Camera, DrawableId, FrameNumber};

/// The same eye with half of the field of view.
fn narrower(view: &View) -> View {
    let camera = view.camera();
    let tan = camera.tan_half_fov_y() / 2.0;
    let camera = Camera::new(camera.eye(), camera.orientation(), tan, camera.near(), FrameNumber(0));
    View::new(camera.unwrap(), view.viewport())
}

#[test]
fn all_that_a_narrower_picture_shows_stays_and_much_else_goes() {
    // At survey coordinates as well.
    for origin in [DVec3::ZERO, DVec3::new(6e6, 40.0, -5e5)] {
        let scene = plant(3, 400, origin).unwrap();
        let views = plant_views(3, 400, origin, Viewport::new(96, 64).unwrap(), 6).unwrap();
        let (mut kept, mut all) = (0, 0);
        for wide in views {
            let mut wider = lod_cut(&scene, &wide, LodRule::new(2.0).unwrap());
            let narrow = narrower(&wide);
            draw_order(&scene, &narrow, &mut wider);
            let mut ids = wider.clone();
            retain_in_sight(&scene, &narrow, &mut ids);
            assert!(ids.is_sorted_by_key(|id| wider.iter().position(|other| other == id)), "in order");
            let picture = |ids: &[DrawableId]| rasterize(&scene, &narrow, ids.to_vec(), Placement::Single);
            assert_eq!(picture(&ids).ids(), picture(&wider).ids());
            (kept, all) = (kept + ids.len(), all + wider.len());
            let known = BTreeSet::from_iter(&wider);
            assert!(ids.iter().all(|id| known.contains(id)));
        }
        assert!(kept * 4 < all * 3, "{kept} of {all}");
    }
}
