//! The three roles as state machines, their drivers, and the session that joins them.
//!
//! [`SwitchMachine`] and [`DisplayMachine`] know what is due and what is out of order; [`PairRole`] and
//! [`DisplayRole`] move messages between them, a device ([`PairDevice`], [`PictureDevice`]) and links;
//! [`in_process`] joins three of them in one process.

mod causes;
mod clock;
mod device;
mod driver;
mod join;
mod links;
mod machine;
mod session;

pub use causes::causes;
pub use clock::Stopwatch;
pub use device::{PairDevice, PictureDevice};
pub use driver::{
    Cameras, DisplayRole, Gaps, IdError, LinkError, Observer, ObserverError, OccluderPolicy, PairRole,
    PairTraffic, RoleError, ShownFrame, Stop, Stopper, Turns, leave_unable, max_frame,
};
pub use join::{JoinError, Joined, Place, again, await_pair, join_session, role_of};
pub use links::{
    FrameEvent, FrameReceiver, FrameSender, FrameStart, LatestReceiver, LatestSender, Link, Listener,
};
pub use machine::{DisplayMachine, DisplayStep, OrderError, Seat, SwitchMachine, SwitchStep};
pub use session::{Devices, SessionError, in_process};
