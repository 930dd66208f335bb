//! Why a role ends early.

use thiserror::Error;
use trimaran_cull::{CullError, LodRuleError, OccluderError};
use trimaran_proto::CloseCode;
use trimaran_transport::{RecvError, SendError};

use crate::{ids::IdError, machine::OrderError};

/// Why an observer can note no more, such as a full disk.
pub type ObserverError = Box<dyn std::error::Error + Send + Sync>;

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
    /// The session's error bound cannot be used.
    #[error("the session's error bound cannot be used")]
    Rule(#[from] LodRuleError),
}

impl<D: std::error::Error + 'static> RoleError<D> {
    /// That of a role whose device cannot be made ready for the session.
    pub const fn unopened(cause: D) -> Self {
        Self::Device { doing: "being made ready", cause }
    }

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

/// What a failure of a link means to a role that was `doing` something with it.
pub(super) fn link<D: std::error::Error + 'static, E: Into<LinkError>>(
    doing: &'static str,
) -> impl Fn(E) -> RoleError<D> {
    move |cause| RoleError::Link { doing, cause: cause.into() }
}
