//! Progress bars on a terminal; nothing in a pipe.

use indicatif::{ProgressBar, ProgressStyle};
use trimaran::walkthrough::{CameraPath, Pace};

/// A bar for `total` steps of `what`. Nothing is drawn unless standard error is a terminal.
pub(crate) fn bar(what: &'static str, total: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:>12} [{bar:32}] {pos}/{len} {eta}");
    let bar = ProgressBar::new(total).with_message(what);
    match style {
        Ok(style) => bar.with_style(style.progress_chars("=> ")),
        Err(_) => bar,
    }
}

/// A bar for a walk. The number of frames of a live walk is not known beforehand.
pub(crate) fn walk(pace: Pace, path: &CameraPath) -> ProgressBar {
    match pace {
        Pace::Lockstep => bar("walking", path.frames().into()),
        Pace::Live { .. } => {
            let style = ProgressStyle::with_template("{msg:>12} {pos} frames, {elapsed}");
            let bar = ProgressBar::no_length().with_message("walking");
            style.map_or_else(|_| bar.clone(), |style| bar.clone().with_style(style))
        }
    }
}
