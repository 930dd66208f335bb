//! The program with faulty input: its messages, its exit code, and the files that it leaves behind.

use std::{fs, net::TcpListener, path::Path, process::Output};

use crate::common::program::{Bench, Process, said, signal};

impl Bench {
    /// Runs the program, which must refuse its input: exit code 2, and every one of `words` in its output.
    fn refuses(&self, args: &[&str], words: &[&str]) {
        expect(&self.trimaran(args), 2, words);
    }

    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.path("")).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

fn expect(output: &Output, code: i32, words: &[&str]) {
    says(output.status.code(), &said(output), code, words);
}

/// Checks a program's exit code, and every one of `words` in its output.
fn says(ended: Option<i32>, said: &str, code: i32, words: &[&str]) {
    assert_eq!(ended, Some(code), "{said}");
    for word in words {
        assert!(said.contains(word), "{word:?} is not in: {said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

#[test]
fn flags_that_make_no_sense_are_refused() {
    let bench = Bench::empty();
    bench.refuses(&["run", "a.scene", "--size", "0x5"], &["--size", "WIDTHxHEIGHT"]);
    bench.refuses(&["run", "a.scene", "--epsilon", "-1"], &["--epsilon"]);
    bench.refuses(&["run", "a.scene", "--batch", "20000"], &["--batch", "16384"]);
    bench.refuses(&["run", "a.scene", "--occlusion-test", "guess"], &["query", "raster", "hzb"]);
}

#[test]
fn files_that_are_not_what_they_should_be_are_refused() {
    let bench = Bench::empty();
    bench.write("a.glb", b"glTF\x02\0\0\0\xff\xff\xff\x7f");
    bench.write("a.rvm", b"\0\0\0H\0\0\0E\0\0\0A");
    bench.write("a.scene", b"not a scene at all");
    bench.refuses(&["import", "a.glb", "-o", "b.scene"], &["a.glb"]);
    bench.refuses(&["import", "a.rvm", "-o", "b.scene"], &["a.rvm"]);
    bench.refuses(&["import", "missing.glb", "-o", "b.scene"], &["missing.glb"]);
    bench.refuses(&["info", "a.scene"], &["a.scene", "not a cooked scene"]);
    assert_eq!(bench.files(), ["a.glb", "a.rvm", "a.scene"], "something was left behind");
}

#[test]
fn a_model_beyond_the_limits_is_refused_with_the_flag_that_allows_it() {
    let bench = Bench::empty();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\no plate\nf 1 2 3 4\n";
    bench.write("a.obj", square);
    let import = |flag: &str, most: &str| bench.trimaran(&["import", "a.obj", "-o", "b.scene", flag, most]);
    for (flag, most) in [("--max-triangles", "1"), ("--max-vertices", "3"), ("--max-objects", "0")] {
        expect(&import(flag, most), 2, &["a.obj", "\"plate\"", flag]);
    }
    expect(&import("--max-nodes", "1"), 2, &["\"plate\"", "--max-nodes"]);
    assert_eq!(bench.files(), ["a.obj"], "something was left behind");
    assert!(import("--max-triangles", "2").status.success());
}

#[test]
fn a_scene_cut_short_or_changed_is_refused() {
    let bench = Bench::with_plant(300);
    let whole = fs::read(bench.path("plant.scene")).unwrap();
    bench.write("short.scene", &whole[..whole.len() / 2]);
    bench.refuses(&["info", "short.scene"], &["short.scene", "cut short"]);
    let changed_at = |byte: usize| {
        let mut changed = whole.clone();
        changed[byte] ^= 1;
        bench.write("changed.scene", changed);
    };
    // `info` reads all of it, and a walk begins with the top of the tree, which stands first.
    changed_at(whole.len() / 2);
    bench.refuses(&["info", "changed.scene"], &["changed.scene", "damaged"]);
    changed_at(200);
    bench.refuses(&["run", "changed.scene"], &["changed.scene", "nodes 0 to", "damaged"]);
}

#[test]
fn a_path_that_cannot_be_walked_is_refused() {
    let bench = Bench::with_plant(300);
    let path = r#"{"vfov_deg":60,"frames":[{"eye":[0,0,0],"forward":[0,0,0],"up":[0,1,0]}]}"#;
    bench.write("path.json", path);
    bench.refuses(&["run", "plant.scene", "--path", "path.json"], &["path.json", "frame 0"]);
    bench.refuses(&["run", "plant.scene", "--path", "nowhere.json"], &["nowhere.json"]);
}

#[test]
fn without_a_vulkan_device_it_says_what_to_install() {
    let bench = Bench::with_plant(300);
    let run = bench
        .command(&["run", "plant.scene"])
        .env("VK_DRIVER_FILES", "/nonexistent")
        .env("VK_ICD_FILENAMES", "/nonexistent")
        .output()
        .unwrap();
    expect(&run, 1, &["mesa-vulkan-drivers"]);
}

#[test]
fn a_full_disk_leaves_nothing_half_written() {
    let bench = Bench::empty();
    // A file size limit stands for the full disk: both make the write fail half-way.
    let program = env!("CARGO_BIN_EXE_trimaran");
    let script =
        format!("ulimit -f 16; trap '' XFSZ; exec {program} generate plant --objects 300 -o plant.scene");
    let output = bench.command_of("sh", &["-c", &script]).output().unwrap();
    expect(&output, 1, &["plant.scene"]);
    assert_eq!(bench.files(), Vec::<String>::new(), "something was left behind");
}

#[test]
fn keys_are_made_once_and_both_files_say_who_they_are() {
    let bench = Bench::empty();
    let printed = bench.done(&["keys", "new", "one", "--out", "keys"]);
    let prints: Vec<_> = printed.lines().filter(|line| line.starts_with("  ")).collect();
    assert_eq!(prints.len(), 2, "{printed}");
    for (file, kind) in [("keys/one.key", "private"), ("keys/one.pub", "public")] {
        let shown = bench.done(&["keys", "show", file]);
        assert_eq!(shown, format!("one ({kind})\n{}\n", prints.join("\n")));
    }
    bench.refuses(&["keys", "new", "one", "--out", "keys"], &["keys/one.key", "not overwritten"]);
    bench.refuses(&["keys", "new", "a/b"], &["letters, digits"]);
    bench.refuses(&["keys", "show", "keys/two.pub"], &["keys/two.pub"]);
    bench.write("keys/one.pub", "name = 'one'\nquic = 'zz'\n");
    bench.refuses(&["keys", "show", "keys/one.pub"], &["keys/one.pub, line 2", "64 hexadecimal digits"]);
}

#[test]
fn a_port_that_stays_in_use_is_named() {
    let bench = Bench::with_plant(300);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", taken.local_addr().unwrap());
    write_display(&bench, &address);
    let display = bench.trimaran(&["role", "display", "--config", "display.toml", "--join-timeout", "0.5"]);
    expect(&display, 1, &[&address, "in use"]);
}

#[test]
fn roles_that_hold_different_scenes_refuse_each_other() {
    let bench = Bench::with_plant(300);
    bench.done(&["generate", "plant", "--objects", "300", "--seed", "2", "-o", "other.scene"]);
    let (mut culler, address) = listening(&bench, "other.scene", "tcp://127.0.0.1:0", &[]);
    let args = ["role", "display", "--scene", "plant.scene", "--out", "out", "--cullers", &address];
    let mut display = bench.start(&[&args[..], &["--join-timeout", "60"]].concat());
    // Either may be started again with the other one's scene.
    let hashes = ["plant.scene", "other.scene"].map(|scene| hash_of(&bench, scene));
    for role in [&mut culler, &mut display] {
        role.says_all(&["scene", &hashes[0], &hashes[1]]);
    }
}

/// A culler that holds this scene, and where it listens.
fn listening(bench: &Bench, scene: &str, listen: &str, more: &[&str]) -> (Process, String) {
    let args = ["role", "culler", "--scene", scene, "--listen", listen];
    let mut culler = bench.start(&[&args[..], more].concat());
    let line = culler.says("the culler listens on");
    let address = line.trim().rsplit_once(' ').unwrap().1.to_owned();
    (culler, address)
}

fn write_display(bench: &Bench, address: &str) {
    let config = format!("scene = 'plant.scene'\nlisten = '{address}'\nout = 'out'\n[session]\nframes = 4\n");
    bench.write("display.toml", config);
}

fn hash_of(bench: &Bench, scene: &str) -> String {
    let info: serde_json::Value = serde_json::from_str(&bench.done(&["info", scene, "--json"])).unwrap();
    info["hash"].as_str().unwrap().to_owned()
}

#[test]
fn walks_over_every_transport_and_with_any_number_of_cullers_show_the_same() {
    let bench = Bench::with_plant(300);
    let walk = |out: &str, more: &[&str]| {
        let args = ["run", "plant.scene", "--out", out, "--frames", "6", "--size", "96x80"];
        bench.done(&[&args[..], &["--audit-every", "3", "--batch", "16"], more].concat());
    };
    walk("inproc", &[]);
    let switch = ["--link", "tcp", "--coding", "plain", "--schedule", "switch"];
    for (out, more) in [
        ("unix", &["--link", "unix"][..]),
        ("tcp", &["--link", "tcp", "--coding", "plain"]),
        ("quic", &["--link", "quic"]),
        ("udp", &["--link", "udp"]),
        ("switch", &switch),
        ("quic-switch", &["--link", "quic", "--schedule", "switch"]),
        ("none", &["--cullers", "0"]),
        ("one", &["--cullers", "1"]),
        ("three", &["--cullers", "3", "--link", "unix"]),
    ] {
        walk(out, more);
        assert_eq!(pictures(&bench, "inproc", 6), pictures(&bench, out, 6), "{out}");
    }
    for frame in bench.report("tcp")["frames"].as_array().unwrap() {
        assert!(
            frame["or_ms"].is_number() && frame["hc_ms"].is_number(),
            "the cullers' times arrived: {frame}"
        );
        let end = frame["timeline"].as_array().unwrap().iter().filter_map(|span| span["end_ms"].as_f64());
        let end = end.fold(0.0, f64::max);
        for key in ["occluders_device_ms", "picture_device_ms"] {
            let ms = frame[key].as_f64().unwrap();
            assert!(ms > 0.0 && ms <= end, "{key} within the walk: {frame}");
        }
        let ids = frame["bytes_by_kind"]["ids"].as_u64().unwrap();
        assert_eq!(ids, 4 * frame["nodes_drawn"].as_u64().unwrap(), "{frame}");
    }
    for frame in bench.report("switch")["frames"].as_array().unwrap() {
        let ids = frame["bytes_by_kind"]["ids"].as_u64().unwrap();
        assert_eq!(
            ids,
            2 * 4 * frame["nodes_drawn"].as_u64().unwrap(),
            "the other culler gets them too: {frame}"
        );
    }
    let id_bytes = |link: &str| bench.report(link)["summary"]["bytes_by_kind"]["ids"].as_u64().unwrap();
    assert!(2 * id_bytes("unix") < id_bytes("tcp"), "{} and {}", id_bytes("unix"), id_bytes("tcp"));
    assert!(walks_again(&bench), "a report can be walked again");
}

/// The first `count` pictures of a walk.
fn pictures(bench: &Bench, out: &str, count: u32) -> Vec<Vec<u8>> {
    (0..count).map(|n| fs::read(bench.path(out).join(format!("frames/{n:05}.png"))).unwrap()).collect()
}

/// The display connects to one culler over QUIC and the other over TCP, over which these connect too. A
/// culler whose configuration lacks the other's endpoint culls independently: a display's word is not enough.
#[test]
fn every_two_roles_may_have_another_transport_and_cullers_meet_where_they_were_told() {
    const WALK: [&str; 6] = ["--frames", "4", "--size", "96x80", "--audit-every", "0"];
    let bench = Bench::with_plant(300);
    bench.done(&[&["run", "plant.scene", "--out", "alone"], &WALK[..]].concat());
    for name in ["show", "one", "two"] {
        bench.done(&["keys", "new", name]);
    }
    let (two, tcp) = listening(&bench, "plant.scene", "tcp://127.0.0.1:0", &[]);
    let config = "scene = 'plant.scene'\nkeys = 'show.key'\npeers.cullers = ['one.pub']\n\
                  schedule = 'switch'\n\
                  session = { frames = 4, width = 96, height = 80, audit_every = 0, coding = 'plain' }\n";
    bench.write("display.toml", config);
    for (out, told, receivers) in [("apart", &["--cullers", &tcp][..], 2), ("untold", &[], 1)] {
        let known = ["--keys", "one.key", "--peer-displays", "show.pub"];
        let (one, quic) =
            listening(&bench, "plant.scene", "quic://127.0.0.1:0", &[&known[..], told].concat());
        let cullers = format!("{quic},{tcp}");
        bench.done(&["role", "display", "--config", "display.toml", "--cullers", &cullers, "--out", out]);
        one.signal("TERM");
        let said = one.ends(0);
        assert_eq!(said.contains("--cullers"), receivers == 1, "{said}");
        assert_eq!(pictures(&bench, out, 4), pictures(&bench, "alone", 4));
        let report = bench.report(out);
        assert_eq!(report["run"]["link"], "quic and tcp");
        for frame in report["frames"].as_array().unwrap() {
            let ids = frame["bytes_by_kind"]["ids"].as_u64().unwrap();
            assert_eq!(ids, receivers * 4 * frame["nodes_drawn"].as_u64().unwrap(), "{out}: {frame}");
        }
    }
    two.signal("TERM");
    two.ends(0);
}

#[test]
fn a_flag_goes_before_the_environment_and_that_before_the_file() {
    let bench = Bench::with_plant(300);
    let taken: Vec<_> = (0..3).map(|_| TcpListener::bind("127.0.0.1:0").unwrap()).collect();
    let [flag, variable, file] = &taken[..] else { panic!("not three") };
    let [flag, variable, file] = [flag, variable, file].map(|l| format!("tcp://{}", l.local_addr().unwrap()));
    write_display(&bench, &file);
    let args = ["role", "display", "--config", "display.toml"];
    let command = || {
        let mut command = bench.command(&args);
        command.env("TRIMARAN_JOIN_TIMEOUT_S", "0");
        command
    };
    expect(&command().output().unwrap(), 1, &[&file, "in use"]);
    let from_variable = command().env("TRIMARAN_LISTEN", &variable).output().unwrap();
    expect(&from_variable, 1, &[&variable, "in use"]);
    let all = command().env("TRIMARAN_LISTEN", &variable).args(["--listen", &flag]).output().unwrap();
    expect(&all, 1, &[&flag, "in use"]);
    // An error of a bad value names its source.
    let bad = bench.command(&args).env("TRIMARAN_SESSION_BATCH", "0").output().unwrap();
    expect(&bad, 2, &["TRIMARAN_SESSION_BATCH", "1 to 16384"]);
    bench
        .refuses(&["role", "display", "--config", "display.toml", "--batch", "0"], &["--batch", "1..=16384"]);
    bench.write("display.toml", "scene = 'a'\n[quic]\ncongestion = 'reno'\n");
    bench.refuses(&args, &["display.toml", "line 3", "congestion", "new-reno"]);
}

#[test]
fn a_bad_key_of_a_transport_is_named_wherever_it_stands() {
    let bench = Bench::empty();
    let args = ["ping", "tcp://127.0.0.1:1"];
    for (given, why) in [
        ("udp.mode=fast", "reliable"),
        ("tcp.nodelay=2", "boolean"),
        ("unix.allow_uids=me", "u32"),
        ("link.idle_timeout_s=0", "0.1 to 86400"),
        ("link.idle_time=1", "trimaran config"),
        ("udp.mode", "KEY=VALUE"),
    ] {
        let (key, _) = given.split_once('=').unwrap_or((given, ""));
        bench.refuses(&[&args[..], &["-o", given]].concat(), &["--option", key, why]);
    }
    for (variable, value) in [("TRIMARAN_UDP_REPAIR_PERCENT", "101"), ("TRIMARAN_UNIX_ALLOW_UIDS", "1,me")] {
        expect(&bench.command(&args).env(variable, value).output().unwrap(), 2, &[variable]);
    }
}

#[test]
fn a_transport_that_encrypts_asks_for_keys() {
    let bench = Bench::with_plant(300);
    let listen =
        ["role", "display", "--scene", "plant.scene", "--out", "o", "--listen", "quic://127.0.0.1:0"];
    bench.refuses(&listen, &["quic://127.0.0.1:0", "`keys`", "peers.cullers", "trimaran keys new"]);
    let args = ["role", "culler", "--scene", "plant.scene", "--listen", "quic://127.0.0.1:0"];
    bench.refuses(&args, &["quic://127.0.0.1:0", "`keys`", "peers.displays"]);
}

#[test]
fn the_configuration_of_each_role_is_printed() {
    let bench = Bench::empty();
    for (role, key) in [("culler", "#displays ="), ("display", "#cullers =")] {
        assert!(bench.done(&["config", role]).contains(key));
    }
}

/// A long session of a display and two cullers as processes.
struct LongSession {
    display: Process,
    cullers: Vec<String>,
}

impl LongSession {
    fn start(bench: &Bench, link: &str) -> Self {
        let args =
            ["run", "plant.scene", "--link", link, "--out", "long", "--frames", "20000", "--size", "64x64"];
        let mut command = bench.command(&args);
        command.env("TRIMARAN_LINK_IDLE_TIMEOUT_S", "4");
        command.args(["--audit-every", "0"]).env("TRIMARAN_LOG", "info");
        let mut display = Process::start(&mut command);
        // The cullers share the display's standard error, and each says when the display has come.
        for _ in 0..2 {
            display.says("has joined");
        }
        let children = format!("/proc/{0}/task/{0}/children", display.id());
        let cullers = fs::read_to_string(children).unwrap().split_whitespace().map(str::to_owned).collect();
        Self { display, cullers }
    }

    /// Waits until this many frames are on disk.
    fn has_recorded(&self, bench: &Bench, frames: usize) {
        while recorded(&bench.path("long/unfinished")) < frames {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    }

    /// Waits for the end of all three, with this exit code and output.
    fn ends(self, code: i32, words: &[&str]) {
        let (ended, said) = self.display.ended();
        says(ended, &said, code, words);
    }
}

/// The loader of this test, which is the program's as well.
fn dynamic_loader() -> Option<String> {
    let maps = fs::read_to_string("/proc/self/maps").unwrap();
    let mut files = maps.lines().filter_map(|line| line.split_whitespace().nth(5));
    let loader = |file: &&str| file.rsplit('/').next().is_some_and(|name| name.starts_with("ld-"));
    files.find(loader).map(str::to_owned)
}

#[test]
fn cullers_that_cannot_start_are_not_waited_for() {
    let Some(loader) = dynamic_loader() else {
        return println!("skipped: the program has no dynamic loader");
    };
    let bench = Bench::with_plant(300);
    for link in ["tcp", "unix", "quic", "udp"] {
        // Started by the loader, the program takes the loader for itself, so the machines that it starts end
        // at once.
        let args = [env!("CARGO_BIN_EXE_trimaran"), "run", "plant.scene", "--link", link, "--frames", "4"];
        let run = bench.command_of(&loader, &args).output().unwrap();
        expect(&run, 1, &["culler ", " ended with", "exit status: 127", "before it had joined"]);
    }
}

#[test]
fn when_a_culler_is_killed_the_walk_goes_on_and_says_which() {
    let bench = Bench::with_plant(300);
    let mut session = LongSession::start(&bench, "tcp");
    session.has_recorded(&bench, 3);
    signal("KILL", &session.cullers[0]);
    session.display.says("culler 1 was lost before frame");
    session.has_recorded(&bench, recorded(&bench.path("long/unfinished")) + 20);
    session.display.signal("INT");
    session.ends(3, &["ended early", "it was asked to stop"]);
    let notes = long_report(&bench)["run"]["notes"].to_string();
    assert!(notes.contains("culler 1 was lost before frame"), "{notes}");
}

/// The report of a [`LongSession`], with exactly the walked frames.
fn long_report(bench: &Bench) -> serde_json::Value {
    if bench.path("long/unchecked.json").exists() {
        // It was stopped before all of its pictures were drawn.
        bench.done(&["report", "long"]);
    }
    let report = bench.report("long");
    let frames = report["frames"].as_array().unwrap();
    assert!((1..20_000).contains(&frames.len()));
    assert_eq!(report["summary"]["frames"], frames.len());
    assert_eq!(report["summary"]["ended"]["frames_due"], 20_000);
    let pictures = fs::read_dir(bench.path("long/frames")).unwrap().count();
    assert_eq!(pictures, frames.len(), "all that was shown is there");
    assert!(!bench.path("long/unfinished").exists());
    report
}

#[test]
fn a_culler_that_hangs_is_noticed_within_the_idle_timeout() {
    let bench = Bench::with_plant(300);
    for link in ["unix", "tcp", "quic", "udp"] {
        let mut session = LongSession::start(&bench, link);
        session.has_recorded(&bench, 3);
        // Its connections stay open, and its system acknowledges for it.
        signal("STOP", &session.cullers[1]);
        session.display.says("culler 2 was late with frame");
        let lost = session.display.says("culler 2 was lost before frame");
        assert!(lost.contains("no keep-alive"), "{link}: {lost}");
        session.display.signal("INT");
        session.ends(3, &["ended early"]);
    }
}

#[test]
fn an_interrupted_session_reports_what_it_walked() {
    let bench = Bench::with_plant(300);
    let session = LongSession::start(&bench, "tcp");
    session.has_recorded(&bench, 3);
    session.display.signal("INT");
    session.ends(3, &["ended early", "it was asked to stop"]);
    assert_eq!(long_report(&bench)["summary"]["ended"]["how"], "interrupted");
    assert!(fs::read_to_string(bench.path("long/report.html")).unwrap().contains("This walk ended early"));
}

/// A stopped walk leaves its report soon, and its checks for another time.
#[test]
fn a_walk_that_is_stopped_is_reported_at_once_and_checked_later() {
    let bench = Bench::with_plant(300);
    let args = ["run", "plant.scene", "--out", "long", "--frames", "20000", "--size", "192x192"];
    let mut walk = bench.start(&[&args[..], &["--audit-every", "1"]].concat());
    while recorded(&bench.path("long/unfinished")) < 40 {
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    walk.signal("INT");
    walk.says("reporting it");
    walk.signal("INT");
    let said = walk.ends(3);
    assert!(said.contains("ended early"), "{said}");
    let audited = |report: &serde_json::Value| {
        let frames = report["frames"].as_array().unwrap();
        let is_exact = |frame: &&serde_json::Value| frame["cut_mismatch_pixels"] == 0;
        (frames.iter().filter(is_exact).count(), frames.len())
    };
    let before = bench.report("long");
    let (checked, frames) = audited(&before);
    assert!(checked < frames && frames >= 40, "{checked} of {frames} frames are checked");
    let notes = before["run"]["notes"].to_string();
    assert!(notes.contains("pictures and checks end after") && notes.contains("trimaran report"), "{notes}");

    bench.done(&["generate", "plant", "--objects", "50", "--triangles", "5000", "-o", "other.scene"]);
    let said = bench.trimaran(&["report", "long", "--scene", "other.scene"]);
    expect(&said, 2, &["--scene", "other.scene"]);
    bench.done(&["report", "long"]);
    let after = bench.report("long");
    assert_eq!(audited(&after), (frames, frames));
    assert_eq!(after["summary"]["ended"], before["summary"]["ended"]);
    assert_eq!(after["run"]["command_line"], before["run"]["command_line"]);
    for (number, [one, other]) in before["frames"]
        .as_array()
        .unwrap()
        .iter()
        .zip(after["frames"].as_array().unwrap())
        .map(|(a, b)| [a, b])
        .enumerate()
    {
        for key in ["eye", "nodes_drawn", "triangles_drawn", "latency_ms"] {
            assert_eq!(one[key], other[key], "{key} of frame {number}");
        }
        assert!(
            bench.path(&format!("long/frames/{number:05}.png")).exists(),
            "frame {number} has no picture"
        );
    }
    assert!(!bench.path("long/unchecked.json").exists() && !bench.path("long/unfinished").exists());
    // There is nothing to be added any more.
    expect(&bench.trimaran(&["report", "long"]), 2, &["unchecked.json"]);
}

/// A name in a model cannot set a terminal's title, or forge a line.
#[test]
fn words_of_a_file_are_no_commands_to_a_terminal() {
    let bench = Bench::empty();
    let name = "a\\u001b]0;PWNED\\u0007\\u001b[31m\\nfake line";
    let gltf = |children: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"name":"{name}","mesh":7,"children":[{children}]}},{{"name":"{name}","children":[0]}}]}}"#
        )
    };
    for (file, children) in [("loop.gltf", "1"), ("\u{1b}[31mx.gltf", "0"), ("mesh.gltf", "")] {
        bench.write(file, gltf(children));
        let said = bench.trimaran(&["import", file, "-o", "x.scene"]);
        let text = String::from_utf8([said.stdout, said.stderr].concat()).unwrap();
        assert!(!text.is_empty() && !text.lines().any(|line| line.starts_with("fake")), "{text:?}");
        assert!(text.chars().all(|c| c == '\n' || !c.is_control()), "{text:?}");
    }
}

