//! Runs the checks of the fuzz targets on their corpus, and on broken copies of it.

#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../../fuzz/src/costs.rs"]
mod costs;
#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../../fuzz/src/datagrams.rs"]
mod datagrams;
#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../../fuzz/src/handshakes.rs"]
mod handshakes;
#[allow(unreachable_pub, reason = "tests of other packages use it too")]
#[path = "../../../../fuzz/replay.rs"]
mod replay;

const TARGETS: [replay::Target; 4] = [
    ("strangers", 18, datagrams::strangers),
    ("chunks", 61, datagrams::chunks),
    ("costs", 10, costs::costs),
    ("handshakes", 10, handshakes::handshakes),
];

#[test]
fn the_fuzz_corpus_does_no_harm() {
    replay::replay(&TARGETS);
}

#[test]
fn broken_inputs_of_the_corpus_do_no_harm() {
    replay::replay_broken(&TARGETS, 500, 2);
}
