//! Traversals with little room: for the tree, and for the lists.

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{CutRule, LodRule, OcclusionTest as _, Viewport, WholeTraversal};

use super::{FIRST_CAPACITY, TreeBudget};
use crate::common::{CheckedGpu, lacks_float64};
use crate::{GpuScene, OccluderPass};

type Found = Option<WholeTraversal>;

/// The traversals of a walk through a plant, each ascending, with a tree and lists of these sizes at first.
/// Then the most submissions that a frame took, and the size of the lists at the end.
fn walk(gpu: &CheckedGpu, budget: Option<TreeBudget>, capacity: u32) -> (Vec<Found>, u64, u32) {
    let (seed, objects, size) = (7, 800, Viewport::new(160, 120).unwrap());
    let scene = plant(seed, objects, DVec3::ZERO).unwrap();
    let on_device = GpuScene::new(gpu, &scene).unwrap();
    if let Some(budget) = budget {
        on_device.limit_tree(budget);
    }
    let mut pass = OccluderPass::new(&on_device, size).unwrap();
    let rule = CutRule::from(LodRule::new(1.0).unwrap());
    let (mut found, mut most) = (Vec::new(), 0);
    let views = plant_views(seed, objects, DVec3::ZERO, size, 30).unwrap();
    pass.begin(&views[0]).unwrap();
    pass.hzb_test().unwrap().traversal().capacity = capacity;
    for view in views {
        pass.begin(&view).unwrap();
        pass.draw(&[]).unwrap();
        let before = pass.pass.over_depth().unwrap().stream.submissions();
        let mut whole = pass.hzb_test().unwrap().traverse(&view, &rule).unwrap();
        most = most.max(pass.pass.over_depth().unwrap().stream.submissions() - before);
        whole.iter_mut().for_each(|whole| whole.visible.sort_unstable());
        found.push(whole);
    }
    let capacity = pass.hzb_test().unwrap().traversal().capacity;
    (found, most, capacity)
}

/// Pages that are absent are brought, and dropped where there is no room, and lists grow. The results are
/// those of enough room.
#[test]
fn a_traversal_with_little_room_gives_the_same_after_more_submissions() {
    let Some(gpu) = CheckedGpu::open() else { return };
    if lacks_float64(&gpu) {
        return;
    }
    let (expected, with_room, capacity) = walk(&gpu, None, FIRST_CAPACITY);
    let visible: usize = expected.iter().flatten().map(|whole| whole.visible.len()).sum();
    assert!(visible > 2000 && capacity == FIRST_CAPACITY, "{visible} drawables");
    // Room for four pages of nodes.
    let (found, cramped, _) = walk(&gpu, Some(TreeBudget(4 * 64 * 168)), FIRST_CAPACITY);
    assert_eq!(found, expected);
    assert!(cramped > with_room, "{cramped} submissions, {with_room} with room");
    let (found, _, grown) = walk(&gpu, None, 2);
    assert_eq!(found, expected);
    assert!(grown > 2 && grown < FIRST_CAPACITY, "lists of {grown}");
    // One page of each does not suffice where a node's drawables stand in two: the host culls then.
    let (found, ..) = walk(&gpu, Some(TreeBudget(1)), FIRST_CAPACITY);
    let done = found.iter().zip(&expected).filter(|(found, _)| found.is_some());
    assert!(done.clone().count() < found.len() && done.clone().all(|(found, expected)| found == expected));
}
