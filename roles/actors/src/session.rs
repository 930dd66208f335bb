//! Three roles in one process.

use std::{sync::Arc, thread};

use crate::Link;
use thiserror::Error;
use tokio::runtime::Handle;
use trimaran_proto::{Identity, Role, Settings, Walkthrough};
use trimaran_scene::Scene;
use trimaran_transport::{HandshakeError, LinkConfig, Net, inproc};

use crate::{
    Cameras, DisplayRole, Observer, OccluderPolicy, PairDevice, PairRole, PairTraffic, PictureDevice,
    RoleError, Seat, Stop, Stopwatch, Turns, max_frame,
};

/// The devices of the three roles.
#[derive(Debug)]
pub struct Devices<P, D> {
    /// Of the pair's first machine.
    pub first: P,
    /// Of the pair's second machine.
    pub second: P,
    /// Of the display.
    pub display: D,
}

/// Why a session in one process failed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SessionError<P: std::error::Error + 'static, D: std::error::Error + 'static> {
    /// The roles do not go together.
    #[error("the roles cannot be joined")]
    Refused(#[from] HandshakeError),
    /// The system gave no thread.
    #[error("cannot start a thread for a role")]
    Thread(#[source] std::io::Error),
    /// A machine of the pair failed.
    #[error("the {seat:?} machine of the pair failed")]
    Pair {
        /// Which.
        seat: Seat,
        /// Why.
        #[source]
        cause: RoleError<P>,
    },
    /// The display failed.
    #[error("the display failed")]
    Display(#[source] RoleError<D>),
}

/// Runs a whole session in this process: the pair on two threads of its own, the display on this one. Returns
/// what the display's links carried. All three measure by one clock.
///
/// # Errors
/// The first role to fail; the others are told and end as well.
#[expect(clippy::too_many_arguments, reason = "a session has this many parts, each of its own type")]
pub fn in_process<P, D>(
    scene: &Arc<Scene>,
    settings: Settings,
    devices: Devices<P, D>,
    cameras: &mut dyn Cameras,
    observer: &mut dyn Observer,
    net: &Arc<dyn Net>,
    runtime: &Handle,
    stop: &Stop,
    turns: &Turns,
) -> Result<PairTraffic, SessionError<P::Error, D::Error>>
where
    P: PairDevice + Send,
    D: PictureDevice,
{
    let join = |ours: Role, theirs: Role| -> Result<(Link, Link), HandshakeError> {
        let identity = |role| Identity {
            role,
            scene: scene.hash(),
            settings: (role == Role::Display).then_some(settings),
        };
        let config = LinkConfig { max_frame: max_frame(scene), ..LinkConfig::default() };
        inproc::pair::<Walkthrough>(net, identity(ours), identity(theirs), &config)
    };
    let (display_first, first_display) = join(Role::Display, Role::SwitchA)?;
    let (display_second, second_display) = join(Role::Display, Role::SwitchB)?;
    let (first_second, second_first) = join(Role::SwitchA, Role::SwitchB)?;
    let clock = Stopwatch::start();
    let machine = |seat, device, display, other| PairRole {
        seat,
        scene: Arc::clone(scene),
        device,
        display,
        other,
        settings,
        occluders: OccluderPolicy::default(),
        clock,
        turns: turns.clone(),
    };
    let first = machine(Seat::First, devices.first, first_display, first_second);
    let second = machine(Seat::Second, devices.second, second_display, second_first);
    let display = DisplayRole {
        scene: Arc::clone(scene),
        device: devices.display,
        first: display_first,
        second: display_second,
        settings,
        net: Arc::clone(net),
        clock,
        turns: turns.clone(),
    };

    thread::scope(|scope| {
        let start = |name: &str, role: PairRole<P>| {
            let seat = role.seat;
            let run = move || role.run(runtime, stop).map_err(|cause| SessionError::Pair { seat, cause });
            thread::Builder::new()
                .name(name.to_owned())
                .spawn_scoped(scope, run)
                .map_err(SessionError::Thread)
        };
        let first = start("first", first)?;
        let second = start("second", second)?;
        let display = display.run(cameras, observer, runtime, stop).map_err(SessionError::Display);
        let pair = [first, second].map(|role| match role.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        });
        root_cause(pair, display)
    })
}

/// When one role fails, the others fail for it: tells the one that did not just hear of another's failure.
fn root_cause<T, P: std::error::Error, D: std::error::Error>(
    pair: [Result<(), SessionError<P, D>>; 2],
    display: Result<T, SessionError<P, D>>,
) -> Result<T, SessionError<P, D>> {
    let mut hearsay = None;
    for failure in pair.into_iter().filter_map(Result::err) {
        match &failure {
            SessionError::Pair { cause: RoleError::Link { .. }, .. } => hearsay = hearsay.or(Some(failure)),
            _ => return Err(failure),
        }
    }
    match (display, hearsay) {
        (Ok(value), None) => Ok(value),
        (Ok(_), Some(failure)) => Err(failure),
        (Err(failure), _) => Err(failure),
    }
}
