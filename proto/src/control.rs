//! Control messages: who a peer is, whether it is taken, and how it leaves.

use std::fmt;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{SceneHash, Settings};

/// The version of the wire. Peers of different versions refuse each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProtocolVersion(pub u16);

impl ProtocolVersion {
    /// The version that this crate speaks.
    pub const CURRENT: Self = Self(1);
}

impl fmt::Display for ProtocolVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// A peer's place in the session.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Role {
    /// One half of the switch: culls the even frames (HC) and draws the occluders of the odd ones (OR).
    SwitchA,
    /// The other half of the switch: culls the odd frames and draws the occluders of the even ones.
    SwitchB,
    /// Renders the visible geometry (RVG) and owns the camera.
    Display,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::SwitchA => "switch A",
            Self::SwitchB => "switch B",
            Self::Display => "display",
        })
    }
}

/// Which of the two lanes of a link a connection carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Lane {
    /// Cameras: a cell of size one.
    Latest,
    /// Frames of ids.
    Frames,
}

impl fmt::Display for Lane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Latest => "latest",
            Self::Frames => "frames",
        })
    }
}

/// A random number that one peer draws for one link: it pairs the connections of the link's lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SessionId(pub u64);

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// The first message of whoever connects.
///
/// On the wire it starts with a magic number and the version, in a layout that no version changes: so a peer
/// of any other version can be told so.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// What the connecting peer is.
    pub identity: Identity,
    /// The link that this connection belongs to.
    pub session: SessionId,
    /// The lane that this connection shall carry.
    pub lane: Lane,
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

/// The answer to a hello that was taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Accept {
    /// What the accepting peer is.
    pub identity: Identity,
}

/// Why a hello was refused, with both sides' values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The versions of the wire differ.
    #[error(
        "the listener speaks version {listener} of the protocol, the connecting peer version {connector}: \
         install the same release on both"
    )]
    Version {
        /// Of the listening peer.
        listener: ProtocolVersion,
        /// Of the connecting peer.
        connector: ProtocolVersion,
    },
    /// The scenes differ.
    #[error(
        "the listener holds scene {listener}, the connecting peer scene {connector}: \
         give both the same cooked file"
    )]
    Scene {
        /// Of the listening peer.
        listener: SceneHash,
        /// Of the connecting peer.
        connector: SceneHash,
    },
    /// The listening peer has this role itself, or has a peer with it already.
    #[error(
        "the role {role} is taken: each role exists once in a session, and the place of one that was killed is free when its lease has ended"
    )]
    RoleTaken {
        /// The role both claim.
        role: Role,
    },
    /// Both sides hold settings, and they differ.
    #[error(
        "the listener's settings are {listener}, the connecting peer's {connector}: only the display decides"
    )]
    Settings {
        /// Of the listening peer.
        listener: Settings,
        /// Of the connecting peer.
        connector: Settings,
    },
    /// The two connections of one session contradict each other, or carry the same lane.
    #[error("session {session}: the {lane} lane came twice or from a peer that calls itself something else")]
    Session {
        /// The session.
        session: SessionId,
        /// The lane that was refused.
        lane: Lane,
    },
    /// The other lane of the session did not come in time.
    #[error("session {session}: the other lane did not come in time")]
    Unpaired {
        /// The session.
        session: SessionId,
    },
    /// The listening peer has too many handshakes under way; trying again later may work.
    #[error("the listener has too many handshakes under way: try again")]
    Busy,
    /// The listening peer knows the connecting peer's key for another role.
    #[error(
        "the connecting peer claims to be {claimed}, and the listener knows its key as that of {known}:          use this role's own keys, or name them for it in the listener's configuration"
    )]
    Key {
        /// The role that the connecting peer claims.
        claimed: Role,
        /// The role that its key is known for.
        known: Role,
    },
}

impl Refusal {
    /// Whether the same peer may be let in when it tries again.
    #[must_use]
    pub const fn is_passing(&self) -> bool {
        // One lane of a pair may have found room where the other found none.
        matches!(self, Self::Busy | Self::Unpaired { .. })
    }
}

impl Identity {
    /// The hello of this peer for one lane of one link.
    #[must_use]
    pub const fn hello(self, session: SessionId, lane: Lane) -> Hello {
        Hello { identity: self, session, lane }
    }

    /// Whether `self`, listening, takes `connector`.
    ///
    /// # Errors
    /// The first of scene, role and settings in which the two do not go together.
    pub fn admits(&self, connector: &Self) -> Result<(), Refusal> {
        if self.scene != connector.scene {
            return Err(Refusal::Scene { listener: self.scene, connector: connector.scene });
        }
        if self.role == connector.role {
            return Err(Refusal::RoleTaken { role: self.role });
        }
        match (self.settings, connector.settings) {
            (Some(listener), Some(connector)) if listener != connector => {
                Err(Refusal::Settings { listener, connector })
            }
            _ => Ok(()),
        }
    }
}

/// How a peer leaves.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Goodbye {
    /// The session is over: all frames are done.
    Finished,
    /// Someone stopped the peer (Ctrl-C).
    Interrupted,
    /// The peer cannot go on.
    Failed(Explanation),
    /// The peer has lost another one: the session stops, and goes on if all join again.
    PeerLost(Explanation),
    /// The peer's graphics device failed or hangs. It ends, and may be started again: the session goes on as
    /// after a lost peer.
    DeviceFailed(Explanation),
}

