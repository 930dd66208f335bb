//! Pages' questions about a scene's objects: details, the hierarchy.

use std::{collections::HashMap, ops::Range, sync::Arc};

use serde::Serialize;
use trimaran_scene::{Attribute, Bounds, Extent, Group, Hierarchy, ReadError, Scene};

use super::sides::{Side, sides};

/// The most parts in a list of a group's children.
const CHILDREN: usize = 500;
/// The most bytes of a list in an answer. An answer has at most two lists.
const LIST: usize = 256 << 10;
/// The most bytes of a part's name, and of an attribute's name and value. Longer ones are cut.
pub(super) const NAME: usize = 256;
const VALUE: usize = 4096;
/// Marks the end of a cut text.
const CUT: char = '…';

/// The objects of a scene, and their groups.
#[derive(Debug)]
pub(super) struct Parts {
    scene: Arc<Scene>,
    hierarchy: Arc<Hierarchy>,
    /// The groups in each group; under none the outermost ones.
    groups: HashMap<Option<u32>, Vec<u32>>,
}

/// A group of objects, or an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PartId {
    Group(u32),
    Object(u32),
}

/// A part, as pages get it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Part {
    kind: &'static str,
    id: u32,
    name: String,
    /// Its first object.
    first: u32,
    /// The end of its objects.
    end: u32,
}

/// Some parts of a list.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(super) struct PartList {
    parts: Vec<Part>,
    /// How many parts the whole list has.
    total: usize,
}

/// A part with all its details.
#[derive(Debug, Serialize)]
pub(super) struct Details {
    #[serde(flatten)]
    part: Part,
    /// The groups that it is in, the outermost first. If too many, some after the outermost are left out.
    path: Vec<Part>,
    #[serde(flatten)]
    extent: Extent,
    /// The box around it without the few objects that lie far from all others. For a part that cannot be
    /// drawn, the box of the innermost group around it that can.
    core: Bounds,
    /// How much of it is hidden from which sides.
    sides: Vec<Side>,
    /// Names and values, as many as fit in an answer.
    attributes: Vec<(String, String)>,
    /// How many attributes it has.
    #[serde(rename = "attributeCount")]
    attribute_count: usize,
}

#[cfg(test)]
impl Part {
    /// Its kind and its number.
    pub(super) fn key(&self) -> (&'static str, u32) {
        (self.kind, self.id)
    }
}

impl Parts {
    /// The parts of a scene.
    ///
    /// # Errors
    /// If its hierarchy cannot be read.
    pub(super) fn new(scene: Arc<Scene>) -> Result<Self, ReadError> {
        let hierarchy = Arc::new(scene.hierarchy()?);
        let mut groups: HashMap<Option<u32>, Vec<u32>> = HashMap::new();
        for (id, group) in (0..).zip(&hierarchy.groups) {
            groups.entry(group.parent).or_default().push(id);
        }
        Ok(Self { scene, hierarchy, groups })
    }

    /// The scene's hierarchy.
    pub(super) const fn hierarchy(&self) -> &Arc<Hierarchy> {
        &self.hierarchy
    }

    /// How many named groups an object is in, at most. The file, its outermost group, does not count.
    pub(super) fn levels(&self) -> usize {
        // Each group stands behind its parent.
        let mut levels: Vec<usize> = Vec::with_capacity(self.hierarchy.groups.len());
        for group in &self.hierarchy.groups {
            let above = group.parent.map(|parent| levels.get(parent as usize).copied().unwrap_or_default());
            levels.push(above.map_or(0, |above| above + usize::from(!group.name.is_empty())));
        }
        levels.into_iter().max().unwrap_or_default()
    }

    /// The details of a part; `None` if it does not exist.
    pub(super) fn details(&self, id: PartId) -> Option<Details> {
        let part = self.part(id)?;
        let (extent, attributes) = match id {
            PartId::Group(id) => {
                let group = self.hierarchy.groups.get(id as usize)?;
                (group.extent, &*group.attributes)
            }
            PartId::Object(id) => (self.scene.extent(id), self.hierarchy.attributes_of(id)),
        };
        let pair = |Attribute { name, value }: &Attribute| (cut(name, NAME), cut(value, VALUE));
        let attribute_count = attributes.len();
        let attributes = that_fit(attributes.iter().map(pair));
        // A part that cannot be drawn takes the place of the innermost group that can.
        let drawn = |group: &&Group| group.extent.triangles > 0;
        let around = || self.around(id).filter_map(|id| self.hierarchy.groups.get(id as usize)).find(drawn);
        let nearest = if extent.triangles == 0 { around() } else { None };
        let objects = nearest.map_or(part.first..part.end, |group| group.objects.clone());
        let core = Bounds::of_most(&self.scene, objects.clone());
        let sides = sides(&self.scene, &core, &objects);
        Some(Details { part, path: self.path(id), extent, core, sides, attributes, attribute_count })
    }

