//! `trimaran deployment`: the files of a display and its cullers, in a folder for each machine.

use std::{
    collections::HashSet,
    fs::{self, Permissions},
    io,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
};

use tempfile::Builder;
use thiserror::Error;
use toml::Value;
use trimaran_actors::CullerId;
use trimaran_transport::{
    Name,
    keys::{Keys, KeysError},
};

use super::{Failure, args::DeploymentArgs, walking};

/// The port at which the cullers listen.
const PORT: u16 = 7400;
/// The address of each role's metrics.
const METRICS: &str = "127.0.0.1:9464";

/// Why the files were not made. Then none is left.
#[derive(Debug, Error)]
enum DeploymentError {
    /// A host would have to play two roles.
    #[error("the host {0} is given twice: give each role a machine of its own")]
    Twice(Name),
    /// More cullers than a display takes.
    #[error("{0} cullers are too many for a display: give at most {most}", most = CullerId::MOST)]
    TooMany(usize),
    /// The name would be a flag or a hidden folder.
    #[error("{0} is no host: a host's name begins with a letter or a digit")]
    Host(Name),
    /// The folder exists.
    #[error("{} is there already: remove it, or give another folder with --out", .0.display())]
    Exists(PathBuf),
    /// The keys could not be made.
    #[error("the keys could not be made")]
    Keys(#[from] KeysError),
    /// A file could not be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

pub(super) fn run(args: &DeploymentArgs) -> Result<(), Failure> {
    walking::open(&args.scene)?;
    make(args).map_err(|error| match error {
        DeploymentError::Keys(_) | DeploymentError::Write { .. } => Failure::broken(error),
        _ => Failure::bad_input(error),
    })?;
    let DeploymentArgs { out, display, cullers, .. } = args;
    for host in cullers.iter().chain([display]) {
        println!("{}  copy it to {host}, and run its install.sh there", out.join(host.as_str()).display());
    }
    println!("They have private keys: remove {} once the machines are installed.", out.display());
    Ok(())
}

/// Makes the folder whole, or not at all. Only its owner may read it, as it has private keys.
fn make(args: &DeploymentArgs) -> Result<(), DeploymentError> {
    let DeploymentArgs { scene, display, cullers, out } = args;
    if cullers.len() > CullerId::MOST {
        return Err(DeploymentError::TooMany(cullers.len()));
    }
    check_hosts(cullers.iter().chain([display]))?;
    if out.symlink_metadata().is_ok() {
        return Err(DeploymentError::Exists(out.clone()));
    }
    let beside = out.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(beside).map_err(failed(beside))?;
    let made = Builder::new()
        .prefix(".deployment-")
        .permissions(Permissions::from_mode(0o700))
        .tempdir_in(beside)
        .map_err(failed(beside))?;
    // A symbolic link would be linked as it is.
    let source = scene.canonicalize().map_err(failed(scene))?;
    let mut scene = source.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if !scene.ends_with(".scene") {
        scene.push_str(".scene");
    }
    let folder = |host: &Name| made.path().join(host.as_str());
    for host in cullers.iter().chain([display]) {
        let folder = folder(host);
        Keys::generate(host.clone())?.save(&folder)?;
        let Files { role, configuration, install } = files(args, host, &scene);
        write(&folder.join(format!("{role}.toml")), &configuration)?;
        write(&folder.join("install.sh"), &install)?;
        let copy = folder.join(&scene);
        // A hard link takes no more room.
        fs::hard_link(&source, &copy)
            .or_else(|_| fs::copy(&source, &copy).map(drop))
            .map_err(failed(&copy))?;
    }
    for host in cullers.iter().chain([display]) {
        for peer in cullers.iter().chain([display]).filter(|peer| *peer != host) {
            copy_public(peer, &folder(peer), &folder(host))?;
        }
    }
    fs::rename(made.path(), out).map_err(failed(out))?;
    let _moved = made.keep();
    Ok(())
}

/// Each host has one role.
fn check_hosts<'n>(hosts: impl Iterator<Item = &'n Name>) -> Result<(), DeploymentError> {
    let mut seen = HashSet::new();
    for host in hosts {
        if !host.as_str().starts_with(|first: char| first.is_ascii_alphanumeric()) {
            return Err(DeploymentError::Host(host.clone()));
        }
        if !seen.insert(host) {
            return Err(DeploymentError::Twice(host.clone()));
        }
    }
    Ok(())
}

/// The text files of a machine.
struct Files {
    /// The name of its configuration.
    role: String,
    configuration: String,
    install: String,
}

fn files(DeploymentArgs { display, cullers, .. }: &DeploymentArgs, host: &Name, scene: &str) -> Files {
    let is_display = host == display;
    let (kind, role, service) = if is_display {
        ("display", "display".to_owned(), "trimaran-display".to_owned())
    } else {
        ("culler", host.to_string(), format!("trimaran-culler@{host}"))
    };
    let peers: Vec<_> = cullers.iter().filter(|culler| *culler != host).collect();
    let mut configuration = format!("# The {kind} {host}. Every key: trimaran config {kind}\n");
    let mut key = |name: &str, value: Value| configuration.push_str(&format!("{name} = {value}\n"));
    key("scene", scene.into());
    key("keys", format!("/run/credentials/{service}.service/keys").into());
    key("metrics", METRICS.into());
    if is_display {
        key("out", "/var/lib/trimaran/walk".into());
    } else {
        key("listen", format!("quic://0.0.0.0:{PORT}").into());
        key("peers.displays", Value::Array(vec![format!("{display}.pub").into()]));
    }
    // Cullers meet each other in the schedule `switch`.
    if !peers.is_empty() {
        let list =
            |each: fn(&Name) -> String| Value::Array(peers.iter().map(|peer| each(peer).into()).collect());
        key("cullers", list(|culler| format!("quic://{culler}:{PORT}")));
        key("peers.cullers", list(|culler| format!("{culler}.pub")));
    }
    let start = if is_display {
        format!("echo 'systemctl start {service} walks'")
    } else {
        format!("systemctl enable {service}\nsystemctl restart {service}")
    };
    let install = format!(
        "#!/bin/sh\n# Installs the {kind} {host} as a service. Run it as root; the package must be there.\n\
         set -eu\ncd \"$(dirname \"$0\")\"\n\
         install -D -g trimaran -m 640 -t /etc/trimaran ./*.toml ./*.pub ./*.scene\n\
         install -D -m 600 '{host}.key' '/etc/credstore/trimaran-{role}.key'\n{start}\n"
    );
    Files { role, configuration, install }
}

/// Copies a peer's public keys.
fn copy_public(peer: &Name, from: &Path, to: &Path) -> Result<(), DeploymentError> {
    let file = format!("{peer}.pub");
    let copy = to.join(&file);
    fs::copy(from.join(&file), &copy).map(drop).map_err(failed(&copy))
}

fn write(path: &Path, text: &str) -> Result<(), DeploymentError> {
    fs::write(path, text).map_err(failed(path))
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> DeploymentError + use<> {
    let path = path.to_owned();
    move |source| DeploymentError::Write { path, source }
}
