//! Work on many parts of a scene, on all threads.

use rayon::prelude::*;
use trimaran_scene::{ReadError, Scene};

/// Parts that a thread takes at a time: some tens of microseconds' work. Waking up threads for fewer than
/// two such chunks costs more than it saves.
const CHUNK: usize = 128;

/// The results of `work` on each chunk of these parts, in order.
pub(crate) fn in_chunks<P: Sync, R: Send>(parts: &[P], work: impl Fn(&[P]) -> R + Sync + Send) -> Vec<R> {
    if parts.len() < 2 * CHUNK {
        return vec![work(parts)];
    }
    parts.par_chunks(CHUNK).map(work).collect()
}

/// The results of `find` on each of these parts of `scene`, in order.
///
/// # Errors
/// If part of the scene cannot be read, on whichever thread.
pub(crate) fn find_each<P: Sync, R: Send>(
    scene: &Scene,
    parts: &[P],
    find: impl Fn(&P) -> R + Sync,
) -> Result<Vec<R>, ReadError> {
    let of_chunk = |chunk: &[P]| scene.reading(|| chunk.iter().map(&find).collect::<Vec<R>>());
    let chunks: Result<Vec<_>, _> = in_chunks(parts, of_chunk).into_iter().collect();
    Ok(chunks?.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_than_two_chunks_of_parts_stay_together() {
        let lengths = |parts: usize| in_chunks(&vec![(); parts], <[()]>::len);
        assert_eq!(lengths(0), [0]);
        assert_eq!(lengths(255), [255]);
        assert_eq!(lengths(256), [128, 128]);
        assert_eq!(lengths(300), [128, 128, 44]);
    }
}
