//! Why a walk has no report.

use thiserror::Error;
use trimaran_gpu::GpuError;

#[cfg(feature = "lab")]
use super::audit::AuditError;
use super::redraw::RedrawError;
use crate::report::ReportError;

/// Why there is no report, or only an incomplete one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportingError {
    /// A device failed.
    #[error("drawing the report's pictures failed")]
    Gpu(#[from] GpuError),
    /// A picture could not be drawn again.
    #[error(transparent)]
    Redraw(#[from] RedrawError),
    /// A frame could not be checked.
    #[cfg(feature = "lab")]
    #[error(transparent)]
    Audit(#[from] AuditError),
    /// It was cancelled.
    #[error("interrupted: `trimaran report DIR` adds what is missing to the report in the folder DIR")]
    Interrupted,
    /// Writing failed.
    #[error(transparent)]
    Write(#[from] ReportError),
    /// The system gave no thread to write on.
    #[error("cannot start a thread to write on")]
    Thread(#[source] std::io::Error),
}
