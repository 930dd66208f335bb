//! Clashes by pairs of groups: of a part and a part, of one piece of equipment and another.

use std::{collections::HashMap, ops::Range};

use serde::Serialize;
use trimaran_scene::{GroupLevel, ReadError, clearance::Clearance};

use super::rows::{ClashNames, ClashPart, ClashRow, path_cell};

/// The clashes between two groups.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClashGroup {
    /// How many there are.
    pub clashes: usize,
    /// How many of them are hard.
    pub hard: usize,
    /// The name of each group behind those of the groups that it is in, from the file.
    pub groups: [Vec<String>; 2],
    /// The nearest of them. Its objects are in the order of the groups.
    pub nearest: ClashRow,
}

/// The columns of [`ClashGroup::to_csv`] before those of the nearest clash.
pub const CLASH_GROUP_COLUMNS: &str = "clashes,hard,group_1,group_2,";

impl ClashNames {
    /// The clashes of each pair of groups at a level, in the order of the nearest clash of each. Clashes are
    /// the nearest first. `scene_name` is the name of the model in links.
    ///
    /// # Errors
    /// If a part of the scene cannot be read.
    pub fn groups(
        &self,
        scene_name: &str,
        level: GroupLevel,
        clashes: &[Clearance],
    ) -> Result<Vec<ClashGroup>, ReadError> {
        let (nearest, counts): (Vec<_>, Vec<_>) =
            counted(&self.groups_at(level), clashes).into_iter().unzip();
        let rows = self.rows(scene_name, &nearest)?.into_iter();
        let group = |(row, [clashes, hard]): (ClashRow, [usize; 2])| ClashGroup {
            clashes,
            hard,
            groups: row.parts.each_ref().map(|part| part.group(level)),
            nearest: row,
        };
        Ok(rows.zip(counts).map(group).collect())
    }
}

/// The nearest clash of each pair of groups, and how many there are and how many of them are hard.
fn counted(groups: &[Range<u32>], clashes: &[Clearance]) -> Vec<(Clearance, [usize; 2])> {
    let (mut places, mut found) = (HashMap::new(), Vec::new());
    for clash in clashes {
        let mut pair = clash.objects.map(|object| groups.get(object as usize).map(|of| (of.start, of.end)));
        pair.sort_unstable();
        let place = *places.entry(pair).or_insert_with(|| {
            found.push((*clash, [0, 0]));
            found.len() - 1
        });
        if let Some((_, [all, hard])) = found.get_mut(place) {
            *all += 1;
            *hard += usize::from(clash.is_hard());
        }
    }
    found
}

impl ClashPart {
    /// The names of its group at a level, and before it of those that this one is in. The object stands for
    /// itself where no group has a name.
    fn group(&self, level: GroupLevel) -> Vec<String> {
        // The outermost is the file.
        let is_named = |at: &usize| self.path.get(*at).is_some_and(|name| !name.is_empty());
        let outwards = (1..self.path.len()).rev().filter(is_named).take(1 + level as usize);
        match outwards.last() {
            Some(at) => self.path.iter().take(at + 1).cloned().collect(),
            None => self.path.iter().cloned().chain([self.called()]).collect(),
        }
    }

    fn called(&self) -> String {
        if self.name.is_empty() { format!("object {}", self.object) } else { self.name.clone() }
    }
}

impl ClashGroup {
    /// A line of comma-separated values, with the columns [`CLASH_GROUP_COLUMNS`] and those of the nearest
    /// clash.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let Self { clashes, hard, groups: [first, second], nearest } = self;
        let [first, second] = [first, second].map(|group| path_cell(group));
        format!("{clashes},{hard},{first},{second},{}", nearest.to_csv())
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::page::clash::rows::tests::names;

    fn clash(objects: [u32; 2], distance: f64) -> Clearance {
        Clearance { objects, distance, points: [DVec3::ZERO, DVec3::X * distance], rounding: 2e-6 }
    }

    #[test]
    fn clashes_are_counted_by_pairs_of_groups_in_either_order() {
        let clashes = [
            clash([2, 0], 0.0),
            clash([4, 5], 0.0),
            clash([1, 3], 0.01),
            clash([5, 4], 0.02),
            clash([3, 4], 0.03),
        ];
        let groups = [0..2, 0..2, 2..4, 2..4, 4..5];
        let found = counted(&groups, &clashes);
        let expected = [(clashes[0], [2, 1]), (clashes[1], [2, 1]), (clashes[4], [1, 0])];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_pair_of_groups_has_names_counts_and_its_nearest_clash() {
        let clashes = [clash([2, 5], 1e-6), clash([3, 5], 0.01), clash([1, 2], 0.02)];
        let at = |level| names().groups("plant", level, &clashes).unwrap();
        let parts = at(GroupLevel::Part);
        assert_eq!(parts.iter().map(|of| (of.clashes, of.hard)).collect::<Vec<_>>(), [(2, 1), (1, 0)]);
        assert_eq!(parts[0].groups[0], ["plant.RVM", "/ZONE \"1\", north", "/PIPE-7"]);
        assert_eq!(parts[1].groups[0], ["plant.RVM", "/ZONE \"1\", north"]);
        assert_eq!((parts[0].nearest.parts[0].object, parts[1].nearest.distance), (2, 0.02));
        let [_, alone] = &parts[0].groups;
        assert!(alone.len() == 2 && alone[0] == "plant.RVM" && !alone[1].is_empty(), "{alone:?}");
        // One level up, the zone is that of all three.
        let equipment = at(GroupLevel::Equipment);
        assert_eq!(equipment[0].groups[0], ["plant.RVM", "/ZONE \"1\", north"]);
        assert_eq!(equipment[1].groups[0], equipment[1].groups[1]);
        let csv = parts[0].to_csv();
        let start = "2,1,\"plant.RVM > /ZONE \"\"1\"\", north > /PIPE-7\",plant.RVM > ";
        assert!(csv.starts_with(start) && csv.ends_with(&parts[0].nearest.to_csv()), "{csv}");
        assert_eq!(CLASH_GROUP_COLUMNS.matches(',').count(), 4);
    }

    #[test]
    fn an_object_without_groups_and_name_is_called_by_its_number() {
        let part = |path: &[&str], name: &str| ClashPart {
            object: 7,
            name: name.into(),
            path: path.iter().map(|&group| group.into()).collect(),
        };
        assert_eq!(part(&[], "").group(GroupLevel::Part), ["object 7"]);
        assert_eq!(part(&["a.stl", ""], "box").group(GroupLevel::System), ["a.stl", "", "box"]);
        let deep = part(&["a.rvm", "Z", "", "E", "P", ""], "box");
        assert_eq!(deep.group(GroupLevel::Part), ["a.rvm", "Z", "", "E", "P"]);
        assert_eq!(deep.group(GroupLevel::Equipment), ["a.rvm", "Z", "", "E"]);
        assert_eq!(deep.group(GroupLevel::System), ["a.rvm", "Z"]);
    }
}
