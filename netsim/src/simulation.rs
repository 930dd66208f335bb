//! Running programs on a simulated network.

use std::collections::BTreeMap;
use std::io::Write;
use std::pin::pin;
use std::sync::Arc;
use std::task::Poll;
use std::time::Duration;

use thiserror::Error;
use trimaran_net::Instant;

use crate::capture::{Capture, CaptureError};
use crate::control::Control;
use crate::host::HostId;
use crate::link::LinkTally;
use crate::net::context::NOWHERE;
use crate::net::{Scope, SimNet};
use crate::tcp::Class;
use crate::topology::Topology;
use crate::wire::WireTally;
use crate::world::World;

/// A network in virtual time: while every task waits, time jumps to the next event.
///
/// Everything happens on the caller's thread, in an order that depends only on the topology, the seed and the
/// programs.
#[derive(Debug)]
pub struct Simulation {
    world: Arc<World>,
}

/// How long a simulation in step with a clock sleeps at most.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// No event is left, and the program still waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("every task waits and nothing is under way, {} ns after the start", at.as_nanos())]
pub struct Stalled {
    /// The time at which everything came to a stop.
    pub at: Instant,
}

/// The topology has no host of this name.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("no host of the topology is called {name:?}")]
pub struct UnknownHost {
    /// The name.
    pub name: String,
}

impl Simulation {
    /// The hosts and links of `topology` at time 0. The same seed gives the same losses and delays.
    #[must_use]
    pub fn new(topology: &Topology, seed: u64) -> Self {
        Self { world: Arc::new(World::new(topology, seed)) }
    }

    /// Captures every packet that a host sends from now on, as pcapng: an interface for each host,
    /// times since the start.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn capture(&self, out: Box<dyn Write + Send>) -> Result<(), CaptureError> {
        let mut core = self.world.core();
        let capture = Capture::begin(out, core.names.iter().map(String::as_str))?;
        core.capture = Some(capture);
        Ok(())
    }

    /// Ends the capture begun by [`Simulation::capture`].
    ///
    /// # Errors
    /// If a packet could not be written.
    pub fn end_capture(&self) -> Result<(), CaptureError> {
        let capture = self.world.core().capture.take();
        capture.map_or(Ok(()), Capture::end)
    }

    /// The network as that host sees it.
    #[must_use]
    pub fn net(&self, host: HostId) -> SimNet {
        SimNet { world: Arc::clone(&self.world), host, timer_grain: 1 }
    }

    /// The network as the host of this name sees it.
    ///
    /// # Errors
    /// If no host has the name.
    pub fn named(&self, name: &str) -> Result<SimNet, UnknownHost> {
        let host = self.world.core().find(name);
        host.map(|host| self.net(host)).ok_or_else(|| UnknownHost { name: name.to_owned() })
    }

    /// Crashes, partitions and changes of links while programs run.
    #[must_use]
    pub fn control(&self) -> Control {
        Control { world: Arc::clone(&self.world) }
    }

    /// Runs `program` and the tasks that it spawns until it is done. Remaining tasks go on with the next
    /// program.
    ///
    /// # Errors
    /// If it waits and no event is left.
    pub fn run<F: Future>(&self, program: F) -> Result<F::Output, Stalled> {
        let mut program = pin!(Scope { net: self.net(NOWHERE), program: pin!(program) });
        let waker = self.world.executor.main();
        waker.wake_by_ref();
        loop {
            if let Poll::Ready(output) = self.world.executor.run_until_stalled(&mut program, &waker) {
                return Ok(output);
            }
            if !self.world.go_on() {
                return Err(Stalled { at: self.world.now() });
            }
        }
    }

    /// Runs `program` and the tasks that it spawns until it is done, in step with a clock: each event happens
    /// when its time has come. Tasks may wait for other threads; this one sleeps meanwhile.
    ///
    /// `clock` tells the time since the simulation began, and never goes back.
    pub fn run_in_step<F: Future>(&self, clock: impl Fn() -> Instant, program: F) -> F::Output {
        let mut program = pin!(Scope { net: self.net(NOWHERE), program: pin!(program) });
        let waker = self.world.executor.main();
        waker.wake_by_ref();
        let Self { world } = self;
        loop {
            let now = clock();
            if !world.go_on_until(now) {
                let next = world.idle_until(now);
                if !world.executor.is_ready() {
                    let pause = next.map_or(LONGEST_PAUSE, |next| next.since(now));
                    world.executor.wait(pause.min(LONGEST_PAUSE));
                    continue;
                }
            }
            if let Poll::Ready(output) = world.executor.run_until_stalled(&mut program, &waker) {
                return output;
            }
        }
    }

    /// The time.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.world.now()
    }

    /// A hash of the trace so far: time, addresses and size of every packet sent and every packet arrived.
    #[must_use]
    pub fn trace_hash(&self) -> u64 {
        self.world.core().trace_hash()
    }

    /// The tally of each direction of each link, in the order in which the links were joined.
    #[must_use]
    pub fn links(&self) -> Vec<LinkTally> {
        self.world.core().fabric.tallies()
    }

    /// The packets that one host sent to another, by purpose.
    #[must_use]
    pub fn sent_by_class(&self, from: HostId, to: HostId) -> BTreeMap<Class, WireTally> {
        self.world.core().sent(from, to)
    }
}

impl Drop for Simulation {
    fn drop(&mut self) {
        // The world and the tasks hold each other.
        self.world.executor.clear();
    }
}
