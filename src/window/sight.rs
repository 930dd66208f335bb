//! Culling requests for a moving eye, and their results.

use std::{sync::mpsc, time::Duration};

use trimaran_cull::{View, Viewport};
use trimaran_proto::{Camera, CameraError, FrameNumber, LodRule, SettingsError, ViewState};

use super::{
    display_role::{FoundSet, Wish},
    navigate::{Pose, Prediction},
    recent_sets::RecentSets,
};

/// The culled view is this much wider and higher than the picture, so that a turn uncovers nothing new.
const WIDER: f64 = 1.5;
/// While the eye moves, culling pixels are this much wider, so that sets come sooner. Silhouettes stay as
/// fine.
const COARSER: f64 = 1.5;
/// The eye is predicted for the time when its set arrives, and in turn for somewhat earlier and later: it may
/// slow down, or go around a corner.
const SPREAD: [f64; 3] = [0.6, 1.2, 1.8];

/// How the eye got to its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moved {
    /// It rests.
    Not,
    /// It moved on.
    Went,
    /// It jumped.
    Leapt,
}

/// Requests visible sets, and keeps recent ones.
pub(super) struct Sight {
    wish: Wish,
    sets: mpsc::Receiver<FoundSet>,
    recent: RecentSets,
    /// The view state, and the level of detail at rest.
    state: ViewState,
    near: f32,
    /// The largest picture that the cullers take.
    most: Viewport,
    prediction: Prediction,
    /// The next index into the spread.
    turn: usize,
    /// How long the newest set took.
    latency: Duration,
    /// The resolution of culling.
    sampling: Option<Sampling>,
    /// The last requested camera, if the eye is there.
    asked: Option<Camera>,
}

impl Sight {
    /// Requests through `wish` views in `state`, and receives `sets`. `near` is in metres, and no requested
    /// picture is larger than `most`.
    pub(super) fn new(
        wish: Wish,
        sets: mpsc::Receiver<FoundSet>,
        state: ViewState,
        near: f32,
        most: Viewport,
    ) -> Self {
        Self {
            wish,
            sets,
            recent: RecentSets::default(),
            state,
            near,
            most,
            prediction: Prediction::default(),
            turn: 0,
            latency: Duration::ZERO,
            sampling: None,
            asked: None,
        }
    }

    /// The sets that came lately.
    pub(super) const fn recent(&self) -> &RecentSets {
        &self.recent
    }

    /// The near distance, metres.
    pub(super) const fn near(&self) -> f32 {
        self.near
    }

    /// A camera of the pose with this vertical field of view, degrees.
    pub(super) fn camera(&self, Pose { eye, gaze }: Pose, vfov_deg: f64) -> Result<Camera, CameraError> {
        let tan = (vfov_deg.to_radians() / 2.0).tan() as f32;
        let orientation = gaze.orientation().normalize().to_array();
        Camera::new(eye.to_array(), orientation, tan, self.near, FrameNumber(0))
    }

    /// Takes the sets that have arrived.
    pub(super) fn take_sets(&mut self) {
        for set in self.sets.try_iter() {
            self.latency = set.came.saturating_sub(set.posed);
            self.wish.seen_in(set.camera.view());
            self.recent.add(set);
        }
    }

