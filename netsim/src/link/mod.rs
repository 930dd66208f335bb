//! One direction of a link between two hosts, and its packets.

mod jitter;
mod loss;
mod model;
mod parcel;
mod pipe;
mod queue;
mod tally;

pub use jitter::{Distribution, Jitter};
pub use loss::{GilbertElliott, Loss};
pub use model::{
    Conditions, Framing, LinkModel, Phase, Probability, ProbabilityError, Rate, RateError, Reorder,
};
pub(crate) use parcel::Outage;
pub use parcel::{Action, Ecn, Parcel};
pub use pipe::Pipe;
pub use queue::{CoDel, Discipline, QueueModel};
pub use tally::{Count, Drops, LinkTally};
