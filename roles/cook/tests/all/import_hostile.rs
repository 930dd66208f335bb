//! The corpus of the fuzz targets for models and scenes, unchanged, cut off, and with bytes, numbers and
//! measures changed at random: the result is a valid model or an error.

use proptest::prelude::*;
use proptest::sample::Index;
use trimaran_cook::import::WarningKind;

use crate::import_files::{RvmWriter, import_bytes, reals};

const TARGETS: [crate::replay::Target; 8] = [
    ("gltf", 34, crate::models::gltf),
    ("rvm", 34, crate::models::rvm),
    ("rvm_text", 15, crate::models::rvm_text),
    ("attributes", 12, crate::models::attributes),
    ("obj", 27, crate::models::obj),
    ("stl", 35, crate::models::stl),
    ("ply", 33, crate::models::ply),
    ("scene", 28, crate::models::scene),
];

/// An input of the corpus.
fn input(target: &str, name: &str) -> Vec<u8> {
    crate::replay::corpus(target).into_iter().find(|(known, _)| known == name).unwrap().1
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    crate::replay::replay(&TARGETS);
}

#[test]
fn broken_inputs_of_the_corpus_do_no_harm() {
    crate::replay::replay_broken(&TARGETS, 400, 1);
}

#[test]
fn every_cut_of_a_binary_file_is_an_error() {
    let glb = input("gltf", "coloured-and-sparse-below-a-matrix");
    for end in 0..glb.len() {
        assert!(import_bytes("a.glb", &glb[..end]).is_err(), "cut at {end}");
    }
    let rvm = input("rvm", "one-of-each-in-two-groups-with-a-colour");
    // The letters of the last chunk are enough.
    let (rvm, _) = rvm.split_at(rvm.len() - 16);
    let mut cut_behind_all_groups = Vec::new();
    for end in 0..rvm.len() {
        let Ok(imported) = import_bytes("a.rvm", &rvm[..end]) else { continue };
        assert!(imported.report.counts().contains(&(WarningKind::EndMissing, 1)), "cut at {end}");
        cut_behind_all_groups.push(end);
    }
    // After the last group, before the next chunk's first letter is complete.
    assert!(cut_behind_all_groups.len() <= 4, "{cut_behind_all_groups:?}");
    assert!(cut_behind_all_groups.array_windows().all(|[a, b]| a + 1 == *b), "{cut_behind_all_groups:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..Default::default() })]

    /// Digits for digits: the JSON stays JSON, and its indices, counts and offsets lead elsewhere.
    #[test]
    fn changed_numbers_in_a_document_do_no_harm(
        changes in prop::collection::vec((any::<Index>(), 0..10u8), 1..5),
    ) {
        let mut file = input("gltf", "coloured-and-sparse-below-a-matrix");
        let digits: Vec<usize> = (20..file.len() - 64).filter(|&at| file[at].is_ascii_digit()).collect();
        for (place, digit) in changes {
            file[*place.get(&digits)] = b'0' + digit;
        }
        crate::models::gltf(&file);
    }

    #[test]
    fn any_text_does_no_harm(
        lines in prop::collection::vec(
            "(v|f|o|g|l|usemtl|mtllib|x)( -?[0-9]{1,3}(/-?[0-9]{1,20})?){0,5}", 0..20,
        ),
    ) {
        crate::models::obj(lines.join("\n").as_bytes());
    }
}

proptest! {
    // Huge measures make the most triangles that a curve may have: few cases.
    #![proptest_config(ProptestConfig { cases: 32, ..Default::default() })]

    /// Measures of any size, finite or not.
    #[test]
    fn any_measures_do_no_harm(kind in 1..10u32, measures in prop::array::uniform9(any::<f32>())) {
        let shape = reals(&measures);
        let file = RvmWriter::new().open("/A", 1).primitive(kind, [0.0; 3], [0.0; 3], [0.0; 3], &shape).close();
        if let Ok(imported) = import_bytes("a.rvm", &file.finish()) {
            assert_eq!(imported.model.check(), Ok(()));
        }
    }
}
