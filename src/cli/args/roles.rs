//! One role of a deployment, its keys, and what the machine can do.

use std::{net::SocketAddr, path::PathBuf};

use clap::{Args, Subcommand, ValueEnum};
use confique::Config;
use trimaran::config::{CullerConfig, DisplayConfig, RelayConfig, WatcherConfig};
use trimaran_transport::Name;

use super::links::LinkFlags;

#[derive(Debug, Subcommand)]
pub(crate) enum RoleCommand {
    /// A culler: draws occluders and tests boxes for the displays that come.
    Culler(Box<RoleArgs<<CullerConfig as Config>::Layer>>),
    /// The display: shows the pictures, holds the camera and deals frames to cullers.
    Display(Box<RoleArgs<<DisplayConfig as Config>::Layer>>),
    /// A relay: passes the frames of one display on to many that watch.
    Relay(Box<RoleArgs<<RelayConfig as Config>::Layer>>),
    /// A display that watches: draws the frames that come through a relay.
    Watcher(Box<RoleArgs<<WatcherConfig as Config>::Layer>>),
}

/// The arguments of a role. A flag overrides its environment variable, the variable overrides the file, and
/// the file the default.
#[derive(Debug, Args)]
pub(crate) struct RoleArgs<L: Args> {
    /// The role's configuration (TOML); `trimaran config` prints one with every key.
    #[arg(long, value_name = "F.toml", env = "TRIMARAN_CONFIG")]
    pub(crate) config: Option<PathBuf>,
    /// Stop when standard input ends: the role of a process that may be killed.
    #[arg(long, hide = true)]
    pub(crate) until_input_ends: bool,
    #[command(flatten)]
    pub(crate) flags: L,
    #[command(flatten)]
    pub(crate) links: LinkFlags,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RoleName {
    /// A culler.
    Culler,
    /// The display.
    Display,
    /// A relay.
    Relay,
    /// A display that watches.
    Watcher,
}

#[derive(Debug, Subcommand)]
pub(crate) enum KeysCommand {
    /// Make the keys of a machine: NAME.key, which is private and stays there, and NAME.pub for its peers.
    New {
        /// The machine's name: up to 64 letters, digits, dots, hyphens and underscores.
        name: Name,
        /// The folder to write both files into.
        #[arg(long, value_name = "DIR", default_value = ".")]
        out: PathBuf,
    },
    /// Print who a key file is.
    Show {
        /// A private or a public key file.
        file: PathBuf,
    },
}

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// An address whose port is to be tried for listening.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub(crate) listen: SocketAddr,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}
