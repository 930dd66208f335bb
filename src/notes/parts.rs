//! Parts of a scene by names that stay when the model is imported again, and back to their numbers.

use std::{
    collections::HashMap,
    ops::Range,
    sync::{Arc, OnceLock},
};

use thiserror::Error;
use trimaran_proto::ObjectSet;
use trimaran_scene::{Attribute, Bounds, Hierarchy, Scene};

use super::{PartRef, note::PARTS};

/// The system that knows parts by their paths.
const SYSTEM: &str = "Trimaran";
/// Between two names of a path.
const BETWEEN: char = '>';
/// Attributes with an `IfcGuid`: in lower case, without separators.
const IFC_GUIDS: [&str; 4] = ["ifcguid", "ifcglobalid", "globalid", "ifcgloballyuniqueid"];
/// The length of one.
const IFC_LENGTH: usize = 22;

/// The parts of a scene, to be named and found.
#[derive(Debug)]
pub struct SceneParts {
    scene: Arc<Scene>,
    hierarchy: Arc<Hierarchy>,
    /// The groups in each group, in order; under none the outermost ones.
    groups: HashMap<Option<u32>, Vec<u32>>,
    ifc: OnceLock<IfcParts>,
}

/// The parts that have an `IfcGuid`.
#[derive(Debug, Default)]
struct IfcParts {
    by_guid: HashMap<Arc<str>, Member>,
    /// The first object of each, ascending.
    firsts: Vec<u32>,
}

/// A group, or an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum Member {
    Group(u32),
    Object(u32),
}

/// A set of objects consists of too many parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("more than {PARTS} separate parts: hide or pick the groups around them")]
pub struct TooManyParts;

/// The members of groups by their names, as far as they were asked for.
type Names<'p> = HashMap<Option<u32>, HashMap<&'p str, Vec<Member>>>;

impl SceneParts {
    /// The parts of a scene with this hierarchy.
    #[must_use]
    pub fn new(scene: &Arc<Scene>, hierarchy: &Arc<Hierarchy>) -> Self {
        let mut groups: HashMap<Option<u32>, Vec<u32>> = HashMap::new();
        for (id, group) in (0..).zip(&hierarchy.groups) {
            groups.entry(group.parent).or_default().push(id);
        }
        let (scene, hierarchy) = (Arc::clone(scene), Arc::clone(hierarchy));
        Self { scene, hierarchy, groups, ifc: OnceLock::new() }
    }

    /// The fewest parts that have just these objects.
    ///
    /// # Errors
    /// If they are too many.
    pub fn named(&self, objects: &ObjectSet) -> Result<Vec<PartRef>, TooManyParts> {
        let (mut parts, mut names) = (Vec::new(), Names::new());
        for run in objects.runs() {
            let mut at = run.start;
            while at < run.end.min(self.objects()) {
                let whole = |group: &u32| {
                    let objects = self.range(Member::Group(*group));
                    objects.start == at && objects.end <= run.end
                };
                let member =
                    self.around(at).into_iter().find(whole).map_or(Member::Object(at), Member::Group);
                if parts.len() == PARTS {
                    return Err(TooManyParts);
                }
                parts.push(self.reference(member, &mut names));
                at = self.range(member).end;
            }
        }
        Ok(parts)
    }

    /// The objects of parts, and how many of these parts the scene does not have.
    #[must_use]
    pub fn found(&self, parts: &[PartRef]) -> (ObjectSet, usize) {
        let mut names = Names::new();
        let found: Vec<_> = parts.iter().filter_map(|part| self.find(part, &mut names)).collect();
        (union(found.iter().map(|member| self.range(*member)).collect()), parts.len() - found.len())
    }

    /// The middle of the first of these parts that the scene has.
    #[must_use]
    pub fn middle(&self, parts: &[PartRef]) -> Option<[f64; 3]> {
        let mut names = Names::new();
        let found = parts.iter().find_map(|part| self.find(part, &mut names))?;
        let Bounds { min, max } = Bounds::of_most(&self.scene, self.range(found));
        Some([0, 1, 2].map(|axis| (min[axis] + max[axis]) / 2.0))
    }

