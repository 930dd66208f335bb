//! The command line. The help texts are the manual: each says what a thing is, its unit and its
//! default.

mod access;
#[cfg(feature = "lab")]
mod audit;
mod clash;
#[cfg(feature = "lab")]
mod compare;
mod cullers;
mod links;
mod notes;
mod roles;
mod scenes;
mod serve;
#[cfg(feature = "lab")]
mod sim;
mod walks;

use std::path::PathBuf;

use clap::{Parser, Subcommand};
use clap_complete::Shell;

pub(crate) use access::{AccessArgs, TokenCommand};
#[cfg(feature = "lab")]
pub(crate) use audit::{AuditCommand, HardArgs, SearchArgs};
pub(crate) use clash::ClashArgs;
#[cfg(feature = "lab")]
pub(crate) use compare::CompareArgs;
pub(crate) use cullers::CullerArgs;
#[cfg(feature = "lab")]
pub(crate) use cullers::ScheduleArg;
#[cfg(feature = "lab")]
pub(crate) use links::NetemArgs;
pub(crate) use links::{Coding, PingArgs, StatArgs, StatusArgs};
pub(crate) use notes::NotesArgs;
pub(crate) use roles::{
    CheckArgs, ConfigCommand, DeploymentArgs, DoctorArgs, KeysCommand, RoleArgs, RoleCommand,
};
pub(crate) use scenes::{GenerateArgs, ImportArgs, InfoArgs, Kind, Origin, ReadingArgs, Up};
pub(crate) use serve::{DeviceArgs, GuestArgs, ServeArgs, ViewArgs};
#[cfg(feature = "lab")]
pub(crate) use sim::{SimArgs, SimLink};
#[cfg(feature = "lab")]
pub(crate) use walks::SweepArgs;
pub(crate) use walks::{DemoArgs, LinkKind, OcclusionTestArg, ReportArgs, RunArgs, Size, WalkArgs};

/// Walk through CAD models of process plants with tens of millions of triangles.
///
/// Cullers find out what is visible in a frame, and a display shows it. A typical first hour:
///
///   trimaran view plant/*.rvm                     walk your own model in your browser
///   trimaran doctor                               what this machine can do
///   trimaran demo                                 a walk through a generated plant
///   trimaran import plant/*.rvm -o plant.scene    a model for the commands below
///   trimaran serve plant.scene                    the same page for others
///   trimaran run plant.scene --out walk           a walk by itself; open walk/report.html
#[derive(Debug, Parser)]
#[command(
    name = "trimaran",
    version,
    verbatim_doc_comment,
    arg_required_else_help = true,
    max_term_width = 110
)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,
    /// Log more: -v what is done, -vv each frame, -vvv each message. `TRIMARAN_LOG` takes a tracing filter
    /// instead.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Walk a model in your browser: reads and cooks it if it has changed, and opens a page of this machine.
    View(ViewArgs),
    /// Read CAD files and cook them into one scene.
    Import(ImportArgs),
    /// Generate a plant or a tanker and cook it: models of any size for machines without data.
    Generate(GenerateArgs),
    /// Say what a cooked scene holds.
    Info(InfoArgs),
    /// Find clashes: pairs of objects that touch, intersect or are too near each other, at full detail.
    Clash(ClashArgs),
    /// Serve a scene to browsers: they show a page in which to walk. Displays join as well, at
    /// ws://HOST:PORT/link?token=TOKEN, with TLS at wss://.
    Serve(ServeArgs),
    /// List the notes that people have written on a scene, and exchange them with other programs as BCF.
    Notes(NotesArgs),
    /// Walk a camera through a scene with the three roles and write a report.
    Run(RunArgs),
    /// Add to a report the pictures and checks that were left out when its walk was stopped; or put many walks
    /// on one page.
    Report(ReportArgs),
    /// Walk the same path at several error bounds: speed against error.
    #[cfg(feature = "lab")]
    Sweep(SweepArgs),
    /// Walk the same path with other systems, those of the paper among them: speed, what is drawn, error.
    #[cfg(feature = "lab")]
    Compare(CompareArgs),
    /// Check culling on cases made for it.
    #[cfg(feature = "lab")]
    #[command(subcommand)]
    Audit(AuditCommand),
    /// Simulate the three roles on a network: frame latency and bandwidth by transport, before a cable is
    /// bought.
    #[cfg(feature = "lab")]
    Sim(SimArgs),
    /// Put a network of the simulator between real programs: network namespaces whose packets are late, lost
    /// or queued.
    #[cfg(feature = "lab")]
    Netem(NetemArgs),
    /// Run one role of a deployment on several machines.
    #[command(subcommand)]
    Role(Box<RoleCommand>),
    /// Print a role's configuration file with every key, its environment variable, its default and what it
    /// means; or check a file.
    #[command(subcommand)]
    Config(ConfigCommand),
    /// Make and show the keys by which machines know each other where a transport encrypts.
    #[command(subcommand)]
    Keys(KeysCommand),
    /// Make the files of a display and its cullers as services: keys, configurations and a script that installs
    /// them, in a folder for each machine.
    Deployment(DeploymentArgs),
    /// Make tokens by which people open a page of `serve`.
    #[command(subcommand)]
    Token(TokenCommand),
    /// Measure round trips over any transport, of a camera or of a frame of ids.
    Ping(PingArgs),
    /// Watch what the links of a running role carry, its frames and their latency.
    Stat(StatArgs),
    /// Say how a running role is, in one line. The exit code is that of a monitoring plugin: 0 it works, 1 it
    /// lacks a culler or is full, 2 it does not work, 3 unknown.
    Status(StatusArgs),
    /// Generate a plant, walk through it and say where the report is.
    Demo(DemoArgs),
    /// Check GPU, memory and sockets: what works, what is missing, what to install.
    Doctor(DoctorArgs),
    /// Print completions for a shell.
    Completions {
        /// The shell to print them for.
        shell: Shell,
    },
    /// Write the manual pages: one for the program, and one for each command.
    Man {
        /// The folder, such as /usr/local/share/man/man1.
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use trimaran::config::positive;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    /// A unit of systemd and a container give variables.
    #[test]
    fn each_flag_of_serve_has_a_variable() {
        let command = Cli::command();
        let serve = command.find_subcommand("serve").unwrap();
        let flags = serve.get_arguments().filter(|arg| !arg.is_positional());
        let missing: Vec<_> = flags.filter(|arg| arg.get_env().is_none()).map(|arg| arg.get_id()).collect();
        // Each option of links has a variable of its own.
        assert_eq!(missing, ["options"]);
    }

    #[test]
    fn an_error_bound_is_a_number_above_zero() {
        assert_eq!(positive("0.5"), Ok(0.5));
        for bad in ["0", "-1", "NaN", "inf", "two"] {
            assert!(positive(bad).is_err(), "{bad:?} was taken");
        }
    }
}
