//! A hang-up (SIGHUP): a role reads its configuration again, and its links stay.

use crate::common::deployment::culled_by;
use crate::common::ports::unused_port;
use crate::common::program::Bench;

const READ: &str = "has read its configuration again";

/// A culler at one port, which knows these displays.
fn culler(bench: &Bench, at: &str, known: &[&str], more: &str) {
    let known = known.iter().map(|name| format!("'{name}.pub'")).collect::<Vec<_>>().join(", ");
    let config = format!(
        "scene = 'plant.scene'\nlisten = '{at}'\nkeys = 'one.key'\n{more}\n[peers]\ndisplays = [{known}]\n"
    );
    bench.write("one.toml", config);
}

fn display(bench: &Bench, at: &str, name: &str) {
    let config = format!(
        "scene = 'plant.scene'\ncullers = ['{at}']\nkeys = '{name}.key'\nout = '{name}'\njoin_timeout_s = 60\n\
         [session]\nwidth = 64\nheight = 64\naudit_every = 0\n[peers]\ncullers = ['one.pub']\n"
    );
    bench.write(&format!("{name}.toml"), config);
}

fn walk(name: &str, frames: &str) -> [String; 6] {
    let config = format!("{name}.toml");
    ["role", "display", "--config", &config, "--frames", frames].map(str::to_owned)
}

#[test]
fn a_new_key_joins_after_a_hang_up_and_a_wrong_file_changes_nothing() {
    for transport in ["quic", "udp"] {
        let bench = Bench::with_plant(60);
        let at = format!("{transport}://127.0.0.1:{}", unused_port());
        for name in ["one", "first", "second", "third"] {
            bench.done(&["keys", "new", name]);
        }
        for name in ["first", "second", "third"] {
            display(&bench, &at, name);
        }
        culler(&bench, &at, &["first"], "");
        let mut service = bench.start(&["role", "culler", "--config", "one.toml"]);
        service.says("listens on");
        let long = walk("first", "20000");
        let first = bench.start(&long.each_ref().map(String::as_str));
        while !bench.path("first/unfinished/walk.jsonl").exists() {
            std::thread::yield_now();
        }

        // It logs what displays do from now on.
        culler(&bench, &at, &["first", "second"], "log = 'info'");
        service.signal("HUP");
        service.says(READ);
        let short = walk("second", "5");
        let said = bench.start(&short.each_ref().map(String::as_str)).ends(0);
        assert!(!said.contains("begins without"), "{transport}: {said}");
        assert_eq!(culled_by(&bench.report("second")), ["culler 1"], "{transport}");
        service.says("has joined");
        service.says("has left");

        culler(&bench, &at, &["first", "third"], "max_picture = 'large'");
        service.signal("HUP");
        let line = service.says("goes on with its configuration");
        assert!(line.contains("one.toml is not valid") && line.contains("line 4"), "{transport}: {line}");
        let refused = walk("third", "5");
        let refused = [&refused.each_ref().map(String::as_str)[..], &["--join-timeout", "1"]].concat();
        let said = bench.start(&refused).ends(0);
        assert!(said.contains("begins without 1 of 1 culler:"), "{transport}: {said}");

        first.interrupt();
        let (_, said) = first.ended();
        let report = bench.report("first");
        assert_eq!(culled_by(&report), ["culler 1"], "{transport}: {said}");
        assert!(!said.contains("was lost"), "{transport}: {said}");
        service.interrupt();
        service.ends(0);
    }
}
