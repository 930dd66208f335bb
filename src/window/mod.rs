//! A display in a window of the system: the display and the navigation of the page, in Rust on Vulkan.
//!
//! The window draws each picture from the newest pose with the newest sets that are there, on the main thread.
//! A display role beside it deals poses to a culler and takes what that finds, on a thread of its own.

mod app;
mod drive;
mod hand;
pub mod navigate;
mod pictures;
mod recent_sets;
mod role;
mod sight;
mod title;

use std::{
    io,
    sync::{Arc, mpsc},
    thread,
    time::Duration,
};

use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_actors::{
    CullerId, DisplayRole, LocalCullers, Pace, Peers, RoleError, Schedule, SessionError, Sought, Stop,
    Stopper, Turns, max_frame,
};
use trimaran_cull::Viewport;
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene, PresentMode};
use trimaran_proto::{
    Camera, CameraError, FrameNumber, Identity, LodRule, Role, SessionKey, Settings, SettingsError,
};
use trimaran_scene::{Scene, path::PosePath};
use trimaran_transport::{Net, TokioNet};
use winit::{
    error::{EventLoopError, OsError},
    event_loop::{EventLoop, EventLoopProxy},
    raw_window_handle::HasDisplayHandle,
};

use crate::culling::{Culling, CullingMethod};
use app::{App, News, State};
use drive::Drive;
pub use drive::WindowReport;
use navigate::{Ground, Navigator, Start};
use role::{DrawsNothing, PassesOn, Wish};
use sight::Sight;

/// A window that is to be opened.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// What it is called.
    pub name: String,
    /// Where a person begins.
    pub start: Start,
    /// Nothing comes nearer to an eye of a walk than this, metres.
    pub clearance: f64,
    /// When a level of detail is good enough.
    pub lod: LodRule,
    /// Its inside at first, in pixels of a screen that is not scaled.
    pub size: [u32; 2],
    /// A walk that it is to repeat by itself. Then it closes.
    pub drive: Option<PosePath>,
    /// When a picture takes the place of the one before.
    pub present_mode: PresentMode,
    /// The device that draws and culls.
    pub gpu: GpuOptions,
}

