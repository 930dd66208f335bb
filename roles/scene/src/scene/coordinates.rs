//! The coordinates that people know: those of the files that a scene was made of, and those of the plant.
//!
//! A scene is right-handed, in metres, with y up. Files that stand upright in it have their x as its x. So
//! in a scene of any files, x is east and -z is north, unless the plant's grid is shifted or turned against
//! them.

use glam::{DAffine3, DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// The largest coordinate of an origin, metres: millimetres are still exact there.
const FARTHEST: f64 = 1e12;

/// The upward axis of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UpAxis {
    /// y up: glTF by its specification, OBJ by custom.
    #[default]
    Y,
    /// z up: RVM, STL, PLY, and most CAD. (x, y, z) of the file is (x, z, -y) in the scene.
    Z,
}

/// The coordinates of a source file: right-handed, with x as in the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FileFrame {
    /// Its upward axis.
    pub up: UpAxis,
    /// Metres per unit of its lengths; none if a converter made metres of it, and does not say of what.
    pub metres_per_unit: Option<f64>,
}

/// The coordinates of the plant: east, north and up, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PlantFrame {
    /// East, north and up of the scene's origin.
    pub origin: [f64; 3],
    /// Where north is: degrees clockwise, seen from above, from the scene's -z. That is y of a file with z
    /// up.
    pub north_deg: f64,
}

/// The coordinates of a scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Coordinates {
    /// Those of the plant.
    pub plant: PlantFrame,
    /// Those of each source file, in the order of the sources. Files past the end have those of glTF.
    pub files: Vec<FileFrame>,
}

/// That of glTF: y up, in metres.
impl Default for FileFrame {
    fn default() -> Self {
        Self { up: UpAxis::Y, metres_per_unit: Some(1.0) }
    }
}

impl FileFrame {
    /// The map from the file's coordinates to those of the scene. Lengths of an unknown unit are metres.
    #[must_use]
    pub fn to_scene(&self) -> DAffine3 {
        let axes = match self.up {
            UpAxis::Y => DMat3::IDENTITY,
            UpAxis::Z => DMat3::from_cols(DVec3::X, DVec3::NEG_Z, DVec3::Y),
        };
        DAffine3::from_mat3(axes) * DAffine3::from_scale(DVec3::splat(self.metres_per_unit.unwrap_or(1.0)))
    }
}

impl PlantFrame {
    /// East, north and up of a point of the scene, metres.
    #[must_use]
    pub fn to_plant(&self, point: DVec3) -> DVec3 {
        let (sin, cos) = self.north_deg.to_radians().sin_cos();
        let turned = DVec3::new(cos * point.x + sin * point.z, sin * point.x - cos * point.z, point.y);
        DVec3::from_array(self.origin) + turned
    }

    /// The least and the largest east, north and up of a box of the scene, by its corners.
    #[must_use]
    pub fn bounds(&self, min: DVec3, max: DVec3) -> [DVec3; 2] {
        let corner = |x: f64, z: f64| [min.y, max.y].map(|y| self.to_plant(DVec3::new(x, y, z)));
        let corners =
            [corner(min.x, min.z), corner(min.x, max.z), corner(max.x, min.z), corner(max.x, max.z)];
        let empty = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        corners.as_flattened().iter().fold(empty, |[low, high], &at| [low.min(at), high.max(at)])
    }

    /// Whether its numbers make sense: an origin within 10¹² m, and an angle of at most a full turn.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.origin.iter().all(|metres| metres.abs() <= FARTHEST) && self.north_deg.abs() <= 360.0
    }
}

impl Coordinates {
    /// Whether they are those of a scene that says nothing of them.
    pub(super) fn are_usual(&self) -> bool {
        self.plant == PlantFrame::default() && self.files.iter().all(|file| *file == FileFrame::default())
    }

    /// As bytes of postcard.
    pub(super) fn encode(&self) -> Vec<u8> {
        // Numbers alone always fit.
        postcard::to_stdvec(self).unwrap_or_default()
    }

