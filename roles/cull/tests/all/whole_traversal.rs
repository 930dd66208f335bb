//! Occlusion tests that traverse the tree by themselves, and the comparison with one that asks box by box.

use std::convert::Infallible;
use std::sync::Arc;

use glam::DVec3;
use trimaran_audit::cases::{plant, plant_views};
use trimaran_cull::{
    CullError, Culler, CutRule, LodRule, NoOccluders, OcclusionTest, StepCounts, TestBox, View, Viewport,
    WholeTraversal, lod_cut,
};
use trimaran_proto::DrawableId;
use trimaran_scene::{Scene, SceneArrays};

use crate::pieces::{square, view};

/// Without occluders, with a traversal of its own.
struct Own(WholeTraversal);

impl OcclusionTest for Own {
    type Error = Infallible;

    fn test(&mut self, view: &View, boxes: &[TestBox], visible: &mut Vec<u32>) -> Result<(), Infallible> {
        NoOccluders.test(view, boxes, visible)
    }

    fn traverse(&mut self, _: &View, _: &CutRule) -> Result<Option<WholeTraversal>, Infallible> {
        Ok(Some(self.0.clone()))
    }

    fn is_checked(&self) -> bool {
        true
    }
}

/// Two nodes that show, one of them in two pieces: the other one waits for these.
#[test]
fn a_traversal_of_the_tests_own_gives_its_ids_step_by_step_and_ascending() {
    let step = StepCounts { visited: 2, tested: 1, whole: 1, in_pieces: 1, refined: 1, ..Default::default() };
    let pieces = StepCounts { visited: 2, tested: 2, pieces: 1, hidden: 1, ..Default::default() };
    let untested = StepCounts { eye_inside: 1, near_visible: 2, not_finite: 3, ..Default::default() };
    let last = StepCounts { visited: 3, outside: 1, whole: 2, ..untested };
    let visible = [9, 2, 4, 7].map(DrawableId).to_vec();
    let scene = plant(7, 100, DVec3::ZERO).unwrap();
    let view = plant_views(7, 100, DVec3::ZERO, Viewport::new(64, 64).unwrap(), 1).unwrap()[0];
    let mut culler = Culler::new(scene);
    let rule = LodRule::new(1.0).unwrap();
    /// The same unchecked.
    struct Unchecked(Own);
    impl OcclusionTest for Unchecked {
        type Error = Infallible;

        fn test(&mut self, view: &View, boxes: &[TestBox], shows: &mut Vec<u32>) -> Result<(), Infallible> {
            self.0.test(view, boxes, shows)
        }

        fn traverse(&mut self, view: &View, rule: &CutRule) -> Result<Option<WholeTraversal>, Infallible> {
            self.0.traverse(view, rule)
        }
    }
    let mut test = Unchecked(Own(WholeTraversal { visible, steps: vec![step, pieces, last] }));
    let mut given = Vec::new();
    let stats = culler.cull(&view, rule, &mut test, |ids| given.push(ids.to_vec())).unwrap();
    assert_eq!(given, [[2, 4].map(DrawableId), [7, 9].map(DrawableId)]);
    let counts = stats.counts;
    assert_eq!((counts.visited, counts.outside, counts.tested, counts.hidden), (7, 1, 3, 1));
    assert_eq!((counts.emitted, counts.refined, counts.batches), (4, 1, 2));
    assert_eq!((counts.eye_inside, counts.near_visible, counts.not_finite), (1, 2, 3));
}

#[test]
fn a_difference_from_asking_box_by_box_is_an_error_that_names_it() {
    let scene = plant(7, 800, DVec3::ZERO).unwrap();
    let view = plant_views(7, 800, DVec3::ZERO, Viewport::new(64, 64).unwrap(), 5).unwrap()[4];
    let rule = LodRule::new(1.0).unwrap();
    let mut visible = lod_cut(&scene, &view, rule);
    let mut culler = Culler::new(Arc::clone(&scene));
    let lost = visible.pop().unwrap();
    let asked = visible.len() + 1;
    let mut test = Own(WholeTraversal { visible, steps: Vec::new() });
    let error = culler.cull(&view, rule, &mut test, |_| ()).unwrap_err();
    assert!(
        error.to_string().contains(&format!("; only one of them found {lost}: report the device")),
        "{error}"
    );
    let CullError::Differs { own, asked: found, first } = error else { panic!("{error}") };
    assert_eq!((own, found, first), (asked - 1, asked, Some(lost)));
}

#[test]
fn drawables_steps_and_counters_have_to_be_those_of_asking_box_by_box() {
    let objects = [0.0, 1.0, 2.0].map(|x| square(x, -10.0, 0.5));
    let mut culler = Culler::new(Arc::new(Scene::from_arrays(SceneArrays::flat(&objects)).unwrap()));
    let root = StepCounts { visited: 1, tested: 1, refined: 1, ..Default::default() };
    let leaves = StepCounts { visited: 3, tested: 3, whole: 3, ..Default::default() };
    // The given ids and the batches, or the first id that differs.
    let mut check = |ids: [u32; 3], steps: [StepCounts; 2]| {
        let visible = ids.map(DrawableId).to_vec();
        let mut test = Own(WholeTraversal { visible, steps: steps.to_vec() });
        let (view, rule, mut given) = (view(0.0, 1.0), LodRule::new(1.0).unwrap(), Vec::new());
        match culler.cull(&view, rule, &mut test, |ids| given.extend(ids.iter().map(|id| id.0))) {
            Ok(stats) => Ok((given, stats.counts.batches)),
            Err(CullError::Differs { own: 3, asked: 3, first }) => Err(first.map(|id| id.0)),
            Err(error) => panic!("{error}"),
        }
    };
    assert_eq!(check([2, 0, 1], [root, leaves]), Ok((vec![0, 1, 2], 2)));
    assert_eq!(check([0, 1, 7], [root, leaves]), Err(Some(2)));
    assert_eq!(check([0, 1, 2], [root, StepCounts { visited: 4, ..leaves }]), Err(None));
    let early = [StepCounts { whole: 1, ..root }, StepCounts { whole: 2, ..leaves }];
    assert_eq!(check([0, 1, 2], early), Err(None));
}
