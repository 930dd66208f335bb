//! The three roles as state machines, their drivers, and the session that joins them.
//!
//! [`CullerMachine`] and [`DisplayMachine`] know what is due and what is out of order. [`CullerRole`] and
//! [`DisplayRole`] move messages between them, links, and what a role does with a frame ([`CullerWork`],
//! [`DisplayWork`]): [`SceneCulling`] and [`ScenePictures`] do it on devices ([`CullerDevice`],
//! [`PictureDevice`]). [`CullerSession`] joins a culler to the others; [`LocalSession`] is three roles in one
//! process.
//!
//! The state machines know no link and no device. Here the display deals two cameras, one to each culler:
//!
//! ```
//! use trimaran_actors::{CullerIndex, DisplayMachine, DisplayStep};
//! use trimaran_proto::{Camera, FrameNumber};
//!
//! let mut display = DisplayMachine::new(FrameNumber(0), Some(2));
//! for frame in display.first_cameras() {
//!     display.hand_out(Camera::at_origin(frame));
//! }
//! for frame in [FrameNumber(0), FrameNumber(1)] {
//!     let from = CullerIndex::of(frame); // cullers take turns
//!     assert!(matches!(display.step(), DisplayStep::Await { from: due, .. } if due == from));
//!     display.began(Camera::at_origin(frame), true)?;
//!     display.ended()?;
//! }
//! assert!(!matches!(display.step(), DisplayStep::Await { .. }));
//! # Ok::<(), trimaran_actors::OrderError>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `machine` | what is due, and what is out of order: no link, no device |
//! | `driver` | the loop of a role: machine, links and work together |
//! | `work`, `device` | what a role does with a frame, and what it needs of a GPU |
//! | `join`, `session`, `local` | how roles meet, go on after a loss, and run in one process |
//! | `links`, `ids` | links that carry what Trimaran says; the ids of a frame, checked |
//! | `stop`, `turn`, `clock` | being asked to stop; computing one after another; measuring |

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
pub use work::{CulledFrame, Gaps, OccluderPolicy, SceneCulling, ScenePictures};
