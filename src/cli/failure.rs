//! Failures of a command, with their exit codes.

use std::{error::Error, fmt, process::ExitCode};

use trimaran_transport::causes;

/// Why a command ended early, and its exit code for scripts.
#[derive(Debug)]
pub(crate) struct Failure {
    kind: Kind,
    cause: Box<dyn Error + Send + Sync>,
}

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// The user's input cannot be used: a file, a flag, a configuration. Exit code 2.
    BadInput,
    /// A device, a peer or a disk failed. Exit code 1: it may work another time.
    Broken,
    /// It ended early, and the part that was done is reported. Exit code 3: another run would begin anew.
    Incomplete,
    /// It was asked to stop before it had done anything. Exit code 1.
    Stopped,
}

impl Failure {
    /// The user's input cannot be used.
    pub(crate) fn bad_input(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { kind: Kind::BadInput, cause: cause.into() }
    }

    /// Something else than the input failed.
    pub(crate) fn broken(cause: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self { kind: Kind::Broken, cause: cause.into() }
    }

    /// It ended early, and the part that was done is reported.
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

    /// Whether it may work another time with the same input.
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
    /// The error and its causes, each once: the text of many errors already contains their cause.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&causes(&*self.cause))
    }
}
