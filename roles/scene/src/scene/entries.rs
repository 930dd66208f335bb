//! The wire format of drawables' records: packed, several at a time.
//!
//! Numbers that rise or repeat are written as differences, in the order given, and then the bytes of all
//! entries column by column: first the first byte of each, and so on. Entries that are near each other have
//! most of their bytes in common, so zstd packs the columns well.
//!
//! | bytes | what |
//! |---|---|
//! | 2 | number of entries, little-endian |
//! | .. | zstd of the columns, to the end |

use bytemuck::Zeroable;
use thiserror::Error;

use super::DrawableEntry;

/// The most entries that are packed together.
pub const MOST_ENTRIES: usize = 256;

const LEVEL: i32 = 3;
const SIZE: usize = size_of::<DrawableEntry>();

/// The bytes are not valid packed entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the records of drawables cannot be unpacked")]
pub struct EntriesError;

/// Packs entries: the first [`MOST_ENTRIES`]; later ones are ignored.
#[must_use]
pub fn pack_entries(entries: &[DrawableEntry]) -> Vec<u8> {
    let entries = entries.get(..MOST_ENTRIES).unwrap_or(entries);
    let mut changed = entries.to_vec();
    for (entry, before) in changed.iter_mut().skip(1).zip(entries) {
        apply(entry, before, u32::wrapping_sub);
    }
    let rows: &[u8] = bytemuck::cast_slice(&changed);
    let columns: Vec<u8> =
        (0..SIZE).flat_map(|column| rows.iter().skip(column).step_by(SIZE).copied()).collect();
    let mut packed = (entries.len() as u16).to_le_bytes().to_vec();
    // Packing into memory fails only if memory runs out.
    packed.extend(zstd::bulk::compress(&columns, LEVEL).unwrap_or_default());
    packed
}

/// Unpacks the output of [`pack_entries`]. Its allocation is bounded by [`MOST_ENTRIES`].
///
/// # Errors
/// If the bytes are invalid.
pub fn unpack_entries(packed: &[u8]) -> Result<Vec<DrawableEntry>, EntriesError> {
    let (count, packed) = packed.split_first_chunk().ok_or(EntriesError)?;
    let count = usize::from(u16::from_le_bytes(*count));
    if count > MOST_ENTRIES {
        return Err(EntriesError);
    }
    let columns = zstd::bulk::decompress(packed, count * SIZE).map_err(|_| EntriesError)?;
    if columns.len() != count * SIZE {
        return Err(EntriesError);
    }
    let mut entries = vec![DrawableEntry::zeroed(); count];
    for (row, bytes) in entries.iter_mut().enumerate() {
        let column = columns.iter().skip(row).step_by(count);
        for (byte, value) in bytemuck::bytes_of_mut(bytes).iter_mut().zip(column) {
            *byte = *value;
        }
    }
    let mut before = None;
    for entry in &mut entries {
        if let Some(before) = &before {
            apply(entry, before, u32::wrapping_add);
        }
        before = Some(*entry);
    }
    Ok(entries)
}

/// Changes the numbers of an entry by those of the previous one.
fn apply(entry: &mut DrawableEntry, before: &DrawableEntry, change: fn(u32, u32) -> u32) {
    entry.id = change(entry.id, before.id);
    entry.node = change(entry.node, before.node);
    entry.geometry = change(entry.geometry, before.geometry);
    entry.object = change(entry.object, before.object);
    entry.level = change(entry.level, before.level);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_entry() -> impl Strategy<Value = DrawableEntry> {
        prop::array::uniform32(any::<u32>()).prop_map(|words| {
            let bytes: Vec<u8> =
                words.iter().flat_map(|word| word.to_le_bytes()).cycle().take(SIZE).collect();
            bytemuck::pod_read_unaligned(&bytes)
        })
    }

    fn bytes(entries: &[DrawableEntry]) -> &[u8] {
        bytemuck::cast_slice(entries)
    }

    proptest! {
        #[test]
        fn what_is_packed_unpacks_to_the_bit(entries in prop::collection::vec(any_entry(), 0..20)) {
            let unpacked = unpack_entries(&pack_entries(&entries)).unwrap();
            prop_assert_eq!(bytes(&unpacked), bytes(&entries));
        }

        #[test]
        fn any_bytes_are_refused_or_are_entries(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            if let Ok(entries) = unpack_entries(&bytes) {
                prop_assert!(entries.len() <= MOST_ENTRIES);
            }
        }
    }

    #[test]
    fn no_more_than_the_most_are_packed() {
        let entries = vec![DrawableEntry::zeroed(); MOST_ENTRIES + 1];
        assert_eq!(unpack_entries(&pack_entries(&entries)).map(|entries| entries.len()), Ok(MOST_ENTRIES));
        let more =
            [&257_u16.to_le_bytes()[..], &zstd::bulk::compress(&vec![0; 257 * SIZE], 3).unwrap()].concat();
        assert_eq!(unpack_entries(&more), Err(EntriesError));
    }
}
