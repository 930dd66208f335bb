//! `trimaran man`: the manual pages.

use std::{fs, path::Path};

use clap::CommandFactory;

use super::{Failure, args::Cli};

/// Writes a page for the program and one for each of its commands.
pub(super) fn run(folder: &Path) -> Result<(), Failure> {
    fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(Cli::command(), folder))
        .map_err(|cause| Failure::bad_input(format!("cannot write to {}: {cause}", folder.display())))
}
