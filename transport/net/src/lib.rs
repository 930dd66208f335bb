//! Time, tasks and sockets behind one trait, [`Net`].
//!
//! Code that asks a [`Net`] for the time, a timer, a task or a socket runs on any network. [`TokioNet`] is
//! the real one. A simulator implements the same trait in virtual time and runs the same code.
//!
//! ```
//! use std::sync::Arc;
//! use std::time::Duration;
//! use trimaran_net::{Net, TokioNet, sleep_until, until};
//!
//! /// Says whether `work` was done within a second, on whatever network.
//! async fn within_a_second(net: &Arc<dyn Net>, work: impl Future<Output = ()>) -> bool {
//!     until(&**net, net.now().after(Duration::from_secs(1)), work).await.is_some()
//! }
//!
//! # #[tokio::main]
//! # async fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let net: Arc<dyn Net> = Arc::new(TokioNet::current()?);
//! let soon = net.now().after(Duration::from_millis(1));
//! assert!(within_a_second(&net, sleep_until(&*net, soon)).await);
//! # Ok(())
//! # }
//! ```
//!
//! | module | contents |
//! |---|---|
//! | `time` | [`Instant`], a point in the time of one network |
//! | `net` | [`Net`], timers, byte streams, and how to wait |
//! | `congestion` | [`CongestionSigns`], for connections with a congestion control of their own |
//! | `tcp`, `unix`, `udp` | options of sockets, facts about peers, and datagrams in batches |
//! | `tokio_net` | [`TokioNet`], behind the feature `tokio` |
//! | `quinn` | QUIC endpoints of quinn on any [`Net`], behind the feature `quinn` |

#![cfg_attr(docsrs, feature(doc_cfg))] // the documentation says which feature has an item

/// Setters that take and return the value: `with_FIELD`. For structs of options, which may get more fields.
#[doc(hidden)]
#[macro_export]
macro_rules! setters {
    ($($with:ident $field:ident: $value:ty),+ $(,)?) => {
        $(
            #[doc = concat!("The same with this `", stringify!($field), "`.")]
            #[must_use]
            pub fn $with(mut self, $field: $value) -> Self {
                self.$field = $field;
                self
            }
        )+
    };
}

#[cfg(feature = "config")]
pub mod config;
mod congestion;
mod net;
#[cfg(feature = "quinn")]
pub mod quinn;
mod tcp;
mod time;
#[cfg(feature = "tokio")]
mod tokio_net;
mod udp;
mod unix;

pub use congestion::CongestionSigns;
pub use net::{
    BoxFuture, BoxReader, BoxWriter, Listen, Net, Stream, StreamPeer, Timer, random_bytes, sleep_until, until,
};
pub use tcp::TcpOptions;
pub use time::Instant;
#[cfg(feature = "tokio")]
pub use tokio_net::TokioNet;
pub use udp::{BATCH_SIZE, EcnCodepoint, RecvMeta, Transmit, UdpPoller, UdpSocket, UdpSocketOptions};
pub use unix::{Credentials, UnixSocketOptions};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct ReadmeExamples;
