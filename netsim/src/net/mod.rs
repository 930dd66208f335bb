//! The [`Net`] that a simulated host offers to programs.

pub(crate) mod context;
pub(crate) mod tcp;
mod timer;
mod udp;

use std::fmt;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use trimaran_net::{BoxFuture, Instant, Listen, Net, Stream, TcpOptions, Timer, UdpSocket, UdpSocketOptions};

use crate::host::HostId;
use crate::world::World;
pub use context::Scope;
use timer::SimTimer;

/// The network as one host of a simulation sees it.
#[derive(Clone)]
pub struct SimNet {
    pub(crate) world: Arc<World>,
    pub(crate) host: HostId,
    /// Nanoseconds.
    pub(crate) timer_grain: u64,
}

impl fmt::Debug for SimNet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SimNet").field("host", &self.host).finish_non_exhaustive()
    }
}

impl SimNet {
    /// This host with the timers of a runtime that counts time in ticks of `grain`, as tokio counts
    /// milliseconds. Timers ring at a tick, not before their time, and only while the runtime is awake. It
    /// sleeps for whole ticks from the moment it fell asleep, so it may wake late after a tick, unless a
    /// packet wakes it. Without a grain timers ring to the nanosecond.
    #[must_use]
    pub fn with_timer_grain(self, grain: Duration) -> Self {
        let nanos = u64::try_from(grain.as_nanos()).unwrap_or(u64::MAX);
        Self { timer_grain: nanos.max(1), ..self }
    }

    /// A program on this host, for those that use the functions of [`tokio`](crate::tokio). Tasks of
    /// [`Net::spawn`] are on their host anyway. Dropping the result drops the program; a crash of the host
    /// does not end it.
    pub fn scope<F: Future>(&self, program: F) -> Scope<Pin<Box<F>>> {
        Scope { net: self.clone(), program: Box::pin(program) }
    }

    /// The host.
    #[must_use]
    pub const fn host(&self) -> HostId {
        self.host
    }

    /// Checks that a socket can be bound to `at`: an address of this host.
    fn own(&self, at: IpAddr) -> io::Result<()> {
        if self.host.of(at) == Some(self.host) { Ok(()) } else { Err(io::ErrorKind::AddrNotAvailable.into()) }
    }

    pub(crate) fn lookup(&self, address: &str) -> io::Result<Vec<SocketAddr>> {
        if let Ok(address) = address.parse() {
            return Ok(vec![address]);
        }
        let unknown =
            || io::Error::new(io::ErrorKind::NotFound, format!("the simulation has no host of {address}"));
        let (name, port) = address.rsplit_once(':').ok_or_else(unknown)?;
        let port = port.parse().map_err(|_| unknown())?;
        let core = self.world.core();
        let host = match name {
            "localhost" => self.host,
            name => core.find(name).ok_or_else(unknown)?,
        };
        Ok(vec![SocketAddr::new(host.v4(), port), SocketAddr::new(host.v6(), port)])
    }
}

impl Net for SimNet {
    fn now(&self) -> Instant {
        self.world.now()
    }

    fn timer(&self) -> Box<dyn Timer> {
        Box::new(SimTimer::new(self))
    }

    fn spawn(&self, task: BoxFuture<'static, ()>) {
        if self.world.core().check_up(self.host).is_ok() {
            self.world.executor.spawn(self.host, Box::pin(Scope { net: self.clone(), program: task }));
        }
    }

    fn random(&self) -> io::Result<u64> {
        Ok(self.world.core().random.bits())
    }

    /// Resolves host names of the topology.
    fn resolve<'a>(&'a self, address: &'a str) -> BoxFuture<'a, io::Result<Vec<SocketAddr>>> {
        Box::pin(std::future::ready(self.lookup(address)))
    }

    fn connect_tcp(&self, to: SocketAddr, options: TcpOptions) -> BoxFuture<'_, io::Result<Stream>> {
        Box::pin(async move { Ok(tcp::connect(self, to, options).await?.into_stream()) })
    }

    fn listen_tcp(&self, at: SocketAddr, options: TcpOptions) -> io::Result<(Box<dyn Listen>, SocketAddr)> {
        let listener = tcp::listen(self, at, options)?;
        let local = listener.local;
        Ok((Box::new(listener), local))
    }

    fn bind_udp(&self, at: SocketAddr, options: UdpSocketOptions) -> io::Result<Arc<dyn UdpSocket>> {
        self.own(at.ip())?;
        udp::bind(self, at, options)
    }
}

/// The first port that the system hands out itself (RFC 6335, section 6).
const FIRST_FREE_PORT: u16 = 49_152;

/// The port `wanted`, or the first free one for 0.
fn free_port(wanted: u16, taken: impl Fn(u16) -> bool) -> io::Result<u16> {
    let mut ports = if wanted == 0 { FIRST_FREE_PORT..=u16::MAX } else { wanted..=wanted };
    ports.find(|port| !taken(*port)).ok_or_else(|| io::ErrorKind::AddrInUse.into())
}
