//! A running session's metrics for a monitoring system and `trimaran stat`.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use tokio::net::TcpStream as Dial;
use trimaran::metrics::{LinkMetrics, Metrics};
use trimaran_actors::{FrameStart, Listener};
use trimaran_proto::{Camera, DrawableId, FrameNumber, Identity, Role, SceneHash, Walkthrough};
use trimaran_transport::{
    Endpoint, Limits, LinkConfig, Net, Options, TokioNet, connect, sleep_until, ws::WsOptions,
};

use crate::common::program::Bench;

/// Between two looks: the server turns away a crowd from one address.
const PAUSE: Duration = Duration::from_millis(20);

fn get(address: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

/// The number behind a line that starts with `series`.
fn value(text: &str, series: &str) -> u64 {
    let line = text.lines().find_map(|line| line.strip_prefix(series));
    line.unwrap_or_else(|| panic!("no {series} in {text}")).trim().parse().unwrap()
}

#[test]
fn a_running_session_shows_what_its_links_carry() {
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "plant.scene"]);
    // More frames than there will be time for: it is interrupted at the end.
    let args = [
        "run",
        "plant.scene",
        "--link",
        "tcp",
        "--metrics",
        "127.0.0.1:0",
        "--frames",
        "20000",
        "--size",
        "32x32",
    ];
    let mut session = bench.start(&args);
    let line = session.says("http://");
    let address = line.split("http://").nth(1).unwrap().trim().trim_end_matches("/metrics").to_owned();
    let received =
        |text: &str| value(text, "trimaran_link_frames_total{peer=\"culler 1\",direction=\"received\"}");
    // The page is there before the links are, and either culler may come first.
    for peer in ["culler 1", "culler 2"] {
        let series = format!("trimaran_link_frames_total{{peer=\"{peer}\"");
        while !get(&address, "/metrics").contains(&series) {
            thread::sleep(PAUSE);
        }
    }
    while received(&get(&address, "/metrics")) == 0 {
        thread::sleep(PAUSE);
    }
    let table = bench.done(&["stat", &address, "--interval", "0.3", "--count", "2"]);
    let lines = bench.done(&["stat", &address, "--json", "--count", "1"]);
    let status = bench.done(&["status", &address]);
    let metrics = get(&address, "/metrics");
    let missing = get(&address, "/nowhere");
    // Interrupted once, it writes a report; twice, it leaves.
    for _ in 0..2 {
        session.signal("INT");
    }
    session.ended();

    assert!(metrics.starts_with("HTTP/1.1 200 OK") && metrics.contains("\ntrimaran_ready 1\n"), "{metrics}");
    assert!(status.starts_with("TRIMARAN OK: the display works; plant.scene | sessions=0 "), "{status}");
    assert!(table.contains("\nframes: shown ") && table.contains("camera to picture "), "{table}");
    let shown = value(&metrics, "trimaran_camera_to_picture_seconds_count");
    assert!(shown > 0 && shown == value(&metrics, "trimaran_frames_total{stage=\"rvg\"}"), "{metrics}");
    checked_by_promtool(&metrics);
    let frames = received(&metrics);
    let begins =
        value(&metrics, "trimaran_link_bytes_total{peer=\"culler 1\",direction=\"received\",kind=\"begin\"}");
    assert!(
        frames > 0 && (76 * frames..=76 * (frames + 1)).contains(&begins),
        "{frames} frames, {begins} bytes"
    );
    assert!(missing.starts_with("HTTP/1.1 404"), "{missing}");
    assert_eq!(table.lines().filter(|line| line.starts_with("peer")).count(), 2, "{table}");
    assert_eq!(table.lines().filter(|line| line.trim_start().starts_with("received")).count(), 4, "{table}");
    let readings: serde_json::Value = serde_json::from_str(&lines).unwrap();
    assert_eq!((&readings[0]["peer"], &readings[1]["peer"]), (&"culler 1".into(), &"culler 2".into()));
    assert!(readings[0]["received"]["ids"].as_u64().unwrap() > 0);
}

