//! The window: handles input, and shows the pictures.

use std::{sync::Arc, time::Duration};

use glam::{DVec2, DVec3};
use trimaran_actors::Stopwatch;
use trimaran_cull::{CutRule, View, Viewport};
use trimaran_gpu::{GpuScene, PicturePass, PresentMode, Presenter};
use trimaran_scene::Scene;
use winit::{
    application::ApplicationHandler,
    dpi::{LogicalSize, PhysicalSize},
    event::WindowEvent,
    event_loop::{ActiveEventLoop, ControlFlow},
    window::{Window, WindowId},
};

use super::{
    drive::{Drawn, Drive, Exact, WindowReport},
    error::WindowError,
    hand::Hand,
    navigate::{Ground, Mode, Navigator},
    pictures::Pictures,
    sight::{Moved, Sight, wider},
    title::Title,
};

/// How long after the last picture it is redrawn more finely, if none follows.
const REST: Duration = Duration::from_millis(150);

/// Messages of other threads to the window.
#[derive(Debug, Clone, Copy)]
pub(super) enum News {
    /// A set has come.
    Set,
    /// Close.
    Close,
}

/// The window and its state.
pub(super) struct App {
    pub(super) name: String,
    pub(super) scene: Arc<Scene>,
    pub(super) drawn: Arc<GpuScene>,
    /// The see-through objects, and the rule for levels of detail.
    pub(super) rule: CutRule,
    /// The window's inner size at first, in logical pixels.
    pub(super) size: [u32; 2],
    pub(super) mode: PresentMode,
    pub(super) navigator: Navigator,
    pub(super) ground: Ground,
    pub(super) sight: Sight,
    pub(super) clock: Stopwatch,
    /// A walk to repeat by itself.
    pub(super) drive: Option<Drive>,
    pub(super) state: State,
}

/// State that changes while the window is open.
#[derive(Default)]
pub(super) struct State {
    shown: Option<Shown>,
    hand: Hand,
    /// When the previous picture was begun.
    last: Duration,
    /// When the shown picture last changed, unless it was drawn finely since.
    changed: Option<Duration>,
    title: Title,
    report: Option<WindowReport>,
    failure: Option<WindowError>,
}

/// A window with its pictures.
struct Shown {
    window: Arc<Window>,
    /// Its inner size, physical pixels.
    size: PhysicalSize<u32>,
    presenter: Presenter,
    pictures: Pictures,
    is_hidden: bool,
}

impl App {
    /// The report of a repeated walk, or the error that closed the window.
    pub(super) fn into_report(self) -> Result<Option<WindowReport>, WindowError> {
        self.state.failure.map_or(Ok(self.state.report), Err)
    }

    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Shown, WindowError> {
        let attributes =
            Window::default_attributes()
                .with_title(&self.name)
                .with_inner_size(LogicalSize::<u32>::from(self.size));
        let window = Arc::new(event_loop.create_window(attributes).map_err(WindowError::Window)?);
        let presenter = Presenter::new(self.drawn.gpu(), Arc::clone(&window), self.mode)?;
        let size = window.inner_size();
        let first = Viewport::new(size.width.max(1), size.height.max(1)).map_err(WindowError::Size)?;
        let pass = PicturePass::for_window(&self.drawn, first)?;
        let pictures = Pictures::new(&self.scene, pass, self.rule.clone());
        Ok(Shown { window, size, presenter, pictures, is_hidden: false })
    }

