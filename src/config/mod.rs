//! The configuration of a role in a deployment: flags, environment, file and defaults in layers, checked.
//!
//! Each key is told once, by a field of the structures here: its name in a file, its flag, its environment
//! variable, its default and its description.

#![allow(unused_qualifications, clippy::ptr_arg, reason = "as `Config` derives its layers and checks")]

mod needs;
mod options;
mod relay;
mod role;
mod role_name;
mod security;
mod shared;

use bytesize::ByteSize;
use std::{
    fs,
    path::{Path, PathBuf},
};

use confique::{Config, Layer};
use serde::{Deserialize, de::Error as _};
use thiserror::Error;
use toml::{Spanned, Table, Value, de::DeTable};
use trimaran_transport::{Endpoint, Options, keys::KeysError};

pub use needs::{RoleNeeds, SoughtPeers};
pub use options::{GivenOption, GivenOptionError, OptionKey, options};
pub use relay::{RelayConfig, RelayPeers, WatcherConfig, WatcherPeers};
pub use role::{CullerConfig, CullerPeers, DisplayConfig, DisplayPeers, SessionConfig, WhileLoading};
pub use role_name::RoleName;
pub use security::{PeerFiles, needs_keys, security};
pub use shared::{CommonConfig, GpuConfig};

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
        /// The fault and its place.
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
    /// An environment variable has a bad value for a link.
    #[error("the environment is not valid: {variable}: {cause}")]
    Variable {
        /// The variable.
        variable: String,
        /// Why.
        #[source]
        cause: GivenOptionError,
    },
    /// The options of links do not go together.
    #[error("the options of links are not valid: {cause}")]
    Options {
        /// Why.
        #[source]
        cause: Box<toml::de::Error>,
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
        /// The values that it may have.
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
    #[error("{0}{advice}", advice = advice(.0))]
    Keys(#[from] KeysError),
}

/// The fault that this program finds in it.
const fn advice(error: &KeysError) -> &'static str {
    match error {
        KeysError::Malformed { .. } | KeysError::Unusable { .. } => {
            "; `trimaran keys new NAME` makes new ones"
        }
        _ => "",
    }
}

/// The rules of a role's configuration beside its keys.
pub trait RoleConfig: Config {
    /// The paths in a layer: those in a file start at its folder.
    fn paths(layer: &mut Self::Layer) -> impl Iterator<Item = &mut PathBuf>;

    /// Checks what single values cannot show.
    ///
    /// # Errors
    /// Names the key and what is wrong with it.
    fn check(&self) -> Result<(), ConfigError>;

    /// Checks the options of the role's links.
    ///
    /// # Errors
    /// Names the key and what is wrong with it.
    fn check_links(_options: &Options) -> Result<(), ConfigError> {
        Ok(())
    }

    /// Reads the layers, each before the next: flags, the environment, `file` and the defaults. Gives the
    /// role's own keys, and the options of its links.
    ///
    /// # Errors
    /// Names the file with line and key, the variable, or the key that is nowhere.
    fn load(
        flags: Self::Layer,
        link_flags: &[GivenOption],
        file: Option<&Path>,
    ) -> Result<(Self, Options), ConfigError> {
        let environment = Self::Layer::from_env().map_err(|cause| ConfigError::Environment { cause })?;
        let none = || Ok((Self::Layer::empty(), Table::new()));
        let (file, links) = file.map_or_else(none, read::<Self>)?;
        let layers = flags.with_fallback(environment).with_fallback(file);
        let layers = layers.with_fallback(Self::Layer::default_values());
        let config = Self::from_layer(layers).map_err(|cause| ConfigError::Missing { cause })?;
        config.check()?;
        let options = options(link_flags, links)?;
        Self::check_links(&options)?;
        Ok((config, options))
    }

    /// A file with every key, its description and its default, each commented out.
    fn template() -> String {
        let own = confique::toml::template::<Self>(confique::toml::FormatOptions::default());
        // Files have no tables for shared keys.
        own.replace("[gpu]\n", "\n").replace("[common]\n", "\n") + &OptionKey::template()
    }
}

/// The layer that a file makes, and what it says of links.
fn read<C: RoleConfig>(path: &Path) -> Result<(C::Layer, Table), ConfigError> {
    let text =
        fs::read_to_string(path).map_err(|cause| ConfigError::Read { path: path.to_owned(), cause })?;
    let (mut layer, mut links) = split::<C>(&text).map_err(|mut cause| {
        cause.set_input(Some(&text));
        ConfigError::Parse { path: path.to_owned(), cause: Box::new(cause) }
    })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    for relative in C::paths(&mut layer) {
        *relative = folder.join(&*relative);
    }
    if let Some(Value::String(ca)) = links.get_mut("ws").and_then(|ws| ws.get_mut("ca")) {
        *ca = folder.join(&*ca).to_string_lossy().into_owned();
    }
    Ok((layer, links))
}

/// A role's own keys, and the tables of links. Both are read with their places in the text, for errors.
fn split<C: RoleConfig>(text: &str) -> Result<(C::Layer, Table), toml::de::Error> {
    let all = DeTable::parse(text)?;
    let span = all.span();
    let tables = OptionKey::tables();
    let (links, own): (DeTable<'_>, DeTable<'_>) =
        all.into_inner().into_iter().partition(|(key, _)| tables.iter().any(|table| key.get_ref() == table));
    let tables = tables.iter().map(String::as_str);
    let known: Vec<_> = shared::top(&C::META).map(|field| field.name).chain(tables).collect();
    if let Some(key) = own.keys().find(|key| !known.contains(&&**key.get_ref())) {
        let line = text.get(..key.span().start).unwrap_or(text).matches('\n').count() + 1;
        let (key, known) = (key.get_ref(), known.join("`, `"));
        return Err(toml::de::Error::custom(format!("line {line}: unknown key `{key}`, expected `{known}`")));
    }
    let own = shared::nested(own, &C::META);
    let deserializer = |table| toml::Deserializer::from(Spanned::new(span.clone(), table));
    Options::deserialize(deserializer(links.clone()))?;
    Ok((C::Layer::deserialize(deserializer(own))?, Table::deserialize(deserializer(links))?))
}

/// A number of seconds that can be waited.
#[allow(clippy::trivially_copy_pass_by_ref, reason = "as the derived code calls it")]
fn seconds(seconds: &f64) -> Result<(), &'static str> {
    if (0.0..=86_400.0).contains(seconds) { Ok(()) } else { Err("give 0 to 86400 seconds") }
}

/// The least memory that a device may be told to use for triangles: a large mesh's level takes most of it.
const LEAST_MEMORY: ByteSize = ByteSize::mib(1);

fn enough_memory(size: &ByteSize) -> Result<(), &'static str> {
    if *size >= LEAST_MEMORY { Ok(()) } else { Err("give 1MiB at least") }
}

/// An amount of memory, for a flag.
///
/// # Errors
/// Says what to give.
pub fn memory(text: &str) -> Result<ByteSize, String> {
    let size: ByteSize = text.parse().map_err(|_| "give an amount such as 64MiB or 2GB".to_owned())?;
    enough_memory(&size).map_err(str::to_owned)?;
    Ok(size)
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
