//! What a run leaves behind: `report.json`, `report.html` and PNG frames, and what is printed; all from one [`Report`].

pub mod metrics;
pub mod schema;

pub use schema::{Frame, Lens, Report, Run, Summary, SweepPoint};
