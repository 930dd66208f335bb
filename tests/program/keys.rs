//! Roles of a deployment whose keys are mixed up: the real program, by configuration files.

use crate::common::ports::unused_port;
use crate::common::program::Bench;

/// The fingerprint behind `transport` in the output of `trimaran keys show` for `file`.
fn fingerprint(bench: &Bench, transport: &str, file: &str) -> String {
    let shown = bench.done(&["keys", "show", file]);
    let line = shown.lines().find_map(|line| line.trim().strip_prefix(transport));
    line.unwrap_or_else(|| panic!("no {transport} in {shown}")).trim().to_owned()
}

#[test]
fn a_culler_is_no_display_and_the_display_goes_on_with_the_right_one() {
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "plant.scene"]);
    for name in ["display", "one", "two"] {
        bench.done(&["keys", "new", name, "--out", "."]);
    }
    for transport in ["quic", "udp"] {
        let [one, two] = [(); 2].map(|()| format!("{transport}://127.0.0.1:{}", unused_port()));
        // The second culler takes the display's key for a culler's.
        for (name, at, peers) in [
            ("one", &one, "peers.displays = ['display.pub']"),
            ("two", &two, "peers.cullers = ['display.pub']"),
        ] {
            let config = format!("scene = 'plant.scene'\nlisten = '{at}'\nkeys = '{name}.key'\n{peers}\n");
            bench.write(&format!("{name}.toml"), config);
        }
        bench.write(
            "display.toml",
            format!(
                "scene = 'plant.scene'\ncullers = ['{one}', '{two}']\nout = '{transport}'\nkeys = 'display.key'\n\
                 peers.cullers = ['one.pub', 'two.pub']\njoin_timeout_s = 3\n\
                 [session]\nframes = 4\nwidth = 32\nheight = 32\n"
            ),
        );
        let role = |kind, name| bench.start(&["role", kind, "--config", &format!("{name}.toml")]);
        let [_one, mut two] = ["one", "two"].map(|name| role("culler", name));
        let said = role("display", "display").ends(0);
        assert!(said.contains("begins without 1 of 2 cullers"), "{transport}: {said}");
        let culled = bench.report(transport)["frames"].to_string();
        assert!(culled.contains("culler 1") && !culled.contains("culler 2"), "{transport}: {culled}");
        let key = fingerprint(&bench, transport, "display.pub");
        let claim =
            format!("key 'display' ({key}) claims to be display; this configuration knows it as culler");
        two.says(&claim);
        two.signal("TERM");
        assert!(!two.ends(0).split_once(&claim).unwrap().1.contains(&claim), "{transport}: it says so once");
    }
}
