//! The system's network settings, through iproute2's `ip`.

use std::process::Command;

use super::NetemError;

/// Runs `ip`; returns its output.
pub(super) fn ip(words: &[&str]) -> Result<String, NetemError> {
    let output = Command::new("ip").args(words).output().map_err(|cause| NetemError::NoIp { cause })?;
    if output.status.success() {
        return Ok(String::from_utf8_lossy(&output.stdout).into_owned());
    }
    let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
    Err(NetemError::Ip { command: words.join(" "), said })
}