    /// The same parts for other programs: in place of a group that has no `IfcGuid`, those in it that have.
    #[must_use]
    pub fn for_others(&self, parts: &[PartRef]) -> Vec<PartRef> {
        let (mut told, mut names) = (Vec::new(), Names::new());
        for part in parts {
            match self.find(part, &mut names) {
                Some(member) if part.ifc_guid.is_none() => {
                    let mut below = Vec::new();
                    let room = PARTS.saturating_sub(told.len());
                    if self.unfold(member, room, &mut below) && below.len() > 1 {
                        told.extend(below.into_iter().map(|member| self.reference(member, &mut names)));
                    } else {
                        told.push(self.reference(member, &mut names));
                    }
                }
                _ => told.push(part.clone()),
            }
        }
        told
    }

    /// Adds the outermost parts of a member that have an `IfcGuid`, and what is beside them. Returns whether
    /// there was room for all.
    fn unfold(&self, member: Member, room: usize, into: &mut Vec<Member>) -> bool {
        match member {
            Member::Group(id) if self.ifc_guid(member).is_none() && self.has_ifc_guids(member) => {
                self.members(Some(id)).all(|member| self.unfold(member, room, into))
            }
            _ => {
                into.push(member);
                into.len() <= room
            }
        }
    }

    fn find<'p>(&'p self, part: &PartRef, names: &mut Names<'p>) -> Option<Member> {
        let by_path = part.id.as_deref().filter(|_| part.system.as_deref() == Some(SYSTEM));
        let by_path = by_path.and_then(|path| self.at_path(path, names));
        by_path.or_else(|| self.ifc().by_guid.get(part.ifc_guid.as_deref()?).copied())
    }

    fn reference<'p>(&'p self, member: Member, names: &mut Names<'p>) -> PartRef {
        let ifc_guid = self.ifc_guid(member).map(|guid| guid.to_string());
        PartRef { ifc_guid, system: Some(SYSTEM.to_owned()), id: Some(self.path(member, names)) }
    }

    /// The names from the outermost group to a member. Equal ones beside each other are counted: `PIPE[2]`.
    fn path<'p>(&'p self, member: Member, names: &mut Names<'p>) -> String {
        let groups = match member {
            Member::Group(id) => {
                let parent =
                    |id: &u32| self.hierarchy.groups.get(*id as usize).and_then(|group| group.parent);
                let mut groups: Vec<u32> = std::iter::successors(parent(&id), parent).collect();
                groups.reverse();
                groups
            }
            Member::Object(id) => self.around(id),
        };
        let parents = std::iter::once(None).chain(groups.iter().copied().map(Some));
        let members = groups.iter().copied().map(Member::Group).chain([member]);
        let each = parents.zip(members).map(|(parent, member)| {
            let name = self.name(member);
            let same = self.names(parent, names).get(name);
            let at = same.and_then(|same| same.iter().position(|other| *other == member)).unwrap_or_default();
            segment(name, at)
        });
        each.collect::<Vec<_>>().join(&BETWEEN.to_string())
    }

    fn at_path<'p>(&'p self, path: &str, names: &mut Names<'p>) -> Option<Member> {
        let mut found = None;
        for (name, at) in segments(path) {
            let parent = match found {
                None => None,
                Some(Member::Group(id)) => Some(id),
                Some(Member::Object(_)) => return None,
            };
            found = Some(*self.names(parent, names).get(&*name)?.get(at)?);
        }
        found
    }

    fn names<'n, 'p: 'n>(
        &'p self,
        group: Option<u32>,
        names: &'n mut Names<'p>,
    ) -> &'n HashMap<&'p str, Vec<Member>> {
        names.entry(group).or_insert_with(|| {
            let mut named: HashMap<&str, Vec<Member>> = HashMap::new();
            for member in self.members(group) {
                named.entry(self.name(member)).or_default().push(member);
            }
            named
        })
    }

    /// The members of a group in their order.
    fn members(&self, group: Option<u32>) -> impl Iterator<Item = Member> + '_ {
        let all = group.map_or(0..self.objects(), |id| self.range(Member::Group(id)));
        let inner = self.groups.get(&group).map_or(&[][..], Vec::as_slice);
        let starts =
            std::iter::once(all.start).chain(inner.iter().map(|id| self.range(Member::Group(*id)).end));
        let ends = inner.iter().map(|id| self.range(Member::Group(*id)).start).chain([all.end]);
        let groups = inner.iter().map(|id| Some(Member::Group(*id))).chain([None]);
        starts
            .zip(ends)
            .zip(groups)
            .flat_map(|((start, end), group)| (start..end).map(Member::Object).chain(group))
    }

    /// The groups around an object, the outermost first.
    fn around(&self, object: u32) -> Vec<u32> {
        let mut around = Vec::new();
        while let Some(inner) = self.groups.get(&around.last().copied()) {
            let at = inner.partition_point(|id| self.range(Member::Group(*id)).end <= object);
            match inner.get(at).filter(|id| self.range(Member::Group(**id)).contains(&object)) {
                Some(id) => around.push(*id),
                None => break,
            }
        }
        around
    }

    fn objects(&self) -> u32 {
        self.scene.objects().len() as u32
    }

    fn range(&self, member: Member) -> Range<u32> {
        match member {
            Member::Group(id) => {
                self.hierarchy.groups.get(id as usize).map(|group| group.objects.clone()).unwrap_or_default()
            }
            Member::Object(id) => id..id + 1,
        }
    }

    fn name(&self, member: Member) -> &str {
        match member {
            Member::Group(id) => self.hierarchy.groups.get(id as usize).map_or("", |group| &group.name),
            Member::Object(id) => self.scene.object_name(id).unwrap_or_default(),
        }
    }

    fn ifc_guid(&self, member: Member) -> Option<&Arc<str>> {
        ifc_guid_in(match member {
            Member::Group(id) => {
                self.hierarchy.groups.get(id as usize).map_or(&[], |group| &group.attributes)
            }
            Member::Object(id) => self.hierarchy.attributes_of(id),
        })
    }

    /// Whether a part in it, or it, has an `IfcGuid`.
    fn has_ifc_guids(&self, member: Member) -> bool {
        let (objects, firsts) = (self.range(member), &self.ifc().firsts);
        firsts.get(firsts.partition_point(|first| *first < objects.start)).is_some_and(|at| *at < objects.end)
    }

    fn ifc(&self) -> &IfcParts {
        self.ifc.get_or_init(|| {
            let groups =
                (0..).zip(&self.hierarchy.groups).map(|(id, of)| (Member::Group(id), &*of.attributes));
            let objects = &self.hierarchy.attributes;
            let objects = objects.iter().map(|of| (Member::Object(of.object), &*of.attributes));
            let mut ifc = IfcParts::default();
            for (member, attributes) in groups.chain(objects) {
                if let Some(guid) = ifc_guid_in(attributes) {
                    // The group is the part, where objects in it have the same.
                    ifc.by_guid.entry(Arc::clone(guid)).or_insert(member);
                    ifc.firsts.push(self.range(member).start);
                }
            }
            ifc.firsts.sort_unstable();
            ifc
        })
    }
}

