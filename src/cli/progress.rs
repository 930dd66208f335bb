//! Progress on a terminal, silence in a pipe.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar for `total` steps of `what`. Nothing is drawn where standard error is no terminal.
pub(crate) fn bar(what: &'static str, total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>12} [{bar:32}] {pos}/{len} {eta}");
    let bar = ProgressBar::new(total).with_message(what);
    match style {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
}
