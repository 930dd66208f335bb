//! The bulk lane: geometry for a display that holds none, and that display's messages about it.
//!
//! A block holds consecutive items, each encoded by postcard. A culler sends [`Supply`], a display
//! [`Demand`].

use bytes::Bytes;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;
use trimaran_wire::MAX_BLOCK;

use crate::varint::{get_varint, put_varint};
use crate::{DrawableId, FrameNumber};

/// Items from a culler to a display that holds no scene.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Supply {
    /// Records that drawing needs of drawables beside their geometry, packed by `trimaran-scene`.
    Entries {
        /// The packed records.
        packed: Bytes,
    },
    /// The next part of a piece of geometry, as in the scene's file. The parts of a piece come in order, with
    /// no parts of other pieces in between.
    Geometry {
        /// The number of the piece.
        number: u32,
        /// The bytes of the whole piece.
        length: u32,
        /// The offset of this part in the piece.
        offset: u32,
        /// The part.
        part: Bytes,
    },
    /// A coarser level that may be shown in place of other drawables until these have arrived.
    StandIn {
        /// Its first drawable.
        id: DrawableId,
        /// How many drawables it consists of: this many consecutive ones.
        pieces: u32,
        /// The drawables that it stands in for.
        drawables: NumberList,
    },
    /// Prefetched geometry, sent or about to be sent, that no frame needs yet.
    Ahead {
        /// The pieces.
        geometries: NumberList,
    },
}

/// Items from a display without a scene to the culler that supplies it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Demand {
    /// Asks for everything that becomes visible from now on.
    Begin {
        /// Whether coarser drawables are sent first, as stand-ins for geometry still to come.
        coarser_first: bool,
        /// The limit of prefetched geometry that no frame has used, in bytes. Such bytes count for ten
        /// seconds. 0 turns prefetching off.
        ahead: u64,
    },
    /// Ends the supply: another culler takes over.
    End,
    /// Data that the display already has.
    Holds {
        /// Drawables whose records it has.
        drawables: NumberList,
        /// Pieces of geometry.
        geometries: NumberList,
    },
    /// A frame needs drawables of which some are missing.
    Lacks {
        /// The frame, as the display numbers it.
        frame: FrameNumber,
        /// Bytes of blocks that the display had taken from this culler by then. Later blocks may still be in
        /// flight.
        taken: u64,
        /// The drawables.
        drawables: NumberList,
    },
    /// The display threw geometry away.
    Dropped {
        /// The pieces.
        geometries: NumberList,
    },
    /// Bytes of blocks that the display has taken from this culler, in all.
    Taken {
        /// Bytes.
        bytes: u64,
    },
    /// A frame was shown. Data that only this frame and earlier ones lack is no longer needed.
    Shown {
        /// The frame, as the display numbers it.
        frame: FrameNumber,
    },
}

/// A block of the bulk lane that cannot be read.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("an item of the bulk lane cannot be read")]
pub struct BulkError(#[from] postcard::Error);

/// Appends an item to a block. If it has no room, returns false and leaves the block as it was.
#[must_use]
pub fn put_item(block: &mut Vec<u8>, item: &impl Serialize) -> bool {
    match postcard::to_stdvec(item) {
        Ok(bytes) if block.len() + bytes.len() <= MAX_BLOCK => {
            block.extend(bytes);
            true
        }
        _ => false,
    }
}

/// The items of a block.
///
/// # Errors
/// If a byte is not part of an item.
pub fn items<T: DeserializeOwned>(mut block: &[u8]) -> Result<Vec<T>, BulkError> {
    let mut items = Vec::new();
    while !block.is_empty() {
        let (item, rest) = postcard::take_from_bytes(block)?;
        items.push(item);
        block = rest;
    }
    Ok(items)
}

/// Rising numbers. On the wire each is a varint: its difference from the one before, minus 1.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct NumberList(Vec<u32>);

impl NumberList {
    /// This many numbers fit into a block, however large they are.
    pub const MOST: usize = 3_000;

    /// Sorts these numbers and removes duplicates.
    #[must_use]
    pub fn of(mut numbers: Vec<u32>) -> Self {
        numbers.sort_unstable();
        numbers.dedup();
        Self(numbers)
    }

    /// Splits the list into lists that each fit into a block.
    pub fn parts(&self) -> impl Iterator<Item = Self> + '_ {
        self.0.chunks(Self::MOST).map(|part| Self(part.to_vec()))
    }

    /// Whether the list is empty.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The numbers.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = u32> + '_ {
        self.0.iter().copied()
    }

    fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(2 * self.0.len());
        let mut least = 0;
        for number in &self.0 {
            put_varint(&mut bytes, number - least);
            least = number.wrapping_add(1);
        }
        bytes
    }

    fn of_bytes(mut bytes: &[u8]) -> Option<Self> {
        let mut numbers = Vec::with_capacity(bytes.len());
        let mut least = Some(0_u32);
        while !bytes.is_empty() {
            let number = least?.checked_add(get_varint(&mut bytes)?)?;
            numbers.push(number);
            least = number.checked_add(1);
        }
        Some(Self(numbers))
    }
}

