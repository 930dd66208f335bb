use std::collections::BTreeSet;

use trimaran_cull::lod_cut;
use trimaran_proto::LodRule;
use trimaran_scene::NodeId;

use super::super::testing::{PLANT, outside, view_at};
use super::*;

const EPSILON_PX: f64 = 0.25;

fn rule() -> CutRule {
    LodRule::new(EPSILON_PX).unwrap().into()
}

/// From outside, so that all of the plant is visible.
fn view() -> View {
    view_at(outside(), 0.0, 7, 512)
}

fn cut() -> Vec<DrawableId> {
    lod_cut(&PLANT, &view(), rule())
}

/// The drawables of these to send first, and the messages for the display.
fn find(ids: &[DrawableId], has: &[DrawableId]) -> (BTreeSet<DrawableId>, Vec<(DrawableId, Vec<u32>)>) {
    let mut stand_ins = StandIns::default();
    ids.iter().for_each(|id| stand_ins.add(*id, FrameNumber(7)));
    let first = stand_ins.find(&PLANT, &view(), &rule(), |id| has.contains(&id));
    let told = stand_ins.tell().into_iter().map(|item| match item {
        Supply::StandIn { id, drawables, .. } => (id, drawables.iter().collect()),
        item => panic!("{item:?}"),
    });
    (first.into_iter().map(|(id, _)| id).collect(), told.collect())
}

fn node_of(id: DrawableId) -> NodeId {
    NodeId(PLANT.drawables()[id.index()].node)
}

/// Whether `id` is a coarser level of the node of `finer`, or one of a node above.
fn is_coarser(id: DrawableId, finer: DrawableId) -> bool {
    let (own, above) = (node_of(finer), node_of(id));
    if own == above { id > finer } else { PLANT.ancestors(own).any(|(node, _)| node == above) }
}

#[test]
fn each_drawable_comes_first_or_has_something_coarser_that_does() {
    let cut = cut();
    assert!(cut.len() > 100);
    let (first, told) = find(&cut, &[]);
    assert!(first.len() * 2 < cut.len(), "{} of {} come first", first.len(), cut.len());
    let view = view();
    let lods = LodCut::new(&PLANT, &view, rule());
    let mut covered = BTreeSet::new();
    for (id, drawables) in &told {
        assert!(first.contains(id));
        let drawable = &PLANT.drawables()[id.index()];
        let error = lods.error_on_screen(&PLANT.nodes()[drawable.node as usize], drawable.error.into());
        assert!(error <= COARSER * EPSILON_PX, "{error} px");
        for finer in drawables {
            assert!(is_coarser(*id, DrawableId(*finer)));
            assert!(covered.insert(DrawableId(*finer)), "told once");
        }
    }
    let alone = first.iter().filter(|id| cut.contains(id)).copied();
    assert_eq!(covered.into_iter().chain(alone).collect::<BTreeSet<_>>(), cut.into_iter().collect());
}

/// One of the cut, with its possible stand-ins.
fn with_several_coarser() -> (DrawableId, Vec<Level>) {
    let view = view();
    let lods = LodCut::new(&PLANT, &view, rule());
    let coarser = |id: DrawableId| (id, lods.coarser(id, COARSER * EPSILON_PX).collect::<Vec<_>>());
    cut()
        .into_iter()
        .map(coarser)
        .max_by_key(|(_, coarser)| coarser.len())
        .filter(|(_, c)| c.len() > 2)
        .unwrap()
}

#[test]
fn the_finest_that_the_display_has_stands_in_and_is_not_sent() {
    let (id, coarser) = with_several_coarser();
    let there: Vec<DrawableId> = coarser[1..3].iter().copied().flat_map(Level::pieces).collect();
    let (first, told) = find(&[id], &there);
    assert_eq!((first.len(), told), (0, vec![(coarser[1].first(), vec![id.0])]));
}

#[test]
fn a_finer_level_that_the_display_has_stands_in_first() {
    let all = (0..PLANT.drawables().len() as u32).map(DrawableId);
    let own = |id: &DrawableId| PLANT.levels(&PLANT.nodes()[node_of(*id).0 as usize]).collect::<Vec<_>>();
    let levels = all.map(|id| own(&id)).find(|levels| levels.len() > 2).unwrap();
    let there: Vec<DrawableId> = [levels[0], levels[2]].into_iter().flat_map(Level::pieces).collect();
    let own = levels[1].first();
    let (first, told) = find(&[own], &there);
    assert_eq!((first.len(), told), (0, vec![(levels[0].first(), vec![own.0])]));
}

#[test]
fn of_little_nothing_coarser_is_sent() {
    let (id, _) = with_several_coarser();
    assert!(bytes_of(&PLANT, id) < FEW);
    assert_eq!(find(&[id], &[]), (BTreeSet::new(), Vec::new()));
}

#[test]
fn what_the_display_knows_it_is_not_told_again() {
    let ((id, coarser), mut stand_ins) = (with_several_coarser(), StandIns::default());
    let mut told = |has: Level| {
        stand_ins.add(id, FrameNumber(7));
        let _first = stand_ins.find(&PLANT, &view(), &rule(), |id| has.holds(id));
        stand_ins.tell().len()
    };
    assert_eq!(told(coarser[0]), 1);
    assert_eq!(told(coarser[0]), 0);
    assert_eq!(told(coarser[1]), 1, "another one stands in now");
}
