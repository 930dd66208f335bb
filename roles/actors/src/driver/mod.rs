//! The drivers: thin loops that move messages between links, state machines and devices.
//!
//! A role occupies one thread, since its device blocks. The links are async: each wait hands the thread to the runtime for just
//! that long, and gives up when the role is asked to stop.

mod cameras;
mod display;
mod gaps;
mod occluders;
mod outlet;
mod pair;
mod parting;
mod stop;
mod turn;

pub use cameras::Cameras;
pub use display::{DisplayRole, Observer, PairTraffic, ShownFrame};
pub use gaps::Gaps;
pub use occluders::OccluderPolicy;
pub use pair::PairRole;
pub use stop::{Stop, Stopper};
pub use turn::Turns;

use std::future::Future;

use thiserror::Error;
use trimaran_cull::{CullError, CutRule, CutRuleError, OccluderError, Viewport, ViewportError};
use trimaran_proto::{Goodbye, Settings};
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
    /// The session's picture has no pixels.
    #[error("the session's picture size cannot be used")]
    Viewport(#[from] ViewportError),
    /// The session's error bound is none.
    #[error("the session's error bound cannot be used")]
    Rule(#[from] CutRuleError),
}

impl<D: std::error::Error + 'static> RoleError<D> {
    /// Whether a peer is gone that may come again: its connection broke, or it has lost another peer itself. The session can go
    /// on with the frame that was due, once all three have joined again.
    #[must_use]
    pub const fn lost_a_peer(&self) -> bool {
        let Self::Link { cause, .. } = self else { return false };
        matches!(
            cause,
            LinkError::Receive(
                RecvError::Lost { .. }
                    | RecvError::Silent { .. }
                    | RecvError::Goodbye { reason: Goodbye::PeerLost(_), .. }
            ) | LinkError::Send(SendError::Lost { .. } | SendError::Stalled { .. })
        )
    }

    /// Whether the session was ended on purpose: this role was asked to stop, or a peer that was said goodbye.
    #[must_use]
    pub const fn is_clean_end(&self) -> bool {
        matches!(self, Self::Stopped)
            || matches!(self, Self::Link { cause: LinkError::Receive(cause), .. } if left_on_purpose(cause))
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

/// Whether the peer left because its session was over or it was asked to.
const fn left_on_purpose(cause: &RecvError) -> bool {
    matches!(cause, RecvError::Goodbye { reason: Goodbye::Finished | Goodbye::Interrupted, .. })
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

fn viewport_of(settings: &Settings) -> Result<Viewport, ViewportError> {
    Viewport::new(settings.size.width(), settings.size.height())
}

fn rule_of(settings: &Settings) -> Result<CutRule, CutRuleError> {
    Ok(CutRule::new(settings.epsilon.pixels())?.stopping_at_few_pixels(settings.few_pixels))
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
