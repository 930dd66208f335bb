//! Identities of peers, and reasons to refuse them or to close a link.

use std::fmt;

use serde::{Deserialize, Serialize};
use trimaran_wire::{CloseReason, Rejection};

use crate::{SceneOutline, Settings};

/// A peer's role in a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Draws the occluders (OR) of its frames, and culls them (HC).
    Culler,
    /// Renders the visible geometry (RVG), owns the camera and assigns frames to cullers.
    Display,
    /// Stands between a culler and many displays: one display leads, and the others watch what it sees.
    Relay,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Culler => "culler",
            Self::Display => "display",
            Self::Relay => "relay",
        })
    }
}

/// The role's name in links and keys.
impl From<Role> for String {
    fn from(role: Role) -> Self {
        role.to_string()
    }
}

/// The session of a link: a random number that the display keeps when it restarts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct SessionKey(pub u64);

/// The number by which displays follow another one. That one chooses it, and tells it to whomever it likes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(transparent)]
pub struct LeaderKey(pub u64);

/// A peer's role, scene and session.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// The peer's role.
    pub role: Role,
    /// The peer's scene. A display without one shows its cullers' scene.
    pub scene: Option<SceneOutline>,
    /// The session, and the display's settings for it. A display names its own, and a culler that connects to
    /// another culler names theirs. A culler that serves any display names none, and a relay names none. A
    /// display that names none watches: it sends no cameras, and shows the frames of another display.
    pub session: Option<(SessionKey, Settings)>,
}

/// Why a listener refuses a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum RejectionCode {
    /// The scenes differ.
    Scene = 1,
    /// A display connected to a display, a culler without a session to a culler, or a culler to a relay.
    Role = 3,
}

impl RejectionCode {
    /// Whether `rejection` has this code.
    #[must_use]
    pub const fn is_of(self, rejection: &Rejection) -> bool {
        rejection.code == self as u16
    }
}

impl Identity {
    /// Whether `self`, the listener, admits `connector`.
    ///
    /// # Errors
    /// The first mismatch, of scene or role.
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
            (Role::Relay, Role::Display, Some(_)) if connector.scene.is_none() => {
                let why = "a relay passes on no geometry: give this display the scene";
                Err(Rejection::new(RejectionCode::Scene as u16, why))
            }
            (Role::Relay, Role::Culler, _) | (_, Role::Relay, _) => {
                let why = format!("a {} does not take a {}", self.role, connector.role);
                Err(Rejection::new(RejectionCode::Role as u16, &why))
            }
            (listener, connector, _) if listener == connector => {
                let why = format!("the listener is a {listener} as well: connect displays with cullers");
                Err(Rejection::new(RejectionCode::Role as u16, &why))
            }
            _ => Ok(()),
        }
    }
}

/// Why a peer closes a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum CloseCode {
    /// The session is over: all frames are done.
    Finished = 0,
    /// A user stopped the peer (Ctrl-C).
    Interrupted = 1,
    /// The peer cannot go on.
    Failed = 2,
    /// The peer's graphics device failed or hangs. The peer ends, and may be restarted.
    DeviceFailed = 4,
    /// The peer has another link for the same session.
    Replaced = 5,
}

impl CloseCode {
    /// The close reason with this code; `why` is for people, and may be empty.
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

    /// The close reason with this code.
    #[must_use]
    pub fn reason(self) -> CloseReason {
        self.because("")
    }

    /// The code of a close reason; `None` if this version does not know it.
    #[must_use]
    pub fn of(reason: &CloseReason) -> Option<Self> {
        [Self::Finished, Self::Interrupted, Self::Failed, Self::DeviceFailed, Self::Replaced]
            .into_iter()
            .find(|close| *close as u16 == reason.code)
    }
}
