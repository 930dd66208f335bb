//! Control messages: hello, answer and close.

use std::fmt;
use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::{
    ChannelFormat, ChannelList, ChannelNumber, Explanation, ProtocolName, Text, WireVersion, WireVersions,
};

/// The lane of a link that a connection carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Lane {
    /// A cell of size one.
    Latest,
    /// Frames of items.
    Frames,
    /// Messages in order.
    Messages,
    /// Blocks of bytes in order, behind everything else.
    Bulk,
    /// A channel: values or frames.
    Channel(ChannelNumber),
}

impl fmt::Display for Lane {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Latest => "latest",
            Self::Frames => "frames",
            Self::Messages => "messages",
            Self::Bulk => "bulk",
            Self::Channel(ChannelNumber(number)) => return write!(f, "channel {number}"),
        })
    }
}

/// A random number that one peer draws for one link; it joins the connections of the link's lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct SessionId(pub u64);

impl fmt::Display for SessionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

/// How long a peer may be silent before it counts as lost: milliseconds, 50 at least.
///
/// Each side tells the other its own. The shorter one holds for both (as in RFC 9000, section 10.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct IdleTimeout(u32);

impl IdleTimeout {
    /// The shortest one. Shorter ones count as this: an idle peer sends four keep-alives in that time.
    pub const MIN: Duration = Duration::from_millis(50);

    /// The longest one that is sent: its varint has four bytes, for which [`Hello`] has room.
    const MAX_MILLIS: u32 = (1 << 28) - 1;

    /// The timeout that holds for both sides.
    #[must_use]
    pub fn agreed(self, theirs: Self) -> Duration {
        Duration::from_millis(u64::from(self.0.min(theirs.0))).max(Self::MIN)
    }
}

/// A time beyond three days counts as three days.
impl From<Duration> for IdleTimeout {
    fn from(time: Duration) -> Self {
        let millis = u32::try_from(time.max(Self::MIN).as_millis()).unwrap_or(u32::MAX);
        Self(millis.min(Self::MAX_MILLIS))
    }
}

/// The most bytes of an application's hello.
pub const MAX_HELLO: usize = 200;

/// The first message of the connecting peer.
///
/// On the wire it starts with a magic number and the highest version, in a layout that no version changes: so
/// a peer of any other version can be told. A listener of version 4 reads at most 256 bytes, or 897 with
/// channels. The longest hello has no more.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hello {
    /// The versions that the connecting peer speaks. Where the highest is 4 the hello has version 4's layout,
    /// which names no other one.
    pub versions: WireVersions,
    /// The name of the application's protocol.
    pub protocol: ProtocolName,
    /// The link of this connection.
    pub session: SessionId,
    /// The lane of this connection.
    pub lane: Lane,
    /// When the connecting peer takes a silent one for lost.
    pub idle_timeout: IdleTimeout,
    /// The channels of the connecting peer.
    pub channels: ChannelList,
    /// The hello of the application's peer: at most [`MAX_HELLO`] bytes.
    pub application: Bytes,
}

/// The answer to an accepted hello, with the hello of the application's peer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Accept {
    /// The version of the link: the highest in common. Version 4's layout is that of version 4 alone.
    pub version: WireVersion,
    /// When the listening peer takes a silent one for lost.
    pub idle_timeout: IdleTimeout,
    /// As in [`Hello::application`].
    pub application: Bytes,
}

/// Why a listener refuses a peer: a number for programs and a text for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Error)]
#[error("{why}")]
pub struct Rejection {
    /// The application's own number.
    pub code: u16,
    /// A text for people. It has room for the values of both sides.
    pub why: Text<400>,
}

impl Rejection {
    /// A rejection with the application's own number; at most 400 bytes of the text are sent.
    #[must_use]
    pub fn new(code: u16, why: &str) -> Self {
        Self { code, why: Text::new(why) }
    }
}