#[test]
fn a_killed_display_leaves_what_it_recorded() {
    let bench = Bench::with_plant(300);
    let session = LongSession::start(&bench, "tcp");
    session.has_recorded(&bench, 3);
    session.display.signal("KILL");
    session.display.ended();
    assert!(!bench.path("long/report.json").exists());
    // The next walk moves it aside and says so.
    let again = bench.trimaran(&["run", "plant.scene", "--out", "long", "--frames", "4", "--size", "64x64"]);
    expect(&again, 0, &["left no report", "long/unfinished.before"]);
    assert!(recorded(&bench.path("long/unfinished.before")) >= 3);
    assert!(bench.path("long/report.json").exists());
}

/// How many frames are recorded in the folder of an unfinished walk.
fn recorded(folder: &Path) -> usize {
    let journal = fs::read_to_string(folder.join("walk.jsonl")).unwrap_or_default();
    journal.matches("\n{\"frame\":").count()
}

#[test]
fn a_live_walk_ends_with_its_path_and_shows_poses_of_it() {
    let bench = Bench::with_plant(300);
    for link in ["inproc", "tcp"] {
        let out = format!("live-{link}");
        let args =
            ["run", "plant.scene", "--link", link, "--live", "40", "--frames", "20", "--size", "64x64"];
        bench.done(&[&args[..], &["--audit-every", "3", "--out", &out]].concat());
        let report = bench.report(&out);
        assert_eq!(report["run"]["mode"], "live");
        let frames = report["frames"].as_array().unwrap();
        assert!(!frames.is_empty());
        for (number, frame) in frames.iter().enumerate() {
            assert_eq!(frame["frame"], number, "no frame is missing");
            assert_ne!(frame["forward"], serde_json::json!([0.0, 0.0, 0.0]), "each shows a pose of the path");
            assert!(frame["latency_ms"].as_f64().unwrap() >= 0.0);
            if number % 3 == 0 {
                let wrong = (&frame["cut_mismatch_pixels"], &frame["false_culled_pixels"]);
                assert_eq!(wrong, (&0.into(), &0.into()), "frame {number} over {link}");
            }
        }
    }
}