    /// The eye is there at this time, and sees a picture of this size. Requests the set at its predicted
    /// pose. Once it rests, its own pose follows.
    pub(super) fn ask(
        &mut self,
        pose: Pose,
        vfov_deg: f64,
        picture: Viewport,
        (now, moved): (Duration, Moved),
    ) -> Result<(), CameraError> {
        if moved == Moved::Leapt {
            self.prediction.forget();
        }
        self.prediction.add(now, pose);
        self.turn = (self.turn + 1) % SPREAD.len();
        let ahead = self.latency.mul_f64(SPREAD.get(self.turn).copied().unwrap_or(1.0));
        let foreseen = if moved == Moved::Not { None } else { self.prediction.after(ahead) };
        let view = View::new(self.camera(foreseen.unwrap_or(pose), vfov_deg)?, picture);
        let wide = wider(&view);
        let fine = Sampling { size: wide.viewport(), lod: self.state.lod };
        let sampling = fine.coarser(if foreseen.is_some() { COARSER } else { 1.0 }, self.most);
        let asked = if self.sampling.replace(sampling) == Some(sampling) {
            self.wish.look(*wide.camera())
        } else {
            let Sampling { size, lod } = sampling;
            let state = ViewState { viewport: size, lod, ..self.state.clone() };
            self.wish.change(state, *wide.camera())
        };
        self.asked = foreseen.is_none().then_some(asked);
        Ok(())
    }

    /// Whether the newest set is complete, and from the eye's pose, for a picture of this size.
    pub(super) fn is_exact(&self) -> bool {
        let newest = self.recent.newest().filter(|newest| newest.is_whole);
        newest.is_some_and(|newest| Some(newest.camera.for_frame(FrameNumber(0))) == self.asked)
    }
}

/// The resolution of culling: the size of the culled picture, and the level rule in it.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sampling {
    size: Viewport,
    lod: LodRule,
}

impl Sampling {
    /// The same picture and levels, in pixels this much wider, or wider still if it exceeds `most` otherwise.
    fn coarser(self, wider: f64, most: Viewport) -> Self {
        let Self { size, lod } = self;
        let fitting = |side: u32, most: u32| f64::from(side) / f64::from(most);
        let wider = wider.max(fitting(size.width(), most.width())).max(fitting(size.height(), most.height()));
        let side = |side: u32, most: u32| ((f64::from(side) / wider).ceil() as u32).min(most);
        let sides = (side(size.width(), most.width()), side(size.height(), most.height()));
        let size = Viewport::new(sides.0, sides.1).unwrap_or(size);
        let few = lod.stops_at_few_pixels();
        let lod = LodRule::new(lod.epsilon_px() / wider).map_or(lod, |lod| lod.stopping_at_few_pixels(few));
        Self { size, lod }
    }
}

