//! The three roles as state machines, their drivers, and the session that joins them.
//!
//! A display deals cameras to cullers and shows the frames that they cull. [`Dealer`] decides the culler of
//! each frame and the frame that is due. [`DisplayRole`] and [`CullerRole`] move messages between it, links,
//! and a role's work on a frame ([`DisplayWork`], [`CullerWork`]): [`ScenePictures`] and [`SceneCulling`] do
//! it on devices ([`PictureDevice`], [`CullerDevice`]). A culler is a [`CullerService`], which serves
//! displays as they come; a display's [`Peers`] are its cullers as they come. [`LocalSession`] is all of it
//! in one process.
//!
//! The dealer knows no link and no device. Here it deals two frames, one to each culler:
//!
//! ```
//! use trimaran_actors::{CullerId, Dealer, Pace};
//! use trimaran_proto::FrameNumber;
//! use trimaran_transport::Instant;
//!
//! let now = Instant::from_nanos(0);
//! let mut dealer = Dealer::new(Pace::Lockstep { frames: Some(2) }, true, FrameNumber(0));
//! let cullers: Vec<_> = CullerId::first(2).collect();
//! cullers.iter().for_each(|culler| dealer.join(*culler, now));
//! assert_eq!(dealer.deal(now), [(cullers[0], FrameNumber(0)), (cullers[1], FrameNumber(1))]);
//! for frame in [FrameNumber(1), FrameNumber(0)] {
//!     let culler = cullers[frame.0 as usize];
//!     dealer.began(culler, frame)?;
//!     dealer.ended(culler, now)?;
//! }
//! assert_eq!(dealer.due(), Some(FrameNumber(0)), "frames are shown in order");
//! # Ok::<(), trimaran_actors::Disorder>(())
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | `deal` | the culler of each frame, and the next one to show: no link, no device |
//! | `driver` | the loop of a role: dealer, links and work together |
//! | `choice` | whether a display that culls for itself culls a frame by occlusion |
//! | `work`, `device` | a role's work on a frame, and its GPU interface |
//! | `peers`, `join`, `meeting` | how roles find each other, and reconnect |
//! | `supply` | geometry for displays that hold no scene |
//! | `relay` | one display's frames for many displays that watch |
//! | `service`, `local` | a culler as a service; all roles in one process |
//! | `limits` | the limits of sessions |
//! | `sharing`, `shared_sets`, `leads` | objects that sessions share: visible sets, leaders, packed geometry |
//! | `links`, `ids` | links with Trimaran's messages; the checked ids of a frame |
//! | `stop`, `turn`, `shares`, `clock`, `median` | stop requests; computing one after another; measuring |

mod choice;
mod clock;
mod deal;
mod device;
mod driver;
mod ids;
mod join;
mod leads;
mod limits;
mod links;
mod local;
mod median;
mod meeting;
mod peers;
mod relay;
mod service;
mod shared_sets;
mod shares;
mod sharing;
mod stop;
mod supply;
mod turn;
mod work;

pub use clock::Stopwatch;
pub use deal::{CullerId, Dealer, Disorder, Pace, Schedule, UnknownSchedule};
pub use device::{CullerDevice, PictureDevice};
pub use driver::{
    BoxedError, Cameras, CullerEvent, CullerRole, CullerWork, DisplayRole, DisplayWork, LinkError, Observer,
    RoleError, ShownFrame, Supplied, VisibleIds, WatcherRole, WhileLoading,
};
pub use ids::{IdError, max_frame};
pub use join::{JoinError, PeerEndpoint, again};
pub use leads::LeadError;
pub use limits::{Lease, LimitError, SessionLimits};
pub use links::{
    FrameEvent, FrameReceiver, FrameSender, FrameStart, LatestReceiver, LatestSender, Link, Listener,
    sent_bytes,
};
pub use local::{LocalCullers, LocalSession};
pub use meeting::{Expected, Meeting};
pub use peers::{Arrival, Peers, PeersConfig, SlotGuard};
pub use relay::{Relay, RelayEndpoints, RelayError, WatchLink};
pub use service::{CullerService, ListenerHandles, NewSession, ServiceEndpoints, SessionError};
pub use sharing::{SessionObserver, Sharing};
pub use stop::{Stop, Stopper};
pub use supply::{AheadUse, PackingCounts, SupplyError, SupplyFault};
pub use turn::Turns;
pub use work::{CulledFrame, Gaps, OccluderPolicy, SceneCulling, ScenePictures};
