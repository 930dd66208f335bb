//! A cache of heightfield tiles: the most recently used ones.

use std::collections::HashMap;

use hyper::body::Bytes;

/// The size limit of the cache, bytes.
const MOST: usize = 32 << 20;

/// Tiles by their numbers, x and z.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    kept: HashMap<[i32; 2], Kept>,
    bytes: usize,
    /// Counts requests.
    asked: u64,
}

#[derive(Debug)]
struct Kept {
    tile: Bytes,
    /// The number of the last request for it.
    asked: u64,
}

impl Tiles {
    pub(super) fn get(&mut self, number: [i32; 2]) -> Option<Bytes> {
        self.asked += 1;
        let kept = self.kept.get_mut(&number)?;
        kept.asked = self.asked;
        Some(kept.tile.clone())
    }

    /// Keeps a tile, and drops the least recently used ones.
    pub(super) fn keep(&mut self, number: [i32; 2], tile: Bytes) {
        self.asked += 1;
        self.bytes += tile.len();
        if let Some(before) = self.kept.insert(number, Kept { tile, asked: self.asked }) {
            self.bytes -= before.tile.len();
        }
        while self.bytes > MOST
            && let Some(oldest) =
                self.kept.iter().min_by_key(|(_, kept)| kept.asked).map(|(number, _)| *number)
            && let Some(Kept { tile, .. }) = self.kept.remove(&oldest)
        {
            self.bytes -= tile.len();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_that_were_asked_for_last_are_kept_and_no_more_than_fit() {
        let mut tiles = Tiles::default();
        let tile = |number: i32| Bytes::from(vec![number as u8; 1 << 20]);
        let fit = (MOST >> 20) as i32;
        for number in 0..fit {
            tiles.keep([number, -1], tile(number));
        }
        assert_eq!(tiles.get([0, -1]), Some(tile(0)));
        assert_eq!(tiles.get([0, 0]), None);
        tiles.keep([fit, -1], tile(fit));
        tiles.keep([fit, -1], tile(fit));
        assert_eq!(tiles.get([1, -1]), None, "it was asked for the longest time ago");
        assert!([0, 2, fit].iter().all(|number| tiles.get([*number, -1]).is_some()));
        assert_eq!((tiles.kept.len() as i32, tiles.bytes), (fit, MOST));
    }
}
