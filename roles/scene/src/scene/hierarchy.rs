//! The grouping of objects in their source files, and the files' attributes.

use std::{ops::Range, sync::Arc};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::{Level, Scene, SceneError};

/// The groups of a scene's objects, and the attributes of both.
///
/// Objects are numbered in depth-first order of the hierarchy. So the objects of a group, with those of the
/// groups below it, are a run of numbers.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Hierarchy {
    /// Each group follows its parent, and everything in its elder siblings. The outermost are the files.
    pub groups: Vec<Group>,
    /// Attributes of objects, in the order of their numbers. In most models most objects have none.
    pub attributes: Vec<ObjectAttributes>,
}

/// Objects that belong together: a file, a zone, an assembly.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// Its name in its file; empty if it has none.
    pub name: Arc<str>,
    /// Index of its parent group; none for the outermost.
    pub parent: Option<u32>,
    /// Its objects, with those of the groups in it.
    pub objects: Range<u32>,
    /// Its attributes, in the file's order.
    pub attributes: Vec<Attribute>,
    /// Its extent in the world. [`Scene::from_arrays`](crate::Scene::from_arrays) computes it.
    pub extent: Extent,
}

/// The extent of objects in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Extent {
    /// Lower corner of the box around them, metres. Above the upper one if there is nothing.
    pub min: [f64; 3],
    /// Upper corner.
    pub max: [f64; 3],
    /// Their triangles at full detail, instances counted each.
    pub triangles: u64,
}

/// The attributes of an object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ObjectAttributes {
    /// The object's number.
    pub object: u32,
    /// In the order of its file.
    pub attributes: Vec<Attribute>,
}

/// A name and a value, as in the file. Equal texts of a scene that was read share memory.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Attribute {
    /// Such as `DESCRIPTION`.
    pub name: Arc<str>,
    /// As text.
    pub value: Arc<str>,
}

/// Nothing.
impl Default for Extent {
    fn default() -> Self {
        Self { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3], triangles: 0 }
    }
}

impl Extent {
    /// The union of both.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        let triangles = self.triangles.saturating_add(other.triangles);
        let (min, max) = (DVec3::from_array(self.min), DVec3::from_array(self.max));
        let min = min.min(DVec3::from_array(other.min)).to_array();
        Self { min, max: max.max(DVec3::from_array(other.max)).to_array(), triangles }
    }
}

impl Scene {
    /// The extent of an object: of all nodes below its own. Parts that cannot be read are left out, which
    /// [`reading`](Self::reading) tells.
    #[must_use]
    pub fn extent(&self, object: u32) -> Extent {
        let nodes = self.nodes();
        let mut extent = Extent::default();
        let mut open: Vec<u32> = self.objects().get(object as usize).map(|of| of.node).into_iter().collect();
        while let Some(node) = open.pop().and_then(|id| nodes.get(id as usize)) {
            let finest = self.levels(node).next().filter(|_| node.is_leaf());
            let pieces = finest.into_iter().flat_map(Level::pieces);
            let pieces = pieces.filter_map(|id| self.drawables().get(id.index()));
            let triangles = pieces.map(|drawable| u64::from(drawable.triangles)).sum();
            extent = extent.and(&Extent { min: node.world_min, max: node.world_max, triangles });
            open.extend(node.children());
        }
        extent
    }
}

impl Hierarchy {
    /// The attributes of an object; none for most.
    #[must_use]
    pub fn attributes_of(&self, object: u32) -> &[Attribute] {
        let found = self.attributes.binary_search_by_key(&object, |of| of.object);
        found.ok().and_then(|index| self.attributes.get(index)).map_or(&[], |of| &of.attributes)
    }

    /// Checks the invariants of readers: groups are nested and consecutive, and within the number of objects.
    ///
    /// # Errors
    /// The first group, or the first object's attributes, that break a rule.
    pub fn check(&self, objects: u32) -> Result<(), SceneError> {
        // The least start of the next child of each group, and last that of the next outermost one.
        let mut next: Vec<u32> = Vec::with_capacity(self.groups.len());
        let mut outermost = 0;
        for (index, group) in self.groups.iter().enumerate() {
            let wrong = |why| SceneError::Malformed { what: "group", index, why };
            let Range { start, end } = group.objects;
            let within = match group.parent {
                None => 0..objects,
                Some(parent) => {
                    let parent = self.groups.get(..index).and_then(|before| before.get(parent as usize));
                    parent.ok_or_else(|| wrong("it stands before the group that it is in"))?.objects.clone()
                }
            };
            if start > end || start < within.start || end > within.end {
                return Err(wrong("its objects are not among those of the group that it is in"));
            }
            let free = match group.parent {
                None => &mut outermost,
                Some(parent) => next.get_mut(parent as usize).ok_or_else(|| wrong("it is in no group"))?,
            };
            if start < *free {
                return Err(wrong("it shares objects with a group beside it"));
            }
            *free = end;
            next.push(start);
        }
        let numbers = self.attributes.iter().map(|of| of.object);
        for (index, (object, after)) in numbers.clone().zip(numbers.skip(1).chain([objects])).enumerate() {
            if object >= after {
                let why = "they are not in the order of objects";
                return Err(SceneError::Malformed { what: "attributes", index, why });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(parent: Option<u32>, objects: Range<u32>) -> Group {
        Group { name: "".into(), parent, objects, attributes: Vec::new(), extent: Extent::default() }
    }

    fn of(object: u32) -> ObjectAttributes {
        let attributes = vec![Attribute { name: "TAG".into(), value: object.to_string().into() }];
        ObjectAttributes { object, attributes }
    }

    #[test]
    fn groups_lie_within_each_other_one_behind_the_other() {
        let groups = |groups: &[Group]| Hierarchy { groups: groups.to_vec(), ..Default::default() }.check(10);
        let sound = [group(None, 0..6), group(Some(0), 1..4), group(Some(1), 1..2), group(Some(0), 4..6)];
        assert_eq!(groups(&sound), Ok(()));
        assert_eq!(groups(&[&sound[..], &[group(None, 6..10)]].concat()), Ok(()));
        for (wrong, why) in [
            (group(None, 6..11), "its objects"),
            (group(None, 5..6), "it shares"),
            (group(Some(0), 5..6), "it shares"),
            (group(Some(1), 1..2), "it shares"),
            (group(Some(1), 2..5), "its objects"),
            (group(Some(4), 6..7), "it stands"),
            (group(Some(0), Range { start: 6, end: 5 }), "its objects"),
        ] {
            let error = groups(&[&sound[..], std::slice::from_ref(&wrong)].concat()).unwrap_err().to_string();
            assert!(error.contains("group 4") && error.contains(why), "{wrong:?}: {error}");
        }
    }

    #[test]
    fn attributes_are_found_by_the_number_of_an_object() {
        let hierarchy = Hierarchy { attributes: vec![of(2), of(5)], ..Default::default() };
        assert_eq!(hierarchy.check(6), Ok(()));
        assert_eq!(*hierarchy.attributes_of(5)[0].value, *"5");
        assert_eq!(hierarchy.attributes_of(3), []);
        assert!(hierarchy.check(5).is_err());
        assert!(Hierarchy { attributes: vec![of(2), of(2)], ..Default::default() }.check(6).is_err());
    }
}
