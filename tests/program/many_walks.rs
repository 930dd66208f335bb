//! `trimaran report DIR.. --together PAGE`: many walks on one page.

use std::fs;

use serde_json::Value;

use crate::common::program::{Bench, printed, said};

/// Two walks, one of them with another seed.
fn walked() -> Bench {
    let bench = Bench::with_plant(60);
    for seed in ["1", "2"] {
        let out = format!("walks/{seed}");
        let walk = ["run", "plant.scene", "--frames", "3", "--size", "64x64", "--audit-every", "2"];
        bench.done(&[&walk[..], &["--seed", seed, "--out", &out]].concat());
    }
    bench
}

#[test]
fn walks_are_put_on_one_page_and_the_exit_code_says_whether_some_are_missing() {
    let bench = walked();
    let printed_page = bench.done(&["report", "walks/2", "walks/1", "--together", "walks/page.html"]);
    assert!(printed_page.contains("plant.scene") && printed_page.ends_with("page: walks/page.html\n"));
    let page = fs::read_to_string(bench.path("walks/page.html")).unwrap();
    for walk in ["1", "2"] {
        assert!(page.contains(&format!(r#"<a href="{walk}/report.html">walks/{walk}</a>"#)), "{page}");
    }
    assert!(page.contains("Culling changed no pixel and lost no visible node on 4 audited frames of 6."));

    // The page is written again, and the walks' JSON stands alone on standard output.
    let missing = ["report", "walks/1", "walks/2", "walks/3", "--together", "walks/page.html", "--json"];
    let output = bench.trimaran(&missing);
    assert_eq!(output.status.code(), Some(3), "{}", said(&output));
    assert!(said(&output).contains("1 folder has no report: walks/3"), "{}", said(&output));
    let walks: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(walks["walks"].as_array().unwrap().len(), 2);
    assert_eq!((&walks["all"]["whole"], &walks["all"]["wrong_pixels"]), (&2.into(), &0.into()));
    assert_eq!(walks["kinds"].as_array().unwrap().len(), 1);
    assert_eq!(walks["without_report"][0]["why"], "there is no such folder");
    assert!(fs::read_to_string(bench.path("walks/page.html")).unwrap().contains("no such folder"));
}

#[test]
fn a_page_takes_the_place_of_no_other_file_and_several_folders_need_one() {
    let bench = walked();
    let before = fs::read(bench.path("walks/1/report.html")).unwrap();
    let refused = |arguments: &[&str], words: &str| {
        let output = bench.trimaran(&[&["report", "walks/1", "walks/2"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(words), "{arguments:?}: {}", said(&output));
    };
    refused(&[], "--together PAGE.html");
    refused(&["--together", "walks/1/report.html"], "is one of the files to be read");
    refused(&["--together", "plant.scene"], "is there already and is no page of a report");
    refused(&["--together", "no/page.html"], "cannot write no/page.html");
    assert_eq!(fs::read(bench.path("walks/1/report.html")).unwrap(), before);
    assert!(!bench.path("no").exists());
    assert!(printed(&bench.trimaran(&["info", "plant.scene"])).contains("plant.scene"));
}