/// Why a hello was refused, with both sides' values.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, Error)]
#[non_exhaustive]
pub enum Refusal {
    /// The peers have no version of the wire in common.
    #[error(
        "the listener speaks {listener} of the wire, the connecting peer {connector}: install the same \
         release on both"
    )]
    Version {
        /// Of the listening peer.
        listener: WireVersions,
        /// Of the connecting peer.
        connector: WireVersions,
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
    /// The listening peer's application refuses the connecting one.
    #[error(transparent)]
    Rejected(Rejection),
    /// The connections of one session contradict each other, or have the same lane.
    #[error("session {session}: the {lane} lane came twice or from a peer that calls itself something else")]
    Session {
        /// The session.
        session: SessionId,
        /// The lane that was refused.
        lane: Lane,
    },
    /// Another lane of the session did not come in time.
    #[error("session {session}: another lane did not come in time")]
    Unpaired {
        /// The session.
        session: SessionId,
    },
    /// The listening peer has too many peers or open handshakes; trying again later may work.
    #[error("the listener has too many peers or handshakes under way: try again")]
    Busy,
    /// The listening peer knows the connecting peer's key for another role.
    #[error(
        "the connecting peer claims to be {claimed}, and the listener knows its key as that of {known}: use \
         this role's own keys, or name them for it in the listener's configuration"
    )]
    Key {
        /// The role that the connecting peer claims.
        claimed: Explanation,
        /// The role that its key is known for.
        known: Explanation,
    },
    /// The channels differ; the first one that does.
    #[error(
        "channel {} of the listener is {}, that of the connecting peer {}: install the same release on both",
        number.0, said(listener.as_ref()), said(connector.as_ref())
    )]
    Channel {
        /// Its number.
        number: ChannelNumber,
        /// Of the listening peer, if it has one of that number.
        listener: Option<ChannelFormat>,
        /// Of the connecting peer, if it has one of that number.
        connector: Option<ChannelFormat>,
    },
}

fn said(channel: Option<&ChannelFormat>) -> String {
    channel.map_or_else(|| "missing".to_owned(), ChannelFormat::to_string)
}

impl Refusal {
    /// Whether the same peer may be admitted when it tries again.
    #[must_use]
    pub const fn is_passing(&self) -> bool {
        // One lane may have found room where another did not.
        matches!(self, Self::Busy | Self::Unpaired { .. })
    }
}

/// Why a peer leaves: a number for programs and a text for people.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct CloseReason {
    /// The application's own number, or [`CloseReason::REFUSED`].
    pub code: u16,
    /// A text for people.
    pub why: Explanation,
}

impl CloseReason {
    /// The code of a connecting peer that refuses the listener. Applications have all others.
    pub const REFUSED: u16 = u16::MAX;

    /// A reason with the application's own number; at most [`Explanation::MAX_BYTES`] of the text are sent.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shorter_idle_timeout_holds_and_none_is_too_short_or_too_long() {
        let of = |millis| IdleTimeout::from(Duration::from_millis(millis));
        let agreed = |ours, theirs| of(ours).agreed(of(theirs)).as_millis();
        assert_eq!((agreed(1_000, 30_000), agreed(30_000, 1_000)), (1_000, 1_000));
        assert_eq!(agreed(0, 30_000), 50);
        // As a peer may send it.
        assert_eq!(IdleTimeout(0).agreed(of(30_000)), IdleTimeout::MIN);
        assert_eq!(agreed(u64::MAX, u64::MAX), (1 << 28) - 1);
    }

    #[test]
    fn what_a_peer_says_is_shown_escaped() {
        let odd = "a\u{1b}b";
        let shown = "a\\u{1b}b";
        assert_eq!(CloseReason::new(7, odd).to_string(), shown);
        assert_eq!(Rejection::new(7, odd).to_string(), shown);
        assert_eq!(Refusal::Rejected(Rejection::new(7, odd)).to_string(), shown);
        let claim = Refusal::Key { claimed: Explanation::new(odd), known: Explanation::new("arm") };
        assert!(claim.to_string().contains(&format!("claims to be {shown}")));
        assert_eq!(SessionId(0xbeef).to_string(), "000000000000beef");
    }
}
