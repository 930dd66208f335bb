//! Sections: cuts through the scene that let a user look inside.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Cuts away one side of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[[f64; 3]; 2]", into = "[[f64; 3]; 2]")]
pub struct SectionPlane {
    location: [f64; 3],
    direction: [f64; 3],
}

/// Cuts away everything outside a box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "[[f64; 3]; 2]", into = "[[f64; 3]; 2]")]
pub struct SectionBox {
    min: [f64; 3],
    max: [f64; 3],
}

/// Cuts a part of the scene away.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Section {
    /// One side of a plane.
    Plane(SectionPlane),
    /// The outside of a box.
    Box(SectionBox),
}

/// Up to six sections. A point is visible if none of them cuts it away.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<Section>", into = "Vec<Section>")]
pub struct Sections([Option<Section>; Self::MOST]);

/// Why a section is invalid.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[non_exhaustive]
pub enum SectionError {
    /// A coordinate is NaN or infinite.
    #[error("a coordinate of the section is not finite")]
    NotFinite,
    /// The direction is zero, or too short or long to tell where it points.
    #[error("the direction of the section plane points nowhere")]
    Direction,
    /// An upper corner does not lie above the lower one.
    #[error("the section box is empty: its upper corner must lie above its lower one in x, y and z")]
    Empty,
    /// There are more than six.
    #[error("{0} sections: there can be {most}", most = Sections::MOST)]
    TooMany(usize),
}

impl SectionPlane {
    /// Cuts away the side of the plane through `location` (metres, world) that `direction` points to, as
    /// the clipping planes of BCF do. The direction's length does not matter.
    ///
    /// # Errors
    /// If a coordinate is not finite, or the direction is invalid.
    pub fn new(location: [f64; 3], direction: [f64; 3]) -> Result<Self, SectionError> {
        if !location.iter().chain(&direction).all(|c| c.is_finite()) {
            return Err(SectionError::NotFinite);
        }
        let length = direction.iter().map(|c| c * c).sum::<f64>().sqrt();
        if !(1e-100..=1e100).contains(&length) {
            return Err(SectionError::Direction);
        }
        // A unit vector stays as it is, so that it reads back as it was written.
        let unit = (length - 1.0).abs() < 1e-15;
        let direction = if unit { direction } else { direction.map(|c| c / length) };
        Ok(Self { location, direction })
    }

    /// A point of the plane, metres, world.
    #[must_use]
    pub const fn location(&self) -> [f64; 3] {
        self.location
    }

    /// A unit vector towards the side that is cut away.
    #[must_use]
    pub const fn direction(&self) -> [f64; 3] {
        self.direction
    }
}

impl SectionBox {
    /// Keeps the space between the corners `min` and `max` (metres, world).
    ///
    /// # Errors
    /// If a coordinate is not finite, or the box is empty.
    pub fn new(min: [f64; 3], max: [f64; 3]) -> Result<Self, SectionError> {
        if !min.iter().chain(&max).all(|c| c.is_finite()) {
            return Err(SectionError::NotFinite);
        }
        if min.iter().zip(&max).any(|(low, high)| low >= high) {
            return Err(SectionError::Empty);
        }
        Ok(Self { min, max })
    }

    /// The lower corner, metres, world.
    #[must_use]
    pub const fn min(&self) -> [f64; 3] {
        self.min
    }

    /// The upper corner, metres, world.
    #[must_use]
    pub const fn max(&self) -> [f64; 3] {
        self.max
    }
}

impl Sections {
    /// The largest number of sections.
    pub const MOST: usize = 6;
    /// No sections.
    pub const NONE: Self = Self([None; Self::MOST]);

    /// These sections.
    ///
    /// # Errors
    /// If there are more than [`Sections::MOST`].
    pub fn new(sections: &[Section]) -> Result<Self, SectionError> {
        if sections.len() > Self::MOST {
            return Err(SectionError::TooMany(sections.len()));
        }
        let mut kept = Self::NONE;
        for (slot, section) in kept.0.iter_mut().zip(sections) {
            *slot = Some(*section);
        }
        Ok(kept)
    }

    /// The sections, in the order given.
    pub fn iter(&self) -> impl Iterator<Item = &Section> {
        self.0.iter().flatten()
    }

    /// Whether there are no sections.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        matches!(self.0, [None, ..])
    }

    /// The planes that bound the kept space, at most 36: those given, and the six of each box.
    pub fn planes(&self) -> impl Iterator<Item = SectionPlane> + '_ {
        self.iter().flat_map(|section| match section {
            Section::Plane(plane) => vec![*plane],
            Section::Box(SectionBox { min, max }) => {
                let sides = [(*min, -1.0), (*max, 1.0)].into_iter();
                sides
                    .flat_map(|(corner, sign)| axes(sign).map(|direction| (corner, direction)))
                    .map(|(location, direction)| SectionPlane { location, direction })
                    .collect()
            }
        })
    }
}

