//! Distributes the attributes of attribute files to the parts of a model.

use trimaran_scene::Attribute;

use super::attributes::Attributes;
use super::file::Group;
use super::matching::matches;
use crate::import::budget::{Budget, OverBudget};

/// The bytes counted for a repeated attribute, beside its letters.
const FURTHER: u64 = 16;

/// Attributes of groups.
pub(super) struct Said {
    attributes: Attributes,
    /// The attribute files' group of each group.
    of: Vec<Option<u32>>,
    /// How many parts of the model each group is: an object, a group of objects, or both.
    parts: Vec<u32>,
    /// How often each of the attribute files' groups is still to be used.
    left: Vec<u32>,
}

impl Said {
    /// Attributes for `groups`. Those with the numbers `objects`, ascending, are objects.
    pub(super) fn new(attributes: Attributes, groups: &[Group], objects: &[u32]) -> Self {
        let of = matches(groups, &attributes);
        let before = |end: u32| objects.partition_point(|&object| object < end);
        let part = |(number, group): (u32, &Group)| {
            let is_object = u32::from(objects.binary_search(&number).is_ok());
            is_object + u32::from(group.end > number + 1 && before(number) < before(group.end))
        };
        let parts: Vec<u32> = (0..).zip(groups).map(part).collect();
        let mut left = vec![0; attributes.len()];
        for (node, parts) in of.iter().zip(&parts) {
            if let Some(left) = node.and_then(|node| left.get_mut(node as usize)) {
                *left += parts;
            }
        }
        Self { attributes, of, parts, left }
    }

    /// How many parts there are, and how many of them have attributes.
    pub(super) fn matched(&self) -> [u64; 2] {
        let parts = || self.parts.iter().zip(&self.of).filter(|(parts, _)| **parts > 0);
        [parts().count() as u64, parts().filter(|(_, node)| node.is_some()).count() as u64]
    }

    /// The attributes of a group that is a part of the model. All but the last are copies, which count.
    pub(super) fn of(&mut self, group: u32, budget: &Budget) -> Result<Vec<Attribute>, OverBudget> {
        let place = group as usize;
        let (Some(Some(node)), Some(1..)) = (self.of.get(place).copied(), self.parts.get(place)) else {
            return Ok(Vec::new());
        };
        let (Some(said), Some(left)) = (self.attributes.of(node), self.left.get_mut(node as usize)) else {
            return Ok(Vec::new());
        };
        *left = left.saturating_sub(1);
        if *left == 0 {
            return Ok(std::mem::take(said));
        }
        let bytes = |said: &Attribute| said.name.len() as u64 + said.value.len() as u64 + FURTHER;
        budget.attributes(said.iter().map(bytes).sum(), || {
            "the attributes that several parts share".to_owned()
        })?;
        Ok(said.clone())
    }
}
