//! TCP as Linux does it, without IO: a model of its behaviour, not of its code.
//!
//! Modelled, with specifications: the retransmission timer with Linux's floor of 200 ms (RFC 6298), selective
//! acknowledgements and duplicates among them (RFC 2018, 2883), timestamps (RFC 7323), RACK and the tail loss
//! probe (RFC 8985), proportional rate reduction (RFC 6937), CUBIC with HyStart (RFC 9438, 9406's
//! forerunner), undoing spurious reductions (RFC 4015, and by duplicate reports), delayed and quick
//! acknowledgements, a receive window that grows with the program's reads, a send buffer that grows with the
//! congestion window, no more than about a millisecond of data in the host's own queue, and holding back
//! small segments while the one before is in it.
//!
//! Not modelled: segmentation offload (each packet is its own), pacing (Linux paces CUBIC only under the `fq`
//! qdisc), ECN (off unless a peer asks), F-RTO, path MTU discovery (the path MTU is known), `TIME_WAIT`,
//! urgent data, and the granularity of the kernel's clock tick.

mod cubic;
mod delayed_ack;
mod receiver;
mod rtt;
mod scoreboard;
pub(crate) mod segment;
mod sender;
mod socket;
mod unsent;

pub use segment::Class;
pub(crate) use segment::Segment;
pub(crate) use socket::{Config, Socket};
