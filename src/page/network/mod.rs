//! Simulated networks between pages and their culler, so that a person experiences their effects. Without the
//! feature `lab` there are none.

#[cfg(not(feature = "lab"))]
mod none;
#[cfg(feature = "lab")]
mod simulated;

use std::io;

use serde::Serialize;
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};

#[cfg(not(feature = "lab"))]
pub(super) use none::{Network, Networks, names};
#[cfg(feature = "lab")]
pub(super) use simulated::{Network, Networks, names};

/// The most networks at a time: each has a thread of its own.
#[cfg(feature = "lab")]
const MOST: usize = 16;

/// A network that can be simulated.
#[derive(Debug, Clone, Serialize)]
pub struct SimulatedNetwork {
    /// Its name.
    pub name: String,
    /// A description.
    pub about: String,
}

/// The bytes of a real connection.
pub(in crate::page) trait Connection: AsyncRead + AsyncWrite + Send + Unpin {}

impl<C: AsyncRead + AsyncWrite + Send + Unpin> Connection for C {}

/// A network that a page asks for. All connections of the same page share one.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(in crate::page) struct Wanted {
    /// The name of a built-in profile.
    pub(in crate::page) network: String,
    /// The page's name for itself.
    pub(in crate::page) page: String,
}

impl Wanted {
    /// Parses the query of a link's address: `network=wifi&page=...`.
    pub(in crate::page) fn of(query: &str) -> Option<Self> {
        let value = |name: &str| {
            let mut pairs = form_urlencoded::parse(query.as_bytes());
            pairs.find(|(known, _)| known == name).map(|(_, value)| value.into_owned())
        };
        Some(Self { network: value("network")?, page: value("page").unwrap_or_default() })
    }
}

/// Why a page cannot have its network.
#[derive(Debug, Error)]
pub(in crate::page) enum NetworkError {
    /// There is no profile of that name.
    #[error("there is no such network")]
    Unknown,
    #[cfg(feature = "lab")]
    /// The limit of networks is reached.
    #[error("too many pages are on simulated networks: at most {MOST} may be")]
    TooMany,
    /// It has no thread.
    #[error("the system has no thread for it")]
    Thread(#[from] io::Error),
}
