//! The systemd units of `deploy/systemd`: their commands exist, and their exit codes decide about restarts.

use std::env;
use std::ffi::OsStr;
use std::fs::{self, Permissions};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::program::{Bench, said};

/// The kinds of roles, each with its unit and the name of the configuration that the unit reads.
const UNITS: [(&str, &str, &str); 2] =
    [("culler", "trimaran-culler@.service", "%i"), ("display", "trimaran-display.service", "display")];
/// The unit of a relay.
const RELAY: &str = "trimaran-relay@.service";
/// The unit of a service of pages.
const SERVE: &str = "trimaran-serve@.service";
const INSTALLED: &str = "/usr/bin/trimaran";
/// The exit code for errors that waiting cannot fix.
const UNUSABLE: i32 = 2;

fn path(unit: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/systemd").join(unit)
}

fn units() -> impl Iterator<Item = &'static str> {
    UNITS.into_iter().map(|(_, name, _)| name).chain([RELAY, SERVE])
}

fn text(unit: &str) -> String {
    fs::read_to_string(path(unit)).unwrap()
}

fn unit(role: &str) -> String {
    let (_, unit, _) = UNITS.into_iter().find(|(name, ..)| *name == role).unwrap();
    text(unit)
}

/// The value of a key that a unit has once.
fn value<'u>(unit: &'u str, key: &str) -> &'u str {
    let values: Vec<&str> =
        unit.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('=')).collect();
    let [value] = values[..] else { panic!("{key}: {values:?}") };
    value
}

/// Runs the command of a role's service with this configuration in place of the installed one.
fn serve(role: &str, bench: &Bench, configuration: &str) -> Output {
    let unit = unit(role);
    let words: Vec<&str> = value(&unit, "ExecStart").split(' ').collect();
    let [program, arguments @ .., installed] = &words[..] else { panic!("{words:?}") };
    let (.., name) = UNITS.into_iter().find(|(name, ..)| *name == role).unwrap();
    assert_eq!((*program, *installed), (INSTALLED, &*format!("/etc/trimaran/{name}.toml")));
    bench.write("role.toml", configuration);
    bench.command(arguments).arg("role.toml").output().unwrap()
}

#[test]
fn a_configuration_that_cannot_be_used_ends_a_service_for_good() {
    let bench = Bench::empty();
    for (role, ..) in UNITS {
        // A walk that ended early is reported with 3, and a new one would replace the report.
        let down = if role == "display" { format!("{UNUSABLE} 3") } else { UNUSABLE.to_string() };
        assert_eq!(value(&unit(role), "RestartPreventExitStatus"), down);
        let output = serve(role, &bench, "scene = 'none.scene'\nsaet = 'one'\n");
        assert_eq!(output.status.code(), Some(UNUSABLE), "{role}: {output:?}");
        let said = said(&output);
        assert!(said.contains("role.toml") && said.contains("saet"), "{role}: {said}");
    }
}

/// Runs a role that waits in vain: it must be restarted.
fn serves_in_vain(role: &str, bench: &Bench, configuration: &str, why: &str) {
    let output = serve(role, bench, &format!("scene = 'plant.scene'\n{configuration}"));
    assert_eq!(output.status.code(), Some(1), "{role}: {output:?}");
    let said = said(&output);
    assert!(said.contains(why), "{role}: {said}");
}

#[test]
fn a_service_whose_port_is_in_use_is_started_again() {
    let bench = Bench::with_plant(100);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let listen = format!("join_timeout_s = 0.2\nlisten = 'tcp://{}'\n", taken.local_addr().unwrap());
    for (role, kind, more) in [("culler", "always", ""), ("display", "on-failure", "out = 'walk'\n")] {
        assert_eq!(value(&unit(role), "Restart"), kind);
        serves_in_vain(role, &bench, &format!("{listen}{more}"), "in use");
    }
}

#[test]
fn a_relay_is_started_again_unless_its_configuration_is_wrong() {
    let bench = Bench::empty();
    let unit = text(RELAY);
    let command = format!("{INSTALLED} role relay --config /etc/trimaran/%i.toml");
    assert_eq!(value(&unit, "ExecStart"), command);
    assert_eq!((value(&unit, "Restart"), value(&unit, "RestartPreventExitStatus")), ("always", "2"));
    let holder = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = holder.local_addr().unwrap();
    let whole = format!("upstream = 'tcp://{taken}'\nlisten = 'tcp://127.0.0.1:0'\njoin_timeout_s = 0.1\n");
    for (configuration, code, why) in [
        (whole.clone(), 1, "joining the culler failed"),
        (format!("{whole}saet = 1\n"), UNUSABLE, "saet"),
        (format!("{whole}[udp]\nmode = 'deadline'\n"), UNUSABLE, "udp.mode"),
        (whole.replace("tcp://127.0.0.1:0", "quic://127.0.0.1:0"), UNUSABLE, "peers.upstream"),
    ] {
        bench.write("relay.toml", &configuration);
        let output = bench.command(&["role", "relay", "--config", "relay.toml"]).output().unwrap();
        let said = said(&output);
        assert!(output.status.code() == Some(code) && said.contains(why), "{configuration}: {output:?}");
    }
}

