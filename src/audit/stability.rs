//! How figures change with scale, offset, field of view, depth and the picture's size, up to where the
//! program refuses.

use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;
use tokio::runtime::Handle;
use trimaran_audit::cases::{Case, PlantCase};
use trimaran_cull::{LodRule, View, Viewport};
use trimaran_gpu::Gpu;
use trimaran_proto::OcclusionTestKind;
use trimaran_transport::causes;

use super::{
    Way,
    depth_formats::DepthFormat,
    figures::NONE,
    hard::{MeasureError, Target, depth_at, deviation_px, short_name},
};
use crate::comparison::System;

/// One property taken to its limits.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Curve {
    /// The property, with its unit.
    pub of: &'static str,
    /// The cause of its limit.
    pub about: &'static str,
    /// Names of the figures.
    pub figures: Vec<String>,
    /// Its values, each with its figures.
    pub points: Vec<Point>,
}

/// The figures at one value.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Point {
    /// The value.
    pub at: String,
    /// The figures, or why the program refused.
    pub figures: Result<Vec<String>, String>,
    /// Why a device refused it.
    pub notes: Vec<String>,
    /// Whether pictures differ from the usual ones, by rounding of positions.
    pub differs: bool,
    /// Whether no figure is wrong.
    pub holds: bool,
}

impl Point {
    pub(super) const fn new(at: String) -> Self {
        Self { at, figures: Ok(Vec::new()), notes: Vec::new(), differs: false, holds: true }
    }
}

/// An error bound at which the small pictures have coarse levels.
const COARSE_PX: f64 = 16.0;

/// The oracle walks no picture with more pixels: it is slow.
const ORACLE_PIXELS: u32 = 1 << 17;

/// The targets of curves.
pub struct Curves<'c> {
    /// The devices.
    pub devices: &'c [Arc<Gpu>],
    /// The rule for levels of detail, where their deviation is not measured.
    pub rule: LodRule,
    /// The runtime of the walks.
    pub runtime: &'c Handle,
    /// Called after each point.
    pub done: &'c dyn Fn(),
}

/// A value of a property, and the plant that has it; none if its picture has no valid size.
type Variation = (String, Result<PlantCase, String>);

/// The figures of a device.
enum OnDevice {
    Walked { wrong: u64, toggles: u64, deviation: f64, unlike: Option<usize> },
    Refused(String),
    Failed(String),
}

