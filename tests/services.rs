//! The systemd units of `deploy/systemd`: their commands exist, and end with the codes by which they are started again or not.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

const UNITS: [&str; 2] = ["switch", "display"];
const INSTALLED: &str = "/usr/bin/trimaran";
/// The exit code for what waiting does not mend.
const UNUSABLE: i32 = 2;

fn unit(role: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/systemd");
    fs::read_to_string(folder.join(format!("trimaran-{role}.service"))).unwrap()
}

/// What a unit says for a key that it has once.
fn value<'u>(unit: &'u str, key: &str) -> &'u str {
    let values: Vec<&str> =
        unit.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('=')).collect();
    let [value] = values[..] else { panic!("{key}: {values:?}") };
    value
}

/// Runs the command of a role's service with this configuration in place of the installed one.
fn serve(role: &str, folder: &TempDir, configuration: &str) -> Output {
    let unit = unit(role);
    let words: Vec<&str> = value(&unit, "ExecStart").split(' ').collect();
    let [program, arguments @ .., installed] = &words[..] else { panic!("{words:?}") };
    assert_eq!((*program, *installed), (INSTALLED, &*format!("/etc/trimaran/{role}.toml")));
    let path = folder.path().join("role.toml");
    fs::write(&path, configuration).unwrap();
    Command::new(env!("CARGO_BIN_EXE_trimaran")).args(arguments).arg(path).output().unwrap()
}

#[test]
fn a_configuration_that_cannot_be_used_ends_a_service_for_good() {
    let folder = tempfile::tempdir().unwrap();
    for role in UNITS {
        assert_eq!(value(&unit(role), "RestartPreventExitStatus"), UNUSABLE.to_string());
        let output = serve(role, &folder, "scene = 'none.scene'\nsaet = 'first'\n");
        assert_eq!(output.status.code(), Some(UNUSABLE), "{role}: {output:?}");
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("role.toml") && said.contains("saet"), "{role}: {said}");
    }
}

#[test]
fn a_service_whose_peers_are_not_there_is_started_again() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("plant.scene");
    let generate = ["generate", "plant", "--objects", "100", "-o"];
    let made = Command::new(env!("CARGO_BIN_EXE_trimaran")).args(generate).arg(&scene).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    let socket = format!("'unix:{}/show.sock'", folder.path().display());
    for (role, kind, configuration) in [
        ("switch", "always", format!("seat = 'second'\ndisplay = {socket}\npair = {socket}\n")),
        ("display", "on-failure", format!("listen = {socket}\nout = 'walk'\n")),
    ] {
        assert_eq!(value(&unit(role), "Restart"), kind);
        let output =
            serve(role, &folder, &format!("scene = 'plant.scene'\npatience_s = 0.2\n{configuration}"));
        assert_eq!(output.status.code(), Some(1), "{role}: {output:?}");
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(said.contains("show.sock"), "{role}: {said}");
    }
}

#[test]
fn systemd_takes_the_units() {
    let folder = tempfile::tempdir().unwrap();
    let paths = UNITS.map(|role| {
        let path = folder.path().join(format!("trimaran-{role}.service"));
        fs::write(&path, unit(role).replace(INSTALLED, env!("CARGO_BIN_EXE_trimaran"))).unwrap();
        path
    });
    let Ok(verified) = Command::new("systemd-analyze").args(["verify", "--man=no"]).args(paths).output()
    else {
        return println!("skipped: there is no systemd-analyze");
    };
    // It ends well though it ignores keys that it does not know, and not where other units of the machine have faults.
    let said = String::from_utf8(verified.stderr).unwrap();
    assert!(!said.contains("trimaran-"), "{said}");
    if !verified.status.success() {
        println!("skipped: systemd-analyze cannot judge here: {said}");
    }
}