#[test]
fn a_live_walk_that_is_over_before_its_first_frame_says_so() {
    let bench = Bench::with_plant(300);
    let run = bench.trimaran(&["run", "plant.scene", "--live", "1000000", "--frames", "1", "--out", "none"]);
    expect(&run, 3, &["the path was over before its first frame", "--frames"]);
    assert!(!bench.path("none/report.json").exists());
}

#[test]
fn only_roles_that_compute_one_after_another_are_a_model_of_a_machine_each() {
    const WALK: [&str; 8] = ["run", "plant.scene", "--frames", "6", "--size", "96x80", "--audit-every", "3"];
    let bench = Bench::with_plant(300);
    let walk = |out: &str, more: &[&str]| {
        (bench.done(&[&WALK[..], &["--out", out], more].concat()), bench.report(out))
    };
    let (text, report) = walk("at-once", &[]);
    assert!(!text.contains("MODEL") && text.contains("run with --alone"), "{text}");
    assert!(report["summary"]["model"].is_null() && report["run"]["alone"] == false, "{report}");

    let (text, report) = walk("alone", &["--alone"]);
    assert!(text.contains("\nMODEL ") && !text.contains("\nmeasured "), "{text}");
    assert_eq!(report["run"]["alone"], true);
    let model = |key: &str| report["summary"]["model"][key].as_f64().unwrap();
    assert!(model("fps_at_least") <= model("fps"));
    let frames = report["frames"].as_array().unwrap();
    let spans = frames.iter().flat_map(|frame| frame["timeline"].as_array().unwrap());
    let mut spans: Vec<_> =
        spans.map(|s| ["start_ms", "end_ms"].map(|key| s[key].as_f64().unwrap())).collect();
    assert_eq!(spans.len(), 18);
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    for pair in spans.windows(2) {
        assert!(pair[0][1] <= pair[1][0] + 1e-6, "{:?} overlaps {:?}", pair[0], pair[1]);
    }
    assert_eq!(pictures(&bench, "alone", 6), pictures(&bench, "at-once", 6));

    bench.refuses(&["run", "plant.scene", "--alone", "--link", "tcp"], &["--alone", "--link"]);
    bench.refuses(&["run", "plant.scene", "--alone", "--live", "30"], &["--alone", "--live"]);
}

