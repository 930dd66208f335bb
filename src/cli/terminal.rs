//! Standard output and standard error: the only module through which text from files and peers comes to a
//! terminal. Its macros replace the standard ones within the whole command line.

use std::{
    borrow::Cow,
    fmt,
    io::{self, Write},
};

/// As [`std::print`], without control characters, and without a panic if the reader has gone.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::terminal::out(format_args!($($text)*), "") };
}

/// As [`std::println`], likewise.
macro_rules! println {
    ($($text:tt)*) => { $crate::cli::terminal::out(format_args!($($text)*), "\n") };
}

/// As [`std::eprintln`], likewise. Lines after the first are indented, so that no text can pass for a line of
/// its own.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::cli::terminal::err(format_args!($($text)*)) };
}

/// Prints on standard output. Text that cannot be printed is dropped.
pub(super) fn out(text: fmt::Arguments<'_>, end: &str) {
    let _nobody_reads = write!(stdout(), "{text}{end}");
}

/// Prints a line on standard error. Text that cannot be printed is dropped.
pub(super) fn err(text: fmt::Arguments<'_>) {
    let _nobody_reads = stderr().write_all(format!("{text}\n").as_bytes());
}

pub(super) fn stdout() -> Plain<io::Stdout> {
    Plain { to: io::stdout(), indent: "" }
}

pub(super) fn stderr() -> Plain<io::Stderr> {
    Plain { to: io::stderr(), indent: "  " }
}

/// Text from a file or a peer for the middle of a line: line breaks and tabs are escaped as well.
pub(super) fn word(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_control(c) || matches!(c, '\n' | '\t'))
}

/// Escapes control characters in its text, except line breaks and tabs.
#[derive(Debug)]
pub(super) struct Plain<W> {
    to: W,
    /// Precedes each line but the first of a write.
    indent: &'static str,
}

impl<W: Write> Write for Plain<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes);
        let text = escaped(&text, is_control);
        match (self.indent, text.trim_end_matches('\n')) {
            ("", _) => self.to.write_all(text.as_bytes())?,
            (indent, lines) => {
                let end = text.get(lines.len()..).unwrap_or_default();
                let lines = lines.replace('\n', &format!("\n{indent}"));
                self.to.write_all(format!("{lines}{end}").as_bytes())?;
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

/// Characters that may begin a terminal command, or change the direction of text.
fn is_control(c: char) -> bool {
    let turns = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    turns || c.is_control() && !matches!(c, '\n' | '\t')
}

/// Writes some characters as JSON escapes, which mean the same in a string.
fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut plain = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_escaped(c) {
            plain.push_str(&format!("\\u{:04x}", u32::from(c)));
        } else {
            plain.push(c);
        }
    }
    Cow::Owned(plain)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(text: &str, indent: &'static str) -> String {
        let mut plain = Plain { to: Vec::new(), indent };
        plain.write_all(text.as_bytes()).unwrap();
        String::from_utf8(plain.to).unwrap()
    }

    #[test]
    fn control_characters_are_escaped_and_lines_of_an_error_are_indented() {
        let title = "a\u{1b}]0;PWNED\u{7}b\r\u{9b}31m\u{202e}c\td\n";
        assert_eq!(written(title, ""), "a\\u001b]0;PWNED\\u0007b\\u000d\\u009b31m\\u202ec\td\n");
        assert_eq!(written("one\nfake line\n", "  "), "one\n  fake line\n");
        assert_eq!(word("x\nfake\tline"), "x\\u000afake\\u0009line");
        assert_eq!(word("plain, für"), "plain, für");
    }

    proptest! {
        #[test]
        fn nothing_reaches_a_terminal_but_text_and_lines(text in any::<String>()) {
            for indent in ["", "  "] {
                prop_assert!(written(&text, indent).chars().all(|c| !is_control(c)));
            }
            prop_assert!(word(&text).chars().all(|c| !c.is_control()));
        }

        /// JSON stays valid, with the same value.
        #[test]
        fn json_means_the_same(text in any::<String>()) {
            let json = serde_json::to_string(&text).unwrap();
            let read: String = serde_json::from_str(&written(&json, "")).unwrap();
            prop_assert_eq!(read, text);
        }
    }
}
