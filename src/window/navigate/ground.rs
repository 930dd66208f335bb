//! The solid spans around a person, computed ahead of need on a thread of its own.

use std::{
    collections::HashMap,
    error::Error,
    io,
    sync::{Arc, mpsc},
    thread,
    time::Duration,
};

use trimaran_scene::{
    Scene,
    heightfield::{Heightfield, Tile},
};

/// The solid spans at places.
pub trait Solid {
    /// The grid spacing, metres.
    fn cell(&self) -> f64;

    /// Lower and upper ends of spans, ascending, in metres; none if not known yet.
    fn spans(&self, x: f64, z: f64) -> Option<impl Iterator<Item = [f64; 2]>>;
}

/// The most tiles that are kept.
const MOST: usize = 100;
/// The pause after a failed tile.
const PAUSE: Duration = Duration::from_millis(200);

/// The tiles around a person.
pub struct Ground {
    /// Side of a tile, metres.
    side: f64,
    /// Known tiles, and requested ones.
    tiles: HashMap<(i32, i32), Option<Tile>>,
    asked: mpsc::Sender<(i32, i32)>,
    made: mpsc::Receiver<((i32, i32), Option<Tile>)>,
}

impl Ground {
    /// The ground of a scene, for eyes this high above floors.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn new(scene: &Arc<Scene>, eye_height: f64) -> io::Result<Self> {
        let (field, scene) = (Heightfield::new(scene, eye_height), Arc::clone(scene));
        Self::of(field.tile_side(), move |x, z| field.tile(&scene, x, z))
    }

    /// Tiles with sides of this many metres; `tile` makes them by their numbers along x and z. It is called
    /// on a thread of its own, and again later for tiles that failed.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn of<E: Error>(
        side: f64,
        tile: impl Fn(i32, i32) -> Result<Tile, E> + Send + 'static,
    ) -> io::Result<Self> {
        let (asked, questions) = mpsc::channel::<(i32, i32)>();
        let (answers, made) = mpsc::channel();
        // The thread ends when its channel closes.
        thread::Builder::new().name("ground".to_owned()).spawn(move || {
            while let Ok((x, z)) = questions.recv() {
                let made = tile(x, z);
                if let Err(error) = &made {
                    // The person waits at its edge meanwhile.
                    tracing::warn!(%error, "does not know what is solid there");
                    thread::sleep(PAUSE);
                }
                if answers.send(((x, z), made.ok())).is_err() {
                    break;
                }
            }
        })?;
        Ok(Self { side, tiles: HashMap::new(), asked, made })
    }

    /// The numbers of the tile that a place is in.
    fn tile_at(&self, x: f64, z: f64) -> (i32, i32) {
        let along = |at: f64| (at / self.side).floor() as i32;
        (along(x), along(z))
    }

    /// Takes finished tiles, and requests the missing ones around a place.
    pub fn look_around(&mut self, x: f64, z: f64) {
        for (place, tile) in self.made.try_iter() {
            match tile {
                Some(tile) => self.tiles.insert(place, Some(tile)),
                None => self.tiles.remove(&place),
            };
        }
        let here = self.tile_at(x, z);
        for right in [0, -1, 1] {
            for back in [0, -1, 1] {
                let place = (here.0.saturating_add(right), here.1.saturating_add(back));
                self.tiles.entry(place).or_insert_with(|| {
                    // Without the thread no tiles come, so the person cannot go there.
                    let _ended = self.asked.send(place);
                    None
                });
            }
        }
        if self.tiles.len() > MOST {
            let far = |(x, z): (i32, i32)| x.abs_diff(here.0).max(z.abs_diff(here.1));
            self.tiles.retain(|&place, _| far(place) <= 2);
        }
    }
}

impl Solid for Ground {
    fn cell(&self) -> f64 {
        self.side / Heightfield::SIDE as f64
    }

    fn spans(&self, x: f64, z: f64) -> Option<impl Iterator<Item = [f64; 2]>> {
        let tile = self.tiles.get(&self.tile_at(x, z))?.as_ref()?;
        Some(tile.spans_at(x, z))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use glam::DVec3;
    use trimaran_audit::cases::plant;

    use super::*;

    #[test]
    fn the_ground_comes_where_a_person_is_and_goes_behind_them() {
        let scene = plant(1, 200, DVec3::ZERO).unwrap();
        let mut ground = Ground::new(&scene, 1.7).unwrap();
        assert!(ground.spans(0.0, 0.0).is_none(), "it was not asked for");
        let wait = |ground: &mut Ground, x: f64| {
            ground.look_around(x, 0.0);
            while ground.spans(x, 0.0).is_none() {
                thread::yield_now();
                ground.look_around(x, 0.0);
            }
        };
        wait(&mut ground, 0.0);
        let here: Vec<_> = ground.spans(0.0, 0.0).unwrap().collect();
        let tile = Heightfield::new(&scene, 1.7).tile(&scene, 0, 0).unwrap();
        assert_eq!(here, tile.spans_at(0.0, 0.0).collect::<Vec<_>>());
        for step in 0..60 {
            wait(&mut ground, f64::from(step) * 6.4);
            assert!(ground.tiles.len() <= MOST, "{}", ground.tiles.len());
        }
    }

    #[test]
    fn what_could_not_be_had_is_asked_for_again() {
        let tries = Arc::new(AtomicU32::new(0));
        let counted = Arc::clone(&tries);
        let tile = move |_, _| {
            counted.fetch_add(1, Ordering::Relaxed);
            Err(io::Error::from(io::ErrorKind::TimedOut))
        };
        let mut ground = Ground::of(6.4, tile).unwrap();
        assert!((ground.cell() - 0.1).abs() < 1e-12);
        while tries.load(Ordering::Relaxed) < 10 {
            ground.look_around(0.0, 0.0);
            thread::yield_now();
        }
        assert!(ground.spans(0.0, 0.0).is_none());
    }
}
