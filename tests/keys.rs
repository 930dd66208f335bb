//! Roles of a deployment whose keys are mixed up: the real program, by configuration files.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends where what it needs is not there")]

#[path = "../transport/tests/common/ports.rs"]
mod ports;
#[path = "common/program.rs"]
mod program;

use ports::unused_port;
use program::Bench;

/// The fingerprint behind `transport` in what `trimaran keys show` says of `file`.
fn fingerprint(bench: &Bench, transport: &str, file: &str) -> String {
    let shown = bench.done(&["keys", "show", file]);
    let line = shown.lines().find_map(|line| line.trim().strip_prefix(transport));
    line.unwrap_or_else(|| panic!("no {transport} in {shown}")).trim().to_owned()
}

#[test]
fn the_second_machines_keys_do_not_get_the_first_machines_place_and_the_session_goes_on_without() {
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "plant.scene"]);
    for name in ["display", "first", "second"] {
        bench.done(&["keys", "new", name, "--out", "."]);
    }
    for transport in ["quic", "udp"] {
        let [display, pair] = [(); 2].map(|()| format!("{transport}://127.0.0.1:{}", unused_port()));
        bench.write(
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
            bench.write(
                &format!("{name}.toml"),
                format!(
                    "scene = 'plant.scene'\nindex = '{index}'\ndisplay = '{display}'\npair = '{pair}'\nkeys = '{keys}.key'\n\
                     peers.display = 'display.pub'\npeers.other = '{other}.pub'\n"
                ),
            );
        }
        let role = |kind, name| bench.start(&["role", kind, "--config", &format!("{name}.toml")]);
        let show = role("display", "display");
        // The listener's configuration may be what is mended: it tries until its time is over.
        let mixed_up = ["role", "culler", "--config", "mixed-up.toml", "--join-timeout", "1"];
        let said = bench.start(&mixed_up).ends(1);
        let why = "claims to be first culler, and the listener knows its key as that of second culler";
        assert!(said.contains(why), "{transport}: {said}");

        let pair = [role("culler", "first"), role("culler", "second")];
        for culler in pair {
            culler.ends(0);
        }
        let said = show.ends(0);
        let key = fingerprint(&bench, transport, "second.pub");
        let claim = format!(
            "key 'second' ({key}) claims to be first culler; this configuration knows it as second culler"
        );
        assert_eq!(said.matches(&claim).count(), 1, "{transport}: {said}");
    }
}