impl Curves<'_> {
    /// All curves.
    #[must_use]
    pub fn all(&self) -> Vec<Curve> {
        vec![self.scales(), self.offsets(), self.fields(), self.sizes(), self.depths(), formats()]
    }

    /// How many points there are.
    pub const POINTS: u64 = 57;

    fn scales(&self) -> Curve {
        let of = |scale: f64| (format!("{scale:.0e}"), Ok(PlantCase { scale, ..PlantCase::default() }));
        let scales = [1e-6, 1e-3, 1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e9];
        let about =
            "Positions are f32 within an object and f64 between objects, so only ratios of sizes matter.";
        self.curve("scale: a plant of 8 m, so many times as large", about, true, scales.map(of))
    }

    fn offsets(&self) -> Curve {
        let of = |far: f64| {
            let origin = DVec3::new(far, -far, 0.5 * far);
            (format!("{far:.0e}"), Ok(PlantCase { origin, ..PlantCase::default() }))
        };
        let offsets = [0.0, 1e3, 1e5, 1e6, 1e7, 1e8, 1e9, 1e12, 1e15];
        let about = "Positions of objects and of the eye are f64, and their difference is rounded to f32. \
                     Doubles have steps of 0.1 micrometres at 1e9 m, 0.1 mm at 1e12 m and 10 cm at 1e15 m.";
        self.curve("distance from the origin, metres", about, true, offsets.map(of))
    }

    fn fields(&self) -> Curve {
        let of = |degrees: f64| {
            let tan_half_fov_y = (degrees.to_radians() * 0.5).tan() as f32;
            (degrees.to_string(), Ok(PlantCase { tan_half_fov_y, ..PlantCase::default() }))
        };
        let fields = [0.001, 0.01, 0.1, 1.0, 10.0, 60.0, 120.0, 170.0, 179.0, 179.99, 179.9999];
        let about = "A camera outside of the limits cannot be made.";
        self.curve("vertical field of view, degrees", about, false, fields.map(of))
    }

    fn sizes(&self) -> Curve {
        let of = |(width, height): (u32, u32)| {
            let viewport = Viewport::new(width, height).map_err(|error| error.to_string());
            let frames = if width.saturating_mul(height) > ORACLE_PIXELS { (2, 6) } else { (10, 8) };
            let plant = viewport.map(|viewport| PlantCase { viewport, frames, ..PlantCase::default() });
            (format!("{width} x {height}"), plant)
        };
        let sizes = [
            (0, 1),
            (1, 1),
            (7, 5),
            (1, 8192),
            (8192, 1),
            (1, 16_384),
            (16_384, 1),
            (16_384, 64),
            (1024, 1024),
            (16_385, 1),
            (65_537, 1),
        ];
        let about = "A picture has at most 65,536 pixels a side, and each device has a limit of its own.";
        self.curve("picture, pixels", about, false, sizes.map(of))
    }

    fn curve(
        &self,
        of: &'static str,
        about: &'static str,
        compares: bool,
        values: impl IntoIterator<Item = Variation>,
    ) -> Curve {
        let mut figures = vec!["f64 oracle: wrong pixels".to_owned()];
        let all = ["wrong pixels", "toggles", "deviation", "unlike"];
        for gpu in self.devices {
            let name = short_name(gpu);
            let measured = all.iter().take(if compares { 4 } else { 3 });
            figures.extend(measured.map(|figure| format!("{name}: {figure}")));
        }
        let points = values.into_iter().map(|(at, plant)| {
            tracing::info!(of, at, "measures");
            let point = self.point(at, plant, compares);
            (self.done)();
            point
        });
        Curve { of, about, figures, points: points.collect() }
    }

    fn point(&self, at: String, plant: Result<PlantCase, String>, compares: bool) -> Point {
        let case = plant.and_then(|plant| plant.case("plant").map_err(|error| causes(&error)));
        let case = match case {
            Ok(case) => case,
            Err(refused) => return Point { figures: Err(refused), ..Point::new(at) },
        };
        let (mut figures, mut holds, mut notes, mut differs) = (Vec::new(), true, Vec::new(), false);
        let size = case.views.first().map(View::viewport);
        if size.is_some_and(|size| size.width() * size.height() <= ORACLE_PIXELS) {
            match Target::Oracle.walk(&case, &[], self.rule) {
                Ok(walked) => {
                    holds &= walked.worst().holds();
                    figures.push(walked.worst().wrong_pixels.to_string());
                }
                Err(error) => {
                    holds = false;
                    figures.push(causes(&error));
                }
            }
        } else {
            figures.push(NONE.to_owned());
        }
        for gpu in self.devices {
            let count = if compares { 4 } else { 3 };
            let mut cells = match self.on_device(gpu, &case, compares) {
                OnDevice::Walked { wrong, toggles, deviation, unlike } => {
                    holds &= wrong + toggles == 0 && deviation <= COARSE_PX;
                    differs |= unlike.is_some_and(|pixels| pixels > 0);
                    let moved = format!("{deviation:.1} px");
                    let unlike = unlike.map(|pixels| format!("{pixels} px"));
                    [format!("{wrong} px"), toggles.to_string(), moved].into_iter().chain(unlike).collect()
                }
                OnDevice::Refused(why) => {
                    notes.push(why);
                    vec!["refused".to_owned()]
                }
                OnDevice::Failed(why) => {
                    holds = false;
                    notes.push(why);
                    vec!["FAILED".to_owned()]
                }
            };
            cells.resize(count, NONE.to_owned());
            figures.extend(cells);
        }
        Point { at, figures: Ok(figures), notes, differs, holds }
    }

    /// Two cullers with each occlusion test.
    fn on_device(&self, gpu: &Arc<Gpu>, case: &Case, compares: bool) -> OnDevice {
        let target = Target::Device(gpu, self.runtime);
        let way = |occlusion_test| Way { system: System::Independent2, occlusion_test, rule: self.rule };
        let ways = OcclusionTestKind::ALL.map(way);
        let measured = || {
            let worst = target.walk(case, &ways, self.rule)?.worst();
            let coarse = LodRule::new(COARSE_PX).unwrap_or(self.rule);
            let deviation = deviation_px(&target, case, coarse)?.unwrap_or(0.0);
            let unlike = compares.then(|| unlike(&target, case, self.rule)).transpose()?;
            let wrong = worst.wrong_pixels + worst.lost_nodes + worst.outside_cut;
            Ok(OnDevice::Walked { wrong, toggles: worst.toggles.unwrap_or(0), deviation, unlike })
        };
        measured().unwrap_or_else(|error: MeasureError| match error.refused_size() {
            Some(refused) => OnDevice::Refused(refused.to_string()),
            None => OnDevice::Failed(causes(&error)),
        })
    }

    /// Surfaces ever farther from the near plane.
    fn depths(&self) -> Curve {
        let targets = || {
            let devices = self.devices.iter().map(|gpu| Target::Device(gpu, self.runtime));
            std::iter::once(Target::Oracle).chain(devices)
        };
        let names = std::iter::once("f64 oracle".to_owned()).chain(self.devices.iter().map(short_name));
        let figure = |name: String| [format!("{name}: smallest gap"), format!("{name}: wrong pixels")];
        let point = |power: i32| {
            let (near, distance) =
                (10_f64.powf(-f64::from(power) * 0.7), 10_f64.powf(f64::from(power) * 0.3));
            tracing::info!(power, "measures depth");
            let (mut figures, mut holds) = (Vec::new(), true);
            for target in targets() {
                let found = depth_at(&target, near as f32, distance, self.rule);
                holds &= found.as_ref().is_ok_and(|(_, wrong)| *wrong == 0);
                figures.extend(match found {
                    Ok((gap, wrong)) => {
                        [gap.map_or("none".to_owned(), |gap| format!("{gap:.0e}")), format!("{wrong} px")]
                    }
                    Err(error) => [causes(&error), NONE.to_owned()],
                });
            }
            (self.done)();
            Point { figures: Ok(figures), holds, ..Point::new(format!("1e{power}")) }
        };
        let points = [1, 3, 5, 7, 10, 20, 30, 37, 38, 39, 41].map(point);
        Curve {
            of: "depth: distance of two surfaces over that of the near plane",
            about: "The smallest gap at which the nearer surface shows at each pixel, of the distance. From \
                    1e38 on depth is below the smallest normal number of f32. Devices take it for 0, which \
                    is the background: \"none\". Culled and unculled pictures then lack the same, and \
                    nothing refuses. By default the near plane is a ten-thousandth of the scene's \
                    diagonal, so only a path with a near plane of its own comes there.",
            figures: names.flat_map(figure).collect(),
            points: points.into(),
        }
    }
}

