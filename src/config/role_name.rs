//! The roles by name, and the role that a configuration file is for.

use std::{fs, path::Path};

use clap::ValueEnum;
use confique::{
    Config, Layer,
    meta::{FieldKind, LeafKind, Meta},
};
use toml::{Table, Value};
use trimaran_transport::Options;

use super::{
    ConfigError, CullerConfig, DisplayConfig, RelayConfig, RoleConfig, RoleNeeds, WatcherConfig, shared,
};

/// A role of a deployment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RoleName {
    /// A culler.
    Culler,
    /// The display.
    Display,
    /// A relay.
    Relay,
    /// A display that watches.
    Watcher,
}

impl RoleName {
    /// A role's name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Culler => "culler",
            Self::Display => "display",
            Self::Relay => "relay",
            Self::Watcher => "watcher",
        }
    }

    /// A configuration file with every key.
    #[must_use]
    pub fn template(self) -> String {
        match self {
            Self::Culler => CullerConfig::template(),
            Self::Display => DisplayConfig::template(),
            Self::Relay => RelayConfig::template(),
            Self::Watcher => WatcherConfig::template(),
        }
    }

    /// Loads the configuration as the role does, from the file and this process's environment.
    ///
    /// # Errors
    /// As [`RoleConfig::load`].
    pub fn load(self, file: &Path) -> Result<(Box<dyn RoleNeeds>, Options), ConfigError> {
        fn loaded<C: RoleConfig + RoleNeeds + 'static>(
            file: &Path,
        ) -> Result<(Box<dyn RoleNeeds>, Options), ConfigError> {
            let (config, options) = C::load(C::Layer::empty(), &[], Some(file))?;
            Ok((Box::new(config), options))
        }
        match self {
            Self::Culler => loaded::<CullerConfig>(file),
            Self::Display => loaded::<DisplayConfig>(file),
            Self::Relay => loaded::<RelayConfig>(file),
            Self::Watcher => loaded::<WatcherConfig>(file),
        }
    }

    /// The role that a file is for, by its keys: the one that has most of them and misses fewest.
    ///
    /// # Errors
    /// If the file cannot be read, or is no TOML.
    pub fn of_file(file: &Path) -> Result<Self, ConfigError> {
        let text =
            fs::read_to_string(file).map_err(|cause| ConfigError::Read { path: file.to_owned(), cause })?;
        let table: Result<Table, _> = text.parse();
        let invalid = |cause| ConfigError::Parse { path: file.to_owned(), cause: Box::new(cause) };
        Ok(Self::of_keys(&table.map_err(invalid)?))
    }

    fn of_keys(file: &Table) -> Self {
        let fits = |role: Self| match role {
            Self::Culler => fit(file, &CullerConfig::META),
            Self::Display => fit(file, &DisplayConfig::META),
            Self::Relay => fit(file, &RelayConfig::META),
            Self::Watcher => fit(file, &WatcherConfig::META),
        };
        // Of equals the first.
        let others = [Self::Display, Self::Relay, Self::Watcher].into_iter();
        others.fold(Self::Culler, |best, role| if fits(role) > fits(best) { role } else { best })
    }
}

/// How many keys of a file a role has, less those that the role needs and the file lacks.
fn fit(file: &Table, role: &Meta) -> i64 {
    let fields = shared::top(role).map(|field| match (field.kind, file.get(field.name)) {
        (FieldKind::Nested { meta }, Some(Value::Table(table))) => {
            1 + table.keys().filter(|key| meta.fields.iter().any(|field| field.name == *key)).count() as i64
        }
        (FieldKind::Leaf { kind: LeafKind::Required { default: None }, .. }, None) => -1,
        (_, Some(_)) => 1,
        (_, None) => 0,
    });
    fields.sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_files_keys_say_which_role_it_is_for() {
        use RoleName::{Culler, Display, Relay, Watcher};
        for (text, role) in [
            ("scene = 'a'\nlisten = 'tcp://x:1'", Culler),
            ("scene = 'a'\ndisplays = 'tcp://x:1'", Culler),
            ("scene = 'a'\nlisten = 'tcp://x:1'\ncullers = 'tcp://y:1'\npeers.displays = ['d.pub']", Culler),
            ("scene = 'a'\ncullers = 'tcp://x:1'\nout = 'walk'", Display),
            ("scene = 'a'\nlisten = 'tcp://x:1'\nout = 'walk'\npeers.cullers = ['one.pub']", Display),
            ("cullers = 'tcp://x:1'\n[session]\npath = 'p.json'", Display),
            ("upstream = 'tcp://x:1'\nlisten = 'tcp://y:1'\nlimits.peers = 256", Relay),
            ("scene = 'a'\nrelay = 'tcp://x:1'", Watcher),
            // With a mistake in it, which loading names.
            ("scene = 'a'\nlissten = 'tcp://x:1'\nmax_picture = '64x64'", Culler),
            ("scene = 'a'\ncullers = 'tcp://x:1'\nout = 'walk'\nsesion = 1", Display),
        ] {
            assert_eq!(RoleName::of_keys(&text.parse().unwrap()), role, "{text}");
        }
    }
}
