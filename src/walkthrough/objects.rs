//! How many objects drawables show.

use std::collections::HashSet;

use trimaran_proto::DrawableId;
use trimaran_scene::{Node, Scene};

/// Counts the objects that drawables show: what is merged of several shows all of them, and the parts of one
/// are one.
#[derive(Debug)]
pub struct ObjectCounts {
    /// The objects at and below each node.
    below: Vec<u64>,
}

impl ObjectCounts {
    /// Prepares counting in a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let nodes = scene.nodes();
        let mut below = vec![0_u64; nodes.len()];
        // Children follow their parents. An object's parts are below its own node, which counts once.
        for (index, node) in nodes.iter().enumerate().rev() {
            below[index] = if node.object == Node::NONE {
                node.children().filter_map(|child| below.get(child as usize)).sum()
            } else {
                1
            };
        }
        Self { below }
    }

    /// The number of objects that drawables of one LOD cut show. In a cut no node is below another.
    pub fn of(&self, scene: &Scene, drawn: impl IntoIterator<Item = DrawableId>) -> u64 {
        let mut objects = HashSet::new();
        let mut merged = 0;
        for drawable in drawn.into_iter().filter_map(|id| scene.drawables().get(id.index())) {
            match scene.nodes().get(drawable.node as usize).map(|node| node.object) {
                Some(Node::NONE) => merged += self.below.get(drawable.node as usize).copied().unwrap_or(0),
                Some(object) => {
                    objects.insert(object);
                }
                None => {}
            }
        }
        merged + objects.len() as u64
    }
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
    use crate::walkthrough::deviation::finest_below;

    #[test]
    fn objects_are_counted_once_and_merged_ones_each() {
        let model = plant(&PlantOptions { objects: 300, triangles: 60_000, ..PlantOptions::small(5) });
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let counts = ObjectCounts::new(&scene);
        let objects = scene.objects().len() as u64;
        let leaves = finest_below(&scene, NodeId(0));
        assert!(leaves.len() as u64 > objects, "some objects are in parts");
        assert_eq!(counts.of(&scene, leaves), objects);
        assert_eq!(counts.of(&scene, []), 0);

        let merged =
            scene.nodes().iter().enumerate().filter(|(_, n)| n.object == Node::NONE && n.levels().len() > 0);
        let mut tried = 0;
        for (index, node) in merged {
            let below: BTreeSet<u32> = finest_below(&scene, NodeId(index as u32))
                .into_iter()
                .map(|id| scene.nodes()[scene.drawables()[id.index()].node as usize].object)
                .collect();
            assert_eq!(counts.of(&scene, node.levels().next()), below.len() as u64, "node {index}");
            tried += 1;
        }
        assert!(tried > 0, "some levels are merged");
    }
}
