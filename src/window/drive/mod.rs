//! A walk that the window repeats by itself, and its report.

mod album;
mod audit;
mod way;

use std::time::Duration;

use serde::Serialize;
use trimaran_cull::{View, Viewport};
use trimaran_gpu::{GpuError, PresentMode};
use trimaran_proto::{Camera, DrawableId};
use trimaran_scene::path::PosePath;

use super::{navigate::Navigator, sight::Moved};
use crate::{page::WrongPixels, report::schema::Stat};
use album::{Album, Taken};
pub(super) use audit::Exact;
use way::{Step, Way};

/// The report of a window's walk.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct WindowReport {
    /// The device.
    pub device: String,
    /// How presentation was synchronized with the screen.
    pub present_mode: &'static str,
    /// The picture's size in pixels.
    pub width: u32,
    /// Its height.
    pub height: u32,
    /// Seconds from the window's opening to the first exact picture at the first pose.
    pub exact_picture_s: f64,
    /// How long the walk took, seconds.
    pub walk_s: f64,
    /// Pictures that were drawn on it.
    pub pictures: u32,
    /// Milliseconds between two pictures.
    pub picture_ms: Option<Stat>,
    /// Age of the poses for which the drawn sets were culled, milliseconds.
    pub set_age_ms: Option<Stat>,
    /// Milliseconds from the last pose to its exact picture, with the eye at rest.
    pub rest_ms: f64,
    /// The differences between its pictures and the exact ones.
    pub wrong: WrongPixels,
}

/// The phase of a walk.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    /// At the first pose, until its exact picture.
    Waits,
    /// On its way since then.
    Walks { begun: Duration, before: Duration },
    /// At the last pose since then.
    Rests { begun: Duration, ended: Duration },
    /// Finished.
    Done { begun: Duration, ended: Duration, rested: Duration },
}

/// A walk by itself. Times are since the session's start.
#[derive(Debug)]
pub(super) struct Drive {
    way: Way,
    phase: Phase,
    /// When the first exact picture was shown.
    exact: Duration,
    /// When the eye last jumped, until a set from after the jump has come.
    jumped: Option<Duration>,
    album: Album,
    ages: Vec<f64>,
    size: Option<Viewport>,
}

/// A picture that was drawn on a walk.
pub(super) struct Drawn<'d> {
    pub(super) at: Duration,
    pub(super) camera: Camera,
    pub(super) size: Viewport,
    pub(super) ids: &'d [DrawableId],
    /// When the pose of the newest set was published.
    pub(super) posed: Option<Duration>,
    /// That set is from the eye's pose.
    pub(super) is_exact: bool,
}

impl Drive {
    pub(super) fn new(path: &PosePath) -> Self {
        Self {
            way: Way::new(path),
            phase: Phase::Waits,
            exact: Duration::ZERO,
            jumped: None,
            album: Album::default(),
            ages: Vec::new(),
            size: None,
        }
    }

    /// Puts the eye at its pose for this time.
    pub(super) fn step(&mut self, navigator: &mut Navigator, now: Duration) -> Moved {
        let (time, before) = match &mut self.phase {
            Phase::Waits => (Duration::ZERO, Duration::ZERO),
            Phase::Walks { begun, before } => {
                let time = now.saturating_sub(*begun);
                (time, std::mem::replace(before, time))
            }
            Phase::Rests { .. } | Phase::Done { .. } => return Moved::Not,
        };
        let Some(Step { eye, forward, is_jump }) = self.way.at(time, before) else {
            if let Phase::Walks { begun, .. } = self.phase {
                self.phase = Phase::Rests { begun, ended: now };
            }
            return Moved::Not;
        };
        if self.phase == Phase::Waits && navigator.pose().eye == eye {
            return Moved::Not;
        }
        navigator.go_to(eye, forward);
        if is_jump {
            self.jumped = Some(now);
        }
        if is_jump { Moved::Leapt } else { Moved::Went }
    }

    /// Vertical field of view of the walk, degrees.
    pub(super) fn vfov_deg(&self) -> f64 {
        self.way.vfov_deg()
    }

    /// Notes a picture, and enters the next phase if it was the awaited one.
    pub(super) fn note(&mut self, drawn: &Drawn<'_>) {
        let &Drawn { at, camera, size, ids, posed, is_exact } = drawn;
        match self.phase {
            Phase::Waits if is_exact => {
                self.exact = at;
                self.phase = Phase::Walks { begun: at, before: Duration::ZERO };
            }
            Phase::Walks { .. } => {
                let jumped = self.jumped.filter(|&jumped| posed.is_none_or(|posed| posed < jumped));
                self.jumped = jumped;
                self.ages.extend(posed.map(|posed| 1e3 * at.saturating_sub(posed).as_secs_f64()));
                self.size = Some(size);
                let ids = jumped.is_none().then(|| ids.to_vec());
                self.album.add(Taken { at, camera, ids, has_jumped: jumped.is_some() });
            }
            Phase::Rests { begun, ended } if is_exact => {
                self.phase = Phase::Done { begun, ended, rested: at }
            }
            Phase::Waits | Phase::Rests { .. } | Phase::Done { .. } => {}
        }
    }

    /// Whether it is on its way.
    pub(super) const fn is_walking(&self) -> bool {
        matches!(self.phase, Phase::Walks { .. })
    }

    /// Whether all of the walk was seen.
    pub(super) const fn is_done(&self) -> bool {
        matches!(self.phase, Phase::Done { .. })
    }

    /// The report, once it is done. Comparing its pictures with the exact ones takes a while.
    pub(super) fn report<W: Fn(&View) -> View>(
        &self,
        exact: &Exact<'_, W>,
        present_mode: PresentMode,
    ) -> Result<Option<WindowReport>, GpuError> {
        let (Phase::Done { begun, ended, rested }, Some(size)) = (self.phase, self.size) else {
            return Ok(None);
        };
        let pictures = self.album.pictures();
        let between = pictures.windows(2).filter_map(|pair| {
            let [before, after] = pair else { return None };
            Some(1e3 * after.at.saturating_sub(before.at).as_secs_f64())
        });
        Ok(Some(WindowReport {
            device: exact.drawn.gpu().info().name.clone(),
            present_mode: present_mode.name(),
            width: size.width(),
            height: size.height(),
            exact_picture_s: self.exact.as_secs_f64(),
            walk_s: ended.saturating_sub(begun).as_secs_f64(),
            pictures: u32::try_from(pictures.len()).unwrap_or(u32::MAX),
            picture_ms: Stat::of(between),
            set_age_ms: Stat::of(self.ages.iter().copied()),
            rest_ms: 1e3 * rested.saturating_sub(ended).as_secs_f64(),
            wrong: exact.audit(pictures, size)?,
        }))
    }
}
