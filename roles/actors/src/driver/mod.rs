//! The drivers: thin loops that move messages between links, state machines and devices.
//!
//! A role occupies one thread, since its device blocks. The links are async: each wait hands the thread to
//! the runtime for just that long, and gives up when the role is asked to stop.

mod cameras;
mod display;
mod gaps;
mod ids;
mod occluders;
mod outlet;
mod pair;
mod parting;
mod stop;
mod turn;

pub use cameras::Cameras;
pub use display::{DisplayRole, Observer, ObserverError, PairTraffic, ShownFrame};
pub use gaps::Gaps;
pub use ids::{IdError, max_frame};
pub use occluders::OccluderPolicy;
pub use pair::PairRole;
pub use parting::leave_unable;
pub use stop::{Stop, Stopper};
pub use turn::Turns;

use std::future::Future;

use thiserror::Error;
use trimaran_cull::{CullError, LodRule, LodRuleError, OccluderError};
use trimaran_proto::{CloseCode, Settings};
use trimaran_transport::{RecvError, SendError};

use crate::OrderError;
use stop::Waiting;

/// Why a role ended early. `D` is its device's error.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RoleError<D: std::error::Error + 'static> {
    /// It was asked to stop.
    #[error("stopped")]
    Stopped,
    /// A link failed: the peer died, fell silent or spoke nonsense.
    #[error("{doing} failed")]
    Link {
        /// What the role was doing.
        doing: &'static str,
        /// Why.
        #[source]
        cause: LinkError,
    },
    /// A peer broke the order of a frame's messages.
    #[error("the {peer} broke the order of messages")]
    Order {
        /// The peer.
        peer: &'static str,
        /// How.
        #[source]
        cause: OrderError,
    },
    /// A peer sent an id that no frame of the scene can have.
    #[error("the {peer} sent ids that no frame can have")]
    Ids {
        /// The peer.
        peer: &'static str,
        /// Which, and why.
        #[source]
        cause: IdError,
    },
    /// The device failed.
    #[error("the device failed while {doing}")]
    Device {
        /// What the role was doing.
        doing: &'static str,
        /// Why.
        #[source]
        cause: D,
    },
    /// Culling failed.
    #[error("culling failed")]
    Cull(#[from] CullError<D>),
    /// A peer named a drawable that the scene does not have, although both hold the same scene.
    #[error("the peer named a drawable that the scene does not have")]
    Unknown(#[from] OccluderError),
    /// The observer cannot note any more what is shown.
    #[error("what is shown cannot be recorded any more")]
    Observer(#[source] ObserverError),
    /// The session's error bound is none.
    #[error("the session's error bound cannot be used")]
    Rule(#[from] LodRuleError),
}

impl<D: std::error::Error + 'static> RoleError<D> {
    /// Whether a peer is gone that may come again: its connection broke, it was interrupted, its device
    /// failed, or it has lost another peer itself. The session can go on with the frame that was due,
    /// once all three have joined again.
    #[must_use]
    pub fn lost_a_peer(&self) -> bool {
        let passing = [CloseCode::PeerLost, CloseCode::Interrupted, CloseCode::DeviceFailed];
        match self {
            Self::Link {
                cause: LinkError::Receive(RecvError::Lost { .. } | RecvError::Silent { .. }),
                ..
            }
            | Self::Link {
                cause: LinkError::Send(SendError::Lost { .. } | SendError::Stalled { .. }), ..
            } => true,
            _ => self.close().is_some_and(|close| passing.contains(&close)),
        }
    }

    /// Why a peer left that said so, if that is what ended this role.
    fn close(&self) -> Option<CloseCode> {
        match self {
            Self::Link { cause: LinkError::Receive(RecvError::Closed { reason, .. }), .. } => {
                CloseCode::of(reason)
            }
            _ => None,
        }
    }

    /// How this role's own device failed, if that is what happened. The role cannot go on, but its process
    /// may be started again, for which its peers wait as for one that was lost.
    #[must_use]
    pub const fn device_failure(&self) -> Option<&D> {
        match self {
            Self::Device { cause, .. } | Self::Cull(CullError::Test(cause)) => Some(cause),
            _ => None,
        }
    }

    /// Whether this is an end on purpose: this role was asked to stop, or a peer says that the session is
    /// over.
    #[must_use]
    pub fn is_clean_end(&self) -> bool {
        matches!(self, Self::Stopped) || self.close() == Some(CloseCode::Finished)
    }
}

/// What failed on a link.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LinkError {
    /// Nothing more comes.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// Nothing more goes out.
    #[error(transparent)]
    Send(#[from] SendError),
}

/// A device that gave up a wait because the role was asked to stop has not failed.
fn stopped_or<T, D: std::error::Error + 'static>(
    result: Result<T, RoleError<D>>,
    stop: &Stop,
) -> Result<T, RoleError<D>> {
    match result {
        Err(error) if error.device_failure().is_some() && stop.requested() => {
            tracing::debug!(error = &error as &dyn std::error::Error, "the device's work was left");
            Err(RoleError::Stopped)
        }
        result => result,
    }
}

/// Waits for a link, and says what failed while doing what.
fn wait<T, E: Into<LinkError>, D: std::error::Error + 'static>(
    waiting: Waiting<'_>,
    doing: &'static str,
    link: impl Future<Output = Result<T, E>>,
) -> Result<T, RoleError<D>> {
    match waiting.on(link) {
        Some(result) => result.map_err(|cause| RoleError::Link { doing, cause: cause.into() }),
        None => Err(RoleError::Stopped),
    }
}

fn rule_of(settings: &Settings) -> Result<LodRule, LodRuleError> {
    Ok(LodRule::new(settings.epsilon.pixels())?.stopping_at_few_pixels(settings.few_pixels))
}

fn nanoseconds(time: std::time::Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{BatchSize, EpsilonPx, FrameNumber, IdCoding, PictureSize, TesterKind};

    use super::*;

    #[test]
    fn the_display_decides_bound_and_rule() {
        for few_pixels in [false, true] {
            let settings = Settings {
                size: PictureSize::new(8, 8).unwrap(),
                epsilon: EpsilonPx::new(3.0).unwrap(),
                batch: BatchSize::default(),
                coding: IdCoding::Plain,
                tester: TesterKind::Raster,
                lockstep: true,
                few_pixels,
                first: FrameNumber(0),
                frames: None,
            };
            let rule = rule_of(&settings).unwrap();
            assert_eq!((rule.epsilon_px(), rule.stops_at_few_pixels()), (3.0, few_pixels));
        }
    }
}
