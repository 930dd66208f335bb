//! Messages between roles.

use serde::{Deserialize, Serialize};

use crate::{FrameNumber, FrameStats, LeaderKey, SessionKey, ViewVersion};

/// Messages between roles, beside cameras and ids.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum RoleMessage {
    /// A culler's statistics for a frame that it has sent.
    Stats(FrameStats),
    /// The display asks a culler to meet another one, for the schedule `switch`.
    Meet {
        /// The key by which the two recognize each other.
        key: SessionKey,
        /// The endpoint to connect to, as written in the culler's configuration; it connects to no others.
        /// `None`: the other culler connects.
        at: Option<String>,
    },
    /// The culler has a link to the other one.
    Met {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The culler got no such link, or has lost it.
    Unmet {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks both cullers to draw each other's visible drawables (paper, algorithm 4.2).
    Switch {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
        /// The first frame of this schedule: it has no frame of the other culler before it.
        first: FrameNumber,
    },
    /// The culler has switched.
    Switched {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// The display asks a culler to drop the other one, which is gone or late.
    Part,
    /// The display sends a part of a view state, before a camera that names the version.
    View {
        /// The version.
        version: ViewVersion,
        /// The next bytes of the [`ViewState`](crate::ViewState), encoded by postcard.
        part: Vec<u8>,
        /// Whether this part is the last.
        last: bool,
    },
    /// The culler waits for the other one, which may connect now.
    Waits {
        /// As in [`RoleMessage::Meet`].
        key: SessionKey,
    },
    /// Other displays of this culler may follow the display from now on.
    Lead {
        /// The number by which they follow it, chosen by the display.
        leader: LeaderKey,
    },
    /// The display asks for the frames of another one in place of its own.
    Follow {
        /// The number of the other display.
        leader: LeaderKey,
    },
    /// The display goes on with its own cameras.
    Unfollow {
        /// As in [`RoleMessage::Follow`].
        leader: LeaderKey,
    },
    /// The culler sends the leader's frames. Its view states follow as [`RoleMessage::View`], in the leader's
    /// versions.
    Followed {
        /// As in [`RoleMessage::Follow`].
        leader: LeaderKey,
        /// The first frame of the link that is not the display's own.
        first: FrameNumber,
    },
    /// The culler answers to the display's own cameras: the display asked for it, or nobody leads by this
    /// number (any more).
    Unfollowed {
        /// As in [`RoleMessage::Follow`].
        leader: LeaderKey,
        /// The first frame of the link that is the display's own again.
        first: FrameNumber,
    },
}
