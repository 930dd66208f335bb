//! How a command ends when it does not end well.

use std::{error::Error, fmt, process::ExitCode};

use trimaran_transport::causes;

/// Why a command ended early, and the exit code that says so to a script.
#[derive(Debug)]
pub(crate) struct Failure {
    kind: Kind,
    cause: Box<dyn Error + Send + Sync>,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// What the user gave cannot be used: a file, a flag, a configuration. Exit code 2.
    BadInput,
    /// It should have worked: a device, a peer or a disk failed. Exit code 1: it may work another time.
    Broken,
    /// It ended before its end, and what was done is reported. Exit code 3: another time would begin anew.
    Incomplete,
    /// It was asked to stop before it had done anything. Exit code 1.
    Stopped,
}

impl Failure {
    /// What the user gave cannot be used.
    pub(crate) fn bad_input(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { kind: Kind::BadInput, cause: cause.into() }
    }

    /// Something failed that the input is not to blame for.
    pub(crate) fn broken(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { kind: Kind::Broken, cause: cause.into() }
    }

    /// It ended before its end, and what was done is reported.
    pub(crate) fn incomplete(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { kind: Kind::Incomplete, cause: cause.into() }
    }

    /// It was asked to stop before it had done anything.
    pub(crate) fn stopped(cause: &'static str) -> Self {
        Self { kind: Kind::Stopped, cause: cause.into() }
    }

    /// Whether it was only asked to stop.
    pub(crate) const fn is_stop(&self) -> bool {
        matches!(self.kind, Kind::Stopped)
    }

    /// Whether it may work another time though nothing is changed in what the user gave.
    pub(crate) const fn may_pass(&self) -> bool {
        matches!(self.kind, Kind::Broken)
    }

    pub(crate) fn exit_code(&self) -> ExitCode {
        match self.kind {
            Kind::BadInput => ExitCode::from(2),
            Kind::Broken | Kind::Stopped => ExitCode::from(1),
            Kind::Incomplete => ExitCode::from(3),
        }
    }
}

impl Error for Failure {}

impl fmt::Display for Failure {
    /// The error and its causes, each once: many errors name their cause in their own text.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&causes(&*self.cause))
    }
}
