//! The configuration of a role in a deployment: flags, environment, file and defaults in layers, checked.
//!
//! Each key is told once, by a field of the structures here: its name in a file, its flag, its environment
//! variable, its default and its description.

#![allow(unused_qualifications, clippy::ptr_arg, reason = "as `Config` derives its layers and checks")]

mod links;
mod role;

use std::{
    fs,
    path::{Path, PathBuf},
};

use confique::{Config, Layer};
use thiserror::Error;
use trimaran_transport::{Endpoint, keys::KeysError};

pub use links::{
    FileMode, FileModeError, FrameMode, LimitsConfig, LinkConfig, PeerFile, QuicConfig, RepairMode,
    TcpConfig, UdpConfig, UdpCongestion, UdpTrust, UnixConfig,
};
pub use role::{DisplayConfig, DisplayPeers, PairSeat, SessionConfig, SwitchConfig, SwitchPeers};

/// Why a configuration could not be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}: {cause}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        cause: std::io::Error,
    },
    /// The file is not what it should be; the cause names line, column and key.
    #[error("the configuration {path} is not valid: {cause}", path = path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        #[source]
        cause: Box<toml::de::Error>,
    },
    /// An environment variable has a bad value; the cause names it.
    #[error("the environment is not valid: {cause:#}")]
    Environment {
        /// Which variable, and why.
        #[source]
        cause: confique::Error,
    },
    /// A key that has no default is nowhere; the cause names it.
    #[error("{cause}: give it in the configuration file, as a flag or in the environment")]
    Missing {
        /// Which.
        #[source]
        cause: confique::Error,
    },
    /// A value is outside its range, or does not go with another one.
    #[error("the configuration has a bad {key}: {why}")]
    Value {
        /// The key.
        key: &'static str,
        /// What it should be.
        why: &'static str,
    },
    /// An endpoint needs keys, and there are none.
    #[error(
        "{endpoint} wants both sides to prove who they are: name this machine's private keys in `keys` and the peer's public ones in \
         `{peer}` (`trimaran keys new NAME` makes both)"
    )]
    NoKeys {
        /// Where.
        endpoint: Endpoint,
        /// The key that names the peer.
        peer: &'static str,
    },
    /// A key file cannot be used.
    #[error(transparent)]
    Keys(#[from] KeysError),
}

/// What a role's configuration has beside its keys.
pub trait RoleConfig: Config {
    /// The paths in a layer: those in a file start at its folder.
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf>;

    /// Checks what single values cannot show.
    ///
    /// # Errors
    /// Names the key and what is wrong with it.
    fn check(&self) -> Result<(), ConfigError>;

    /// Reads the layers, each before the next: `flags`, the environment, `file` and the defaults.
    ///
    /// # Errors
    /// Names the file with line and key, the variable, or the key that is nowhere.
    fn load(flags: Self::Layer, file: Option<&Path>) -> Result<Self, ConfigError> {
        let environment = Self::Layer::from_env().map_err(|cause| ConfigError::Environment { cause })?;
        let file = file.map_or_else(|| Ok(Self::Layer::empty()), read::<Self>)?;
        let layers = flags.with_fallback(environment).with_fallback(file);
        let layers = layers.with_fallback(Self::Layer::default_values());
        let config = Self::from_layer(layers).map_err(|cause| ConfigError::Missing { cause })?;
        config.check()?;
        Ok(config)
    }

    /// A file with every key, its description and its default, each commented out.
    fn template() -> String {
        confique::toml::template::<Self>(confique::toml::FormatOptions::default())
    }
}

/// The layer that a file makes.
fn read<C: RoleConfig>(path: &Path) -> Result<C::Layer, ConfigError> {
    let text =
        fs::read_to_string(path).map_err(|cause| ConfigError::Read { path: path.to_owned(), cause })?;
    let mut layer = toml::from_str(&text)
        .map_err(|cause| ConfigError::Parse { path: path.to_owned(), cause: Box::new(cause) })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    for relative in C::paths(&mut layer) {
        *relative = folder.join(&*relative);
    }
    Ok(layer)
}

/// A number of seconds that can be waited.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "as the derived code calls it")]
fn seconds(seconds: &f64) -> Result<(), &'static str> {
    if (0.0..=86_400.0).contains(seconds) { Ok(()) } else { Err("give 0 to 86400 seconds") }
}

/// A number above zero, for a flag.
///
/// # Errors
/// Says what to give.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("give a number above 0".to_owned()),
    }
}

#[cfg(test)]
mod tests;
