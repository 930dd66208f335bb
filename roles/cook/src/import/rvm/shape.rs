//! The eleven kinds of primitive, as they stand in a PRIM chunk.
//!
//! Each stands in a frame of its own, in millimetres, about the z axis; a 3x4 matrix takes it to the world.
//! Angles are in radians.

use glam::DVec3;

use super::RvmError;
use super::reader::Reader;

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
    /// Plane polygons, each of one or more contours; contours within contours are holes.
    FacetGroup { polygons: Vec<Polygon> },
}

/// A plane polygon: its contours.
pub(super) type Polygon = Vec<Vec<DVec3>>;

/// Why a shape could not be read.
pub(super) enum ShapeError {
    /// The bytes do not fit.
    Read(RvmError),
    /// No primitive has this number.
    UnknownKind(u32),
    /// A length, angle or corner is infinite or not a number.
    NotFinite,
}

impl From<RvmError> for ShapeError {
    fn from(error: RvmError) -> Self {
        Self::Read(error)
    }
}

impl Shape {
    /// Reads the shape of primitive `kind` to the end of its chunk.
    pub(super) fn read(kind: u32, reader: &mut Reader<'_>) -> Result<Self, ShapeError> {
        Ok(match kind {
            1 => {
                let [a, b, c, d, e, f, height] = finite(reader.floats("a pyramid")?)?;
                Self::Pyramid { bottom: [a, b], top: [c, d], offset: [e, f], height }
            }
            2 => Self::Box { size: finite(reader.floats("a box")?)? },
            3 => {
                let [inner, outer, height, angle] = finite(reader.floats("a rectangular torus")?)?;
                Self::RectangularTorus { inner, outer, height, angle }
            }
            4 => {
                let [offset, radius, angle] = finite(reader.floats("a circular torus")?)?;
                Self::CircularTorus { offset, radius, angle }
            }
            5 => {
                let [radius, height] = finite(reader.floats("an elliptical dish")?)?;
                Self::EllipticalDish { radius, height }
            }
            6 => {
                let [radius, height] = finite(reader.floats("a spherical dish")?)?;
                Self::SphericalDish { radius, height }
            }
            7 => {
                let [bottom, top, height, ox, oy, bx, by, tx, ty] = finite(reader.floats("a snout")?)?;
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
                let [radius, height] = finite(reader.floats("a cylinder")?)?;
                Self::Cylinder { radius, height }
            }
            9 => {
                let [diameter] = finite(reader.floats("a sphere")?)?;
                Self::Sphere { diameter }
            }
            10 => {
                finite(reader.floats::<2>("a line")?)?;
                Self::Line
            }
            11 => Self::FacetGroup { polygons: polygons(reader)? },
            unknown => return Err(ShapeError::UnknownKind(unknown)),
        })
    }
}

fn finite<const N: usize>(values: [f64; N]) -> Result<[f64; N], ShapeError> {
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(ShapeError::NotFinite) }
}

/// Counts are never trusted with memory: each thing counted takes bytes, and the bytes run out first.
fn polygons(reader: &mut Reader<'_>) -> Result<Vec<Polygon>, ShapeError> {
    let mut polygons = Vec::new();
    for _ in 0..reader.u32("a facet group")? {
        let mut contours = Vec::new();
        for _ in 0..reader.u32("a facet")? {
            let mut contour = Vec::new();
            for _ in 0..reader.u32("a contour")? {
                // The last three are the normal, which follows from the contour.
                let [x, y, z, _, _, _] = reader.floats("a corner of a facet")?;
                contour.push(DVec3::from_array(finite([x, y, z])?));
            }
            contours.push(contour);
        }
        polygons.push(contours);
    }
    Ok(polygons)
}
