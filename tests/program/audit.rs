//! `trimaran audit`: the hard cases of culling as a table, as JSON and as a page.

use std::fs;

use serde_json::Value;

use crate::common::program::{Bench, said};

#[test]
fn some_hard_cases_hold_on_the_oracle_and_on_each_device() {
    let bench = Bench::empty();
    let output = bench.trimaran(&["audit", "hard", "--only", "3,12,13,20", "--json"]);
    assert!(output.status.success(), "{}", said(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["holds"], true);
    let drivers = found["hard"]["drivers"].as_array().unwrap();
    assert!(drivers.len() >= 2 && drivers[0]["name"] == "f64 oracle", "{drivers:?}");
    let rows = found["hard"]["rows"].as_array().unwrap();
    let numbers: Vec<_> = rows.iter().map(|row| row["number"].as_u64().unwrap()).collect();
    assert_eq!(numbers, [3, 12, 12, 12, 12, 13, 20, 20]);
    for row in rows {
        let cells = row["cells"].as_array().unwrap();
        assert_eq!(cells.len(), drivers.len(), "{row}");
        let walks = cells.iter().filter(|cell| cell["figures"].is_object());
        for walk in walks {
            assert_eq!(walk["text"], "0 px, 0 nodes");
            assert!(walk["figures"]["drawn"].as_u64().unwrap() > 0, "{row}");
        }
    }
    let delay = rows.last().unwrap()["cells"][1]["text"].as_str().unwrap();
    assert!(delay.starts_with("0: 0 (0 px), 1: "), "{delay}");
}

#[test]
fn a_page_replaces_only_a_page_and_unknown_numbers_are_refused() {
    let bench = Bench::empty();
    bench.write("notes.md", "my own notes");
    let refused = bench.trimaran(&["audit", "hard", "--only", "13", "--out", "notes.md"]);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
    assert_eq!(fs::read_to_string(bench.path("notes.md")).unwrap(), "my own notes");
    let refused = bench.trimaran(&["audit", "hard", "--only", "24"]);
    assert_eq!(refused.status.code(), Some(2), "{}", said(&refused));
}

#[test]
fn a_short_search_counts_frames_and_replays_what_was_kept() {
    let bench = Bench::empty();
    let output = bench.trimaran(&["audit", "search", "--frames", "100", "--seed", "7", "--json"]);
    assert!(output.status.success() && output.stderr.is_empty(), "{}", said(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&found["wrong_pixels"], &found["lost_nodes"]), (&0.into(), &0.into()));
    assert_eq!((&found["seeds"], &found["trials"]), (&serde_json::json!([7, 8]), &1.into()));
    assert!(found["frames"].as_u64().unwrap() >= 100 && !found["driver"].as_str().unwrap().is_empty());
    assert!(!bench.path("found").exists());

    let kept = concat!(env!("CARGO_MANIFEST_DIR"), "/lab/audit/tests/kept/stale-depth.json");
    let output = bench.trimaran(&["audit", "search", "--replay", kept]);
    assert!(output.status.success(), "{}", said(&output));
    let out = String::from_utf8_lossy(&output.stdout);
    assert!(out.starts_with("2 frames by independent-1-hzb"), "{out}");

    // A device with memory for nothing.
    let text = fs::read_to_string(kept).unwrap().replace("\"trial\"", "\"gpu_memory\":64,\"trial\"");
    bench.write("broken.json", &text);
    let output = bench.trimaran(&["audit", "search", "--replay", "broken.json"]);
    assert_eq!(output.status.code(), Some(1), "{}", said(&output));
    assert!(said(&output).contains("the budget is 64"), "{}", said(&output));
    bench.write("broken.json", "{");
    assert_eq!(bench.trimaran(&["audit", "search", "--replay", "broken.json"]).status.code(), Some(2));
}
