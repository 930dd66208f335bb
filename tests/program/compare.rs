//! `trimaran compare`: every system on one generated plant, and refused arguments.

use std::fs;

use serde_json::Value;

use crate::common::program::{Bench, Process, said};

const FRAMES: &str = "12";

fn figures<'v>(table: &'v Value, system: &str) -> &'v Value {
    let systems = table["systems"].as_array().unwrap();
    systems.iter().find(|figures| figures["system"] == system).unwrap_or_else(|| panic!("no {system}"))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

/// All systems walk the same frames. Their pictures are the same; the sets and machines differ as expected.
#[test]
fn every_system_shows_the_same_pictures() {
    let bench = Bench::with_plant(1_500);
    let walk = ["--frames", FRAMES, "--size", "200x160", "--audit-every", "3", "--paths", "2"];
    let more = ["--epsilon", "2", "--curve", "2,8", "--live", "10", "--link", "unix", "--out", "c", "--json"];
    let args = [&["compare", "plant.scene"][..], &walk, &more].concat();
    let output = bench.trimaran(&args);
    assert!(output.status.success(), "{}", said(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    let written: Value = serde_json::from_slice(&fs::read(bench.path("c/compare.json")).unwrap()).unwrap();
    assert_eq!(found, written);

    let table = &found["tables"][0];
    let systems = table["systems"].as_array().unwrap();
    assert_eq!(systems.len(), 12);
    for figures in systems {
        let name = &figures["system"];
        let drawn = figures["drawn"].as_array().unwrap();
        assert_eq!(drawn.len(), 2, "{name}: a record a path");
        for drawn in drawn {
            assert_eq!(drawn["audited_frames"], 3, "{name}: the first frame is left out");
            if name != "rays" {
                assert_eq!((&drawn["wrong_pixels"], &drawn["lost_nodes"]), (&0.into(), &0.into()), "{name}");
            }
        }
        for paths in [&figures["alone"]["model_fps"], &figures["measured"]["fps"]] {
            let paths: Vec<f64> = paths.as_array().unwrap().iter().map(number).collect();
            assert!(paths.len() == 2 && paths.iter().all(|fps| *fps > 0.0), "{name}: {paths:?}");
        }
        assert_eq!(figures["frames"].as_array().unwrap().len(), 12, "{name}");
    }
    assert_ne!(systems[0]["drawn"][0]["triangles"], systems[0]["drawn"][1]["triangles"], "other paths");
    for path in 0..2 {
        let over = |system: &str, what: &str| number(&figures(table, system)["drawn"][path][what]);
        assert_eq!(over("exact", "objects_over_exact"), 1.0);
        let objects = |system| over(system, "objects_over_exact");
        let triangles = |system| over(system, "triangles_over_exact");
        assert!(objects("independent-1") <= objects("gigawalk"), "ours draws no more");
        assert!(triangles("exact") <= triangles("switch") && triangles("switch") < triangles("frustum"));
        assert!(triangles("gigawalk") < triangles("frustum"), "GigaWalk culls something");
        for rival in ["paper", "chc++"] {
            assert!(triangles(rival) < triangles("frustum"), "{rival} culls something");
        }
        let nodes = |system| over(system, "nodes");
        assert_eq!(nodes("gigawalk"), nodes("distributed-gigawalk"), "only what joins them differs");
    }
    let processes = |system| &figures(table, system)["measured"]["processes"];
    assert_eq!([processes("gigawalk"), processes("distributed-gigawalk"), processes("paper")], [1, 2, 3]);
    let occlusion = &figures(table, "frustum")["alone"];
    assert!(number(&occlusion["or_ms"][0]) < 0.1, "nothing draws occluders: {occlusion}");

    let curve = found["curve"].as_array().unwrap();
    assert_eq!(curve.len(), 2 * 2 * systems.len(), "a point a bound, path and system");
    let of = |epsilon: f64| -> Vec<&Value> {
        let of = |point: &&Value| {
            point["epsilon_px"] == epsilon && point["path"] == 0 && point["system"] != "rays"
        };
        curve.iter().filter(of).collect()
    };
    for epsilon in [2.0, 8.0] {
        let first = of(epsilon)[0];
        let same = |point: &&Value| {
            (&point["flip_mean"], &point["silhouette_max_px"])
                == (&first["flip_mean"], &first["silhouette_max_px"])
        };
        assert!(of(epsilon).iter().all(same), "pictures of one error bound are the same");
        assert!(number(&first["silhouette_max_px"]) <= epsilon + 0.1);
    }
    assert!(number(&of(8.0)[0]["flip_mean"]) > number(&of(2.0)[0]["flip_mean"]));
    // Larger errors are seen more when they come and go.
    let popping = found["popping"].as_array().unwrap();
    assert_eq!(popping.len(), 2 * 2, "a record a bound and path");
    let changed = |epsilon: f64| -> f64 {
        let of = popping.iter().filter(|point| point["epsilon_px"] == epsilon);
        of.map(|point| number(&point["changed_p95"])).sum()
    };
    assert!(changed(8.0) > changed(2.0) && changed(2.0) > 0.0, "{popping:?}");
    assert_eq!(found["coherence"].as_array().unwrap().len(), 4 * systems.len());
    for point in found["coherence"].as_array().unwrap().iter().filter(|point| point["system"] == "exact") {
        assert_eq!(point["nodes_over_exact"], 1.0, "{point}");
    }
    let lag = found["lag"].as_array().unwrap();
    assert_eq!(lag.len(), systems.len());
    assert!(lag.iter().all(|point| number(&point["lag_ms"]) > 0.0));

    let page = fs::read_to_string(bench.path("c/compare.html")).unwrap();
    let tables = fs::read_to_string(bench.path("c/tables.md")).unwrap();
    for figures in systems {
        let name = figures["system"].as_str().unwrap();
        assert!(page.contains(name) && tables.contains(name), "{name}");
    }
    let figure = fs::read_to_string(bench.path("c/figures/path-triangles-2.svg")).unwrap();
    assert!(figure.starts_with("<svg xmlns") && figure.contains("exactly visible"));
}

/// The whole model is drawn in each frame, and not held against the LOD cut.
#[test]
fn the_whole_model_is_drawn_at_full_detail() {
    let bench = Bench::with_plant(300);
    let info: Value = serde_json::from_str(&bench.done(&["info", "--json", "plant.scene"])).unwrap();
    let mut args = vec!["compare", "plant.scene", "--systems", "whole,frustum", "--paths", "1", "--frames"];
    args.extend(["3", "--size", "64x64", "--audit-every", "1", "--epsilon", "4", "--curve", "--live"]);
    args.extend(["--no-coherence", "--out", "c", "--json"]);
    let found: Value = serde_json::from_str(&bench.done(&args)).unwrap();
    let [whole, frustum] = ["whole", "frustum"].map(|name| &figures(&found["tables"][0], name)["drawn"][0]);
    assert_eq!(number(&whole["triangles"]), number(&info["triangles"]), "{info}");
    assert_eq!([&whole["audited_frames"], &frustum["audited_frames"]], [0, 2]);
    let tables = fs::read_to_string(bench.path("c/tables.md")).unwrap();
    assert!(
        tables.lines().any(|line| line.starts_with("| whole |") && line.ends_with("| – | – |")),
        "{tables}"
    );
    let page = bench.done(&["report", "c", "--together", "page.html"]);
    assert!(page.lines().any(|line| line.contains(" whole ") && line.ends_with("not audited")), "{page}");
}

/// Ctrl-C loses only the path under way.
#[test]
fn a_comparison_that_is_interrupted_shows_the_paths_that_were_walked() {
    let bench = Bench::with_plant(300);
    let mut args = vec!["compare", "plant.scene", "--systems", "independent-1,frustum", "--paths", "60"];
    args.extend(["--frames", "40", "--size", "64x64", "--audit-every", "10", "--epsilon", "4", "--curve"]);
    args.extend(["--live", "--no-coherence", "--out", "c"]);
    let mut comparing = Process::start(bench.command(&args).env("TRIMARAN_LOG", "info"));
    // A culler is a process of its own on each path.
    for _ in 0..3 {
        comparing.says("has left");
    }
    comparing.signal("INT");
    let ended = comparing.ends(3);
    assert!(ended.contains("the comparison ended early, and its page says so: interrupted"), "{ended}");
    let found: Value = serde_json::from_slice(&fs::read(bench.path("c/compare.json")).unwrap()).unwrap();
    let paths = found["paths"].as_u64().unwrap();
    assert!((2..60).contains(&paths), "{paths}");
    for figures in found["tables"][0]["systems"].as_array().unwrap() {
        assert_eq!(figures["drawn"].as_array().unwrap().len() as u64, paths);
        assert_eq!(figures["measured"]["fps"].as_array().unwrap().len() as u64, paths);
    }
    assert_eq!(found["notes"][0], "ended early: interrupted");
    let page = bench.trimaran(&["report", "c", "--together", "page.html"]);
    assert!(page.status.code() == Some(3) && said(&page).contains("1 comparison is incomplete: c"));
}

#[test]
fn what_makes_no_comparison_is_refused() {
    let bench = Bench::with_plant(300);
    let refused = |more: &[&str], words: &[&str]| {
        let output = bench.trimaran(&[&["compare", "plant.scene", "--out", "c"], more].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}: {}", said(&output));
        for word in words {
            assert!(said(&output).contains(word), "{more:?}: {}", said(&output));
        }
    };
    refused(&["--alone"], &["--alone"]);
    refused(&["--few-pixels", "--occlusion-test", "query"], &["--few-pixels"]);
    refused(&["--link", "inproc"], &["--link", "tcp"]);
    refused(&["--systems", "gigawalks"], &["gigawalks", "distributed-gigawalk"]);
    refused(&["--epsilon", "0"], &["--epsilon"]);
    refused(&["--paths", "0"], &["--paths"]);
    refused(&["--quick", "--paths", "4"], &["--quick", "--paths"]);
    refused(&["--path", "missing.json"], &["missing.json"]);
    assert!(!bench.path("c/compare.json").exists() && !bench.path("c/compare.html").exists());
}