    /// The parts of a group, or the outermost ones, in their order: starting at number `from`, as many as fit
    /// in an answer.
    pub(super) fn children(&self, group: Option<u32>, from: usize) -> Option<PartList> {
        let all = match group {
            None => 0..self.scene.objects().len() as u32,
            Some(id) => self.hierarchy.groups.get(id as usize)?.objects.clone(),
        };
        let groups = self.groups.get(&group).map_or(&[][..], Vec::as_slice);
        let within = |id: &u32| self.hierarchy.groups.get(*id as usize).map(|group| group.objects.clone());
        // Objects between the groups, and the groups.
        let mut runs: Vec<(Range<u32>, Option<u32>)> = Vec::new();
        let mut next = all.start;
        for (id, objects) in groups.iter().filter_map(|id| Some((*id, within(id)?))) {
            runs.push((next..objects.start, None));
            next = objects.end;
            runs.push((objects, Some(id)));
        }
        runs.push((next..all.end, None));
        let count = |(run, group): &(Range<u32>, Option<u32>)| if group.is_some() { 1 } else { run.len() };
        let total = runs.iter().map(count).sum();
        let mut before = from;
        let ids = runs.into_iter().flat_map(|run| {
            let skipped = before.min(count(&run));
            before -= skipped;
            let (Range { start, end }, group) = run;
            let objects = if group.is_some() { 0..0 } else { start + skipped as u32..end };
            group.filter(|_| skipped == 0).map(PartId::Group).into_iter().chain(objects.map(PartId::Object))
        });
        Some(PartList { parts: that_fit(ids.take(CHILDREN).filter_map(|id| self.part(id))), total })
    }

    /// A part, without its details; `None` if it does not exist.
    pub(super) fn part(&self, id: PartId) -> Option<Part> {
        Some(match id {
            PartId::Group(id) => {
                let group = self.hierarchy.groups.get(id as usize)?;
                let Range { start, end } = group.objects;
                Part { kind: "group", id, name: cut(&group.name, NAME), first: start, end }
            }
            PartId::Object(id) => {
                let name = cut(self.scene.object_name(id)?, NAME);
                Part { kind: "object", id, name, first: id, end: id + 1 }
            }
        })
    }

    /// The groups that a part is in, the innermost first.
    fn around(&self, id: PartId) -> impl Iterator<Item = u32> + Clone + '_ {
        let parent = |id: u32| self.hierarchy.groups.get(id as usize).and_then(|group| group.parent);
        let innermost = match id {
            PartId::Group(id) => parent(id),
            // Groups stand behind those that they are in: the last one that contains it is the innermost.
            PartId::Object(id) => {
                let has = |group: &Group| group.objects.contains(&id);
                self.hierarchy.groups.iter().rposition(has).map(|group| group as u32)
            }
        };
        std::iter::successors(innermost, move |id| parent(*id))
    }

    fn path(&self, id: PartId) -> Vec<Part> {
        let above = self.around(id);
        let mut path = that_fit(above.clone().filter_map(|id| self.part(PartId::Group(id))));
        // The outermost is the file, and always included.
        let file = above.last().and_then(|id| self.part(PartId::Group(id)));
        if let Some(file) = file.filter(|file| path.last() != Some(file)) {
            path.push(file);
        }
        path.reverse();
        path
    }
}

/// A text, cut and marked if it has more than this many bytes.
pub(super) fn cut(text: &str, most: usize) -> String {
    match start(text, most) {
        start if start.len() < text.len() => format!("{start}{CUT}"),
        whole => whole.to_owned(),
    }
}

/// At most this many bytes of a text.
fn start(text: &str, most: usize) -> &str {
    text.get(..text.floor_char_boundary(most)).unwrap_or(text)
}