fn ifc_guid_in(attributes: &[Attribute]) -> Option<&Arc<str>> {
    let is_guid = |attribute: &&Attribute| {
        let name: String = attribute.name.chars().filter(|c| c.is_alphanumeric()).collect();
        let is_one = attribute.value.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'_' | b'$'));
        IFC_GUIDS.contains(&&*name.to_lowercase()) && attribute.value.len() == IFC_LENGTH && is_one
    };
    attributes.iter().find(is_guid).map(|attribute| &attribute.value)
}

/// A name in a path, and how many equal ones are before it.
fn segment(name: &str, at: usize) -> String {
    let mut segment = String::new();
    for c in name.chars() {
        if matches!(c, BETWEEN | '[' | '\\') {
            segment.push('\\');
        }
        segment.push(c);
    }
    if at > 0 {
        segment += &format!("[{}]", at + 1);
    }
    segment
}

/// The names of a path, and how many equal ones are before each.
fn segments(path: &str) -> Vec<(String, usize)> {
    let mut segments = vec![(String::new(), 0)];
    let mut rest = path.chars();
    while let Some(c) = rest.next() {
        let Some((name, at)) = segments.last_mut() else { break };
        match c {
            BETWEEN => segments.push((String::new(), 0)),
            '[' => {
                let number: String = rest.by_ref().take_while(|c| *c != ']').collect();
                *at = number
                    .parse::<usize>()
                    .ok()
                    .and_then(|number| number.checked_sub(1))
                    .unwrap_or(usize::MAX);
            }
            '\\' => name.extend(rest.next()),
            c => name.push(c),
        }
    }
    segments
}

