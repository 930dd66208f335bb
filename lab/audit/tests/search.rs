//! The search on the f64 reference.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot be set up fails")]

use std::{fs, path::Path};

use trimaran_audit::search::{Trial, judge, shrink};
use trimaran_audit::{Fault, Testing};

const BOTH: [Testing; 2] = [Testing::Rasterized, Testing::Pyramid];

fn fails(trial: &Trial, testing: Testing, fault: Fault) -> bool {
    judge(trial, testing, fault).is_ok_and(|verdict| !verdict.is_sound())
}

#[test]
fn walks_at_random_lose_nothing_and_hide_much() {
    for testing in BOTH {
        let (mut frames, mut hidden) = (0, 0);
        for seed in 0..30 {
            let trial = Trial::draw(seed, 12);
            let verdict = judge(&trial, testing, Fault::None).unwrap();
            if !verdict.is_sound() {
                let least = shrink(trial, 2000, |trial| fails(trial, testing, Fault::None));
                panic!("seed {seed}, {testing:?}, {verdict:?}: {}", serde_json::to_string(&least).unwrap());
            }
            frames += verdict.frames;
            hidden += verdict.hidden;
        }
        assert_eq!(frames, 360);
        assert!(hidden > 4 * frames, "{testing:?}: {hidden} boxes");
    }
}

/// A fault, and how many walks are drawn at most until one shows it.
fn found_and_shrunk(fault: Fault, testing: Testing, seeds: u64) -> Trial {
    let failing = (0..seeds).map(|seed| Trial::draw(seed, 12)).find(|trial| fails(trial, testing, fault));
    let failing = failing.unwrap_or_else(|| panic!("{fault:?}, {testing:?}: not found"));
    let least = shrink(failing, 600, |trial| fails(trial, testing, fault));
    assert!(fails(&least, testing, fault));
    for testing in BOTH {
        let sound = judge(&least, testing, Fault::None).unwrap();
        assert!(sound.is_sound(), "{fault:?}, {testing:?}: {sound:?}");
    }
    println!("{fault:?}, {testing:?}: {}", serde_json::to_string(&least).unwrap());
    least
}

#[test]
fn each_fault_is_found_and_shrunk_to_a_few_objects_and_frames() {
    let any = Testing::Rasterized;
    for (fault, testing, seeds) in [
        (Fault::OtherLevels, any, 40),
        (Fault::OtherLevelsShown(3), any, 20),
        (Fault::StaleDepth, Testing::Pyramid, 20),
        (Fault::SmallBoxes(0.9), any, 40),
        (Fault::NoInflation(1e-3), any, 40),
        (Fault::NoOutline, any, 20),
        (Fault::DroppedIds(9), any, 5),
        (Fault::NearerOccluders(1e-3), any, 40),
        (Fault::NearerOccluders(0.01), Testing::Pyramid, 60),
    ] {
        let least = found_and_shrunk(fault, testing, seeds);
        let size = (least.solids.len(), least.frames.len());
        assert!(size.0 <= 3 && size.1 <= 2, "{fault:?}, {testing:?}: {size:?}");
    }
}

/// Walks that a search has found. The program's tests walk them on a device.
#[test]
fn kept_walks_are_sound() {
    let mut count = 0;
    let tests = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests");
    let files = ["kept", "kept_of_drivers"].map(|folder| fs::read_dir(tests.join(folder)).unwrap());
    for entry in files.into_iter().flatten() {
        let path = entry.unwrap().path();
        let mut kept: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        let trial: Trial = serde_json::from_value(kept["trial"].take()).unwrap();
        for testing in BOTH {
            let verdict = judge(&trial, testing, Fault::None).unwrap();
            assert!(verdict.is_sound(), "{}, {testing:?}: {verdict:?}", path.display());
        }
        count += 1;
    }
    assert!(count > 0);
}
