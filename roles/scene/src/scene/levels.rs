//! The levels of groups around an object, at which people pick and compare.

use std::{ops::Range, str::FromStr};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::Hierarchy;

/// A level of the named groups around an object, counted outwards. The file, its outermost group, is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GroupLevel {
    /// The innermost named group.
    Part,
    /// The next one.
    Equipment,
    /// The one after that.
    System,
}

/// A text is no level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("give part, equipment or system")]
pub struct GroupLevelError;

impl GroupLevel {
    /// All of them, outwards.
    pub const ALL: [Self; 3] = [Self::Part, Self::Equipment, Self::System];

    /// Its name.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Part => "part",
            Self::Equipment => "equipment",
            Self::System => "system",
        }
    }
}

impl FromStr for GroupLevel {
    type Err = GroupLevelError;

    fn from_str(text: &str) -> Result<Self, GroupLevelError> {
        Self::ALL.into_iter().find(|level| level.as_str() == text).ok_or(GroupLevelError)
    }
}

impl Hierarchy {
    /// For each of this many objects the run of objects of its group at a level. An object in fewer named
    /// groups has the outermost of them, and one in none is alone. The page does the same in
    /// `roles/page/src/objects/levels.ts`.
    #[must_use]
    pub fn groups_at(&self, level: GroupLevel, objects: u32) -> Vec<Range<u32>> {
        let mut found: Vec<Range<u32>> = (0..objects).map(|object| object..object + 1).collect();
        // The named groups around the objects of each group, the innermost first.
        let mut around: Vec<[Option<&Range<u32>>; 3]> = Vec::with_capacity(self.groups.len());
        for group in &self.groups {
            let above = group.parent.and_then(|parent| around.get(parent as usize)).copied();
            let above = above.unwrap_or_default();
            let is_level = group.parent.is_some() && !group.name.is_empty();
            let [first, second, _] = above;
            let own = if is_level { [Some(&group.objects), first, second] } else { above };
            around.push(own);
            let Range { start, end } = group.objects;
            let chosen = own.into_iter().take(1 + level as usize).flatten().next_back();
            // Groups stand behind those that they are in, and so the innermost is the last one.
            if let (Some(chosen), Some(within)) = (chosen, found.get_mut(start as usize..end as usize)) {
                within.fill(chosen.clone());
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Extent, Group};

    #[test]
    fn levels_are_named_groups_counted_outwards() {
        let group = |name: &str, parent, objects| Group {
            name: name.into(),
            parent,
            objects,
            attributes: Vec::new(),
            extent: Extent::default(),
        };
        let groups = vec![
            group("plant.RVM", None, 0..12),
            group("/ZONE", Some(0), 1..10),
            group("/PIPE", Some(1), 2..9),
            group("/BRANCH", Some(2), 3..8),
            group("", Some(3), 3..6),
            group("FLANGE 1", Some(4), 4..6),
            group("other.RVM", None, 12..13),
        ];
        let hierarchy = Hierarchy { groups, ..Hierarchy::default() };
        let at = |level| hierarchy.groups_at(level, 13);
        let (part, equipment, system) =
            (at(GroupLevel::Part), at(GroupLevel::Equipment), at(GroupLevel::System));
        let of = |object: usize| [&part[object], &equipment[object], &system[object]].map(Range::clone);
        assert_eq!((part.len(), of(0)), (13, [0..1, 0..1, 0..1]), "a file is no level");
        assert_eq!(of(12), [12..13, 12..13, 12..13]);
        assert_eq!(of(1), [1..10, 1..10, 1..10], "it is in one group alone");
        assert_eq!(of(2), [2..9, 1..10, 1..10]);
        assert_eq!(of(3), [3..8, 2..9, 1..10], "a group without a name is no level");
        assert_eq!(of(5), [4..6, 3..8, 2..9]);
        assert_eq!((of(7), of(8), of(9)), ([3..8, 2..9, 1..10], of(2), of(1)));
    }

    #[test]
    fn levels_have_names() {
        for level in GroupLevel::ALL {
            assert_eq!(level.as_str().parse(), Ok(level));
            assert_eq!(serde_json::to_value(level).unwrap(), level.as_str());
        }
        assert_eq!("Part".parse::<GroupLevel>(), Err(GroupLevelError));
    }
}
