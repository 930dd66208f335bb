//! Makes the groups of objects from the tree in a file.

use std::ops::Range;

use trimaran_scene::{Attribute, Extent, Group};

/// A part of a file's tree with parts below it. It is not known yet which of its leaves become objects.
#[derive(Debug)]
pub(super) struct Branch {
    pub name: String,
    /// Index of the branch that it is in.
    pub parent: Option<u32>,
    /// Numbers of the leaves in it and below it.
    pub leaves: Range<u32>,
    pub attributes: Vec<Attribute>,
}

/// The groups of branches that have objects. Branches are in depth-first order, and `leaves` are the numbers
/// of those that became objects, ascending.
pub(super) fn groups(branches: Vec<Branch>, leaves: &[u32]) -> Vec<Group> {
    let before = |end: u32| leaves.partition_point(|&leaf| leaf < end) as u32;
    let mut groups = Vec::new();
    // The group of each branch.
    let mut numbers: Vec<Option<u32>> = Vec::with_capacity(branches.len());
    for Branch { name, parent, leaves, attributes } in branches {
        let objects = before(leaves.start)..before(leaves.end);
        numbers.push((!objects.is_empty()).then_some(groups.len() as u32));
        if !objects.is_empty() {
            let parent = parent.and_then(|parent| numbers.get(parent as usize).copied().flatten());
            groups.push(Group { name: name.into(), parent, objects, attributes, extent: Extent::default() });
        }
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn branch(name: &str, parent: Option<u32>, leaves: Range<u32>) -> Branch {
        Branch { name: name.into(), parent, leaves, attributes: Vec::new() }
    }

    #[test]
    fn branches_without_objects_are_no_groups() {
        let branches = vec![
            branch("site", None, 0..9),
            branch("empty", Some(0), 1..4),
            branch("below", Some(1), 2..4),
            branch("zone", Some(0), 4..9),
            branch("pipe", Some(3), 5..8),
        ];
        let groups = groups(branches, &[0, 5, 7, 8]);
        let found: Vec<_> = groups.iter().map(|g| (&*g.name, g.parent, g.objects.clone())).collect();
        assert_eq!(found, [("site", None, 0..4), ("zone", Some(0), 1..4), ("pipe", Some(1), 1..3)]);
    }
}
