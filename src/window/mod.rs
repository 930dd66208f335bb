//! A display in a window of the system: the display and the navigation of the page, in Rust on Vulkan.
//!
//! The window draws each picture from the newest pose with the newest sets, on the main thread. A display
//! role beside it sends poses to a culler and receives the sets, on a thread of its own.

mod app;
mod beside;
mod display_role;
mod drive;
mod error;
mod hand;
pub mod navigate;
mod pictures;
mod recent_sets;
mod service;
mod sight;
mod title;

use std::{
    sync::{Arc, mpsc},
    thread,
};

use tokio::runtime::Handle;
use trimaran_actors::{SessionError, Stop, Stopper, Turns};
use trimaran_cull::{CutRule, Viewport};
use trimaran_gpu::{Gpu, GpuError, GpuOptions, GpuScene, PresentMode};
use trimaran_proto::{Camera, FrameNumber, LodRule, Settings, ViewState};
use trimaran_scene::{Scene, path::PosePath};
use winit::{
    event_loop::{EventLoop, EventLoopProxy},
    raw_window_handle::HasDisplayHandle,
};

use app::{App, News, State};
use beside::Beside;
use display_role::{PassesOn, Wish};
use drive::Drive;
pub use drive::WindowReport;
pub use error::WindowError;
use navigate::{Ground, Navigator, Start};
use service::Described;
pub use service::{AskError, NoService, ServiceAt};
use sight::Sight;

/// The facts of a scene that a window needs before it shows anything.
#[derive(Debug, Clone)]
pub struct About {
    /// Its name.
    pub name: String,
    /// Where a person begins.
    pub start: Start,
    /// The smallest distance between a walking eye and the scene, metres.
    pub clearance: f64,
    /// The largest picture that its cullers take.
    pub max_picture: Viewport,
}

/// The options of a window.
#[derive(Debug, Clone)]
pub struct WindowOptions {
    /// The rule for levels of detail.
    pub lod: LodRule,
    /// Its inner size at first, in logical pixels.
    pub size: [u32; 2],
    /// A walk to repeat by itself before it closes.
    pub drive: Option<PosePath>,
    /// How presentation is synchronized with the screen.
    pub present_mode: PresentMode,
    /// The device that draws and culls.
    pub gpu: GpuOptions,
}

/// Opens a window in which a person walks through a scene, and returns when it is closed or `stop` asks.
/// Returns the report of a walk repeated to its end. Call it on the process's main thread, and once in a
/// process: systems demand both.
///
/// # Errors
/// Why it could not be opened, or what failed later.
pub fn open(
    scene: &Arc<Scene>,
    about: &About,
    options: &WindowOptions,
    runtime: &Handle,
    stop: &Stop,
) -> Result<Option<WindowReport>, WindowError> {
    let screen = Screen::open(options)?;
    // A culler has a device of its own, so that no picture waits behind its work.
    let culled = GpuScene::new(&Gpu::open(&options.gpu)?, scene)?;
    let ground = Ground::new(scene, about.start.eye_height).map_err(WindowError::Thread)?;
    let beside = Beside::new(options, runtime)?;
    let roles = beside.clone();
    let play = move |wish: Wish, observer: PassesOn<_>, stop: &Stop| {
        roles.play_local((scene, &culled), wish, observer, stop)
    };
    screen.show(scene, about, ground, options, &beside, play, stop)
}

/// Opens a window in which a person walks through the scene of a remote service. It begins without geometry,
/// and receives what becomes visible.
///
/// # Errors
/// As [`open`], and when the service does not answer.
pub fn open_service(
    service: &ServiceAt,
    options: &WindowOptions,
    runtime: &Handle,
    stop: &Stop,
) -> Result<Option<WindowReport>, WindowError> {
    let described = service.describe(runtime).map_err(WindowError::Service)?;
    let (start, clearance) = (described.start(), described.clearance);
    let Described { name, max_picture, .. } = described;
    let about = About { name, start, clearance, max_picture };
    let screen = Screen::open(options)?;
    let beside = Beside::new(options, runtime)?;
    let at = service.endpoint().map_err(WindowError::Service)?;
    let found = beside.find(at, service.options()).map_err(WindowError::Session)?;
    let (outline, seeking) = found.ok_or(WindowError::Service(AskError::Late))?;
    let scene = Arc::new(Scene::empty(outline));
    let asked = (service.clone(), runtime.clone());
    let ground = Ground::of(described.tile_side, move |x, z| asked.0.tile(x, z, &asked.1));
    let ground = ground.map_err(WindowError::Thread)?;
    let (roles, supplied) = (beside.clone(), Arc::clone(&scene));
    let play = move |wish: Wish, observer: PassesOn<_>, stop: &Stop| {
        roles.play_remote(supplied, seeking, wish, observer, stop)
    };
    screen.show(&scene, &about, ground, options, &beside, play, stop)
}

