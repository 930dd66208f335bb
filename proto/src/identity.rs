//! Who a peer is, whether it is taken, and how it leaves.

use std::fmt;

use serde::{Deserialize, Serialize};
use trimaran_wire::{CloseReason, Rejection};

use crate::{SceneHash, Settings};

/// A peer's place in the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Role {
    /// Draws the occluders (OR) of the even frames, and culls them (HC).
    FirstCuller,
    /// The same for the odd frames.
    SecondCuller,
    /// Renders the visible geometry (RVG) and owns the camera.
    Display,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::FirstCuller => "first culler",
            Self::SecondCuller => "second culler",
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

/// What a peer is, and what it holds: the same for each of its links.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Its place in the session.
    pub role: Role,
    /// The scene it holds.
    pub scene: SceneHash,
    /// The settings it knows: always those of the display, from anyone else only once it has learned them.
    pub settings: Option<Settings>,
}

/// Why a listener does not take a peer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum RejectionCode {
    /// The scenes differ.
    Scene = 1,
    /// Both sides hold settings, and they differ.
    Settings = 2,
    /// The listening peer has the connecting one's role itself.
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
    /// The first of scene, role and settings in which the two do not go together.
    pub fn admits(&self, connector: &Self) -> Result<(), Rejection> {
        if self.scene != connector.scene {
            let why = format!(
                "the listener holds scene {}, the connecting peer scene {}: give both the same cooked file",
                self.scene, connector.scene
            );
            return Err(Rejection::new(RejectionCode::Scene as u16, &why));
        }
        if self.role == connector.role {
            let why = format!("the listener is the {} itself: each role exists once in a session", self.role);
            return Err(Rejection::new(RejectionCode::Role as u16, &why));
        }
        match (self.settings, connector.settings) {
            (Some(listener), Some(connector)) if listener != connector => {
                let why = format!(
                    "the listener's settings are {listener}, the connecting peer's {connector}: only the \
                     display decides"
                );
                Err(Rejection::new(RejectionCode::Settings as u16, &why))
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
    /// The peer has lost another one: the session stops, and goes on if all join again.
    PeerLost = 3,
    /// The peer's graphics device failed or hangs. It ends, and may be started again: the session goes on as
    /// after a lost peer.
    DeviceFailed = 4,
}

impl CloseCode {
    /// What a peer says that leaves for this reason; `why` is for people, and may be empty.
    #[must_use]
    pub fn because(self, why: &str) -> CloseReason {
        let what = match self {
            Self::Finished => "the session is over",
            Self::Interrupted => "it was interrupted",
            Self::Failed => "it failed",
            Self::PeerLost => "it has lost a peer",
            Self::DeviceFailed => "its device failed",
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
        [Self::Finished, Self::Interrupted, Self::Failed, Self::PeerLost, Self::DeviceFailed]
            .into_iter()
            .find(|close| *close as u16 == reason.code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LodRule, Viewport};

    const SCENE: SceneHash = SceneHash(0xfeed);

    fn identity(role: Role) -> Identity {
        Identity { role, scene: SCENE, settings: None }
    }

    fn settings(width: u32) -> Settings {
        Settings::new(Viewport::new(width, 480).unwrap(), LodRule::new(2.0).unwrap())
    }

    #[test]
    fn peers_that_go_together_are_admitted() {
        let display = Identity { settings: Some(settings(640)), ..identity(Role::Display) };
        assert_eq!(identity(Role::FirstCuller).admits(&identity(Role::SecondCuller)), Ok(()));
        assert_eq!(identity(Role::FirstCuller).admits(&display), Ok(()));
        assert_eq!(display.admits(&identity(Role::SecondCuller)), Ok(()));
        let informed = Identity { settings: Some(settings(640)), ..identity(Role::FirstCuller) };
        assert_eq!(display.admits(&informed), Ok(()));
    }

    #[test]
    fn a_refusal_names_both_sides() {
        let a = identity(Role::FirstCuller);
        let other = Identity { scene: SceneHash(0xbad), ..identity(Role::SecondCuller) };
        let refusal = a.admits(&other).unwrap_err();
        assert!(RejectionCode::Scene.is_of(&refusal));
        let text = refusal.to_string();
        assert!(text.contains("0000feed") && text.contains("00000bad"), "{text}");

        assert!(RejectionCode::Role.is_of(&a.admits(&a).unwrap_err()));

        let (x, y) = (settings(640), settings(641));
        let a = Identity { settings: Some(x), ..a };
        let display = Identity { settings: Some(y), ..identity(Role::Display) };
        let refusal = a.admits(&display).unwrap_err();
        assert!(RejectionCode::Settings.is_of(&refusal));
        let text = refusal.to_string();
        assert!(text.contains("640x480") && text.contains("641x480"), "{text}");
    }
}