impl Serialize for NumberList {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.to_bytes())
    }
}

impl<'de> Deserialize<'de> for NumberList {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let bytes = Bytes::deserialize(deserializer)?;
        Self::of_bytes(&bytes).ok_or_else(|| D::Error::custom("numbers that do not rise within 32 bits"))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_numbers() -> impl Strategy<Value = NumberList> {
        let numbers = prop_oneof![0..100_u32, any::<u32>(), Just(u32::MAX)];
        prop::collection::vec(numbers, 0..200).prop_map(NumberList::of)
    }

    fn any_demand() -> impl Strategy<Value = Demand> {
        let frame = any::<u32>().prop_map(FrameNumber);
        prop_oneof![
            any::<(bool, u64)>().prop_map(|(coarser_first, ahead)| Demand::Begin { coarser_first, ahead }),
            Just(Demand::End),
            (any_numbers(), any_numbers())
                .prop_map(|(drawables, geometries)| Demand::Holds { drawables, geometries }),
            (frame.clone(), any::<u64>(), any_numbers())
                .prop_map(|(frame, taken, drawables)| Demand::Lacks { frame, taken, drawables }),
            any_numbers().prop_map(|geometries| Demand::Dropped { geometries }),
            any::<u64>().prop_map(|bytes| Demand::Taken { bytes }),
            frame.prop_map(|frame| Demand::Shown { frame }),
        ]
    }

    fn any_supply() -> impl Strategy<Value = Supply> {
        let bytes = || prop::collection::vec(any::<u8>(), 0..500).prop_map(Bytes::from);
        prop_oneof![
            bytes().prop_map(|packed| Supply::Entries { packed }),
            (any::<[u32; 3]>(), bytes()).prop_map(|([number, length, offset], part)| {
                Supply::Geometry { number, length, offset, part }
            }),
            (any::<[u32; 2]>(), any_numbers()).prop_map(|([id, pieces], drawables)| {
                Supply::StandIn { id: DrawableId(id), pieces, drawables }
            }),
            any_numbers().prop_map(|geometries| Supply::Ahead { geometries }),
        ]
    }

    proptest! {
        #[test]
        fn demands_are_read_as_they_were_written(demands in prop::collection::vec(any_demand(), 0..9)) {
            let mut block = Vec::new();
            prop_assert!(demands.iter().all(|demand| put_item(&mut block, demand)));
            prop_assert_eq!(items::<Demand>(&block), Ok(demands));
        }

        #[test]
        fn supplies_are_read_as_they_were_written(supplies in prop::collection::vec(any_supply(), 0..9)) {
            let mut block = Vec::new();
            prop_assert!(supplies.iter().all(|supply| put_item(&mut block, supply)));
            prop_assert_eq!(items::<Supply>(&block), Ok(supplies));
        }

        #[test]
        fn any_bytes_are_refused_or_are_items(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = items::<Supply>(&bytes);
            if let Ok(demands) = items::<Demand>(&bytes) {
                prop_assert!(demands.len() <= bytes.len());
            }
        }
    }

    #[test]
    fn a_full_block_takes_no_more() {
        let part = Bytes::from(vec![7; MAX_BLOCK / 2]);
        let half = Supply::Geometry { number: 1, length: 2, offset: 3, part };
        let mut block = Vec::new();
        assert!(put_item(&mut block, &half));
        let before = block.clone();
        assert!(!put_item(&mut block, &half));
        assert_eq!(block, before);
    }

    #[test]
    fn the_largest_numbers_fit_a_block() {
        let gaps = (0..NumberList::MOST as u32).map(|number| number * (u32::MAX / NumberList::MOST as u32));
        let drawables = NumberList::of(gaps.collect());
        assert_eq!(drawables.iter().len(), NumberList::MOST);
        let demand = Demand::Lacks { frame: FrameNumber(u32::MAX), taken: u64::MAX, drawables };
        assert!(put_item(&mut Vec::new(), &demand));
    }

    #[test]
    fn numbers_beyond_32_bits_are_refused() {
        let mut bytes = Vec::new();
        put_varint(&mut bytes, u32::MAX);
        assert_eq!(NumberList::of_bytes(&bytes), Some(NumberList(vec![u32::MAX])));
        put_varint(&mut bytes, 0);
        assert_eq!(NumberList::of_bytes(&bytes), None);
        assert_eq!(NumberList::of_bytes(&[0x80]), None);
    }

    #[test]
    fn a_list_has_each_number_once_and_may_be_empty() {
        let list = NumberList::of(vec![7, 3, 7, u32::MAX]);
        assert_eq!((list.iter().collect::<Vec<_>>(), list.is_empty()), (vec![3, 7, u32::MAX], false));
        assert!(NumberList::of(Vec::new()).is_empty());
    }
}