impl Beside {
    fn new(options: &WindowOptions, runtime: &Handle) -> Result<Self, WindowError> {
        // The first picture sets the real size, with the first view state.
        let small = Viewport::new(64, 64).map_err(WindowError::Size)?;
        let settings = Settings::new(small, options.lod);
        Ok(Self { settings, turns: Turns::at_once(), runtime: runtime.clone() })
    }
}

/// A screen, and the device that draws on it.
struct Screen {
    event_loop: EventLoop<News>,
    gpu: Arc<Gpu>,
}

impl Screen {
    fn open(options: &WindowOptions) -> Result<Self, WindowError> {
        let event_loop = EventLoop::with_user_event().build().map_err(WindowError::NoScreen)?;
        let display = event_loop.display_handle().map_err(|_| WindowError::Gpu(GpuError::NoWindows))?;
        let gpu = Gpu::open_for_windows(&options.gpu, display)?;
        Ok(Self { event_loop, gpu })
    }

    /// Shows the window until it is closed, while `play` plays the roles beside it.
    #[expect(
        clippy::too_many_arguments,
        reason = "each is a part of what is shown, and there is one caller a kind"
    )]
    fn show<P>(
        self,
        scene: &Arc<Scene>,
        about: &About,
        ground: Ground,
        options: &WindowOptions,
        beside: &Beside,
        play: P,
        stop: &Stop,
    ) -> Result<Option<WindowReport>, WindowError>
    where
        P: FnOnce(Wish, PassesOn<Box<dyn Fn() + Send>>, &Stop) -> Result<(), SessionError> + Send,
    {
        let Self { event_loop, gpu } = self;
        let (found, sets) = mpsc::channel();
        let near = (about.clearance / 2.0) as f32;
        let wish = Wish::new(first_camera(&about.start, near)?);
        let drive = options.drive.as_ref().map(Drive::new);
        // A recorded walk may have a lens that no person chooses here: that of a parallel view.
        let vfov_deg = drive.as_ref().map_or(about.start.vfov_deg, Drive::vfov_deg);
        let navigator = Navigator::new(&Start { vfov_deg, ..about.start });
        let state = ViewState::from(beside.settings);
        let mut app = App {
            name: about.name.clone(),
            scene: Arc::clone(scene),
            drawn: GpuScene::new(&gpu, scene)?,
            rule: CutRule::new(scene, &state),
            size: options.size,
            mode: options.present_mode,
            navigator,
            ground,
            sight: Sight::new(wish.clone(), sets, state, near, about.max_picture),
            clock: beside.turns.clock(),
            drive,
            state: State::default(),
        };
        let (closed, over) = Stop::new();
        let wake = event_loop.create_proxy();
        let observer = PassesOn { sets: found, wake: told(&wake, News::Set) };
        close_when_asked(stop, &wake, &beside.runtime);
        thread::scope(|scope| {
            let closed = StopsAtLast(closed);
            let play = || {
                let played = play(wish, observer, &over);
                // When the roles have ended, the window closes.
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
}

/// Stops the roles however the window ends.
struct StopsAtLast(Stopper);

impl Drop for StopsAtLast {
    fn drop(&mut self) {
        self.0.stop();
    }
}

/// Sends the window a message, from any thread.
fn told(wake: &EventLoopProxy<News>, news: News) -> Box<dyn Fn() + Send> {
    let wake = wake.clone();
    Box::new(move || {
        // A closed window needs no messages.
        let _closed = wake.send_event(news);
    })
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