#[test]
fn stopping_at_few_pixels_needs_a_test_that_counts() {
    let bench = Bench::with_plant(300);
    let args = ["run", "plant.scene", "--few-pixels", "--frames", "4", "--size", "64x64", "--out", "few"];
    expect(&bench.trimaran(&args), 2, &["--few-pixels", "--occlusion-test raster"]);
    bench.done(&[&args[..], &["--occlusion-test", "raster", "--epsilon", "20"]].concat());
    assert!(bench.report("few")["frames"][0]["culling"]["stopped_at_few_pixels"].is_u64());
}

#[test]
fn a_recorded_walk_is_simulated_frame_by_frame() {
    let bench = Bench::with_plant(300);
    let args = ["run", "plant.scene", "--record", "walk.trace", "--frames", "12", "--size", "64x64"];
    bench.done(&[&args[..], &["--batch", "16", "--audit-every", "0"]].concat());
    let report = bench.report("out");
    let frames = report["frames"].as_array().unwrap();
    let nodes: f64 = frames.iter().map(|frame| frame["nodes_drawn"].as_f64().unwrap()).sum();

    let args = ["sim", "--trace", "walk.trace", "--frames", "12", "--link", "tcp,udp", "--json"];
    let sim = bench.done(&[&args[..], &["--out", "figures", "--seed", "1,2"]].concat());
    let runs: serde_json::Value = serde_json::from_str(&sim).unwrap();
    for run in runs.as_array().unwrap() {
        assert_eq!(run["nodes"].as_f64().unwrap(), nodes / 12.0);
        assert!((run["bytes"]["ids"].as_f64().unwrap() - 4.0 * nodes / 12.0).abs() < 1e-9);
    }

    assert_eq!(runs.as_array().unwrap().len(), 4, "two transports with two seeds");
    let page = fs::read_to_string(bench.path("figures/sim.html")).unwrap();
    for outside in ["http", "url(", "@import", "<link", " href=", "<script"] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(!page.contains("NaN") && !page.contains("inf\""));
    let lines = |name: &str| fs::read_to_string(bench.path(name)).unwrap().lines().count();
    assert_eq!((lines("figures/runs.csv"), lines("figures/frames.csv")), (1 + 2, 1 + 4 * 12));

    // Frames culled by the display itself have no arrivals.
    let alone = ["run", "plant.scene", "--record", "alone.trace", "--frames", "4", "--size", "64x64"];
    bench.done(&[&alone[..], &["--cullers", "0", "--audit-every", "0", "--out", "alone"]].concat());
    let sim = bench.done(&["sim", "--trace", "alone.trace", "--frames", "4", "--cullers", "0", "--json"]);
    let runs: serde_json::Value = serde_json::from_str(&sim).unwrap();
    let run = &runs[0];
    let [all, parts] = [&run["latency_ms"], &run["waiting_ms"]].map(|of| of["p50"].as_f64().unwrap());
    assert!(all > 0.0 && parts < 1e-9, "{run}");

    let bytes = fs::read(bench.path("walk.trace")).unwrap();
    bench.write("short.trace", &bytes[..bytes.len() - 9]);
    bench.refuses(&["sim", "--trace", "short.trace"], &["short.trace", "cut short", "record the walk again"]);
    bench.refuses(&["sim", "--trace", "plant.scene"], &["plant.scene", "trimaran run --record"]);
}

