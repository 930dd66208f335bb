//! What the fuzz targets of hellos and answers look for, on what they have found so far, and a little
//! further.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use proptest::prelude::*;

#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../fuzz/src/hellos.rs"]
mod hellos;

type Check = fn(&[u8]) -> bool;

/// Each with inputs of its corpus that make a link, unless the corpus is in a layout of the past.
const TARGETS: [(&str, Check, &[&str]); 2] = [
    (
        "hellos",
        hellos::hellos,
        &["a-peer", "a-peer-latest-lane-first", "a-peer-messages-lane-first", "a-peer-without-a-role"],
    ),
    ("answers", hellos::answers, &["accept", "accept-with-a-batch-size-and-a-close"]),
];

/// The corpus of a target: names and inputs.
fn corpus(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = format!(concat!(env!("CARGO_MANIFEST_DIR"), "/../fuzz/corpus/{}"), target);
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap());
    files.map(|file| (file.file_name().into_string().unwrap(), std::fs::read(file.path()).unwrap())).collect()
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    for (target, check, links) in TARGETS {
        let inputs = corpus(target);
        let linked: Vec<_> =
            inputs.iter().filter(|(_, input)| check(input)).map(|(name, _)| name.as_str()).collect();
        assert!(links.iter().all(|name| linked.contains(name)), "links of {target}: {linked:?}");
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
        for (target, check, _) in TARGETS {
            let inputs = corpus(target);
            let (_, mut input) = which.get(&inputs).clone();
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
