//! What the fuzz targets look for, on what they have found so far, and a little further.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use proptest::prelude::*;

#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/costs.rs"]
mod costs;
#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/datagrams.rs"]
mod datagrams;
#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/handshakes.rs"]
mod handshakes;
#[allow(unreachable_pub, dead_code, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/wire.rs"]
mod wire;

/// What holds for any bytes.
type Check = fn(&[u8]);

/// Each check by the name of its target, and how many inputs there are at least.
const TARGETS: [(&str, Check, usize); 4] = [
    ("strangers", datagrams::strangers, 18),
    ("chunks", datagrams::chunks, 61),
    ("costs", costs::costs, 10),
    ("handshakes", handshakes::handshakes, 10),
];

/// The corpus of a target.
fn corpus(target: &str) -> Vec<Vec<u8>> {
    let folder = format!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/corpus/{}"), target);
    std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read(entry.unwrap().path()).unwrap()).collect()
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    for (target, check, least) in TARGETS {
        let inputs = corpus(target);
        inputs.iter().for_each(|input| check(input));
        assert!(inputs.len() >= least, "only {} inputs of {target}: is the corpus there?", inputs.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

    /// Two inputs of the corpus, one behind the other, with a few bytes broken.
    #[test]
    fn broken_inputs_of_the_corpus_do_no_harm(
        first in any::<prop::sample::Index>(), second in any::<prop::sample::Index>(),
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
    ) {
        for (target, check, _) in TARGETS {
            let inputs = corpus(target);
            let mut input = [first.get(&inputs).clone(), second.get(&inputs).clone()].concat();
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