#[test]
fn a_recorded_walk_sends_an_empty_display_what_a_real_one_is_sent() {
    let bench = Bench::with_plant(300);
    let walk = ["run", "plant.scene", "--frames", "12", "--size", "256x256", "--audit-every", "0"];
    let of = |trace: &str, words: &[&str]| -> serde_json::Value {
        serde_json::from_str(
            &bench.done(&[&["sim", "--frames", "12", "--json", "--trace", trace], words].concat()),
        )
        .unwrap()
    };
    let sent = |words: &[&str], out: &str| {
        bench.done(&[&walk[..], words, &["--record", &format!("{out}.trace")]].concat());
        bench.done(&[&walk[..], words, &["--empty-display", "--link", "tcp", "--out", out]].concat());
        let report = bench.report(out);
        let ahead = |key: &str| report["run"]["ahead"][key].as_f64().unwrap();
        (
            report["summary"]["bytes_by_kind"]["geometry"].as_f64().unwrap(),
            ahead("bytes") - ahead("used_bytes"),
        )
    };
    let empty = ["--scene", "plant.scene", "--empty-display"];
    let simulated = |trace: &str| -> Vec<f64> {
        let runs = of(trace, &empty);
        let runs = runs.as_array().unwrap();
        assert!(runs.iter().all(|run| run["pixels"].is_null()), "nothing is drawn");
        runs.iter().map(|run| 12.0 * run["bytes"]["geometry"].as_f64().unwrap()).collect()
    };

    // The amount sent ahead of a moving camera depends on the time of each frame.
    let (moving, unused) = sent(&[], "moving");
    let runs = simulated("moving.trace");
    assert_eq!(runs.len(), 3, "three transports");
    assert!(
        runs.iter().all(|bytes| *bytes > 0.97 * (moving - unused)),
        "{moving} sent, {unused} unused, {runs:?}"
    );

    let report = bench.report("moving");
    let frame = &report["frames"][5];
    let pose = serde_json::json!({ "eye": frame["eye"], "forward": frame["forward"], "up": frame["up"] });
    let (vfov, near) = (&report["vfov_deg"], &report["near"]);
    let still = serde_json::json!({ "vfov_deg": vfov, "near": near, "frames": vec![pose; 12] });
    bench.write("still.json", still.to_string());
    let (still, unused) = sent(&["--path", "still.json"], "still");
    assert!(unused < 1.0, "a camera that stands still has nothing ahead");
    let runs = simulated("still.trace");
    assert!(runs.iter().all(|bytes| (bytes / still - 1.0).abs() < 0.03), "{still} sent, {runs:?} simulated");

    let sim = ["sim", "--trace", "moving.trace", "--frames", "12", "--json"];
    assert_eq!(of("moving.trace", &[])[0]["bytes"]["geometry"], 0.0);

    let refused = |words: &[&str], says: &[&str]| bench.refuses(&[&sim[..], words].concat(), says);
    refused(&["--empty-display"], &["--scene"]);
    bench.done(&["generate", "plant", "--triangles", "9000", "--seed", "5", "-o", "other.scene"]);
    refused(&["--scene", "other.scene", "--empty-display"], &["recorded in scene"]);
    refused(&["--scene", "plant.scene", "--empty-display", "--cullers", "0"], &["at least one culler"]);
}

