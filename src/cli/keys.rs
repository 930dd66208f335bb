//! `trimaran keys`: the keys by which machines authenticate each other on encrypted transports.

use std::path::Path;

use trimaran::config::ConfigError;
use trimaran_transport::{
    Name,
    keys::{Keys, KeysError, PublicKeys},
};

use super::{Failure, args::KeysCommand};

pub(super) fn run(command: &KeysCommand) -> Result<(), Failure> {
    match command {
        KeysCommand::New { name, out } => new(name, out),
        KeysCommand::Show { file } => show(file),
    }
}

fn new(name: &Name, folder: &Path) -> Result<(), Failure> {
    let keys = Keys::generate(name.clone()).map_err(Failure::broken)?;
    let files = keys.save(folder).map_err(Failure::bad_input)?;
    println!("{}  private: stays on this machine, readable by its owner only", files.private.display());
    println!("{}  public: copy it to the machines that {name} talks to", files.public.display());
    print(keys.public());
    Ok(())
}

fn show(file: &Path) -> Result<(), Failure> {
    let public = |file| PublicKeys::read(file).map(|keys| ("public", keys));
    let private = |file| Keys::read(file).map(|keys| ("private", keys.public().clone()));
    let shown = if file.extension().is_some_and(|ending| ending == "pub") {
        public(file)
    } else {
        private(file).or_else(|e| if matches!(e, KeysError::Public { .. }) { public(file) } else { Err(e) })
    };
    let (kind, public) = shown.map_err(|e| Failure::bad_input(ConfigError::from(e)))?;
    println!("{} ({kind})", public.name);
    print(&public);
    Ok(())
}

fn print(keys: &PublicKeys) {
    if let Some(quic) = keys.quic {
        println!("  quic  {quic}");
    }
    println!("  udp   {}", keys.udp);
}
