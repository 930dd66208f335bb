//! Control messages: who a peer is, whether it is taken, and how it leaves.

use std::fmt;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::Rejection;

/// The version of the wire of links. Peers of different versions refuse each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct WireVersion(pub u16);

impl WireVersion {
    /// The version that this crate speaks.
    pub const CURRENT: Self = Self(1);
}

impl fmt::Display for WireVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Which of the lanes of a link a connection carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Lane {
    /// A cell of size one.
    Latest,
    /// Frames of items.
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

/// The name of an application's protocol with its version, such as `robot/1`: at most 32 bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct ProtocolName(String);

impl ProtocolName {
    /// The longest name, in bytes of UTF-8.
    pub const MAX_BYTES: usize = 32;

    /// The name, cut after the last whole character within [`ProtocolName::MAX_BYTES`].
    #[must_use]
    pub fn new(name: &str) -> Self {
        Self(cut(name, Self::MAX_BYTES))
    }
}

impl fmt::Display for ProtocolName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0.escape_debug())
    }
}

/// The first message of whoever connects.
///
/// On the wire it starts with a magic number and the version, in a layout that no version changes: so a peer
/// of any other version can be told so.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hello {
    /// What the application is called.
    pub protocol: ProtocolName,
    /// The link that this connection belongs to.
    pub session: SessionId,
    /// The lane that this connection shall carry.
    pub lane: Lane,
    /// How the application's peer introduces itself.
    pub application: Bytes,
}

/// The answer to a hello that was taken: how the application's peer introduces itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Accept {
    /// As in [`Hello::application`].
    pub application: Bytes,
}

/// Why a hello was refused, with both sides' values.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The versions of the wire differ.
    #[error(
        "the listener speaks version {listener} of the wire, the connecting peer version {connector}: \
         install the same release on both"
    )]
    Version {
        /// Of the listening peer.
        listener: WireVersion,
        /// Of the connecting peer.
        connector: WireVersion,
    },
    /// The applications differ.
    #[error(
        "the listener speaks {listener}, the connecting peer {connector}: install the same release on both"
    )]
    Protocol {
        /// Of the listening peer.
        listener: ProtocolName,
        /// Of the connecting peer.
        connector: ProtocolName,
    },
    /// The application of the listening peer does not take the connecting one.
    #[error(transparent)]
    Rejected(Rejection),
    /// The listening peer has this role itself, or has a peer with it already.
    #[error(
        "the role {role} is taken: each role exists once, and the place of a process that was killed is free \
         when its lease has ended"
    )]
    RoleTaken {
        /// The role both claim.
        role: Explanation,
    },
    /// The connections of one session contradict each other, or carry the same lane.
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
        "the connecting peer claims to be {claimed}, and the listener knows its key as that of {known}: use this \
         role's own keys, or name them for it in the listener's configuration"
    )]
    Key {
        /// The role that the connecting peer claims.
        claimed: Explanation,
        /// The role that its key is known for.
        known: Explanation,
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

/// How a peer leaves: a number for programs and a text for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CloseReason {
    /// The application's own number, or [`CloseReason::REFUSED`].
    pub code: u16,
    /// What a person should know.
    pub why: Explanation,
}

impl CloseReason {
    /// The code of a peer that connected and does not take the listener. Applications have the others.
    pub const REFUSED: u16 = u16::MAX;

    /// A reason with the application's own number; at most [`Explanation::MAX_BYTES`] of the text travel.
    #[must_use]
    pub fn new(code: u16, why: &str) -> Self {
        Self { code, why: Explanation::new(why) }
    }
}

impl fmt::Display for CloseReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.why.fmt(f)
    }
}

/// A short text from a peer, for a person to read. Control characters are shown escaped.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
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
        Self(cut(text, Self::MAX_BYTES))
    }

    /// The text as it came: it may hold control characters.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// As much of `text` as has whole characters within `bytes`.
fn cut(text: &str, bytes: usize) -> String {
    text[..text.floor_char_boundary(bytes)].to_owned()
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
