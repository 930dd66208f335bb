//! What is solid around a person, worked out ahead of need on a thread of its own.

use std::{
    collections::HashMap,
    io,
    sync::{Arc, mpsc},
    thread,
};

use trimaran_scene::{
    Scene,
    heightfield::{Heightfield, Tile},
};

/// What is solid at a place.
pub trait Solid {
    /// The distance between places that may differ, metres.
    fn cell(&self) -> f64;

    /// Lower and upper ends of spans, ascending, in metres; nothing where it is not known yet.
    fn spans(&self, x: f64, z: f64) -> Option<impl Iterator<Item = [f64; 2]>>;
}

/// Tiles that are kept.
const MOST: usize = 100;

/// The tiles around a person.
pub struct Ground {
    field: Heightfield,
    /// Those that are there, and those that were asked for.
    tiles: HashMap<(i32, i32), Option<Tile>>,
    asked: mpsc::Sender<(i32, i32)>,
    made: mpsc::Receiver<((i32, i32), Tile)>,
}

impl Ground {
    /// That of a scene in which eyes are so high above floors.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn new(scene: &Arc<Scene>, eye_height: f64) -> io::Result<Self> {
        let (field, scene) = (Heightfield::new(scene, eye_height), Arc::clone(scene));
        let (asked, questions) = mpsc::channel();
        let (answers, made) = mpsc::channel();
        // It ends with the questions.
        thread::Builder::new().name("ground".to_owned()).spawn(move || {
            while let Ok((x, z)) = questions.recv() {
                match field.tile(&scene, x, z) {
                    Ok(tile) => {
                        if answers.send(((x, z), tile)).is_err() {
                            break;
                        }
                    }
                    // The person waits at its edge. The roles have the same scene, and end the walk.
                    Err(error) => tracing::warn!(%error, "does not know what is solid there"),
                }
            }
        })?;
        Ok(Self { field, tiles: HashMap::new(), asked, made })
    }

    /// Takes what is there by now, and asks for all tiles around a place that are not.
    pub fn look_around(&mut self, x: f64, z: f64) {
        self.tiles.extend(self.made.try_iter().map(|(place, tile)| (place, Some(tile))));
        let here = self.field.tile_at(x, z);
        for right in [0, -1, 1] {
            for back in [0, -1, 1] {
                let place = (here.0.saturating_add(right), here.1.saturating_add(back));
                self.tiles.entry(place).or_insert_with(|| {
                    // Without the thread nothing comes, and nobody goes there.
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
        self.field.cell()
    }

    fn spans(&self, x: f64, z: f64) -> Option<impl Iterator<Item = [f64; 2]>> {
        let tile = self.tiles.get(&self.field.tile_at(x, z))?.as_ref()?;
        Some(tile.spans_at(x, z))
    }
}

#[cfg(test)]
mod tests {
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
        let (x, z) = ground.field.tile_at(0.0, 0.0);
        let tile = ground.field.tile(&scene, x, z).unwrap();
        assert_eq!(here, tile.spans_at(0.0, 0.0).collect::<Vec<_>>());
        for step in 0..60 {
            wait(&mut ground, f64::from(step) * 6.4);
            assert!(ground.tiles.len() <= MOST, "{}", ground.tiles.len());
        }
    }
}
