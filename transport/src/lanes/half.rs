//! The halves of lanes: the traits that a transport implements, one lane at a time.

use std::fmt;
use std::task::{Context, Poll};

use trimaran_wire::{CloseReason, FrameNumber};

use crate::error::{LaneError, Loss};

/// Half of a lane. Its owner polls it, and nobody else. The link around it bounds each wait.
pub trait Half: fmt::Debug + Send {
    /// The owner waits no longer, although the last poll was pending.
    fn rest(&mut self) {}

    /// Whether anything came from the peer since the last call. Only senders of a transport that leaves it to
    /// the link to notice a silent peer are asked.
    fn heard(&mut self) -> bool {
        true
    }
}

/// The sending half of a lane, without the type of its data.
pub trait LaneTx: Half {
    /// Passes staged data on, as far as possible. Ready with `true` once nothing is staged and there is room
    /// for more. Ready with `false` after a part of it: the link's timeout then begins anew.
    ///
    /// # Errors
    /// If the connection is gone.
    fn poll_send(&mut self, _cx: &mut Context<'_>) -> Poll<Result<bool, Loss>> {
        Poll::Ready(Ok(true))
    }

    /// Stages the close of the lane, behind all data.
    ///
    /// # Errors
    /// If the connection is gone.
    fn close(&mut self, reason: CloseReason) -> Result<(), Loss>;

    /// Ready once the peer has all of a closed lane, as far as the transport can tell.
    ///
    /// # Errors
    /// If the connection is gone.
    fn poll_closed(&mut self, _cx: &mut Context<'_>) -> Poll<Result<(), Loss>> {
        Poll::Ready(Ok(()))
    }

    /// The newest frame that the peer has completely, on a lane that loses frames and knows it.
    fn confirmed(&self) -> Option<FrameNumber> {
        None
    }
}

/// The sending half of a lane of `T`.
///
/// | lane | `T` over bytes | |
/// |---|---|---|
/// | latest | [`FixedBytes`](trimaran_wire::FixedBytes) | sent at once, or replaced by the next |
/// | frames | [`FrameMessage`](trimaran_wire::FrameMessage) | any number may be staged |
/// | messages, bulk | [`Bytes`](bytes::Bytes) | one is staged once [`LaneTx::poll_send`] is ready |
pub trait Tx<T>: LaneTx {
    /// Stages `data`. On the latest lane nothing else follows; on the others [`LaneTx::poll_send`] may.
    ///
    /// # Errors
    /// If the connection is gone.
    fn stage(&mut self, data: T) -> Result<(), Loss>;
}

/// The receiving half of a lane of `T`, as [`Tx`] has it.
pub trait Rx<T>: Half {
    /// The next item; on the latest lane the newest one. `None` if something else came, such as a keep-alive
    /// or a part of an item. An end is returned by every later call as well.
    ///
    /// # Errors
    /// If the lane has ended, behind everything that came before.
    fn poll_next(&mut self, cx: &mut Context<'_>) -> Poll<Result<Option<T>, LaneError>>;

    /// Tells the peer's machine that this side is gone, on transports that need a live process for that. Only
    /// the latest lane is asked, after both sides have closed the link.
    fn poll_part(&mut self, _cx: &mut Context<'_>) -> Poll<()> {
        Poll::Ready(())
    }
}

/// Both halves of a lane of `T`.
pub type Duplex<T> = (Box<dyn Tx<T>>, Box<dyn Rx<T>>);