impl Goodbye {
    /// The peer cannot go on, and why; at most [`Explanation::MAX_BYTES`] of the text travel.
    #[must_use]
    pub fn failed(why: &str) -> Self {
        Self::Failed(Explanation::new(why))
    }

    /// The peer has lost another one, and how; at most [`Explanation::MAX_BYTES`] of the text travel.
    #[must_use]
    pub fn peer_lost(how: &str) -> Self {
        Self::PeerLost(Explanation::new(how))
    }

    /// The peer's device failed, and how; at most [`Explanation::MAX_BYTES`] of the text travel.
    #[must_use]
    pub fn device_failed(how: &str) -> Self {
        Self::DeviceFailed(Explanation::new(how))
    }
}

impl fmt::Display for Goodbye {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finished => f.write_str("the session is over"),
            Self::Interrupted => f.write_str("it was interrupted"),
            Self::Failed(why) => write!(f, "it failed: {why}"),
            Self::PeerLost(how) => write!(f, "it has lost a peer: {how}"),
            Self::DeviceFailed(how) => write!(f, "its device failed: {how}"),
        }
    }
}

/// A short text from a peer, for a person to read. Control characters are shown escaped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Explanation(String);

/// A text longer than [`Explanation::MAX_BYTES`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("an explanation of {0} bytes is longer than {max}", max = Explanation::MAX_BYTES)]
pub struct ExplanationError(usize);

impl Explanation {
    /// The longest text, in bytes of UTF-8.
    pub const MAX_BYTES: usize = 200;

    /// The text, cut after the last whole character within [`Explanation::MAX_BYTES`].
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self(text[..text.floor_char_boundary(Self::MAX_BYTES)].to_owned())
    }
}

impl TryFrom<String> for Explanation {
    type Error = ExplanationError;

    fn try_from(text: String) -> Result<Self, ExplanationError> {
        if text.len() > Self::MAX_BYTES { Err(ExplanationError(text.len())) } else { Ok(Self(text)) }
    }
}

impl From<Explanation> for String {
    fn from(explanation: Explanation) -> Self {
        explanation.0
    }
}

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.escape_debug())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BatchSize, EpsilonPx, FrameNumber, IdCoding, PictureSize, TesterKind};

    const SCENE: SceneHash = SceneHash(0xfeed);

    fn identity(role: Role) -> Identity {
        Identity { role, scene: SCENE, settings: None }
    }

    fn settings(width: u32) -> Settings {
        Settings {
            size: PictureSize::new(width, 480).unwrap(),
            epsilon: EpsilonPx::new(2.0).unwrap(),
            batch: BatchSize::default(),
            coding: IdCoding::Plain,
            tester: TesterKind::Raster,
            lockstep: true,
            few_pixels: false,
            first: FrameNumber(0),
            frames: Some(200),
        }
    }

    #[test]
    fn peers_that_go_together_are_admitted() {
        let display = Identity { settings: Some(settings(640)), ..identity(Role::Display) };
        assert_eq!(identity(Role::SwitchA).admits(&identity(Role::SwitchB)), Ok(()));
        assert_eq!(identity(Role::SwitchA).admits(&display), Ok(()));
        assert_eq!(display.admits(&identity(Role::SwitchB)), Ok(()));
        let informed = Identity { settings: Some(settings(640)), ..identity(Role::SwitchA) };
        assert_eq!(display.admits(&informed), Ok(()));
    }

    #[test]
    fn a_refusal_names_both_sides() {
        let a = identity(Role::SwitchA);
        let other = Identity { scene: SceneHash(0xbad), ..identity(Role::SwitchB) };
        let refusal = a.admits(&other).unwrap_err();
        assert_eq!(refusal, Refusal::Scene { listener: SCENE, connector: SceneHash(0xbad) });
        let text = refusal.to_string();
        assert!(text.contains("0000feed") && text.contains("00000bad"), "{text}");

        assert_eq!(a.admits(&a), Err(Refusal::RoleTaken { role: Role::SwitchA }));

        let (x, y) = (settings(640), settings(641));
        let a = Identity { settings: Some(x), ..a };
        let display = Identity { settings: Some(y), ..identity(Role::Display) };
        let refusal = a.admits(&display).unwrap_err();
        assert_eq!(refusal, Refusal::Settings { listener: x, connector: y });
        let text = refusal.to_string();
        assert!(text.contains("640x480") && text.contains("641x480"), "{text}");
    }

    #[test]
    fn explanations_are_cut_at_a_character_and_escaped() {
        let long = "é".repeat(150);
        let cut = Explanation::new(&long);
        assert_eq!(String::from(cut), "é".repeat(100));
        let odd = Explanation::new(&format!("x{long}"));
        assert_eq!(String::from(odd).len(), 199, "a half character does not travel");
        assert_eq!(Explanation::new("a\u{1b}[31mb").to_string(), "a\\u{1b}[31mb");
        assert_eq!(Explanation::try_from("x".repeat(201)), Err(ExplanationError(201)));
    }
}
