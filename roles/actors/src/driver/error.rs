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
    supply::{SupplyError, SupplyFault},
};

/// An error of a device or an observer, whatever these are.
pub type BoxedError = Box<dyn Error + Send + Sync>;

/// Why a role ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RoleError {
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
        peer: String,
        /// How.
        #[source]
        cause: Disorder,
    },
    /// A peer sent an id that no frame of the scene can have.
    #[error("the {peer} sent ids that no frame can have")]
    Ids {
        /// The peer.
        peer: String,
        /// Which, and why.
        #[source]
        cause: IdError,
    },
    /// A peer sent geometry that the display cannot take.
    #[error("the {peer} sent geometry that cannot be taken")]
    Supplied {
        /// The peer.
        peer: String,
        /// Why.
        #[source]
        cause: Box<SupplyError>,
    },
    /// The display cannot be sent what it needs of the scene.
    #[error("the display cannot be supplied")]
    Supply(#[source] Box<SupplyFault>),
    /// The device failed: nothing more can be done with it.
    #[error("the device failed while {doing}")]
    Device {
        /// What the role was doing.
        doing: &'static str,
        /// Why.
        #[source]
        cause: BoxedError,
    },
    /// The device does not do what this session asks of it, or has no memory for it. Other sessions go on.
    #[error("the device cannot serve this session: {doing} failed")]
    Session {
        /// What the role was doing.
        doing: &'static str,
        /// Why.
        #[source]
        cause: BoxedError,
    },
    /// The session asks for more than one may.
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
    /// A peer named a drawable that the scene does not have, although both hold the same scene.
    #[error("the peer named a drawable that the scene does not have")]
    Unknown(#[from] OccluderError),
    /// A view state cannot be told or read.
    #[error("a view state was not understood")]
    View(#[from] ViewStateError),
    /// A camera names a view state that its source does not have.
    #[error("the source of cameras does not have the view state {version} that one of them names", version = .0.0)]
    UnknownView(ViewVersion),
    /// The observer cannot note any more what is shown.
    #[error("what is shown cannot be recorded any more")]
    Observer(#[source] BoxedError),
}

impl RoleError {
    /// What a failure of its device means to a role that was `doing` something with it, and that has the
    /// device for itself.
    pub fn device<D: Error + Send + Sync + 'static>(doing: &'static str) -> impl FnOnce(D) -> Self {
        move |cause| Self::Device { doing, cause: cause.into() }
    }

    /// What an error of a device means that sessions share: the end of all of them where the device is lost,
    /// and else of the one that was `doing` something with it.
    pub fn of_device<D: CullerDevice>(doing: &'static str) -> impl FnOnce(D::Error) -> Self {
        move |cause| match D::is_lost(&cause) {
            true => Self::Device { doing, cause: cause.into() },
            false => Self::Session { doing, cause: cause.into() },
        }
    }

    /// What a failure to cull on such a device means.
    pub fn of_culling<D: CullerDevice>(error: CullError<D::Error>) -> Self {
        match error {
            CullError::Test(cause) => Self::of_device::<D>("testing boxes against the occluders")(cause),
            error => Self::Cull(error.into()),
        }
    }

    /// What a panic means to the session in which it was caught.
    #[must_use]
    pub fn panic(payload: &(dyn Any + Send)) -> Self {
        let text = payload.downcast_ref::<String>().map(String::as_str);
        let text = text.or_else(|| payload.downcast_ref::<&str>().copied());
        Self::Panic(text.unwrap_or("no word of what it is").to_owned())
    }

    /// Whether a peer is gone that may come again: its connection broke, it was interrupted, or its device
    /// failed.
    #[must_use]
    pub fn lost_a_peer(&self) -> bool {
        let passing = [CloseCode::Interrupted, CloseCode::DeviceFailed];
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

    /// How this role's own device failed, if that is what happened: the one end of a session that is the end
    /// of its process as well. It may be started again, for which its peers wait as for one that was lost.
    #[must_use]
    pub fn device_failure(&self) -> Option<&(dyn Error + Send + Sync + 'static)> {
        match self {
            Self::Device { cause, .. } => Some(&**cause),
            _ => None,
        }
    }

    /// Whether a device gave up what the role was doing.
    pub(crate) const fn is_of_a_device(&self) -> bool {
        matches!(self, Self::Device { .. } | Self::Session { .. })
    }

    /// Whether this is an end on purpose: this role was asked to stop, or a peer says that the session is
    /// over.
    #[must_use]
    pub fn is_clean_end(&self) -> bool {
        let ends = [Some(CloseCode::Finished), Some(CloseCode::Replaced)];
        matches!(self, Self::Stopped) || ends.contains(&self.close())
    }
}

/// What failed on a link.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// Nothing more comes.
    #[error(transparent)]
    Receive(#[from] RecvError),
    /// Nothing more goes out.
    #[error(transparent)]
    Send(#[from] SendError),
}

impl From<SupplyFault> for RoleError {
    fn from(fault: SupplyFault) -> Self {
        Self::Supply(Box::new(fault))
    }
}

/// What a failure of a link means to a role that was `doing` something with it.
pub(super) fn link<E: Into<LinkError>>(doing: &'static str) -> impl FnOnce(E) -> RoleError {
    move |cause| RoleError::Link { doing, cause: cause.into() }
}