/// As many as fit in a list of an answer.
pub(super) fn that_fit<T: Serialize>(all: impl Iterator<Item = T>) -> Vec<T> {
    let mut left = LIST;
    let fits = |one: &T| {
        let bytes = serde_json::to_vec(one).map_or(usize::MAX, |json| json.len() + 1);
        let rest = left.checked_sub(bytes);
        left = rest.unwrap_or(0);
        rest.is_some()
    };
    all.take_while(fits).collect()
}

#[cfg(test)]
mod tests {
    use trimaran_cook::{
        CookOptions, Mesh, Model, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_scene::ObjectAttributes;

    use super::*;

    /// A plant from a file with two zones, and some objects between them.
    fn parts() -> Parts {
        let mut model: Model = plant(&PlantOptions::small(7));
        let count = model.objects.len() as u32;
        let group = |name: &str, parent, objects: Range<u32>| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = vec![
            group("plant.RVM", None, 0..count),
            group("/ZONE-1", Some(0), 1..4),
            group("/PIPE-7", Some(1), 2..4),
            group("/ZONE-2", Some(0), 6..7),
        ];
        let tag = Attribute { name: "TAG".into(), value: "P-101A".into() };
        model.hierarchy.attributes = vec![ObjectAttributes { object: 3, attributes: vec![tag] }];
        Parts::new(Arc::new(cook(&model, &CookOptions::default(), &()).unwrap())).unwrap()
    }

    fn length(json: serde_json::Result<Vec<u8>>) -> usize {
        json.unwrap().len()
    }

    fn ids(list: &PartList) -> Vec<(&str, u32)> {
        list.parts.iter().map(Part::key).collect()
    }

    #[test]
    fn children_are_groups_and_the_objects_between_them() {
        let parts = parts();
        let count = parts.scene.objects().len();
        assert_eq!(ids(&parts.children(None, 0).unwrap()), [("group", 0)]);
        let file = parts.children(Some(0), 0).unwrap();
        assert_eq!(file.total, count - 3 - 1 + 2);
        let first = [("object", 0), ("group", 1), ("object", 4), ("object", 5), ("group", 3), ("object", 7)];
        assert_eq!(ids(&file)[..6], first);
        assert_eq!(ids(&parts.children(Some(0), 2).unwrap())[..2], first[2..4]);
        assert_eq!(ids(&parts.children(Some(2), 0).unwrap()), [("object", 2), ("object", 3)]);
        assert_eq!(parts.children(Some(4), 0), None);
    }

    /// Groups without a name are no level, and neither is the file.
    #[test]
    fn levels_are_named_groups() {
        let mut model: Model = plant(&PlantOptions::small(7));
        let count = model.objects.len() as u32;
        let group = |name: &str, parent| Group {
            name: name.into(),
            parent,
            objects: 0..count,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        let mut levels = |groups| {
            model.hierarchy.groups = groups;
            Parts::new(Arc::new(cook(&model, &CookOptions::default(), &()).unwrap())).unwrap().levels()
        };
        assert_eq!(levels(vec![group("plant.RVM", None)]), 0);
        let named = [group("plant.RVM", None), group("/ZONE", Some(0)), group("/PIPE", Some(1))];
        assert_eq!(levels(named.to_vec()), 2);
        assert_eq!(levels(vec![named[0].clone(), group("", Some(0)), named[2].clone()]), 1);
        assert_eq!(parts().levels(), 2);
    }

    #[test]
    fn details_have_the_path_and_what_the_part_takes() {
        let parts = parts();
        let details = parts.details(PartId::Object(3)).unwrap();
        let path: Vec<&str> = details.path.iter().map(|part| &*part.name).collect();
        assert_eq!(path, ["plant.RVM", "/ZONE-1", "/PIPE-7"]);
        assert_eq!(details.attributes, [("TAG".to_owned(), "P-101A".to_owned())]);
        let pipe = parts.details(PartId::Group(2)).unwrap();
        let both = parts.scene.extent(2).and(&parts.scene.extent(3));
        assert!(pipe.extent == both && both.triangles > 0, "{pipe:?}");
        let whole = parts.details(PartId::Group(0)).unwrap();
        assert_eq!(whole.extent.triangles, parts.scene.totals().full_detail_triangles);
        let json = serde_json::to_value(&pipe).unwrap();
        assert_eq!((&json["kind"], &json["first"], &json["end"]), (&"group".into(), &2.into(), &4.into()));
        assert!(parts.details(PartId::Object(1 << 20)).is_none());
    }

    /// The camera flies there, and the part itself has no size.
    #[test]
    fn a_part_of_which_nothing_can_be_drawn_is_where_its_group_is() {
        let mut model: Model = plant(&PlantOptions::small(7));
        model.meshes.push(Mesh::default());
        let (nothing, count) = (model.meshes.len() as u32 - 1, model.objects.len() as u32);
        model.objects[2].mesh = nothing;
        model.objects[5].mesh = nothing;
        let group = |name: &str, parent, objects: Range<u32>| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = vec![
            group("plant.RVM", None, 0..count),
            group("/PIPE-7", Some(0), 1..4),
            group("/NOTHING", Some(0), 5..6),
        ];
        let scene = cook(&model, &CookOptions::default(), &()).unwrap();
        let parts = Parts::new(Arc::new(scene)).unwrap();
        let details = |id| parts.details(id).unwrap();
        let [object, pipe] = [details(PartId::Object(2)), details(PartId::Group(1))];
        assert_eq!((object.core, object.extent.triangles), (pipe.core, 0));
        assert!(object.core.min != object.core.max && object.extent.min[0] > object.extent.max[0]);
        let file = details(PartId::Group(0)).core;
        assert_eq!([PartId::Group(2), PartId::Object(5)].map(|id| details(id).core), [file; 2]);
    }

    /// The pages of a list cover all of it, also objects between groups.
    #[test]
    fn the_pages_of_a_list_have_each_part_once() {
        let parts = parts();
        let whole = parts.children(Some(0), 0).unwrap();
        for from in 0..=whole.total + 1 {
            let rest = parts.children(Some(0), from).unwrap();
            let (rest_ids, whole_ids) = (ids(&rest), ids(&whole));
            let shared = whole_ids.get(from..).unwrap_or_default();
            assert!(rest_ids.starts_with(shared), "from {from}");
            assert_eq!(rest_ids.len(), whole.total.saturating_sub(from).min(CHILDREN), "from {from}");
            assert_eq!(rest.total, whole.total);
        }
        assert_eq!(parts.children(Some(0), usize::MAX).unwrap().parts, []);
    }

    /// Long names, in deep groups, with long attributes: each answer fits, and states the total count.
    #[test]
    fn answers_are_short_however_long_names_are() {
        let mut model: Model = plant(&PlantOptions::small(7));
        let count = model.objects.len() as u32;
        let long = "\u{1}".repeat(1 << 16);
        for object in &mut model.objects {
            object.name.clone_from(&long);
        }
        let tag = Attribute { name: "TAG".into(), value: long.as_str().into() };
        let group = |parent| Group {
            name: "é".repeat(1 << 10).into(),
            parent,
            objects: 0..count,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = (0..4000).map(|depth: u32| group(depth.checked_sub(1))).collect();
        model.hierarchy.groups[0].name = "file".into();
        model.hierarchy.groups[3999].attributes = vec![tag; 50];
        let parts = Parts::new(Arc::new(cook(&model, &CookOptions::default(), &()).unwrap())).unwrap();
        let deepest = parts.details(PartId::Group(3999)).unwrap();
        assert_eq!((deepest.attribute_count, deepest.part.name.chars().last()), (50, Some(CUT)));
        assert!(deepest.path.len() > 100 && deepest.attributes.len() > 5 && deepest.attributes.len() < 50);
        assert_eq!((&*deepest.path[0].name, deepest.path.last().unwrap().id), ("file", 3998));
        assert!(length(serde_json::to_vec(&deepest)) < 1 << 20, "{}", length(serde_json::to_vec(&deepest)));
        let mut told = 0;
        while told < count as usize {
            let some = parts.children(Some(3999), told).unwrap();
            assert!(
                some.total == count as usize
                    && !some.parts.is_empty()
                    && length(serde_json::to_vec(&some)) < 1 << 20
            );
            told += some.parts.len();
        }
    }

    #[test]
    fn a_text_is_cut_between_letters() {
        assert_eq!(cut("née", 3), "né…");
        assert_eq!(cut("née", 2), "n…");
        assert_eq!(cut("née", 4), "née");
    }
}
