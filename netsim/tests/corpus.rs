//! What the fuzz targets of hellos and answers look for, on what they have found so far, and a little
//! further.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use proptest::prelude::*;

#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../fuzz/src/hellos.rs"]
mod hellos;

type Check = fn(&[u8]);

/// Each with how many inputs there are at least.
const TARGETS: [(&str, usize, Check); 2] = [("hellos", 14, hellos::hellos), ("answers", 10, hellos::answers)];

/// The corpus of a target.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = format!(concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus/{}"), target);
    std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read(entry.unwrap().path()).unwrap()).collect()
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    for (target, least, check) in TARGETS {
        let inputs = corpus(target);
        inputs.iter().for_each(|input| check(input));
        assert!(inputs.len() >= least, "only {} inputs of {target}: is the corpus there?", inputs.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    /// Inputs of the corpus with a few bytes broken.
    #[test]
    fn broken_inputs_of_the_corpus_do_no_harm(
        which in any::<prop::sample::Index>(),
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        for (target, _, check) in TARGETS {
            let inputs = corpus(target);
            let mut input = which.get(&inputs).clone();
            for (at, byte) in &broken {
                if !input.is_empty() {
                    let at = at.index(input.len());
                    input[at] = *byte;
                }
            }
            check(&input);
        }
    }
}