/// The view to cull for a picture of this view: with pixels of the same size.
pub(super) fn wider(view: &View) -> View {
    let (camera, size) = (view.camera(), view.viewport());
    let wider = |side: u32| ((f64::from(side) * WIDER).ceil() as u32).min(65_536);
    let wide = || -> Result<View, SettingsError> {
        let wide = Viewport::new(wider(size.width()), wider(size.height()))?;
        let tan = view.tan_half_fov_y() * f64::from(wide.height()) / f64::from(size.height());
        let near = camera.near();
        let seen = Camera::new(camera.eye(), camera.orientation(), tan as f32, near, camera.frame());
        Ok(View::new(seen.unwrap_or(*camera), wide))
    };
    wide().unwrap_or(*view)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use trimaran_actors::Cameras;
    use trimaran_proto::Settings;

    use super::super::navigate::Gaze;
    use super::*;

    const fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn pose(x: f64) -> Pose {
        Pose { eye: DVec3::new(x, 0.0, 0.0), gaze: Gaze { heading: 0.0, pitch: 0.0 } }
    }

    #[test]
    fn a_moving_eye_is_asked_for_ahead_and_a_resting_one_where_it_is() {
        let (found, sets) = mpsc::channel();
        let mut wish = Wish::new(Camera::at_origin(FrameNumber(0)));
        let size = Viewport::new(100, 50).unwrap();
        let glass: trimaran_proto::ObjectSet = [3, 4].into_iter().collect();
        let settings = Settings::new(size, LodRule::new(2.0).unwrap());
        let state = ViewState { see_through: Some(glass.clone()), ..settings.into() };
        let mut sight = Sight::new(wish.clone(), sets, state, 0.1, Viewport::LARGEST);
        let states = wish.clone();
        let culled_for = |camera: Camera| {
            let state = states.clone().view_state(camera.view()).unwrap();
            assert_eq!(state.see_through.as_ref(), Some(&glass));
            ([state.viewport.width(), state.viewport.height()], state.lod.epsilon_px())
        };
        let mut ask = |sight: &mut Sight, x: f64, at: u64, moved: Moved| {
            sight.take_sets();
            sight.ask(pose(x), 90.0, size, (ms(at), moved)).unwrap();
            wish.camera(FrameNumber(0))
        };
        let come = |camera: Camera, posed: u64, came: u64| {
            found
                .send(FoundSet { camera, ids: vec![], posed: ms(posed), came: ms(came), is_whole: true })
                .unwrap();
        };
        let first = ask(&mut sight, 0.0, 0, Moved::Not);
        assert_eq!(first.view().0, 1, "the picture has a size of its own");
        assert!((first.tan_half_fov_y() - 1.5).abs() < 1e-6, "pixels are as large as before");
        assert!(!sight.is_exact());
        come(first.for_frame(FrameNumber(4)), 0, 50);
        sight.take_sets();
        assert!(sight.is_exact());
        // A set takes 50 ms, in which the eye moves 0.05 m; requests lie short of that and beyond.
        ask(&mut sight, 0.0, 100, Moved::Went);
        let mut ahead: Vec<f64> = (1..=3)
            .map(|step| {
                let x = 0.1 * f64::from(step);
                ask(&mut sight, x, 100 + 100 * step as u64, Moved::Went).eye()[0] - x
            })
            .collect();
        ahead.sort_by(f64::total_cmp);
        for (ahead, expected) in ahead.iter().zip([0.03, 0.06, 0.09]) {
            assert!((ahead - expected).abs() < 1e-9, "{ahead}");
        }
        assert!(!sight.is_exact());
        let moving = ask(&mut sight, 0.4, 450, Moved::Went);
        assert_eq!(culled_for(moving), ([100, 50], 2.0 / 1.5), "pixels are wider, and silhouettes the same");
        // A jump does not predict the next movement.
        assert_eq!(ask(&mut sight, 9.0, 500, Moved::Leapt).eye()[0], 9.0);
        let rests = ask(&mut sight, 9.0, 600, Moved::Not);
        assert_eq!(culled_for(rests), ([150, 75], 2.0), "of an eye at rest they are as before");
        come(rests, 600, 650);
        sight.take_sets();
        assert!(sight.is_exact());
    }

    #[test]
    fn no_picture_is_larger_than_the_cullers_take_and_silhouettes_are_as_fine_as_before() {
        let size = |width, height| Viewport::new(width, height).unwrap();
        let lod = LodRule::new(2.0).unwrap();
        let sampling = |width, height, wider, most| {
            let Sampling { size, lod } = Sampling { size: size(width, height), lod }.coarser(wider, most);
            (size.width(), size.height(), lod.epsilon_px())
        };
        assert_eq!(sampling(8192, 4096, 1.0, size(4096, 4096)), (4096, 2048, 1.0));
        assert_eq!(sampling(8192, 4096, 1.5, size(4096, 4096)), (4096, 2048, 1.0));
        assert_eq!(sampling(300, 60, 1.5, size(4096, 4096)), (200, 40, 2.0 / 1.5));
        assert_eq!(sampling(65_536, 1, 1.0, size(1, 1)), (1, 1, 2.0 / 65_536.0));
    }

    #[test]
    fn a_view_that_is_as_wide_as_any_stays_as_it_is() {
        let view =
            |side: u32| View::new(Camera::at_origin(FrameNumber(0)), Viewport::new(side, side).unwrap());
        let wide = wider(&view(65_536));
        assert_eq!((wide.viewport().width(), wide.camera().tan_half_fov_y()), (65_536, 1.0));
        assert_eq!(wider(&view(3)).viewport().width(), 5);
    }
}
