//! Why a role ends early.

use std::{any::Any, error::Error, io};

use trimaran_cull::{CullError, OccluderError};
use trimaran_proto::{CloseCode, ViewStateError, ViewVersion};
use trimaran_transport::{RecvError, SendError};

use crate::{
    LimitError,
    deal::Disorder,
    device::CullerDevice,
    ids::IdError,
    join::JoinError,
    leads::LeadError,
    supply::{SupplyError, SupplyFault},
};

/// An error of a device or an observer.
pub type BoxedError = Box<dyn Error + Send + Sync>;

/// Why a role ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RoleError {
    /// It was asked to stop.
    #[error("stopped")]
    Stopped,
    /// This role's own settings rule out a link to its peer.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// A link failed: the peer died, fell silent or violated the protocol.
    #[error("{doing} failed")]
    Link {
        /// The role's action.
        doing: &'static str,
        /// The cause.
        #[source]
        cause: LinkError,
    },
    /// A peer broke the order of a frame's messages.
    #[error("the {peer} broke the order of messages")]
    Order {
        /// The peer.
        peer: String,
        /// The violation.
        #[source]
        cause: Disorder,
    },
    /// A peer sent an id that is invalid in a frame of the scene.
    #[error("the {peer} sent ids that no frame can have")]
    Ids {
        /// The peer.
        peer: String,
        /// The id and the cause.
        #[source]
        cause: IdError,
    },
    /// A peer sent geometry that the display cannot use.
    #[error("the {peer} sent geometry that cannot be taken")]
    Supplied {
        /// The peer.
        peer: String,
        /// The cause.
        #[source]
        cause: Box<SupplyError>,
    },
    /// The display's geometry cannot be sent.
    #[error("the display cannot be supplied")]
    Supply(#[source] Box<SupplyFault>),
    /// The display's frames cannot be passed on.
    #[error("the display cannot be followed")]
    Lead(#[source] Box<LeadError>),
    /// The device failed, and is unusable.
    #[error("the device failed while {doing}")]
    Device {
        /// The role's action.
        doing: &'static str,
        /// The cause.
        #[source]
        cause: BoxedError,
    },
    /// The device lacks a feature or memory for this session. Other sessions go on.
    #[error("the device cannot serve this session: {doing} failed")]
    Session {
        /// The role's action.
        doing: &'static str,
        /// The cause.
        #[source]
        cause: BoxedError,
    },
    /// The session exceeds its limits.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The system gives the session no thread.
    #[error("the machine has no thread for this session: try later")]
    Thread(#[source] io::Error),
    /// The role's own program failed: a bug.
    #[error("a fault in the program: {0}")]
    Panic(String),
    /// Culling failed.
    #[error("culling failed")]
    Cull(#[source] BoxedError),
    /// A peer named a drawable that the scene lacks, although both hold the same scene.
    #[error("the peer named a drawable that the scene does not have")]
    Unknown(#[source] OccluderError),
    /// A view state cannot be sent or read.
    #[error("a view state was not understood")]
    View(#[from] ViewStateError),
    /// A camera names an unknown view state.
    #[error("the source of cameras does not have the view state {version} that one of them names", version = .0.0)]
    UnknownView(ViewVersion),
    /// The observer failed to record a frame.
    #[error("what is shown cannot be recorded any more")]
    Observer(#[source] BoxedError),
}

impl From<OccluderError> for RoleError {
    fn from(error: OccluderError) -> Self {
        match error {
            OccluderError::Unknown { .. } => Self::Unknown(error),
            error => Self::Cull(error.into()),
        }
    }
}

impl RoleError {
    /// Converts an error of a role's own device during `doing`.
    pub fn device<D: Error + Send + Sync + 'static>(doing: &'static str) -> impl FnOnce(D) -> Self {
        move |cause| Self::Device { doing, cause: cause.into() }
    }

    /// Converts an error of a shared device: it ends all sessions if the device is lost, else only the one
    /// during whose `doing` it occurred.
    pub fn of_device<D: CullerDevice>(doing: &'static str) -> impl FnOnce(D::Error) -> Self {
        move |cause| match D::is_lost(&cause) {
            true => Self::Device { doing, cause: cause.into() },
            false => Self::Session { doing, cause: cause.into() },
        }
    }

    /// Converts an error of culling on such a device.
    pub fn of_culling<D: CullerDevice>(error: CullError<D::Error>) -> Self {
        match error {
            CullError::Test(cause) => Self::of_device::<D>("testing boxes against the occluders")(cause),
            error => Self::Cull(error.into()),
        }
    }

    /// Converts a caught panic of a session.
    #[must_use]
    pub fn panic(payload: &(dyn Any + Send)) -> Self {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
        Self::Panic(text.unwrap_or("no word of what it is").to_owned())
    }

    /// Whether a lost peer may come again: its connection broke, it was interrupted, or its device failed.
    #[must_use]
    pub fn lost_a_peer(&self) -> bool {
        let passing = [CloseCode::Interrupted, CloseCode::DeviceFailed];
        match self {
            Self::Link { cause: LinkError::Receive(RecvError::Lost { .. }), .. }
            | Self::Link {
                cause: LinkError::Send(SendError::Lost { .. } | SendError::Stalled { .. }), ..
            } => true,
            _ => self.close().is_some_and(|close| passing.contains(&close)),
        }
    }

    /// The close code of a peer, if its close ended this role.
    fn close(&self) -> Option<CloseCode> {
        match self {
            Self::Link { cause: LinkError::Receive(RecvError::Closed { reason, .. }), .. } => {
                CloseCode::of(reason)
            }
            _ => None,
        }
    }

    /// The error of this role's own device, if that ended it: the only end of a session that ends its process
    /// as well. It may be restarted, for which its peers wait as for a lost one.
    #[must_use]
    pub fn device_failure(&self) -> Option<&(dyn Error + Send + Sync + 'static)> {
        match self {
            Self::Device { cause, .. } => Some(&**cause),
            _ => None,
        }
    }

    /// The kind, in a word, for counters: there are no more than variants.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Join(_) => "join",
            Self::Link { .. } => "link",
            Self::Order { .. } => "order",
            Self::Ids { .. } => "ids",
            Self::Supplied { .. } | Self::Supply(_) => "geometry",
            Self::Lead(_) => "leader",
            Self::Device { .. } => "device",
            Self::Session { .. } => "session_device",
            Self::Limit(_) => "limit",
            Self::Thread(_) => "thread",
            Self::Panic(_) => "panic",
            Self::Cull(_) => "culling",
            Self::Unknown(_) => "unknown_drawable",
            Self::View(_) | Self::UnknownView(_) => "view",
            Self::Observer(_) => "recording",
        }
    }

    /// Whether a device gave up the role's work.
    pub(crate) const fn is_of_a_device(&self) -> bool {
        matches!(self, Self::Device { .. } | Self::Session { .. })
    }

    /// Whether this is an intended end: this role was asked to stop, or a peer ended the session.
    #[must_use]
    pub fn is_clean_end(&self) -> bool {
        let ends = [Some(CloseCode::Finished), Some(CloseCode::Replaced)];
        matches!(self, Self::Stopped) || ends.contains(&self.close())
    }
}

/// A failure of a link.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// Receiving failed.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// Sending failed.
    #[error(transparent)]
    Send(#[from] SendError),
}

impl From<LeadError> for RoleError {
    fn from(cause: LeadError) -> Self {
        Self::Lead(Box::new(cause))
    }
}

impl From<SupplyFault> for RoleError {
    fn from(fault: SupplyFault) -> Self {
        Self::Supply(Box::new(fault))
    }
}

/// Converts a failure of a link during `doing`.
pub(super) fn link<E: Into<LinkError>>(doing: &'static str) -> impl FnOnce(E) -> RoleError {
    move |cause| RoleError::Link { doing, cause: cause.into() }
}
