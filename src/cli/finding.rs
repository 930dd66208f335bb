//! Findings of a check: a line each, or JSON.

use std::{fmt::Display, io::Write as _};

use serde::Serialize;

use super::{Failure, print_json, printed, terminal};

/// The result of one check.
#[derive(Debug, Serialize)]
pub(super) struct Finding {
    what: &'static str,
    works: bool,
    /// The user's own input does not work, and must be corrected.
    must_correct: bool,
    /// The result; if it does not work, the remedy.
    detail: String,
    /// Missing parts that do no harm, and their effect.
    lacks: Vec<String>,
}

impl Finding {
    pub(super) fn new(what: &'static str, works: bool, detail: impl Display) -> Self {
        Self { what, works, must_correct: false, detail: one_line(&detail.to_string()), lacks: Vec::new() }
    }

    /// It works.
    pub(super) fn ok(what: &'static str, detail: impl Display) -> Self {
        Self::new(what, true, detail)
    }

    /// Something outside the user's input is missing.
    pub(super) fn missing(what: &'static str, detail: impl Display) -> Self {
        Self::new(what, false, detail)
    }

    /// The user's input must be corrected.
    pub(super) fn wrong(what: &'static str, detail: impl Display) -> Self {
        Self { must_correct: true, ..Self::new(what, false, detail) }
    }

    /// As the program would end there.
    pub(super) fn failed(what: &'static str, failure: &Failure) -> Self {
        if failure.may_pass() { Self::missing(what, failure) } else { Self::wrong(what, failure) }
    }

    /// With what is missing beside it without harm.
    pub(super) fn lacking(self, lacks: Vec<String>) -> Self {
        Self { lacks, ..self }
    }

    fn lines(&self) -> String {
        let mark = match (self.works, self.must_correct) {
            (true, _) => "ok      ",
            (false, false) => "MISSING ",
            (false, true) => "WRONG   ",
        };
        let lacks = self.lacks.iter().map(|lack| format!("{:16}lacks {lack}\n", ""));
        format!("{mark}{:8}{}\n", self.what, self.detail) + &lacks.collect::<String>()
    }
}

/// Prints the findings. They are a failure unless all is well: of the input, if that must be corrected.
pub(super) fn conclude(findings: &[Finding], json: bool) -> Result<(), Failure> {
    let works = findings.iter().all(|finding| finding.works);
    if json {
        print_json(&serde_json::json!({ "works": works, "findings": findings }))?;
    } else {
        printed(write!(terminal::stdout(), "{}", findings.iter().map(Finding::lines).collect::<String>()))?;
    }
    match findings.iter().any(|finding| finding.must_correct) {
        true => Err(Failure::bad_input("the configuration must be corrected; see above")),
        false if works => Ok(()),
        false => Err(Failure::broken("something that a walkthrough needs is missing; see above")),
    }
}

/// The text in one line, without the excerpt of a file that errors of TOML show.
fn one_line(text: &str) -> String {
    let is_excerpt =
        |line: &&str| line.trim_start_matches(|c: char| c.is_ascii_digit() || c == ' ').starts_with('|');
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !is_excerpt(line));
    lines.collect::<Vec<_>>().join(": ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mistake_in_a_file_is_one_line() {
        let table: Result<toml::Table, _> = "scene = 'a'\nlisten = tcp\n".parse();
        let finding = Finding::wrong("file", format!("one.toml is not valid: {}", table.unwrap_err()));
        let lines = finding.lines();
        assert!(
            lines.starts_with("WRONG   file    one.toml is not valid: TOML parse error at line 2"),
            "{lines}"
        );
        assert!(lines.matches('\n').count() == 1 && !lines.contains('|'), "{lines}");
    }

    #[test]
    fn the_exit_code_says_what_is_to_be_done() {
        let code = |findings: &[Finding]| match conclude(findings, true) {
            Ok(()) => 0,
            Err(failure) if failure.may_pass() => 1,
            Err(_) => 2,
        };
        let findings = [Finding::ok("scene", ""), Finding::missing("peer", ""), Finding::wrong("keys", "")];
        assert_eq!([1, 2, 3].map(|count| code(&findings[..count])), [0, 1, 2]);
    }
}
