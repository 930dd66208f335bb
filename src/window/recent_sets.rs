//! Recent sets: a moving eye may see a drawable that one of them has and the newest lacks.

use std::{
    collections::{HashMap, HashSet, VecDeque},
    time::Duration,
};

use trimaran_proto::DrawableId;
use trimaran_scene::{Level, Scene};

use super::display_role::FoundSet;

/// The longest time between the poses of two sets that both still count.
const KEPT: Duration = Duration::from_millis(120);

/// The newest set last.
#[derive(Debug, Default)]
pub(super) struct RecentSets(VecDeque<FoundSet>);

impl RecentSets {
    /// Adds a set, replacing one of the same pose. An outdated set is ignored.
    pub(super) fn add(&mut self, set: FoundSet) {
        if self.newest().is_some_and(|newest| newest.posed > set.posed) {
            return;
        }
        self.0.retain(|old| old.posed < set.posed && set.posed - old.posed <= KEPT);
        self.0.push_back(set);
    }

    /// The newest set.
    pub(super) fn newest(&self) -> Option<&FoundSet> {
        self.0.back()
    }

    /// The newest set, and from earlier ones the other drawables: of nodes that no newer one has, or shows at
    /// the same level.
    pub(super) fn union(&self, scene: &Scene, union: &mut Vec<DrawableId>) {
        // The levels of each node in newer sets: several where one of them stands in for a part of the other.
        let mut levels: HashMap<u32, HashSet<Level>> = HashMap::new();
        let mut shown = HashSet::new();
        for set in self.0.iter().rev() {
            let before = union.len();
            for &id in &set.ids {
                let Some(drawable) = scene.drawables().get(id.index()) else { continue };
                let is_shown = |newer: &HashSet<Level>| newer.contains(&drawable.level(id));
                if levels.get(&drawable.node).is_none_or(is_shown) && shown.insert(id) {
                    union.push(id);
                }
            }
            for &id in union.iter().skip(before) {
                let Some(drawable) = scene.drawables().get(id.index()) else { continue };
                levels.entry(drawable.node).or_default().insert(drawable.level(id));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_audit::cases::plant;
    use trimaran_proto::{Camera, FrameNumber};

    use super::*;

    fn set(posed: u64, ids: &[DrawableId]) -> FoundSet {
        let posed = Duration::from_millis(posed);
        FoundSet {
            camera: Camera::at_origin(FrameNumber(0)),
            ids: ids.to_vec(),
            posed,
            came: posed,
            is_whole: true,
        }
    }

    #[test]
    fn a_moving_eye_is_shown_the_newest_set_and_what_others_of_lately_add() {
        let scene = plant(1, 200, DVec3::ZERO).unwrap();
        // Two levels of one node, and one of another node.
        let levels = |node: usize| {
            scene.levels(scene.nodes().get(node).unwrap()).map(Level::first).collect::<Vec<_>>()
        };
        let node = (0..).find(|&node| levels(node).len() > 1).unwrap();
        let [fine, coarse, ..] = levels(node)[..] else { panic!("it has two levels") };
        let other = levels(node + 1)[0];
        let union = |recent: &RecentSets| {
            let mut ids = Vec::new();
            recent.union(&scene, &mut ids);
            ids
        };
        let mut recent = RecentSets::default();
        assert_eq!(union(&recent), []);
        recent.add(set(100, &[coarse, other]));
        recent.add(set(200, &[fine]));
        assert_eq!(union(&recent), [fine, other], "a node is shown at one level");
        // It arrives late.
        recent.add(set(150, &[coarse]));
        assert_eq!(recent.newest().unwrap().posed, Duration::from_millis(200));
        // The same pose again, after more of it has arrived.
        recent.add(set(200, &[coarse]));
        assert_eq!(union(&recent), [coarse, other]);
        recent.add(set(221, &[]));
        assert_eq!(union(&recent), [coarse], "what was posed 121 ms before no longer counts");
    }
}