/// Pages are served again if that may help, and not if variables or the scene are wrong.
#[test]
fn a_service_of_pages_ends_for_good_where_it_cannot_be_mended() {
    let bench = Bench::with_plant(100);
    let unit = text(SERVE);
    assert_eq!(value(&unit, "ExecStart"), format!("{INSTALLED} serve /etc/trimaran/%i.scene"));
    assert_eq!((value(&unit, "Restart"), value(&unit, "RestartPreventExitStatus")), ("always", "2"));
    let holder = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = holder.local_addr().unwrap().to_string();
    for (scene, listen, token, code, why) in [
        ("plant.scene", &*taken, "0123456789abcdef", 1, "in use"),
        ("none.scene", "127.0.0.1:0", "0123456789abcdef", UNUSABLE, "none.scene"),
        ("plant.scene", "127.0.0.1", "0123456789abcdef", UNUSABLE, "--listen"),
        ("plant.scene", "127.0.0.1:0", "short", UNUSABLE, "--token"),
    ] {
        let mut command = bench.command(&["serve", scene]);
        let output = command.env("TRIMARAN_LISTEN", listen).env("TRIMARAN_TOKEN", token).output().unwrap();
        let said = said(&output);
        if said.contains("./x page") && env::var_os("TRIMARAN_REQUIRE_BROWSER").is_none() {
            println!("skipped: {said}");
            return;
        }
        assert!(output.status.code() == Some(code) && said.contains(why), "{scene} {listen}: {output:?}");
    }
}

/// The output of `systemd-analyze`, or `None` if there is none and none is required.
fn systemd_analyze(arguments: &[&OsStr]) -> Option<Output> {
    match Command::new("systemd-analyze").args(arguments).output() {
        Ok(output) => Some(output),
        Err(error) => {
            assert_ne!(env::var("TRIMARAN_REQUIRE_SYSTEMD").as_deref(), Ok("1"), "systemd-analyze: {error}");
            println!("skipped: no systemd-analyze ({error}); ./x setup installs it");
            None
        }
    }
}

#[test]
fn systemd_takes_the_units() {
    let folder = tempfile::tempdir().unwrap();
    for name in units() {
        let path = folder.path().join(name);
        fs::write(&path, text(name).replace(INSTALLED, env!("CARGO_BIN_EXE_trimaran"))).unwrap();
        let Some(verified) = systemd_analyze(&["verify".as_ref(), "--man=no".as_ref(), path.as_ref()]) else {
            return;
        };
        // It succeeds even if it ignores unknown keys, and fails on faults of the machine's other units.
        let said = String::from_utf8(verified.stderr).unwrap();
        let faults: Vec<&str> = said.lines().filter(|line| line.contains("trimaran-")).collect();
        assert!(faults.is_empty(), "{faults:?}");
        if !verified.status.success() {
            println!("skipped: systemd-analyze cannot judge here: {said}");
        }
    }
}

#[test]
fn the_units_leave_little_exposed() {
    for name in units() {
        let arguments = ["security", "--no-pager", "--offline=true", "--threshold=20"].map(OsStr::new);
        let path = path(name);
        let Some(judged) = systemd_analyze(&[&arguments[..], &[path.as_ref()]].concat()) else { return };
        assert!(judged.status.success(), "{}", String::from_utf8_lossy(&judged.stdout));
    }
}

#[test]
fn keys_that_systemd_hands_over_may_be_readable_by_their_group() {
    let bench = Bench::with_plant(100);
    bench.done(&["keys", "new", "one"]);
    // In the end it fails for another reason.
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let configuration = format!(
        "scene = 'plant.scene'\njoin_timeout_s = 0.2\nlisten = ['quic://127.0.0.1:0', 'tcp://{}']\n\
         keys = 'one.key'\npeers.displays = ['one.pub']\n",
        taken.local_addr().unwrap()
    );
    bench.write("role.toml", configuration);
    let (here, elsewhere) = (bench.path(""), bench.path("another"));
    for (mode, credentials, refused) in
        [(0o440, &here, false), (0o440, &elsewhere, true), (0o444, &here, true)]
    {
        fs::set_permissions(bench.path("one.key"), Permissions::from_mode(mode)).unwrap();
        let mut command = bench.command(&["role", "culler", "--config"]);
        command.arg(bench.path("role.toml")).env("CREDENTIALS_DIRECTORY", credentials);
        let output = command.output().unwrap();
        let said = said(&output);
        assert_eq!(said.contains("others may read"), refused, "{mode:o}: {said}");
        assert_eq!(output.status.code(), Some(if refused { UNUSABLE } else { 1 }), "{mode:o}: {said}");
    }
}
