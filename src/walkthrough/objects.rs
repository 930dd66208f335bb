//! Counts the objects that drawables show.

use std::collections::{HashMap, HashSet};

use trimaran_proto::DrawableId;
use trimaran_scene::{Node, Scene};

/// The number of objects that drawables of one LOD cut show: a merged node shows several, and the pieces of
/// one level and the clusters of one object count once. In a cut no node is below another.
pub fn count_objects(scene: &Scene, drawn: impl IntoIterator<Item = DrawableId>) -> u64 {
    let mut objects = HashSet::new();
    let mut merged = HashMap::new();
    for drawable in drawn.into_iter().filter_map(|id| scene.drawables().get(id.index())) {
        match scene.nodes().get(drawable.node as usize) {
            Some(node) if node.objects > 1 || node.object == Node::NONE => {
                merged.insert(drawable.node, u64::from(node.objects));
            }
            Some(node) => {
                objects.insert(node.object);
            }
            None => {}
        }
    }
    merged.values().sum::<u64>() + objects.len() as u64
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use trimaran_cook::{
        CookOptions, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_scene::NodeId;

    use super::*;
    use crate::walkthrough::audit::finest_below;

    #[test]
    fn objects_are_counted_once_and_merged_ones_each() {
        let model = plant(&PlantOptions { objects: 300, triangles: 60_000, ..PlantOptions::small(5) });
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let objects = scene.objects().len() as u64;
        let leaves = finest_below(&scene, NodeId(0));
        assert!(leaves.len() as u64 > objects, "some objects are in parts");
        assert_eq!(count_objects(&scene, leaves), objects);
        assert_eq!(count_objects(&scene, []), 0);

        let merged =
            scene.nodes().iter().enumerate().filter(|(_, n)| n.object == Node::NONE && n.drawable_count > 0);
        let mut tried = 0;
        for (index, node) in merged {
            let below: BTreeSet<u32> = finest_below(&scene, NodeId(index as u32))
                .into_iter()
                .map(|id| scene.nodes()[scene.drawables()[id.index()].node as usize].object)
                .collect();
            let finest = scene.levels(node).next().unwrap();
            assert_eq!(count_objects(&scene, finest.pieces()), below.len() as u64, "node {index}");
            tried += 1;
        }
        assert!(tried > 0, "some levels are merged");
    }
}