/// The report as a path: the same frames.
fn walks_again(bench: &Bench) -> bool {
    let again = ["run", "plant.scene", "--path", "inproc/report.json", "--out", "again", "--size", "96x80"];
    bench.done(&again);
    let picture = |dir: &Path| fs::read(dir.join("frames/00005.png")).unwrap();
    picture(&bench.path("again")) == picture(&bench.path("inproc"))
}

#[test]
fn a_model_is_never_written_over() {
    let bench = Bench::empty();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\no plate\nf 1 2 3 4\n";
    for name in ["a.obj", "b.obj"] {
        bench.write(name, square);
    }
    fs::hard_link(bench.path("b.obj"), bench.path("link.scene")).unwrap();
    // `-o *.obj`: the shell puts the first model behind the flag.
    bench.refuses(&["import", "-o", "a.obj", "b.obj"], &["a.obj", "no cooked scene", "another file"]);
    bench.refuses(&["import", "a.obj", "b.obj", "-o", "./b.obj"], &["./b.obj", "to be read"]);
    bench.refuses(&["import", "b.obj", "-o", "link.scene"], &["link.scene", "to be read"]);
    bench.refuses(&["generate", "plant", "--objects", "9", "-o", "a.obj"], &["a.obj", "no cooked scene"]);
    bench.refuses(&["import", "a.obj", "-o", "."], &["no cooked scene"]);
    for name in ["a.obj", "b.obj", "link.scene"] {
        assert_eq!(fs::read_to_string(bench.path(name)).unwrap(), square, "{name}");
    }
    // A scene may be overwritten, and an empty file is a reserved name.
    bench.write("c.scene", "");
    for _ in 0..2 {
        bench.done(&["import", "a.obj", "b.obj", "-o", "c.scene"]);
    }
    bench.refuses(&["run", "c.scene", "--record", "a.obj", "--out", "walk"], &["a.obj", "no trace"]);
    assert_eq!(fs::read_to_string(bench.path("a.obj")).unwrap(), square);
}