    /// Draws from the current eye. Returns whether another picture is due at once.
    fn picture(&mut self) -> Result<bool, WindowError> {
        let State { shown: Some(shown), .. } = &mut self.state else { return Ok(false) };
        let size = shown.size;
        // May block: the eye's movement is read afterwards.
        let Some(picture) = shown.presenter.acquire([size.width, size.height])? else {
            return Ok(!shown.is_hidden && size.width > 0 && size.height > 0);
        };
        let now = self.clock.elapsed();
        let moved = self.follow(now);
        self.sight.take_sets();
        let (pose, vfov_deg) = (self.navigator.pose(), self.navigator.vfov_deg());
        self.sight.ask(pose, vfov_deg, picture, (now, moved)).map_err(WindowError::Eye)?;
        let camera = self.sight.camera(pose, vfov_deg).map_err(WindowError::Eye)?;
        let (is_exact, recent, has_moved) = (self.sight.is_exact(), self.sight.recent(), moved != Moved::Not);
        let State { shown: Some(shown), title, changed, .. } = &mut self.state else {
            return Ok(false);
        };
        shown.window.pre_present_notify();
        shown.pictures.show(&View::new(camera, picture), recent, is_exact, &mut shown.presenter)?;
        if let Some(drive) = &mut self.drive {
            let posed = recent.newest().map(|set| set.posed);
            let ids = shown.pictures.ids();
            drive.note(&Drawn { at: now, camera, size: picture, ids, posed, is_exact });
        }
        *changed = Some(now);
        if let Some(title) = title.drawn(&self.name, &self.navigator, now, has_moved) {
            shown.window.set_title(title);
        }
        let walks = self.drive.as_ref().is_some_and(Drive::is_walking);
        Ok(has_moved || walks || self.state.hand.holds_a_key())
    }

    /// Evaluates a finished walk. Returns its report.
    fn look_back(&self) -> Result<Option<WindowReport>, WindowError> {
        let Some(drive) = self.drive.as_ref().filter(|drive| drive.is_done()) else { return Ok(None) };
        let exact = Exact { scene: &self.scene, drawn: &self.drawn, rule: &self.rule, wider };
        Ok(drive.report(&exact, self.mode)?)
    }

    /// Draws the picture again with four samples per pixel, if the device supports that size.
    fn picture_finely(&mut self) -> Result<(), WindowError> {
        self.state.changed = None;
        let (pose, vfov_deg) = (self.navigator.pose(), self.navigator.vfov_deg());
        let camera = self.sight.camera(pose, vfov_deg).map_err(WindowError::Eye)?;
        let (is_exact, recent) = (self.sight.is_exact(), self.sight.recent());
        let State { shown: Some(shown), .. } = &mut self.state else { return Ok(()) };
        let size = shown.size;
        let Some(picture) = shown.presenter.acquire([size.width, size.height])? else { return Ok(()) };
        let largest = self.drawn.gpu().info().max_viewport;
        let [width, height] = [picture.width(), picture.height()].map(|side| 2 * side);
        let fine = Viewport::new(width, height).ok().filter(|_| width.max(height) <= largest);
        let view = View::new(camera, fine.unwrap_or(picture));
        shown.window.pre_present_notify();
        shown.pictures.show(&view, recent, is_exact, &mut shown.presenter)?;
        Ok(())
    }

    /// Moves the eye by the person's input, or by the repeated walk.
    fn follow(&mut self, now: Duration) -> Moved {
        let Self { navigator, ground, state, drive, .. } = self;
        if let Some(drive) = drive {
            return drive.step(navigator, now);
        }
        let pose = navigator.pose();
        ground.look_around(pose.eye.x, pose.eye.z);
        let time = now.saturating_sub(std::mem::replace(&mut state.last, now));
        let (motion, is_fast) = state.hand.motion();
        if navigator.step(time, motion, is_fast, ground) { Moved::Went } else { Moved::Not }
    }

    /// The visible world point under the pointer; none if nothing is there, or in walk mode.
    fn pointed_at(&mut self) -> Option<DVec3> {
        if self.navigator.mode() == Mode::Walk {
            return None;
        }
        let pose = self.navigator.pose();
        let tan = (self.navigator.vfov_deg().to_radians() / 2.0).tan();
        let near = f64::from(self.sight.near());
        let State { shown: Some(shown), hand, .. } = &mut self.state else { return None };
        let [width, height] = [shown.size.width, shown.size.height].map(f64::from);
        let share = DVec2::new(hand.at().x / width, hand.at().y / height);
        let depth = match shown.pictures.depth_at(share) {
            Ok(depth) => f64::from(depth),
            Err(error) => {
                tracing::warn!(%error, "does not know what is pointed at");
                0.0
            }
        };
        let along = near / depth;
        let [right, up] = [2.0 * share.x - 1.0, 1.0 - 2.0 * share.y];
        let seen = DVec3::new(right * tan * width / height, up * tan, -1.0) * along;
        let point = pose.eye + pose.gaze.orientation() * seen;
        point.is_finite().then_some(point)
    }

