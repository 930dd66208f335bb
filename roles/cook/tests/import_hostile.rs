//! Files cut off and with bytes changed at random: every importer returns, and what it returns is a model or
//! an error.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: a failure is a test's failure")]
#![allow(dead_code, reason = "each test file uses its part of the helpers")]

mod import_files;

use import_files::{RvmWriter, floats, glb, import_bytes, reals, word};
use proptest::prelude::*;

fn small_glb() -> Vec<u8> {
    let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
        "nodes":[{"children":[1]},{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":2},"indices":1,"material":0}]}],
        "materials":[{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]}}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","sparse":{"count":1,
            "indices":{"bufferView":1,"componentType":5123},"values":{"bufferView":0}}},
            {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"},
            {"bufferView":2,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"}],
        "bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6},
            {"buffer":0,"byteOffset":44,"byteLength":12,"byteStride":4}],
        "buffers":[{"byteLength":56}]}"#;
    let mut bin = floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    bin.extend([0, 0, 1, 0, 2, 0, 0, 0]);
    bin.extend([255; 12]);
    glb(json, &bin)
}

/// One primitive of each kind.
fn small_rvm() -> Vec<u8> {
    let shapes: [(u32, &[f32]); 10] = [
        (1, &[2.0, 3.0, 1.0, 1.0, 0.5, 0.5, 4.0]),
        (2, &[1.0, 2.0, 3.0]),
        (3, &[1.0, 2.0, 1.0, 1.5]),
        (4, &[3.0, 1.0, 1.5]),
        (5, &[2.0, 1.0]),
        (6, &[2.0, 1.0]),
        (7, &[2.0, 1.0, 3.0, 0.5, 0.5, 0.1, 0.1, 0.1, 0.1]),
        (8, &[1.0, 2.0]),
        (9, &[2.0]),
        (10, &[0.0, 1.0]),
    ];
    let mut file = RvmWriter::new().open("/A", 1).open("/A/B", 2);
    for (kind, shape) in shapes {
        file = file.primitive(kind, [1.0, 2.0, 3.0], [-4.0; 3], [4.0; 3], &reals(shape));
    }
    let corner = |x: f32, y: f32| reals(&[x, y, 0.0, 0.0, 0.0, 1.0]);
    let square = |half: f32| {
        let corners = [corner(-half, -half), corner(half, -half), corner(half, half), corner(-half, half)];
        [word(4), corners.concat()].concat()
    };
    let facets = [word(1), word(2), square(2.0), square(1.0)].concat();
    file.primitive(11, [0.0; 3], [-2.0; 3], [2.0; 3], &facets).close().close().finish()
}

const SMALL_OBJ: &[u8] = b"mtllib a.mtl\no one\nv 0 0 0\nv 1 0 0 1 1 0\nv 1 1 0\nv 0 1 0\nusemtl red\n\
    f 1/1/1 2/1/1 3/1/1 4/1/1\ng two\nf -1 -2 -3\nl 1 2 3\n";

/// Imports a changed file: it must return. A model that comes out of it must be sound.
fn survives(name: &str, bytes: &[u8]) {
    if let Ok(imported) = import_bytes(name, bytes) {
        assert_eq!(imported.model.check(), Ok(()));
    }
}

fn changed(
    mut bytes: Vec<u8>,
    changes: &[(prop::sample::Index, u8)],
    end: Option<prop::sample::Index>,
) -> Vec<u8> {
    for (place, value) in changes {
        let place = place.index(bytes.len());
        bytes[place] = *value;
    }
    if let Some(end) = end {
        bytes.truncate(end.index(bytes.len()));
    }
    bytes
}

#[test]
fn the_files_are_sound_before_they_are_changed() {
    let rvm = import_bytes("a.rvm", &small_rvm()).unwrap();
    assert_eq!(rvm.report.objects, 1);
    assert_eq!(import_bytes("a.glb", &small_glb()).unwrap().report.triangles, 1);
    assert_eq!(import_bytes("a.obj", SMALL_OBJ).unwrap().report.triangles, 3);
}

#[test]
fn every_cut_of_a_binary_file_is_an_error() {
    for end in 0..small_glb().len() {
        assert!(import_bytes("a.glb", &small_glb()[..end]).is_err(), "glb cut at {end}");
    }
    // What follows the last chunk's header holds nothing.
    for end in 0..small_rvm().len() - 4 {
        assert!(import_bytes("a.rvm", &small_rvm()[..end]).is_err(), "rvm cut at {end}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..Default::default() })]

    #[test]
    fn changed_bytes_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        end in prop::option::weighted(0.3, any::<prop::sample::Index>()),
    ) {
        survives("a.glb", &changed(small_glb(), &changes, end));
        survives("a.rvm", &changed(small_rvm(), &changes, end));
        survives("a.obj", &changed(SMALL_OBJ.to_vec(), &changes, end));
    }

    /// Digits for digits: the JSON stays JSON, and its indices, counts and offsets lead elsewhere.
    #[test]
    fn changed_numbers_in_a_document_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), 0..10u8), 1..5),
    ) {
        let mut file = small_glb();
        let digits: Vec<usize> = (20..file.len() - 64).filter(|&at| file[at].is_ascii_digit()).collect();
        for (place, digit) in changes {
            file[digits[place.index(digits.len())]] = b'0' + digit;
        }
        survives("a.glb", &file);
    }

    #[test]
    fn any_text_never_panics(lines in prop::collection::vec("(v|f|o|g|l|usemtl|mtllib|x)( -?[0-9]{1,3}(/-?[0-9]{1,20})?){0,5}", 0..20)) {
        survives("a.obj", lines.join("\n").as_bytes());
    }
}

proptest! {
    // Huge measures make as many triangles as a curve may have: few cases.
    #![proptest_config(ProptestConfig { cases: 32, ..Default::default() })]

    /// Measures of any size, finite or not.
    #[test]
    fn any_measures_never_panic(kind in 1..10u32, measures in prop::array::uniform9(any::<f32>())) {
        let shape = reals(&measures);
        let file = RvmWriter::new().open("/A", 1).primitive(kind, [0.0; 3], [0.0; 3], [0.0; 3], &shape).close();
        survives("a.rvm", &file.finish());
    }
}