#[test]
fn strict_makes_warnings_errors_and_writes_nothing() {
    let bench = Bench::empty();
    bench.write("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\no plate\nf 1 2 3\nl 1 2\n");
    bench.refuses(
        &["import", "a.obj", "-o", "a.scene", "--strict"],
        &["a.obj: 1 primitives of points or lines", "nothing was written"],
    );
    assert_eq!(bench.files(), ["a.obj"], "something was left behind");
    bench.done(&["import", "a.obj", "-o", "a.scene"]);
}

#[test]
fn the_log_is_text_or_json() {
    let bench = Bench::empty();
    let said_in = |format: &str| {
        let mut command = bench.command(&["info", "missing.scene"]);
        let output = command.env("TRIMARAN_LOG_FORMAT", format).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        said(&output)
    };
    let text = said_in("text");
    assert!(text.starts_with("trimaran: ") && text.contains("missing.scene"), "{text}");
    let json: serde_json::Value = serde_json::from_str(&said_in("json")).unwrap();
    assert_eq!(json["level"], "ERROR");
    assert_eq!(format!("trimaran: {}\n", json["fields"]["message"].as_str().unwrap()), text);
    let refused = said_in("xml");
    assert!(refused.contains("TRIMARAN_LOG_FORMAT is \"xml\": it may be json or text"), "{refused}");
}

#[test]
fn manual_pages_have_every_command_with_its_flags() {
    let bench = Bench::empty();
    bench.done(&["man", "share/man1"]);
    let page = |name: &str| fs::read_to_string(bench.path("share/man1").join(name)).unwrap();
    assert!(page("trimaran.1").contains("trimaran\\-serve(1)"), "{}", page("trimaran.1"));
    assert!(page("trimaran-role-culler.1").contains("\\-\\-peer\\-displays"));
    assert!(page("trimaran-serve.1").contains("TRIMARAN_LISTEN"));
    bench.write("file", "");
    bench.refuses(&["man", "file"], &["cannot write to file"]);
}
