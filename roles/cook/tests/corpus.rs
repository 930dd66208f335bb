//! Replays what the fuzz targets for models and scenes have in their corpus.
#![allow(clippy::unwrap_used, reason = "a test ends where what it needs is not there")]

use std::fs;
use std::path::Path;

use proptest::prelude::*;

#[path = "../../../fuzz/src/models.rs"]
#[allow(unreachable_pub, reason = "the fuzz targets' library shares the file")]
mod models;

/// The corpus of a target.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(target);
    let mut paths: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| fs::read(path).unwrap()).collect()
}

type Check = fn(&[u8]);

/// Each with how many inputs there are at least.
const TARGETS: [(&str, usize, Check); 4] = [
    ("gltf", 10, models::gltf),
    ("rvm", 10, models::rvm),
    ("obj", 8, models::obj),
    ("scene", 6, models::scene),
];

#[test]
fn the_fuzz_corpus_does_no_harm() {
    for (target, least, check) in TARGETS {
        let inputs = corpus(target);
        assert!(inputs.len() >= least, "only {} inputs of {target}: is the corpus there?", inputs.len());
        inputs.iter().for_each(|input| check(input));
    }
}

proptest! {
    /// Inputs of the corpus with a few bytes broken.
    #[test]
    fn broken_inputs_of_the_corpus_do_no_harm(
        target in 0..TARGETS.len(),
        which: prop::sample::Index,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
    ) {
        let (target, _, check) = TARGETS[target];
        let inputs = corpus(target);
        let mut input = which.get(&inputs).clone();
        for (place, byte) in damage {
            if !input.is_empty() {
                let place = place.index(input.len());
                input[place] = byte;
            }
        }
        check(&input);
    }
}