/// The objects in any of these ranges.
fn union(mut ranges: Vec<Range<u32>>) -> ObjectSet {
    ranges.sort_unstable_by_key(|range| range.start);
    let mut runs: Vec<Range<u32>> = Vec::new();
    for range in ranges.into_iter().filter(|range| !range.is_empty()) {
        match runs.last_mut().filter(|run| run.end >= range.start) {
            Some(run) => run.end = run.end.max(range.end),
            None => runs.push(range),
        }
    }
    let least = std::iter::once(0).chain(runs.iter().map(|run| run.end + 1));
    let coded = runs.iter().zip(least).map(|(run, least)| (run.start - least, run.len() as u32 - 1));
    // They are ascending, and none touches the next.
    ObjectSet::try_from(coded.collect::<Vec<_>>()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use trimaran_cook::{
        CookOptions, Model, cook,
        generate::{PlantOptions, plant},
    };
    use trimaran_scene::{Extent, Group, ObjectAttributes};

    use super::*;

    const WALL: &str = "3Fxyz01234567890123$_A";
    const DOOR: &str = "0aB$_cD1eF2gH3iJ4kL5mN";

    /// Two files. The first has two zones of the same name, with a group without a name between them.
    fn parts() -> SceneParts {
        let mut model: Model = plant(&PlantOptions::small(7));
        let count = model.objects.len() as u32;
        let attribute = |name: &str, value: &str| Attribute { name: name.into(), value: value.into() };
        let group = |name: &str, parent, objects: Range<u32>| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        model.hierarchy.groups = vec![
            group("a>b.RVM", None, 0..20),
            group("/ZONE", Some(0), 0..4),
            group("/PIPE[2]", Some(1), 2..4),
            group("", Some(0), 6..8),
            group("/ZONE", Some(0), 8..12),
            group("c\\.ifc", None, 20..count),
            group("Wall", Some(5), 22..24),
        ];
        model.hierarchy.groups[6].attributes = vec![attribute("Ifc GUID", WALL)];
        model.hierarchy.attributes = vec![
            ObjectAttributes { object: 3, attributes: vec![attribute("GlobalId", "too short")] },
            ObjectAttributes { object: 25, attributes: vec![attribute("GlobalId", DOOR)] },
        ];
        let scene = Arc::new(cook(&model, &CookOptions::default(), &()).unwrap());
        let hierarchy = Arc::new(scene.hierarchy().unwrap());
        SceneParts::new(&scene, &hierarchy)
    }

    fn set(objects: impl IntoIterator<Item = u32>) -> ObjectSet {
        objects.into_iter().collect()
    }

    fn ids(parts: &[PartRef]) -> Vec<&str> {
        parts.iter().map(|part| part.id.as_deref().unwrap()).collect()
    }

    fn by_guid(guid: &str) -> PartRef {
        PartRef { ifc_guid: Some(guid.to_owned()), ..PartRef::default() }
    }

    #[test]
    fn a_set_is_named_by_its_largest_groups() {
        let parts = parts();
        assert_eq!(ids(&parts.named(&set(0..20)).unwrap()), [r"a\>b.RVM"]);
        assert_eq!(ids(&parts.named(&set(8..12)).unwrap()), [r"a\>b.RVM>/ZONE[2]"]);
        let some = parts.named(&set(2..5)).unwrap();
        assert_eq!(ids(&some)[0], r"a\>b.RVM>/ZONE>/PIPE\[2]");
        assert_eq!(some.len(), 2, "the group, and the object behind it");
        assert_eq!(parts.found(&some), (set(2..5), 0));
        assert_eq!(parts.named(&ObjectSet::default()).unwrap(), []);
        // Numbers that the scene does not have are no parts.
        assert_eq!(parts.named(&set([1_000_000])).unwrap(), []);
    }

    #[test]
    fn parts_of_other_programs_are_found_by_their_guids() {
        let parts = parts();
        assert_eq!(parts.found(&[by_guid(WALL), by_guid(DOOR)]), (set([22, 23, 25]), 0));
        let unknown =
            PartRef { system: Some("Other".to_owned()), id: Some(r"a\>b.RVM".to_owned()), ..by_guid("x") };
        assert_eq!(parts.found(&[unknown, by_guid(DOOR)]), (set([25]), 1));
        let named = parts.named(&set(22..24)).unwrap();
        assert_eq!(named[0].ifc_guid.as_deref(), Some(WALL));
        // A part whose path has changed is found by its GUID.
        let moved = PartRef { id: Some("c\\\\.ifc>Other".to_owned()), ..named[0].clone() };
        assert_eq!(parts.found(&[moved]), (set([22, 23]), 0));
        let Bounds { min, max } = Bounds::of_most(&parts.scene, 22..24);
        assert_eq!(parts.middle(&[by_guid("x"), by_guid(WALL)]).unwrap()[1], (min[1] + max[1]) / 2.0);
        assert_eq!(parts.middle(&[by_guid("x")]), None);
    }

    #[test]
    fn other_programs_get_the_parts_that_they_know() {
        let parts = parts();
        let whole = parts.named(&set(20..parts.objects())).unwrap();
        assert_eq!(whole.len(), 1);
        let told = parts.for_others(&whole);
        let guids: Vec<_> = told.iter().filter_map(|part| part.ifc_guid.as_deref()).collect();
        assert_eq!(guids, [WALL, DOOR]);
        assert_eq!(parts.found(&told), (set(20..parts.objects()), 0), "the same objects");
        // A group without a GUID below it stays whole, and a part that is not there stays as it is.
        let zone = parts.named(&set(0..20)).unwrap();
        assert_eq!(parts.for_others(&zone), zone);
        assert_eq!(parts.for_others(&[by_guid("x")]), [by_guid("x")]);
    }

    #[test]
    fn paths_of_a_hostile_file_lead_nowhere() {
        let parts = parts();
        let part =
            |id: &str| PartRef { ifc_guid: None, system: Some(SYSTEM.to_owned()), id: Some(id.to_owned()) };
        for path in [
            "",
            ">",
            "[",
            "\\",
            "[18446744073709551616]",
            "[0]",
            "a\\>b.RVM>/ZONE[3]",
            "a\\>b.RVM>>>>>",
            "/ZONE",
            "a\\>b.RVM>/ZONE[-1]",
        ] {
            assert_eq!(parts.found(&[part(path)]), (ObjectSet::default(), 1), "{path}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn any_set_is_found_as_it_was_named(objects in prop::collection::vec(0_u32..60, 0..40)) {
            static PARTS: OnceLock<SceneParts> = OnceLock::new();
            let parts = PARTS.get_or_init(parts);
            let wanted = set(objects.into_iter().filter(|object| *object < parts.objects()));
            let named = parts.named(&wanted).unwrap();
            prop_assert_eq!(parts.found(&named), (wanted, 0));
        }

        #[test]
        fn names_are_read_as_they_were_written(
            names in prop::collection::vec((".{0,6}|[\\[\\]\\\\>a]{0,6}", 0..5_usize), 1..5),
        ) {
            let path = names.iter().map(|(name, at)| segment(name, *at)).collect::<Vec<_>>().join(">");
            prop_assert_eq!(segments(&path), names);
        }
    }
}
