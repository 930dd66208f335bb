//! Runs the checks of the fuzz targets of hellos and answers on their corpus, and on broken copies of it.

#[allow(unreachable_pub, reason = "the fuzz targets use it too")]
#[path = "../../../fuzz/src/hellos.rs"]
mod hellos;
#[allow(unreachable_pub, dead_code, reason = "tests of other packages use it too")]
#[path = "../../../fuzz/replay.rs"]
mod replay;

type Check = fn(&[u8]) -> bool;

/// Each target with corpus inputs that make a link, unless the corpus has an old layout.
const TARGETS: [(&str, Check, &[&str]); 2] = [
    (
        "hellos",
        hellos::hellos,
        &[
            "a-peer",
            "a-peer-latest-lane-first",
            "a-peer-messages-lane-first",
            "a-peer-bulk-lane-first",
            "a-peer-without-a-role",
            "a-peer-of-two-versions",
        ],
    ),
    ("answers", hellos::answers, &["accept", "accept-with-a-batch-size-and-a-close", "accept-with-version"]),
];

#[test]
fn the_fuzz_corpus_does_no_harm() {
    for (target, check, links) in TARGETS {
        let inputs = replay::corpus(target);
        let linked: Vec<_> =
            inputs.iter().filter(|(_, input)| check(input)).map(|(name, _)| name.as_str()).collect();
        assert!(links.iter().all(|name| linked.contains(name)), "links of {target}: {linked:?}");
    }
}

#[test]
fn broken_inputs_of_the_corpus_do_no_harm() {
    let targets: [replay::Target; 2] = [
        ("hellos", 4, |bytes| _ = hellos::hellos(bytes)),
        ("answers", 2, |bytes| _ = hellos::answers(bytes)),
    ];
    replay::replay_broken(&targets, 200, 1);
}
