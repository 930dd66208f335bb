//! Why a walk has no report.

use thiserror::Error;
use trimaran_audit::metrics::MetricError;
use trimaran_gpu::GpuError;

use super::audit::AuditError;
use crate::report::ReportError;

/// Why there is no report, or only an incomplete one.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportingError {
    /// A device failed.
    #[error("drawing the report's pictures failed")]
    Gpu(#[from] GpuError),
    /// A frame could not be checked.
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
    /// A picture does not have the expected size.
    #[error(transparent)]
    Metric(#[from] MetricError),
}
