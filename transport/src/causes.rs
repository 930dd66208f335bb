//! Errors in one line.

use std::error::Error;

/// An error and its causes, each once: many errors repeat their cause in their own text.
#[must_use]
pub fn causes(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let (mut last, mut next) = (text.clone(), error.source());
    while let Some(cause) = next {
        let more = cause.to_string();
        if !last.contains(&more) {
            text.push_str(": ");
            text.push_str(&more);
        }
        (last, next) = (more, cause.source());
    }
    text
}

#[cfg(test)]
mod tests {
    use std::fmt;

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
        let failure = Layer("the import stopped", Some(Box::new(middle)));
        assert_eq!(causes(&failure), "the import stopped: cannot write a.scene: no space left");
    }
}
