//! Matches the groups of attribute files with those of a model: by path, since many share a name.
//!
//! The two trees may differ. An export may begin deeper in the database than the attributes do, or leave out
//! levels; and some programs write attributes without any levels. Names from the database (`/PIPE-1`, `FLANGE
//! 1 of BRANCH /B1`) have a slash and are unique everywhere. All others (`FLANGE 1`) are only unique within
//! their group.

use std::collections::HashMap;

use super::attributes::Attributes;
use super::file::Group;

/// For each group of a model its group of the attribute files, if it has one.
pub(super) fn matches(groups: &[Group], attributes: &Attributes) -> Vec<Option<u32>> {
    let mut count: HashMap<&str, u32> = HashMap::new();
    for group in groups {
        *count.entry(&group.name).or_default() += 1;
    }
    let mut met: HashMap<(Option<u32>, &str), usize> = HashMap::new();
    let mut found: Vec<Option<u32>> = Vec::with_capacity(groups.len());
    // For each group the match of its innermost matched ancestor, or its own.
    let mut innermost: Vec<Option<u32>> = Vec::with_capacity(groups.len());
    for group in groups {
        let parent = group.parent.map(|parent| parent as usize);
        let around = parent.and_then(|parent| innermost.get(parent).copied().flatten());
        let before = met.entry((group.parent, &group.name)).or_default();
        let seeker = Seeker {
            name: &group.name,
            around,
            around_is_parent: parent.is_none_or(|parent| found.get(parent).is_some_and(Option::is_some)),
            before: *before,
            only_in_model: count.get(&*group.name) == Some(&1),
        };
        *before += 1;
        let node = seeker.find(attributes);
        found.push(node);
        innermost.push(node.or(around));
    }
    found
}

/// A group looking for its attributes.
struct Seeker<'g> {
    name: &'g str,
    /// The match of its innermost matched ancestor.
    around: Option<u32>,
    /// Whether that is its parent.
    around_is_parent: bool,
    /// How many siblings of its name come before it.
    before: usize,
    /// Whether no other group of the model has its name.
    only_in_model: bool,
}

impl Seeker<'_> {
    fn find(&self, attributes: &Attributes) -> Option<u32> {
        match attributes.children(self.around, self.name) {
            // Groups that a model names twice share one of the attributes.
            [only] if self.around_is_parent => return Some(*only),
            all if self.around_is_parent && !all.is_empty() => return all.get(self.before).copied(),
            _ => {}
        }
        let means_one_thing = self.name.contains('/');
        let inside = attributes.only(self.around, self.name);
        if means_one_thing || (self.only_in_model && attributes.is_flat()) {
            return inside.or_else(|| attributes.only(None, self.name));
        }
        // Levels may be missing on one side, not on both.
        let level_with = |node: &u32| self.around_is_parent || attributes.parent(*node) == self.around;
        inside.filter(|_| self.only_in_model).filter(level_with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups, given as lines: indentation is depth.
    fn model(lines: &[&str]) -> Vec<Group> {
        let mut open: Vec<u32> = Vec::new();
        let mut groups = Vec::new();
        for line in lines {
            let name = line.trim_start();
            open.truncate(line.len() - name.len());
            groups.push(Group { name: name.into(), parent: open.last().copied(), end: 0 });
            open.push(groups.len() as u32 - 1);
        }
        groups
    }

    /// The same as an attribute file. Each group has its number as attribute.
    fn file(lines: &[&str]) -> Attributes {
        let mut text = "CADC_Attributes_File v1.0\n".to_owned();
        let mut depth = 0;
        for line in lines {
            let indent = line.len() - line.trim_start().len();
            text += &"END\n".repeat(depth - indent);
            text += &format!("NEW {}\n", line.trim_start());
            depth = indent + 1;
        }
        let mut attributes = Attributes::default();
        attributes.add(&text);
        attributes
    }

    fn found(groups: &[&str], attributes: &[&str]) -> Vec<Option<u32>> {
        matches(&model(groups), &file(attributes))
    }

    #[test]
    fn equal_names_are_told_apart_by_their_paths() {
        let both = ["/P1", " FLANGE 1", "/P2", " FLANGE 1"];
        assert_eq!(found(&both, &both), [Some(0), Some(1), Some(2), Some(3)]);
        // The pipes are in another order.
        let turned = ["/P2", " FLANGE 1", "/P1", " FLANGE 1"];
        assert_eq!(found(&both, &turned), [Some(2), Some(3), Some(0), Some(1)]);
        // The second flange and the second pipe have no attributes.
        assert_eq!(found(&both, &["/P1", " FLANGE 1", "/P2"]), [Some(0), Some(1), Some(2), None]);
        assert_eq!(found(&both, &["/P1", " FLANGE 1"]), [Some(0), Some(1), None, None]);
    }

    #[test]
    fn equal_paths_are_matched_in_their_order() {
        let two = ["/P1", " FLANGE", " TUBE", " FLANGE"];
        assert_eq!(found(&two, &two), [Some(0), Some(1), Some(2), Some(3)]);
        assert_eq!(found(&["/A", "/A"], &["/A"]), [Some(0), Some(0)]);
        assert_eq!(found(&["A", "A", "A"], &["A", "A"]), [Some(0), Some(1), None]);
    }

    #[test]
    fn a_model_may_begin_deeper_than_its_attributes_or_higher() {
        let deep = ["/*", " /SITE", "  /P1", "   FLANGE 1", "  /P2", "   FLANGE 1"];
        let pipes = ["/P1", " FLANGE 1", "/P2", " FLANGE 1"];
        assert_eq!(found(&pipes, &deep), [Some(2), Some(3), Some(4), Some(5)]);
        assert_eq!(found(&deep, &pipes), [None, None, Some(0), Some(1), Some(2), Some(3)]);
    }

    #[test]
    fn levels_may_be_missing_on_one_side() {
        let branch = ["/P1", " /P1/B1", "  FLANGE 1"];
        assert_eq!(found(&["/P1", " FLANGE 1"], &branch), [Some(0), Some(2)]);
        assert_eq!(found(&branch, &["/P1", " FLANGE 1"]), [Some(0), None, Some(1)]);
        // Each has a level that the other lacks.
        assert_eq!(found(&branch, &["/P1", " /P1/B2", "  FLANGE 1"]), [Some(0), None, None]);
        assert_eq!(found(&["/P9", " FLANGE 1"], &["/P1", " FLANGE 1"]), [None, None]);
    }

    #[test]
    fn attributes_without_levels_go_by_names_that_mean_one_thing() {
        let groups = ["/SITE", " /P1", "  FLANGE 1 of /P1", "  VALVE"];
        assert_eq!(found(&groups, &["/P1", "VALVE", "FLANGE 1 of /P1"]), [None, Some(0), Some(2), Some(1)]);
        assert_eq!(found(&["UNIT", " MOTOR"], &["MOTOR", "PUMP"]), [None, Some(0)]);
        // It could belong to either.
        assert_eq!(found(&["A", " MOTOR", "B", " MOTOR"], &["MOTOR"]), [None; 4]);
    }
}
