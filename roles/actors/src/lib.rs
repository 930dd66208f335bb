//! The three roles as state machines, their drivers, and the session that joins them.
//!
//! [`CullerMachine`] and [`DisplayMachine`] know what is due and what is out of order. [`CullerRole`] and
//! [`DisplayRole`] move messages between them, links, and what a role does with a frame ([`CullerWork`],
//! [`DisplayWork`]): [`SceneCulling`] and [`ScenePictures`] do it on devices ([`CullerDevice`],
//! [`PictureDevice`]). [`CullerSession`] joins a culler to the others; [`LocalSession`] is three roles in one
//! process.

mod clock;
mod device;
mod driver;
mod ids;
mod join;
mod links;
mod local;
mod machine;
mod session;
mod stop;
mod turn;
mod work;

pub use clock::Stopwatch;
pub use device::{CullerDevice, PictureDevice};
pub use driver::{
    BoxedError, Cameras, CullerRole, CullerTraffic, CullerWork, DisplayRole, DisplayWork, Drawn, LinkError,
    Observer, RoleError, ShownFrame, VisibleIds, leave_unable,
};
pub use ids::{IdError, max_frame};
pub use join::{JoinError, Joined, PeerEndpoint, again, await_cullers, join_session};
pub use links::{
    FrameEvent, FrameReceiver, FrameSender, FrameStart, LatestReceiver, LatestSender, Link, Listener,
};
pub use local::{LocalCullers, LocalSession};
pub use machine::{CullerIndex, CullerMachine, CullerStep, DisplayMachine, DisplayStep, OrderError};
pub use session::{CullerSession, JoinTimeouts, SessionError, SessionEvent};
pub use stop::{Stop, Stopper};
pub use turn::Turns;
pub use work::{Gaps, OccluderPolicy, SceneCulling, ScenePictures};