/// Pixels that show another object than the usual plant does.
fn unlike(target: &Target<'_>, case: &Case, rule: LodRule) -> Result<usize, MeasureError> {
    let usual = PlantCase::default().case("plant")?;
    let mut pixels = 0;
    for (view, there) in usual.views.iter().zip(&case.views).step_by(3) {
        let (here, there) = (target.objects(&usual, view, rule)?, target.objects(case, there, rule)?);
        pixels += here.iter().zip(&there).filter(|(a, b)| a != b).count();
    }
    Ok(pixels)
}

/// Formats of depth, computed.
fn formats() -> Curve {
    let point = |power: i32| {
        let gap = |format: DepthFormat| format.resolved(1e-3, 10_f64.powi(power));
        let text = |gap: Option<f64>| gap.map_or("none".to_owned(), |gap| format!("{gap:.0e}"));
        let figures = DepthFormat::ALL.map(|format| text(gap(format))).to_vec();
        Point { figures: Ok(figures), ..Point::new(format!("1e{power}")) }
    };
    Curve {
        of: "format of depth: smallest gap at a distance in metres, near plane at 1 mm, far plane at 1e6 m",
        about: "Computed, not drawn: why depth is reversed, and 32 bits wide.",
        figures: DepthFormat::ALL.map(|format| format.name().to_owned()).to_vec(),
        points: [-2, -1, 0, 1, 2, 3, 4, 5].map(point).into(),
    }
}
