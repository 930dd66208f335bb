//! The causes of a connection's end.

use std::time::Duration;

use thiserror::Error;

use crate::inbox::LaneViolation;
use crate::wire::Malformed;

/// Why a connection has ended.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum Closed {
    /// This side closed it.
    #[error("this side closed the connection")]
    Here,
    /// The peer closed it.
    #[error("the peer closed the connection")]
    Peer,
    /// The listening peer was restarted, and has lost the connection.
    #[error("the peer was restarted and no longer knows the connection")]
    Reset,
    /// Nothing came for the idle timeout.
    #[error("nothing came from the peer for {0:?}")]
    Silent(Duration),
    /// The peer sends, but acknowledges nothing.
    #[error("the peer acknowledged nothing for {0:?}")]
    Deaf(Duration),
    /// The peer sent an invalid packet under its own key.
    #[error("the peer sent a packet that is none")]
    Malformed(#[from] Malformed),
    /// The peer broke the rules of a lane.
    #[error("the peer broke the rules of a lane")]
    Lane(#[from] LaneViolation),
    /// The peer acknowledged a packet that was never sent.
    #[error("the peer acknowledged a packet that was never sent")]
    NeverSent,
    /// The peer ended its latest lane with an invalid close.
    #[error("the peer ended its latest lane with bytes that are no close")]
    Reason,
    /// So many packets failed to open that a forgery could succeed by chance.
    #[error("too many packets did not open: somebody tries to forge them")]
    Forged,
    /// All packet numbers are used, or a packet could not be sealed.
    #[error("no further packet can be sealed")]
    Exhausted,
}
