//! The names of tokio over a simulated host: programs on tokio run here with other `use` lines.
//!
//! ```
//! use std::time::Duration;
//! use tokio::io::{AsyncReadExt, AsyncWriteExt};
//! use trimaran_netsim::tokio::net::{TcpListener, TcpStream}; // was: use tokio::net::...
//! use trimaran_netsim::tokio::{task, time};
//! use trimaran_netsim::{Simulation, Topology, link::LinkModel, link::Rate};
//!
//! async fn serve() -> std::io::Result<()> {
//!     let listener = TcpListener::bind("0.0.0.0:80").await?;
//!     loop {
//!         let (mut stream, _) = listener.accept().await?;
//!         time::sleep(Duration::from_secs(3600)).await;
//!         stream.write_all(b"an hour later").await?;
//!     }
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let line = LinkModel::clean(Rate::new(1_000_000), Duration::from_millis(20));
//! let simulation = Simulation::new(&Topology::pair(["client", "server"], &line, &line), 1);
//! let (client, server) = (simulation.named("client")?, simulation.named("server")?);
//! task::spawn_on(&server, serve());
//! let heard = simulation.run(client.scope(async {
//!     let mut heard = [0; 13];
//!     TcpStream::connect("server:80").await?.read_exact(&mut heard).await?;
//!     Ok::<_, std::io::Error>(heard)
//! }))??;
//! assert_eq!(&heard, b"an hour later");
//! # Ok(())
//! # }
//! ```
//!
//! | of tokio | here |
//! |---|---|
//! | `net` | [`net::TcpListener`], [`net::TcpStream`] with both kinds of halves, [`net::UdpSocket`] |
//! | `time` | [`time::sleep`], [`time::timeout`], [`time::interval`], [`time::Instant`] |
//! | `task` | [`spawn`], [`task::JoinHandle`], [`task::yield_now`], and [`task::spawn_on`] to begin with |
//! | `io`, `sync`, `select!`, `join!` | tokio's own: they need no runtime |
//!
//! A program is on the host whose [`scope`](crate::SimNet::scope) it runs in, or on which it was spawned. The
//! tasks that it spawns are there as well. The program of [`Simulation::run`](crate::Simulation::run) itself
//! is on none: it has time, but functions that make sockets fail there, and spawned tasks end at once.
//!
//! Not covered: `TcpSocket`, `readable` and the `try_` functions, Unix sockets, `fs`, `process`, `signal`,
//! `JoinSet`, `LocalSet`, `spawn_blocking`, missed ticks of an interval other than in a burst. A panic of a
//! task ends the simulation. Nothing takes computing time.

pub mod net;
pub mod task;
pub mod time;

pub use task::spawn;