fn axes(length: f64) -> [[f64; 3]; 3] {
    [[length, 0.0, 0.0], [0.0, length, 0.0], [0.0, 0.0, length]]
}

impl TryFrom<[[f64; 3]; 2]> for SectionPlane {
    type Error = SectionError;

    fn try_from([location, direction]: [[f64; 3]; 2]) -> Result<Self, SectionError> {
        Self::new(location, direction)
    }
}

impl From<SectionPlane> for [[f64; 3]; 2] {
    fn from(plane: SectionPlane) -> Self {
        [plane.location, plane.direction]
    }
}

impl TryFrom<[[f64; 3]; 2]> for SectionBox {
    type Error = SectionError;

    fn try_from([min, max]: [[f64; 3]; 2]) -> Result<Self, SectionError> {
        Self::new(min, max)
    }
}

impl From<SectionBox> for [[f64; 3]; 2] {
    fn from(kept: SectionBox) -> Self {
        [kept.min, kept.max]
    }
}

impl TryFrom<Vec<Section>> for Sections {
    type Error = SectionError;

    fn try_from(sections: Vec<Section>) -> Result<Self, SectionError> {
        Self::new(&sections)
    }
}

impl From<Sections> for Vec<Section> {
    fn from(sections: Sections) -> Self {
        sections.iter().copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_has_a_direction_and_a_box_an_inside() {
        let plane = SectionPlane::new([1.0, 2.0, 3.0], [0.0, 0.0, 4.0]).unwrap();
        assert_eq!((plane.location(), plane.direction()), ([1.0, 2.0, 3.0], [0.0, 0.0, 1.0]));
        let nan = [f64::NAN, 0.0, 0.0];
        assert_eq!(SectionPlane::new(nan, [1.0; 3]), Err(SectionError::NotFinite));
        assert_eq!(SectionPlane::new([0.0; 3], nan), Err(SectionError::NotFinite));
        for nowhere in [0.0, 1e-200, 1e200] {
            assert_eq!(SectionPlane::new([0.0; 3], [nowhere, 0.0, 0.0]), Err(SectionError::Direction));
        }
        assert_eq!(SectionBox::new([0.0; 3], [1.0, 1.0, 0.0]), Err(SectionError::Empty));
        assert_eq!(SectionBox::new([0.0; 3], [1.0, f64::INFINITY, 1.0]), Err(SectionError::NotFinite));
    }

    #[test]
    fn a_box_keeps_its_corners_and_is_bounded_by_six_planes_that_point_outwards() {
        let corners = [[0.5, 1.0, 2.0], [3.0, 4.0, 5.0]];
        let kept = SectionBox::try_from(corners).unwrap();
        assert_eq!((kept.min(), kept.max(), <[[f64; 3]; 2]>::from(kept)), (corners[0], corners[1], corners));
        let sections = Sections::new(&[Section::Box(kept)]).unwrap();
        assert!(Sections::NONE.is_empty() && !sections.is_empty());
        let inside = |p: [f64; 3]| {
            sections.planes().all(|plane| {
                let along = |i: usize| (p[i] - plane.location()[i]) * plane.direction()[i];
                (0..3).map(along).sum::<f64>() <= 0.0
            })
        };
        assert_eq!(sections.planes().count(), 6);
        assert!(inside([1.0, 2.0, 3.0]));
        for axis in 0..3 {
            for beyond in [-9.0, 9.0] {
                let mut point = [1.0, 2.0, 3.0];
                point[axis] = beyond;
                assert!(!inside(point), "{point:?}");
            }
        }
    }

    #[test]
    fn there_are_six_sections_at_most_and_bad_ones_do_not_decode() {
        let plane = Section::Plane(SectionPlane::new([0.0; 3], [0.6, 0.0, 0.8]).unwrap());
        let six = Sections::new(&[plane; 6]).unwrap();
        assert_eq!(Sections::new(&[plane; 7]), Err(SectionError::TooMany(7)));
        let bytes = postcard::to_stdvec(&six).unwrap();
        assert_eq!(postcard::from_bytes::<Sections>(&bytes), Ok(six));
        let seven = postcard::to_stdvec(&vec![plane; 7]).unwrap();
        assert!(postcard::from_bytes::<Sections>(&seven).is_err());
        let nowhere = postcard::to_stdvec(&[[0.0_f64; 3]; 2]).unwrap();
        assert!(postcard::from_bytes::<SectionPlane>(&nowhere).is_err());
        assert!(postcard::from_bytes::<SectionBox>(&nowhere).is_err());
    }
}
