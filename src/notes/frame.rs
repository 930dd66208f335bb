//! The frame of BCF, and the scene's.

use glam::{DMat3, DVec3};
use trimaran_scene::{PlantFrame, ReadError, Scene};

/// Converts between the scene's frame (y up) and that of BCF (z up). Both are right-handed, in metres.
///
/// All coordinates and directions of BCF pass here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Where the scene's origin is in the frame of BCF.
    origin: DVec3,
    /// Turns a direction of the scene into one of BCF. A rotation.
    turn: DMat3,
}

impl Frame {
    /// The one of a scene's notes: the coordinates of its plant.
    ///
    /// # Errors
    /// If the scene cannot be read.
    pub fn of(scene: &Scene) -> Result<Self, ReadError> {
        let PlantFrame { origin, north_deg } = scene.coordinates()?.plant;
        Ok(Self::new(origin, north_deg))
    }

    /// That of a plant in whose coordinates (east, north, up; metres) the scene's origin is at `origin`.
    /// North is so many degrees clockwise, seen from above, from the scene's -z.
    #[must_use]
    pub fn new(origin: [f64; 3], north_deg: f64) -> Self {
        let (sin, cos) = north_deg.to_radians().sin_cos();
        // Without a turn (x, y, z) becomes (x, -z, y), as importers of models with z up do the reverse.
        let turn = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::Z, DVec3::new(sin, -cos, 0.0));
        Self { origin: DVec3::from_array(origin), turn }
    }

    /// A place of the scene in the frame of BCF.
    #[must_use]
    pub fn to_bcf(&self, place: [f64; 3]) -> [f64; 3] {
        (self.origin + self.turn * DVec3::from_array(place)).to_array()
    }

    /// The reverse.
    #[must_use]
    pub fn to_scene(&self, place: [f64; 3]) -> [f64; 3] {
        (self.turn.transpose() * (DVec3::from_array(place) - self.origin)).to_array()
    }

    /// A direction of the scene in the frame of BCF.
    #[must_use]
    pub fn direction_to_bcf(&self, direction: [f64; 3]) -> [f64; 3] {
        // The sum with zero leaves no negative zero.
        (self.turn * DVec3::from_array(direction) + DVec3::ZERO).to_array()
    }

    /// The reverse.
    #[must_use]
    pub fn direction_to_scene(&self, direction: [f64; 3]) -> [f64; 3] {
        (self.turn.transpose() * DVec3::from_array(direction) + DVec3::ZERO).to_array()
    }
}

/// For a scene whose origin is that of the plant.
impl Default for Frame {
    fn default() -> Self {
        Self::new([0.0; 3], 0.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn up_is_z_north_is_y_and_east_stays() {
        let frame = Frame::default();
        assert_eq!(frame.to_bcf([1.0, 2.0, 3.0]), [1.0, -3.0, 2.0]);
        assert_eq!(frame.to_scene([1.0, -3.0, 2.0]), [1.0, 2.0, 3.0]);
        assert_eq!(frame.direction_to_bcf([0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
        // Right, up and back stay right-handed.
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            .map(|axis| DVec3::from_array(frame.direction_to_bcf(axis)));
        assert_eq!(x.cross(y), z);
    }

    #[test]
    fn places_have_the_plants_coordinates() {
        let (origin, north_deg) = ([431_000.25, -7.5, 12.0], 32.5);
        let place = [3.0, -4.0, 5.5];
        let there = PlantFrame { origin, north_deg }.to_plant(DVec3::from_array(place));
        let here = DVec3::from_array(Frame::new(origin, north_deg).to_bcf(place));
        assert!(here.distance(there) < 1e-9, "{here} {there}");
    }

    #[test]
    fn a_plant_may_be_shifted_and_turned() {
        let frame = Frame::new([100.0, 200.0, 3.0], 90.0);
        let is_near = |a: [f64; 3], b: [f64; 3]| DVec3::from_array(a).distance(DVec3::from_array(b)) < 1e-12;
        assert!(is_near(frame.to_bcf([1.0, 2.0, 3.0]), [103.0, 201.0, 5.0]));
        assert!(is_near(frame.to_scene([103.0, 201.0, 5.0]), [1.0, 2.0, 3.0]));
        // North is where x is.
        assert!(is_near(frame.direction_to_bcf([1.0, 0.0, 0.0]), [0.0, 1.0, 0.0]));
        assert!(is_near(frame.direction_to_scene([0.0, 1.0, 0.0]), [1.0, 0.0, 0.0]));
    }

    proptest! {
        #[test]
        fn a_place_comes_back_to_the_bit(place in prop::array::uniform3(-1e15..1e15_f64)) {
            let frame = Frame::default();
            prop_assert_eq!(frame.to_scene(frame.to_bcf(place)), place);
            prop_assert_eq!(frame.direction_to_scene(frame.direction_to_bcf(place)), place);
        }
    }
}
