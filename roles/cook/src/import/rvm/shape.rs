//! The eleven kinds of primitive, as in a PRIM chunk of either form.
//!
//! Each is in a frame of its own, in millimetres, about the z axis; a 3x4 matrix takes it to the world.
//! Angles are in radians.

use glam::DVec3;
use thiserror::Error;

/// A primitive's shape. Every number is finite.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Shape {
    /// Two rectangles, one above the other: full lengths along x and y, the top's offset from the bottom, the
    /// height between them. The origin is half way between their centres.
    Pyramid { bottom: [f64; 2], top: [f64; 2], offset: [f64; 2], height: f64 },
    /// A box about the origin: full lengths.
    Box { size: [f64; 3] },
    /// A rectangle turned about z, from the x axis on.
    RectangularTorus { inner: f64, outer: f64, height: f64, angle: f64 },
    /// A circle of `radius` at distance `offset`, turned about z, from the x axis on.
    CircularTorus { offset: f64, radius: f64, angle: f64 },
    /// Half an ellipsoid on the xy plane.
    EllipticalDish { radius: f64, height: f64 },
    /// A cut-off part of a sphere on the xy plane.
    SphericalDish { radius: f64, height: f64 },
    /// A cone's frustum about the origin: the top's centre is `offset` from the bottom's, and each end may be
    /// cut at an angle (about y and about x).
    Snout {
        bottom: f64,
        top: f64,
        height: f64,
        offset: [f64; 2],
        bottom_shear: [f64; 2],
        top_shear: [f64; 2],
    },
    /// A cylinder about the origin.
    Cylinder { radius: f64, height: f64 },
    /// A sphere about the origin.
    Sphere { diameter: f64 },
    /// A line along x: no surface.
    Line,
    /// Plane polygons, each of one or more contours; contours within contours are holes. Those with a broken
    /// corner were left out.
    FacetGroup { polygons: Vec<Polygon>, left_out: u64 },
}

/// A plane polygon: its contours.
pub(super) type Polygon = Vec<Vec<DVec3>>;

/// Why a primitive is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub(super) enum Broken {
    #[error("its chunk is too short for it")]
    Short,
    #[error("it is of an unknown kind")]
    UnknownKind,
    #[error("its matrix has a value that is not finite")]
    Matrix,
    #[error("one of its measures is not finite")]
    Measure,
    #[error("a polygon has a corner that is not finite")]
    Corner,
    #[error("it is too large or too far away: beyond 1e15 m")]
    Place,
    #[error("it stands in no group")]
    NoGroup,
}

/// The source of a primitive's numbers.
pub(super) trait Numbers {
    /// A whole number.
    fn count(&mut self) -> Result<u32, Broken>;

    /// Any number; it may be infinite or NaN.
    fn real(&mut self) -> Result<f64, Broken>;

    fn reals<const N: usize>(&mut self) -> Result<[f64; N], Broken> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.real()?;
        }
        Ok(values)
    }
}

impl Shape {
    /// Reads the shape of primitive `kind`.
    pub(super) fn read(kind: u32, reader: &mut impl Numbers) -> Result<Self, Broken> {
        Ok(match kind {
            1 => {
                let [a, b, c, d, e, f, height] = finite(reader.reals()?)?;
                Self::Pyramid { bottom: [a, b], top: [c, d], offset: [e, f], height }
            }
            2 => Self::Box { size: finite(reader.reals()?)? },
            3 => {
                let [inner, outer, height, angle] = finite(reader.reals()?)?;
                Self::RectangularTorus { inner, outer, height, angle }
            }
            4 => {
                let [offset, radius, angle] = finite(reader.reals()?)?;
                Self::CircularTorus { offset, radius, angle }
            }
            5 => {
                let [radius, height] = finite(reader.reals()?)?;
                Self::EllipticalDish { radius, height }
            }
            6 => {
                let [radius, height] = finite(reader.reals()?)?;
                Self::SphericalDish { radius, height }
            }
            7 => {
                let [bottom, top, height, ox, oy, bx, by, tx, ty] = finite(reader.reals()?)?;
                Self::Snout {
                    bottom,
                    top,
                    height,
                    offset: [ox, oy],
                    bottom_shear: [bx, by],
                    top_shear: [tx, ty],
                }
            }
            8 => {
                let [radius, height] = finite(reader.reals()?)?;
                Self::Cylinder { radius, height }
            }
            9 => {
                let [diameter] = finite(reader.reals()?)?;
                Self::Sphere { diameter }
            }
            10 => {
                finite(reader.reals::<2>()?)?;
                Self::Line
            }
            11 => facets(reader)?,
            _ => return Err(Broken::UnknownKind),
        })
    }
}

fn finite<const N: usize>(values: [f64; N]) -> Result<[f64; N], Broken> {
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(Broken::Measure) }
}

/// Counts are never trusted for allocation: each counted item takes bytes, and the bytes run out first.
fn facets(reader: &mut impl Numbers) -> Result<Shape, Broken> {
    let (mut polygons, mut left_out) = (Vec::new(), 0);
    for _ in 0..reader.count()? {
        let mut contours = Vec::new();
        for _ in 0..reader.count()? {
            let mut contour = Vec::new();
            for _ in 0..reader.count()? {
                // The last three are the normal, which follows from the contour.
                let [x, y, z, _, _, _] = reader.reals()?;
                contour.push(DVec3::new(x, y, z));
            }
            contours.push(contour);
        }
        if contours.iter().flatten().all(|corner| corner.is_finite()) {
            polygons.push(contours);
        } else {
            left_out += 1;
        }
    }
    Ok(Shape::FacetGroup { polygons, left_out })
}
