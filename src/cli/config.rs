//! `trimaran config`: a role's configuration file with every key, or a check of one.

use trimaran::config::RoleName;

use super::{
    Failure,
    args::{CheckArgs, ConfigCommand},
    finding, role_check,
};

pub(super) fn run(command: &ConfigCommand) -> Result<(), Failure> {
    let role = match command {
        ConfigCommand::Culler => RoleName::Culler,
        ConfigCommand::Display => RoleName::Display,
        ConfigCommand::Relay => RoleName::Relay,
        ConfigCommand::Watcher => RoleName::Watcher,
        ConfigCommand::Check(CheckArgs { file, role, json }) => {
            return finding::conclude(&role_check::check(file, *role), *json);
        }
    };
    print!("{}", role.template());
    Ok(())
}
