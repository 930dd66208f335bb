//! How a command ends when it does not end well.

use std::{error::Error, fmt, process::ExitCode};

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
    /// It should have worked: a device, a peer or a disk failed. Exit code 1.
    Broken,
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

    pub(crate) fn exit_code(&self) -> ExitCode {
        match self.kind {
            Kind::BadInput => ExitCode::from(2),
            Kind::Broken => ExitCode::from(1),
        }
    }
}

impl fmt::Display for Failure {
    /// The error and its causes, each once: many errors name their cause in their own text.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut text = self.cause.to_string();
        f.write_str(&text)?;
        let mut next = self.cause.source();
        while let Some(cause) = next {
            let more = cause.to_string();
            if !text.contains(&more) {
                write!(f, ": {more}")?;
            }
            text = more;
            next = cause.source();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug)]
    struct Layer(&'static str, Option<Box<Self>>);

    impl fmt::Display for Layer {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str(self.0)
        }
    }

    impl Error for Layer {
        fn source(&self) -> Option<&(dyn Error + 'static)> {
            self.1.as_deref().map(|cause| cause as _)
        }
    }

    #[test]
    fn causes_are_told_once() {
        let deepest = Layer("no space left", None);
        let middle = Layer("cannot write a.scene: no space left", Some(Box::new(deepest)));
        let failure = Failure::broken(Layer("the import stopped", Some(Box::new(middle))));
        assert_eq!(failure.to_string(), "the import stopped: cannot write a.scene: no space left");
    }
}
