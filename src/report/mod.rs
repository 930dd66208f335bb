//! The output of a run: `report.json`, `report.html`, PNG frames and the printed summary, all from one
//! [`Report`].
//!
//! A run passes frames and pictures to a [`Writer`] as they come, makes a [`Report`] of the frames and has
//! the writer put it beside them.

mod bandwidth;
mod error;
pub(crate) mod format;
pub(crate) mod html;
pub(crate) mod interval;
mod left;
pub mod many_walks;
mod pictures;
#[cfg(test)]
pub(crate) mod sample;
pub mod schema;
pub mod text;
mod unfinished;
mod whole_file;
mod write;

pub use bandwidth::FrameLoad;
pub use error::ReportError;
#[cfg(feature = "lab")]
pub(crate) use error::io_error;
pub use left::Left;
pub use pictures::PictureKind;
pub use schema::{Frame, Projection, Report, Run, Summary, SweepPoint};
pub use whole_file::{write_whole, write_whole_by};
pub use write::{Paths, UNCHECKED, Writer, write};
