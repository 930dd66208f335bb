//! The command-line tool: one file per command.

// Before all others, which use its macros.
#[macro_use]
mod terminal;

mod access;
mod address;
mod args;
#[cfg(feature = "lab")]
mod audit;
mod browser;
mod clash;
#[cfg(feature = "lab")]
mod compare;
mod config;
mod cooking;
mod culling;
mod demo;
mod deployment;
mod display;
mod doctor;
mod failure;
mod finding;
mod generate;
mod import;
mod info;
mod keys;
mod log;
mod man;
#[cfg(all(feature = "lab", target_os = "linux"))]
mod netem;
mod notes;
mod output;
mod ping;
mod preparing;
mod processes;
mod progress;
mod reconfigure;
mod recording;
mod relay;
mod reload;
mod report;
mod role;
mod role_check;
mod run;
mod serve;
mod served;
mod service_manager;
#[cfg(feature = "lab")]
mod sim;
mod stat;
mod status;
mod stopping;
#[cfg(feature = "lab")]
mod sweep;
mod token;
mod view;
mod walking;
#[cfg(feature = "window")]
mod window;

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use indicatif::HumanCount;
use serde::Serialize;

use args::{Cli, Command};
use failure::Failure;

/// Runs the command line given to this process.
pub(crate) fn main() -> ExitCode {
    let cli = Cli::parse();
    // Otherwise thousands of simulated links, a comparison's walks and a window with too few cores would
    // repeat the same warnings.
    let is_quiet = match &cli.command {
        #[cfg(feature = "lab")]
        Command::Sim(_) | Command::Compare(_) | Command::Audit(_) => true,
        Command::View(args) => args.window,
        _ => false,
    };
    // Services tell the journal what they do.
    let is_service = matches!(cli.command, Command::Role(_) | Command::Serve(_)) && log::is_journal();
    let usual = match (is_quiet, is_service) {
        (true, _) => "error",
        (false, true) => "info",
        (false, false) => "warn",
    };
    if let Err(failure) = log::to_stderr(cli.verbose, usual) {
        eprintln!("trimaran: {failure}");
        return failure.exit_code();
    }
    match &cli.command {
        Command::Status(args) => return status::run(args),
        Command::Clash(args) => return clash::run(args),
        _ => {}
    }
    match dispatch(cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            tracing::error!(target: log::SAID, "{failure}");
            failure.exit_code()
        }
    }
}

fn dispatch(command: Command) -> Result<(), Failure> {
    match command {
        Command::View(args) => view::run(&args),
        Command::Import(args) => import::run(&args),
        Command::Generate(args) => generate::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Doctor(args) => doctor::run(&args),
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Cli::command(), "trimaran", &mut io::stdout());
            Ok(())
        }
        Command::Man { folder } => man::run(&folder),
        Command::Serve(args) => serve::run(&args),
        Command::Notes(args) => notes::run(&args),
        Command::Run(args) => run::run(&args),
        Command::Report(args) => report::run(&args),
        #[cfg(feature = "lab")]
        Command::Sweep(args) => sweep::run(&args),
        #[cfg(feature = "lab")]
        Command::Compare(args) => compare::run(&args),
        #[cfg(feature = "lab")]
        Command::Audit(command) => audit::run(&command),
        #[cfg(feature = "lab")]
        Command::Sim(args) => sim::run(&args),
        #[cfg(all(feature = "lab", target_os = "linux"))]
        Command::Netem(args) => netem::run(&args),
        #[cfg(all(feature = "lab", not(target_os = "linux")))]
        Command::Netem(_) => {
            Err(Failure::bad_input("emulating a network needs Linux's network namespaces and TUN devices"))
        }
        Command::Role(command) => role::run(&command),
        Command::Config(command) => config::run(&command),
        Command::Keys(command) => keys::run(&command),
        Command::Deployment(args) => deployment::run(&args),
        Command::Token(command) => token::run(&command),
        Command::Ping(args) => ping::run(&args),
        Command::Stat(args) => stat::run(&args),
        // Their exit codes are of their own.
        Command::Status(_) | Command::Clash(_) => Ok(()),
        Command::Demo(args) => demo::run(&args),
    }
}

/// Prints a value as JSON on standard output.
fn print_json(value: &impl Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::broken)?;
    printed(writeln!(terminal::stdout(), "{text}"))
}

/// Treats a closed pipe as success: a reader such as `head` has enough.
fn printed(written: io::Result<()>) -> Result<(), Failure> {
    match written {
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        written => written.map_err(Failure::broken),
    }
}

/// A count with a comma every three digits.
fn number(count: u64) -> String {
    HumanCount(count).to_string()
}

/// A count, and behind it `one` or `many`.
fn plural(count: u64, one: &str, many: &str) -> String {
    format!("{} {}", number(count), if count == 1 { one } else { many })
}
