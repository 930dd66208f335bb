//! Who a peer is, whether it is taken, and how it leaves.

use std::fmt;

use serde::{Deserialize, Serialize};
use trimaran_wire::{CloseReason, Rejection};

use crate::{SceneOutline, Settings};

/// What a peer does in a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Draws the occluders (OR) of the frames that it is dealt, and culls them (HC).
    Culler,
    /// Renders the visible geometry (RVG), owns the camera and deals frames to cullers.
    Display,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Culler => "culler",
            Self::Display => "display",
        })
    }
}

/// What links and keys know the role by.
impl From<Role> for String {
    fn from(role: Role) -> Self {
        role.to_string()
    }
}

/// The session that a link is for: a random number of the display, which keeps it when it is started again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct SessionKey(pub u64);

/// What a peer is, and what it holds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// What it does.
    pub role: Role,
    /// The scene it holds. A display may hold none, and show what its cullers hold.
    pub scene: Option<SceneOutline>,
    /// The session, and what the display has decided for it. A display names its own, and a culler that
    /// meets another one theirs; a culler that serves whoever comes has none.
    pub session: Option<(SessionKey, Settings)>,
}

/// Why a listener does not take a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum RejectionCode {
    /// The scenes differ.
    Scene = 1,
    /// A display came to a display, or a culler without a session to a culler.
    Role = 3,
}

impl RejectionCode {
    /// Whether this is why.
    #[must_use]
    pub const fn is_of(self, rejection: &Rejection) -> bool {
        rejection.code == self as u16
    }
}

impl Identity {
    /// Whether `self`, listening, takes `connector`.
    ///
    /// # Errors
    /// The first of scene and role in which the two do not go together.
    pub fn admits(&self, connector: &Self) -> Result<(), Rejection> {
        if let (Some(ours), Some(theirs)) = (self.scene, connector.scene)
            && ours != theirs
        {
            let why = format!(
                "the listener holds scene {}, the connecting peer scene {}: give both the same cooked file",
                ours.hash, theirs.hash
            );
            return Err(Rejection::new(RejectionCode::Scene as u16, &why));
        }
        match (self.role, connector.role, connector.session) {
            (Role::Culler, Role::Culler, Some(_)) => Ok(()),
            (listener, connector, _) if listener == connector => {
                let why = format!("the listener is a {listener} as well: connect displays with cullers");
                Err(Rejection::new(RejectionCode::Role as u16, &why))
            }
            _ => Ok(()),
        }
    }
}

/// How a peer leaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum CloseCode {
    /// The session is over: all frames are done.
    Finished = 0,
    /// Someone stopped the peer (Ctrl-C).
    Interrupted = 1,
    /// The peer cannot go on.
    Failed = 2,
    /// The peer's graphics device failed or hangs. It ends, and may be started again.
    DeviceFailed = 4,
    /// The peer has another link for the same session.
    Replaced = 5,
}

impl CloseCode {
    /// What a peer says that leaves for this reason; `why` is for people, and may be empty.
    #[must_use]
    pub fn because(self, why: &str) -> CloseReason {
        let what = match self {
            Self::Finished => "the session is over",
            Self::Interrupted => "it was interrupted",
            Self::Failed => "it failed",
            Self::DeviceFailed => "its device failed",
            Self::Replaced => "it has a newer link for the same session",
        };
        let text = if why.is_empty() { what.to_owned() } else { format!("{what}: {why}") };
        CloseReason::new(self as u16, &text)
    }

    /// What a peer says that leaves for this reason.
    #[must_use]
    pub fn reason(self) -> CloseReason {
        self.because("")
    }

    /// Why a peer left that said so; none for what no peer of this version says.
    #[must_use]
    pub fn of(reason: &CloseReason) -> Option<Self> {
        [Self::Finished, Self::Interrupted, Self::Failed, Self::DeviceFailed, Self::Replaced]
            .into_iter()
            .find(|close| *close as u16 == reason.code)
    }
}