/// Why a window could not be opened, or was closed though nobody wanted that.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WindowError {
    /// There is no screen.
    #[error(
        "there is no screen to open a window on; set DISPLAY or WAYLAND_DISPLAY, or walk in a browser \
         (leave --window out)"
    )]
    NoScreen(#[source] EventLoopError),
    /// The system does not open a window.
    #[error("the system does not open a window")]
    Window(#[source] OsError),
    /// The device failed, or cannot show pictures there.
    #[error(transparent)]
    Gpu(GpuError),
    /// The window is larger than any picture.
    #[error("the window is larger than any picture")]
    Size(#[source] SettingsError),
    /// The eye has gone where no camera is.
    #[error("no picture can be drawn from there")]
    Eye(#[source] CameraError),
    /// The system gives no thread.
    #[error("the system gives no thread")]
    Thread(#[source] io::Error),
    /// What finds out what is visible has failed.
    #[error("what is visible cannot be found out any more")]
    Session(#[source] SessionError),
}

impl WindowError {
    /// Whether it is the machine's, and may work with other flags.
    #[must_use]
    pub const fn is_of_input(&self) -> bool {
        matches!(self, Self::NoScreen(_) | Self::Gpu(GpuError::NoPresentMode { .. } | GpuError::NoWindows))
    }
}

/// Opens a window in which a person walks through a scene, and returns when it is closed or `stop` asks. Gives
/// how a walk went that it has repeated to the end. To be called on the process's main thread, and once in a
/// process: systems demand both.
///
/// # Errors
/// Says what is missing for a window, and what failed while it was there.
pub fn open(
    scene: &Arc<Scene>,
    options: &WindowOptions,
    runtime: &Handle,
    stop: &Stop,
) -> Result<Option<WindowReport>, WindowError> {
    let event_loop = EventLoop::with_user_event().build().map_err(WindowError::NoScreen)?;
    let display = event_loop.display_handle().map_err(|_| WindowError::Gpu(GpuError::NoWindows))?;
    let gpu = Gpu::open_for_windows(&options.gpu, display)?;
    let drawn = GpuScene::new(&gpu, scene)?;
    // A culler has a device of its own, so that no picture waits behind its work.
    let culled = GpuScene::new(&Gpu::open(&options.gpu)?, scene)?;

    let turns = Turns::at_once();
    let (found, sets) = mpsc::channel();
    let near = (options.clearance / 2.0) as f32;
    let wish = Wish::new(first_camera(&options.start, near)?);
    let mut navigator = Navigator::new(&options.start);
    let drive = options.drive.as_ref().map(Drive::new);
    if let Some(drive) = &drive {
        navigator.set_vfov(drive.vfov_deg());
    }
    let mut app = App {
        name: options.name.clone(),
        scene: Arc::clone(scene),
        drawn,
        size: options.size,
        mode: options.present_mode,
        navigator,
        ground: Ground::new(scene, options.start.eye_height).map_err(WindowError::Thread)?,
        sight: Sight::new(wish.clone(), sets, options.lod, near),
        clock: turns.clock(),
        drive,
        state: State::default(),
    };
    // The first picture tells its own size, and with it comes the first view state.
    let small = Viewport::new(64, 64).map_err(WindowError::Size)?;
    let settings = Settings::new(small, options.lod);
    let roles = Roles { scene, culled: &culled, settings, turns: &turns, runtime };
    let (closed, over) = Stop::new();
    let wake = event_loop.create_proxy();
    let observer = PassesOn { sets: found, wake: told(&wake, News::Set) };
    close_when_asked(stop, &wake, runtime);
    thread::scope(|scope| {
        let closed = StopsAtLast(closed);
        let play = || {
            let played = roles.play(wish, observer, &over);
            // Whoever plays no more has no use for the window either.
            told(&wake, News::Close)();
            played
        };
        let display = thread::Builder::new().name("display".to_owned());
        let display = display.spawn_scoped(scope, play).map_err(WindowError::Thread)?;
        let shown = event_loop.run_app(&mut app).map_err(WindowError::NoScreen);
        drop(closed);
        let played = display.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        shown?;
        let report = app.into_report()?;
        played.map_err(WindowError::Session)?;
        Ok(report)
    })
}

/// Stops the roles however the window ends.
struct StopsAtLast(Stopper);

impl Drop for StopsAtLast {
    fn drop(&mut self) {
        self.0.stop();
    }
}

/// Tells the window something, from any thread.
fn told(wake: &EventLoopProxy<News>, news: News) -> impl Fn() + use<> {
    let wake = wake.clone();
    move || {
        // A window that is closed needs no news.
        let _closed = wake.send_event(news);
    }
}

fn close_when_asked(stop: &Stop, wake: &EventLoopProxy<News>, runtime: &Handle) {
    let (stop, close) = (stop.clone(), told(wake, News::Close));
    runtime.spawn(async move {
        stop.unless_requested(std::future::pending::<()>()).await;
        close();
    });
}

fn first_camera(start: &Start, near: f32) -> Result<Camera, WindowError> {
    let navigate::Pose { eye, gaze } = Navigator::new(start).pose();
    let tan = (start.vfov_deg.to_radians() / 2.0).tan() as f32;
    let orientation = gaze.orientation().normalize().to_array();
    Camera::new(eye.to_array(), orientation, tan, near, FrameNumber(0)).map_err(WindowError::Eye)
}

/// A display role and a culler beside a window.
struct Roles<'r> {
    scene: &'r Arc<Scene>,
    culled: &'r Arc<GpuScene>,
    settings: Settings,
    turns: &'r Turns,
    runtime: &'r Handle,
}

impl Roles<'_> {
    /// Plays until `stop` asks.
    fn play<F: Fn()>(
        &self,
        mut wish: Wish,
        mut observer: PassesOn<F>,
        stop: &Stop,
    ) -> Result<(), SessionError> {
        let Self { scene, culled, settings, turns, runtime } = *self;
        let cull =
            |settings: &Settings| Culling::open(CullingMethod::Trimaran, scene, culled, settings, turns);
        let local = LocalCullers::new(scene, 1, turns);
        let net: Arc<dyn Net> = Arc::new(TokioNet::new(runtime.clone()));
        let session = SessionKey(net.random().map_err(SessionError::Random)?);
        let show = || -> Result<(), SessionError> {
            let identity = Identity {
                role: Role::Display,
                scene: Some(scene.outline()),
                session: Some((session, settings)),
            };
            let sought = Sought {
                identity,
                role: Role::Culler,
                endpoints: local.peers().collect(),
                listener: None,
                most: CullerId::MOST,
            };
            let role = DisplayRole {
                work: DrawsNothing,
                alone: Some(cull(&settings)?),
                supplied: None,
                cullers: Peers::seek(&net, sought),
                session,
                settings,
                schedule: Schedule::Independent,
                pace: Pace::Live,
                first: FrameNumber(0),
                join_timeout: Duration::ZERO,
                drawables: max_frame(scene),
                net: Arc::clone(&net),
                turns: turns.clone(),
            };
            Ok(runtime.block_on(role.run(&mut wish, &mut observer, stop))?)
        };
        match local.beside(|_, settings| cull(settings), runtime, show) {
            Err(SessionError::Role(RoleError::Stopped)) => Ok(()),
            played => played,
        }
    }
}