    /// Ends with an error, if there is one.
    fn guard<T>(&mut self, event_loop: &ActiveEventLoop, done: Result<T, WindowError>) -> Option<T> {
        match done {
            Ok(done) => Some(done),
            Err(error) => {
                self.state.failure = Some(error);
                event_loop.exit();
                None
            }
        }
    }

    fn redraw(&self) {
        if let Some(shown) = self.state.shown.as_ref().filter(|shown| !shown.is_hidden) {
            shown.window.request_redraw();
        }
    }
}

impl ApplicationHandler<News> for App {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.state.shown.is_none() {
            let opened = self.open(event_loop);
            self.state.shown = self.guard(event_loop, opened);
        }
        self.redraw();
    }

    fn suspended(&mut self, _: &ActiveEventLoop) {
        self.state.shown = None;
    }

    fn exiting(&mut self, _: &ActiveEventLoop) {
        // The connection to the screen ends with the event loop, and nothing of the window may outlive it.
        self.state.shown = None;
    }

    fn user_event(&mut self, event_loop: &ActiveEventLoop, news: News) {
        match news {
            News::Set => self.redraw(),
            News::Close => event_loop.exit(),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested | WindowEvent::Destroyed => event_loop.exit(),
            WindowEvent::RedrawRequested => {
                let drawn = self.picture();
                if self.guard(event_loop, drawn) == Some(true) {
                    self.redraw();
                }
                let seen = self.look_back();
                self.state.report = self.guard(event_loop, seen).flatten();
                if self.state.report.is_some() {
                    event_loop.exit();
                }
                return;
            }
            WindowEvent::Occluded(is_hidden) => {
                if let Some(shown) = &mut self.state.shown {
                    shown.is_hidden = is_hidden;
                }
            }
            WindowEvent::Focused(false) => self.state.hand.lets_go(),
            WindowEvent::ModifiersChanged(modifiers) => self.state.hand.holds(modifiers.state()),
            WindowEvent::KeyboardInput { event, is_synthetic: false, .. } => {
                if self.state.hand.presses(&event, &mut self.navigator) {
                    event_loop.exit();
                }
            }
            WindowEvent::MouseInput { state, button, .. } => {
                let over = self.pointed_at();
                self.state.hand.clicks(button, state, over, &mut self.navigator);
            }
            WindowEvent::CursorMoved { position, .. } => {
                let Some(shown) = &self.state.shown else { return };
                let screen = (shown.size.height, shown.window.scale_factor());
                if !self.state.hand.moves(position, screen, &mut self.navigator) {
                    return;
                }
            }
            WindowEvent::MouseWheel { delta, .. } => {
                let over = if self.navigator.mode() == Mode::Orbit { self.pointed_at() } else { None };
                self.state.hand.turns(delta, over, &mut self.navigator);
            }
            WindowEvent::Resized(size) => {
                if let Some(shown) = &mut self.state.shown {
                    shown.size = size;
                }
            }
            _ => return,
        }
        self.redraw();
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some(changed) = self.state.changed else {
            event_loop.set_control_flow(ControlFlow::Wait);
            return;
        };
        let rested = self.clock.elapsed().saturating_sub(changed);
        if rested < REST {
            event_loop.set_control_flow(ControlFlow::wait_duration(REST - rested));
            return;
        }
        let drawn = self.picture_finely();
        self.guard(event_loop, drawn);
        event_loop.set_control_flow(ControlFlow::Wait);
    }
}
