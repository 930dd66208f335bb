//! The search on the f64 reference.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up fails")]

use trimaran_audit::search::{Trial, Verdict, judge, shrink};
use trimaran_audit::{Fault, Testing};

const BOTH: [Testing; 2] = [Testing::Rasterized, Testing::Pyramid];

#[test]
fn nothing_is_lost_on_trials_at_random() {
    for testing in BOTH {
        let mut all = Verdict::default();
        for seed in 0..40 {
            let trial = Trial::draw(seed, 12);
            let verdict = judge(&trial, testing, Fault::None).unwrap();
            if !verdict.is_sound() {
                let least = shrink(trial.clone(), 3000, |trial| {
                    judge(trial, testing, Fault::None).is_ok_and(|verdict| !verdict.is_sound())
                });
                panic!("seed {seed}, {testing:?}: {verdict:?}: {}", serde_json::to_string(&least).unwrap());
            }
            all.frames += verdict.frames;
            all.hidden += verdict.hidden;
        }
        println!("{testing:?} {all:?}");
    }
}

#[test]
fn each_fault_is_found_and_shrunk() {
    for fault in [
        Fault::OtherLevels,
        Fault::OtherLevelsShown(3),
        Fault::StaleDepth,
        Fault::SmallBoxes(0.9),
        Fault::SmallBoxes(0.99),
        Fault::NoInflation(0.01),
        Fault::NoInflation(1e-4),
        Fault::NoInflation(1e-6),
        Fault::NoOutline,
        Fault::DroppedIds(9),
        Fault::NearerOccluders(0.01),
        Fault::NearerOccluders(1e-4),
        Fault::NearerOccluders(1e-6),
    ] {
        for testing in BOTH {
            let fails = |trial: &Trial| judge(trial, testing, fault).is_ok_and(|verdict| !verdict.is_sound());
            let seeds: Vec<u64> = (0..400).filter(|seed| fails(&Trial::draw(*seed, 12))).collect();
            let Some(&seed) = seeds.first() else {
                println!("{fault:?} {testing:?}: not found");
                continue;
            };
            let mut tries = 0;
            let least = shrink(Trial::draw(seed, 12), 3000, |trial| {
                tries += 1;
                fails(trial)
            });
            println!(
                "{fault:?} {testing:?}: {} of 400, seed {seed}: {} solids, {} frames, {tries} tries: {}",
                seeds.len(),
                least.solids.len(),
                least.frames.len(),
                serde_json::to_string(&least).unwrap()
            );
        }
    }
}
