//! Clashes for people: with names, paths and a view of each; and the searches of pages.

mod groups;
mod jobs;
mod rows;
mod view;

pub use groups::{CLASH_GROUP_COLUMNS, ClashGroup};
pub(super) use jobs::{ClashJobs, LONGEST_REQUEST};
pub use rows::{CLASH_COLUMNS, ClashNames, ClashPart, ClashRow, ignored_csv};
pub use view::ClashCamera;
