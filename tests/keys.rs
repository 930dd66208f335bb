//! Roles of a deployment whose keys are mixed up: the real program, by configuration files.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

#[path = "../transport/tests/common/ports.rs"]
mod ports;

use std::{
    fs,
    io::Read,
    path::Path,
    process::{Child, Command, Stdio},
};

use ports::unused_port;

fn trimaran(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trimaran"));
    command.current_dir(folder).args(args);
    command
}

fn done(folder: &Path, args: &[&str]) {
    let output = trimaran(folder, args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn start(folder: &Path, args: &[&str]) -> Child {
    trimaran(folder, args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// How a program ended, and what it said.
fn ended(mut child: Child) -> (Option<i32>, String) {
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    (child.wait().unwrap().code(), said)
}

/// The fingerprint behind `transport` in what `trimaran keys show` says of `file`.
fn fingerprint(folder: &Path, transport: &str, file: &str) -> String {
    let shown = trimaran(folder, &["keys", "show", file]).output().unwrap();
    let shown = String::from_utf8(shown.stdout).unwrap();
    let line = shown.lines().find_map(|line| line.trim().strip_prefix(transport));
    line.unwrap_or_else(|| panic!("no {transport} in {shown}")).trim().to_owned()
}

#[test]
fn the_second_machines_keys_do_not_get_the_first_machines_place_and_the_session_goes_on_without() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    done(folder, &["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "plant.scene"]);
    for name in ["display", "first", "second"] {
        done(folder, &["keys", "new", name, "--out", "."]);
    }
    for transport in ["quic", "udp"] {
        let [display, pair] = [(); 2].map(|()| format!("{transport}://127.0.0.1:{}", unused_port()));
        let write = |name: &str, text: String| fs::write(folder.join(name), text).unwrap();
        write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\nlisten = '{display}'\nout = '{transport}'\nkeys = 'display.key'\n\
                 peers.first = 'first.pub'\npeers.second = 'second.pub'\n\
                 [session]\nframes = 4\nwidth = 32\nheight = 32\n"
            ),
        );
        for (name, index, keys, other) in [
            ("first", "first", "first", "second"),
            ("second", "second", "second", "first"),
            ("mixed-up", "first", "second", "second"),
        ] {
            write(
                &format!("{name}.toml"),
                format!(
                    "scene = 'plant.scene'\nindex = '{index}'\ndisplay = '{display}'\npair = '{pair}'\nkeys = '{keys}.key'\n\
                     peers.display = 'display.pub'\npeers.other = '{other}.pub'\n"
                ),
            );
        }
        let role = |kind, name| start(folder, &["role", kind, "--config", &format!("{name}.toml")]);
        let show = role("display", "display");
        // The listener's configuration may be what is mended: it tries until its time is over.
        let mixed_up = ["role", "culler", "--config", "mixed-up.toml", "--join-timeout", "1"];
        let (code, said) = ended(start(folder, &mixed_up));
        assert_eq!(code, Some(1), "{transport}: {said}");
        let why = "claims to be first culler, and the listener knows its key as that of second culler";
        assert!(said.contains(why), "{transport}: {said}");

        let pair = [role("culler", "first"), role("culler", "second")];
        for (code, said) in pair.map(ended) {
            assert_eq!(code, Some(0), "{transport}: {said}");
        }
        let (code, said) = ended(show);
        assert_eq!(code, Some(0), "{transport}: {said}");
        let key = fingerprint(folder, transport, "second.pub");
        let claim = format!(
            "key 'second' ({key}) claims to be first culler; this configuration knows it as second culler"
        );
        assert_eq!(said.matches(&claim).count(), 1, "{transport}: {said}");
    }
}
