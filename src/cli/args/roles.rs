//! One role of a deployment, its keys, and what the machine can do.

use std::{net::SocketAddr, path::PathBuf};

use clap::{Args, Subcommand};
use confique::Config;
use trimaran::config::{CullerConfig, DisplayConfig, RelayConfig, RoleName, WatcherConfig, positive};
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
#[derive(Debug, Clone, Args)]
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

/// A role whose file to print, or a file to check.
#[derive(Debug, Subcommand)]
pub(crate) enum ConfigCommand {
    /// Print a culler's file with every key.
    Culler,
    /// Print a display's file with every key.
    Display,
    /// Print a relay's file with every key.
    Relay,
    /// Print the file of a display that watches, with every key.
    Watcher,
    /// Check a role's file without starting the role: its keys and values, the key files and their modes, the
    /// scene, the device. Exit code 2 if it must be corrected, 1 if something around it is missing.
    Check(CheckArgs),
}

#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// The role's configuration (TOML).
    #[arg(value_name = "F.toml")]
    pub(crate) file: PathBuf,
    /// The role that it is for [default: the one that has its keys].
    #[arg(long, value_enum)]
    pub(crate) role: Option<RoleName>,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
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
pub(crate) struct DeploymentArgs {
    /// The cooked scene.
    #[arg(value_name = "X.scene")]
    pub(crate) scene: PathBuf,
    /// The display's machine: its host name or IPv4 address.
    #[arg(long, value_name = "HOST")]
    pub(crate) display: Name,
    /// The cullers' machines, at most 8: the host names or IPv4 addresses by which the display finds them.
    #[arg(long, value_name = "HOST,..", value_delimiter = ',', required = true)]
    pub(crate) cullers: Vec<Name>,
    /// The folder to make.
    #[arg(long, value_name = "DIR", default_value = "deployment")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// An address whose port is to be tried for listening.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:0")]
    pub(crate) listen: SocketAddr,
    /// Check a role's configuration as well, with what `trimaran config check` leaves out: its ports, its
    /// peers by a handshake, what the service's user may open, the limit of open files.
    #[arg(long, value_name = "F.toml", conflicts_with = "listen")]
    pub(crate) config: Option<PathBuf>,
    /// The role that the configuration is for [default: the one that has its keys].
    #[arg(long, value_enum, requires = "config")]
    pub(crate) role: Option<RoleName>,
    /// The service's user [default: trimaran, if root asks and there is such a user; else the present one].
    #[arg(long, value_name = "NAME", requires = "config")]
    pub(crate) user: Option<String>,
    /// How long to wait for an answer of each peer, seconds.
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = positive, requires = "config")]
    pub(crate) timeout: f64,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}
