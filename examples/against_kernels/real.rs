//! A session over real sockets.
#![allow(clippy::disallowed_methods, reason = "real packets keep real time")]

use std::error::Error;
use std::io;
use std::process::Command;
use std::sync::Arc;
use std::thread;

use rustix::process::setpriority_process;
use tokio::runtime::Builder;
use trimaran::netem::{Emulation, Namespace, Report};
use trimaran::simulate::{FrameTimes, Roles, Scenario};
use trimaran_actors::CullerId;
use trimaran_transport::{Net, TokioNet};

use crate::clock::Clock;

/// The results of a session over real sockets.
pub(crate) struct Played {
    pub(crate) times: Vec<FrameTimes>,
    /// The bytes sent by the machines, as Ethernet frames.
    pub(crate) bytes: u64,
    /// The network's report.
    pub(crate) report: Report,
}

/// Plays a scenario in namespaces, one for each culler and one for the display.
pub(crate) fn play(scenario: &Scenario) -> Ended<Played> {
    let name = |role: &str| format!("trimaran-{}-{role}", std::process::id());
    let ids = CullerId::first(scenario.cullers);
    let names: Vec<_> =
        ids.clone().map(|id| name(&format!("culler-{}", id.index()))).chain([name("display")]).collect();
    let mut emulation = Emulation::start(&scenario.network, &names, scenario.seed)?;
    for (_, place) in emulation.machines() {
        use_cubic(place)?;
    }
    emulation.take_names()?;
    let Some(((_, display), places)) = emulation.machines().split_last() else {
        return Err("a machine is missing".into());
    };
    let (roles, start) = (Roles::new(scenario)?, std::time::Instant::now());
    let sent = || -> u64 {
        let report = emulation.report();
        let leaving = report.links.iter().filter(|link| !link.name.starts_with("switch"));
        leaving.map(|link| link.tally.offered.bytes).sum()
    };
    let (roles, sent) = (&roles, &sent);
    let (before, after) = thread::scope(|scope| {
        let mut cullers = Vec::new();
        for (id, (_, place)) in ids.zip(places) {
            cullers.push(scope.spawn(move || {
                in_place(place, start, async |net, clock| Ok(roles.culler(id, net, clock).await?))
            }));
        }
        let show = scope.spawn(move || {
            in_place(display, start, async |net, clock| Ok(roles.display(net, clock, sent, || ()).await?))
        });
        for role in cullers {
            role.join().map_err(|_| "a culler panicked")??;
        }
        show.join().map_err(|_| "the display panicked")?
    })?;
    Ok(Played { times: roles.times(), bytes: after - before, report: emulation.finish()? })
}

/// The simulator's TCP uses CUBIC; the system's default may differ, and Linux lets a route override it.
fn use_cubic(place: &Namespace) -> io::Result<()> {
    let words = ["-n", place.name(), "route", "replace", "10.0.0.0/24", "dev", "net0", "congctl", "cubic"];
    let status = Command::new("ip").args(words).status()?;
    if status.success() { Ok(()) } else { Err(io::Error::other("the kernel has no CUBIC")) }
}

/// The result of a role's thread.
pub(crate) type Ended<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// Plays a role in a namespace, on this thread alone.
fn in_place<T>(
    place: &Namespace,
    start: std::time::Instant,
    play: impl AsyncFnOnce(&Arc<dyn Net>, &Arc<dyn Net>) -> Ended<T>,
) -> Ended<T> {
    place.enter()?;
    // Other programs run on the machine, and must not disturb the measurement.
    setpriority_process(None, -15).map_err(io::Error::from)?;
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let net = TokioNet::new(runtime.handle().clone());
    let clock: Arc<dyn Net> = Arc::new(Clock::new(start, net.clone()));
    let net: Arc<dyn Net> = Arc::new(net);
    runtime.block_on(play(&net, &clock))
}
