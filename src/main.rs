//! The command-line tool; `cli` has a file a command.

mod cli;

fn main() -> std::process::ExitCode {
    cli::main()
}
