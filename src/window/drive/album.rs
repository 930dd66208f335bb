//! The pictures of a walk. However long it is, the drawables of only a bounded number are kept.

use std::time::Duration;

use trimaran_proto::{Camera, DrawableId};

/// At most this many pictures of longer walks are audited, and at least half as many, evenly over the walk.
const MOST: usize = 500;

/// A picture of a walk.
#[derive(Debug, Clone)]
pub(super) struct Taken {
    pub(super) at: Duration,
    pub(super) camera: Camera,
    /// Its drawables; none if it is not audited.
    pub(super) ids: Option<Vec<DrawableId>>,
    /// The eye has jumped, and since then no set has come.
    pub(super) has_jumped: bool,
}

#[derive(Debug, Default)]
pub(super) struct Album {
    pictures: Vec<Taken>,
    /// One picture in this many is audited, a power of two.
    sparse: u32,
}

impl Album {
    pub(super) fn pictures(&self) -> &[Taken] {
        &self.pictures
    }

    pub(super) fn add(&mut self, picture: Taken) {
        let is_kept = |number: usize, sparse: u32| number.trailing_zeros() >= sparse;
        let ids = picture.ids.filter(|_| is_kept(self.pictures.len(), self.sparse));
        self.pictures.push(Taken { ids, ..picture });
        if self.pictures.len() > MOST << self.sparse {
            self.sparse += 1;
            for (number, kept) in self.pictures.iter_mut().enumerate() {
                if !is_kept(number, self.sparse) {
                    kept.ids = None;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::FrameNumber;

    use super::*;

    #[test]
    fn of_a_long_walk_fewer_and_fewer_pictures_are_audited_evenly() {
        let mut album = Album::default();
        for number in 0..4000 {
            let camera = Camera::at_origin(FrameNumber(number));
            album.add(Taken { at: Duration::ZERO, camera, ids: Some(vec![]), has_jumped: false });
            let kept = album.pictures().iter().filter(|picture| picture.ids.is_some()).count();
            assert!(kept <= MOST + 1 && (number < 500 || kept >= MOST / 2), "{number}: {kept}");
        }
        assert_eq!(album.pictures().len(), 4000);
        let kept = album.pictures().iter().filter(|picture| picture.ids.is_some());
        let numbers: Vec<_> = kept.map(|picture| picture.camera.frame().0).collect();
        assert!(numbers.windows(2).all(|pair| pair[1] - pair[0] == 8), "{numbers:?}");
    }
}