/// A listener with room for one peer and four handshakes, which a link over TCP takes, meets a crowd, and a
/// peer that sends more than allowed.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_came_up_against_a_limit_is_counted_and_shown() {
    let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
    let soon = net.now().after(Duration::from_secs(60));
    let identity = |role| Identity { role, scene: Some(SceneHash(1).into()), session: None };
    let limits = Limits::default().with_peers(1).with_handshakes(4);
    let link = LinkConfig::default().with_messages_per_s(2);
    let strict = Options::default().with_limits(limits).with_link(link);
    let anywhere = "tcp://127.0.0.1:0".parse().unwrap();
    let mut listener = Listener::bind(&net, &anywhere, identity(Role::Display), &strict).await.unwrap();
    let there = listener.local_endpoint().clone();
    let Endpoint::Tcp(at) = &there else { panic!("{there}") };

    let options = Options::default();
    let culler = connect::<Walkthrough>(&net, &there, identity(Role::Culler), &options, soon).await;
    let (mut culler, mut display) = (culler.unwrap(), listener.accept(soon).await.unwrap());
    let mut silent = Vec::new();
    for _ in 0..4 {
        silent.push(Dial::connect(at.to_string()).await.unwrap());
    }
    while listener.turned_away().no_room == 0 {
        let _one_too_many = Dial::connect(at.to_string()).await.unwrap();
        sleep_until(&*net, net.now().after(Duration::from_millis(1))).await;
    }
    drop(silent);
    while listener.turned_away().no_place == 0 {
        let by = net.now().after(Duration::from_millis(200));
        let second = connect::<Walkthrough>(&net, &there, identity(Role::Culler), &options, by).await;
        assert!(second.is_err(), "{second:?}");
    }
    let before = listener.turned_away();
    drop(listener);

    let camera = Camera::at_origin(FrameNumber(0));
    culler.frames_tx.begin(FrameStart { frame: FrameNumber(0), header: camera }).await.unwrap();
    for id in 0..1000 {
        culler.frames_tx.push(&[DrawableId(id)]).await.unwrap();
        culler.frames_tx.flush().await.unwrap();
    }
    while display.frames_rx.recv().await.is_ok() {}
    let serving = Metrics::of("display", LinkMetrics::of([&display]))
        .serve(([127, 0, 0, 1], 0).into(), &WsOptions::default(), &tokio::runtime::Handle::current())
        .unwrap();
    let address = serving.address().to_string();
    let (metrics, status) =
        tokio::task::spawn_blocking(move || (get(&address, "/metrics"), get(&address, "/status")))
            .await
            .unwrap();
    // Peers still being turned away when the listener ended may have been counted later.
    let after = display.stats.listener().unwrap().turned_away();
    for (limit, counted) in [
        ("handshakes", before.no_room..=after.no_room),
        ("handshakes_per_s_per_address", 0..=0),
        ("handshakes_per_s", 0..=0),
        ("peers", before.no_place..=after.no_place),
    ] {
        let shown = value(&metrics, &format!("trimaran_link_turned_away_total{{limit=\"{limit}\"}}"));
        assert!(counted.contains(&shown), "{limit}: {shown}, not {counted:?}");
        assert!(
            counted.map(|count| format!("\"{limit}\":{count}")).any(|text| status.contains(&text)),
            "{status}"
        );
    }
    assert!(before.no_room > 0 && before.no_place > 0, "{before:?}");
    assert_eq!(value(&metrics, "trimaran_link_floods_total{peer=\"culler\"}"), 1);
}

/// Prometheus's own check of the page, and of the alerts.
fn checked_by_promtool(metrics: &str) {
    let promtool = |args: &[&str], input: &str| {
        let started =
            Command::new("promtool").args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        let Ok(mut promtool) = started else {
            eprintln!("skipped: promtool is not there (Debian's package prometheus)");
            return;
        };
        promtool.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        let checked = promtool.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&checked.stdout);
        assert!(checked.status.success(), "{args:?}: {said}");
    };
    promtool(&["check", "metrics"], metrics.split("\r\n\r\n").nth(1).unwrap());
    promtool(&["check", "rules", concat!(env!("CARGO_MANIFEST_DIR"), "/deploy/prometheus/rules.yml")], "");
}

#[test]
fn the_page_says_what_to_do_at_each_alert() {
    let text = |path: &str| fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap();
    let (rules, page) = (text("deploy/prometheus/rules.yml"), text("docs/operations.md"));
    let alerts: Vec<_> =
        rules.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")).map(str::to_owned).collect();
    let told = page.lines().filter_map(|line| line.strip_prefix("| `Trimaran")?.split('`').next());
    let told: Vec<_> = told.map(|name| format!("Trimaran{name}")).collect();
    assert!(!alerts.is_empty() && alerts == told, "{alerts:?}, {told:?}");
}

/// A culler that waits for its scene lives and is not ready; once the scene is there it is.
#[test]
fn a_probe_hears_when_a_culler_has_its_scene() {
    let bench = Bench::empty();
    bench.done(&["generate", "plant", "--objects", "60", "--triangles", "6000", "-o", "cooked.scene"]);
    let args = ["role", "culler", "--scene", "plant.scene", "--listen", "tcp://127.0.0.1:0"];
    let mut culler = bench.start(&[&args[..], &["--metrics", "127.0.0.1:0"]].concat());
    let line = culler.says("http://");
    let address = line.split("http://").nth(1).unwrap().trim().trim_end_matches("/metrics").to_owned();
    assert!(get(&address, "/livez").starts_with("HTTP/1.1 200"));
    assert!(get(&address, "/readyz").starts_with("HTTP/1.1 503"));
    let status = || bench.trimaran(&["status", &address]);
    let critical = |words: &str| {
        let told = status();
        let line = String::from_utf8_lossy(&told.stdout);
        assert!(told.status.code() == Some(2) && line.starts_with("TRIMARAN CRITICAL: "), "{line}");
        assert!(line.contains(words), "{line}");
    };
    critical("the culler is not ready");
    fs::rename(bench.path("cooked.scene"), bench.path("plant.scene")).unwrap();
    culler.says("listens on");
    while !get(&address, "/readyz").starts_with("HTTP/1.1 200") {
        thread::sleep(PAUSE);
    }
    let metrics = get(&address, "/metrics");
    assert!(metrics.contains("trimaran_scene_info{name=\"plant.scene\","), "{metrics}");
    assert!(value_of_f64(&metrics, "trimaran_gpu_memory_bytes{kind=\"geometry\"}") > 0.0, "{metrics}");
    culler.signal("TERM");
    culler.ended();
    critical("nobody answers there");
}

fn value_of_f64(text: &str, series: &str) -> f64 {
    let line = text.lines().find_map(|line| line.strip_prefix(series));
    line.unwrap_or_else(|| panic!("no {series} in {text}")).trim().parse().unwrap()
}

#[test]
fn stat_says_when_nothing_is_there() {
    let said = Bench::empty().start(&["stat", "127.0.0.1:1"]).ends(1);
    assert!(said.contains("127.0.0.1:1") && said.contains("--metrics"), "{said}");
}
