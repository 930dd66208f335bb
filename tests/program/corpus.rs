//! Replays the corpus of the file fuzz targets.

#[path = "../../fuzz/src/files.rs"]
#[allow(unreachable_pub, reason = "the fuzz targets' library shares the file")]
mod files;
#[path = "../../fuzz/replay.rs"]
#[allow(unreachable_pub, reason = "tests of other packages share the file")]
mod replay;

const TARGETS: [replay::Target; 5] = [
    ("traces", 15, files::traces),
    ("profiles", 25, files::profiles),
    ("tiles", 6, files::tiles),
    ("queries", 8, files::queries),
    ("bcf", 16, files::bcf),
];

#[test]
fn the_fuzz_corpus_does_no_harm() {
    replay::replay(&TARGETS);
}

#[test]
fn broken_inputs_of_the_corpus_do_no_harm() {
    replay::replay_broken(&TARGETS, 128, 1);
}
