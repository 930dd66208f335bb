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
fn rates() {
    for fault in [
        Fault::None,
        Fault::OtherLevels,
        Fault::StaleDepth,
        Fault::SmallBoxes(0.99),
        Fault::NoInflation(1e-4),
        Fault::NoOutline,
    ] {
        for testing in BOTH {
            let verdicts: Vec<Verdict> =
                (0..150).map(|seed| judge(&Trial::draw(seed, 12), testing, fault).unwrap()).collect();
            let found = verdicts.iter().filter(|v| !v.is_sound()).count();
            let hidden: u64 = verdicts.iter().map(|v| v.hidden).sum();
            let with = verdicts.iter().filter(|v| v.hidden > 0).count();
            println!("{fault:?} {testing:?}: {found} of 150, hidden {hidden}, in {with}");
        }
    }
}