    /// The reverse, of a scene with this many sources; `None` if the bytes are invalid.
    pub(super) fn decode(bytes: &[u8], sources: usize) -> Option<Self> {
        let (this, rest) = postcard::take_from_bytes::<Self>(bytes).ok()?;
        let is_length = |metres: f64| metres.is_finite() && metres > 0.0;
        let is_sound = rest.is_empty()
            && this.files.len() <= sources
            && this.files.iter().filter_map(|file| file.metres_per_unit).all(is_length)
            && this.plant.is_sound();
        is_sound.then_some(this)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn without_a_frame_x_is_east_and_minus_z_north() {
        let at = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(PlantFrame::default().to_plant(at), DVec3::new(1.0, -3.0, 2.0));
        // So a file with z up has its own numbers, and one with y up those of the scene.
        for metres_per_unit in [1.0, 0.001] {
            let file = FileFrame { up: UpAxis::Z, metres_per_unit: Some(metres_per_unit) };
            let in_scene = file.to_scene().transform_point3(at);
            assert_eq!(PlantFrame::default().to_plant(in_scene), at * metres_per_unit);
        }
        assert_eq!(FileFrame::default().to_scene(), DAffine3::IDENTITY);
        let converted = FileFrame { up: UpAxis::Z, metres_per_unit: None };
        assert_eq!(converted.to_scene().transform_point3(at), DVec3::new(1.0, 3.0, -2.0));
    }

    #[test]
    fn north_turns_clockwise_and_the_origin_shifts() {
        let frame = PlantFrame { origin: [1e6, 2e6, 30.0], north_deg: 90.0 };
        // North is where x leads, and so east where z does.
        let far = frame.to_plant(DVec3::new(5.0, 7.0, 0.0));
        assert!(far.distance(DVec3::new(1e6, 2e6 + 5.0, 37.0)) < 1e-9, "{far}");
        let far = frame.to_plant(DVec3::new(0.0, 0.0, 3.0));
        assert!(far.distance(DVec3::new(1e6 + 3.0, 2e6, 30.0)) < 1e-9, "{far}");
    }

    #[test]
    fn coordinates_that_make_no_sense_are_refused() {
        let plant = PlantFrame { origin: [432_100.25, -6_789_012.5, 10.0], north_deg: -32.5 };
        let files = vec![FileFrame { up: UpAxis::Z, metres_per_unit: Some(0.001) }; 2];
        let sound = Coordinates { plant, files };
        let bytes = sound.encode();
        assert_eq!(Coordinates::decode(&bytes, 2), Some(sound.clone()));
        let corner = PlantFrame { origin: [1e12, -1e12, 0.0], north_deg: -360.0 };
        let farthest = Coordinates { plant: corner, files: Vec::new() };
        assert_eq!(Coordinates::decode(&farthest.encode(), 0), Some(farthest));
        assert_eq!(Coordinates::decode(&bytes, 1), None, "there is no second file");
        assert_eq!(Coordinates::decode(&[&*bytes, &[0]].concat(), 2), None);
        for end in 0..bytes.len() {
            assert_eq!(Coordinates::decode(&bytes[..end], 2), None, "cut at {end}");
        }
        let of_plant = |plant| Coordinates { plant, ..sound.clone() };
        let of_unit = |unit| {
            let file = FileFrame { up: UpAxis::Y, metres_per_unit: Some(unit) };
            Coordinates { files: vec![file], ..sound.clone() }
        };
        for wrong in [
            of_plant(PlantFrame { origin: [0.0, f64::NAN, 0.0], ..plant }),
            of_plant(PlantFrame { origin: [0.0, 0.0, 1.1e12], ..plant }),
            of_plant(PlantFrame { north_deg: f64::INFINITY, ..plant }),
            of_plant(PlantFrame { north_deg: 361.0, ..plant }),
            of_unit(0.0),
            of_unit(-1.0),
            of_unit(f64::NAN),
        ] {
            assert_eq!(Coordinates::decode(&wrong.encode(), 2), None, "{wrong:?}");
        }
    }

    fn point(farthest: f64) -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-farthest..farthest).prop_map(DVec3::from_array)
    }

    proptest! {
        /// Distances, heights and the sense of turning stay, also far from the origin.
        #[test]
        fn a_plant_is_the_scene_turned_and_shifted(
            origin in point(1e7), north_deg in -360.0..360.0, [a, b, c] in [(); 3].map(|()| point(1e3)),
        ) {
            let frame = PlantFrame { origin: origin.to_array(), north_deg };
            let [p, q, r] = [a, b, c].map(|point| frame.to_plant(point));
            prop_assert!((p.distance(q) - a.distance(b)).abs() < 1e-6);
            prop_assert!(((p - q).z - (a - b).y).abs() < 1e-6);
            let volume = |a: DVec3, b: DVec3, c: DVec3| a.dot(b.cross(c));
            let [before, after] = [volume(a, b, c), volume(p - origin, q - origin, r - origin)];
            prop_assert!((before - after).abs() < 1e-6 * 1e6);
        }

        #[test]
        fn bounds_are_around_each_point_of_a_box(
            north_deg in -360.0..360.0, a in point(1e3), b in point(1e3),
            share in prop::array::uniform3(0.0..1.0),
        ) {
            let frame = PlantFrame { origin: [1e5, 2e5, 3e5], north_deg };
            let (min, max) = (a.min(b), a.max(b));
            let [low, high] = frame.bounds(min, max);
            let within = frame.to_plant(min + (max - min) * DVec3::from_array(share));
            prop_assert!(within.cmpge(low - 1e-9).all() && within.cmple(high + 1e-9).all());
        }
    }
}
