//! A walkthrough: a scene, a path and three roles, and the report of it.
//!
//! ```text
//! CameraPath::find      which way to walk
//! SceneOnDevices::walk  the three roles walk it; a Recorder notes every frame, and a Journal writes it down
//! Redrawer              draws frames again, away from the clock, as they were shown
//! Auditor               also without culling and at full detail, and counts what is wrong (feature `lab`)
//! write_report          all of it as a report with its pictures
//! ```

#[cfg(feature = "lab")]
mod audit;
mod compose;
mod devices;
mod error;
mod journal;
mod objects;
mod path;
mod plan;
mod record;
mod redraw;
mod reporting;
mod resume;
mod unchecked;
mod view_file;
mod view_states;

#[cfg(feature = "lab")]
pub use audit::{
    AttributionError, AuditError, AuditPictures, Auditor, CullingDifference, Judgement, LevelSwitch,
    Reference,
};
pub use compose::FrameRecord;
pub use devices::{SceneOnDevices, WalkthroughError};
pub use error::ReportingError;
pub use journal::{Journal, JournalStopped};
pub use objects::count_objects;
pub use path::{CameraPath, CameraPathError, PathChoice};
pub use plan::{Pace, Plan};
pub use record::Recorder;
pub use redraw::{GivesUp, RedrawError, Redrawer};
pub use reporting::{
    SceneFile, Walk, Written, begin, how_ended, memory_use, report_of, scene_info, write_report,
};
pub use resume::Progress;
pub use unchecked::{Unchecked, UncheckedError};
pub use view_file::{ViewChangeError, ViewFileError};
pub use view_states::{ViewChange, ViewStates};
