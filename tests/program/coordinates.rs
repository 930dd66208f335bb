//! The plant's coordinates of a scene, as import takes them and info tells them.

use std::fs;

use serde_json::{Value, json};

use crate::common::program::{Bench, said};

/// A triangle of 2 by 3 units, 5 above the ground of a file with z up.
const STL: &str = "solid a\nfacet\nouter loop\nvertex 0 0 5\nvertex 2000 0 5\nvertex 0 3000 5\n\
                   endloop\nendfacet\nendsolid a\n";
const OBJ: &str = "o plate\nv 0 0 0\nv 2 0 0\nv 0 0 3\nf 1 2 3\n";

fn info(bench: &Bench, scene: &str) -> Value {
    serde_json::from_str(&bench.done(&["info", scene, "--json"])).unwrap()
}

#[test]
fn info_tells_the_axes_of_files_and_the_coordinates_of_the_plant() {
    let bench = Bench::empty();
    bench.write("a.stl", STL);
    bench.write("b.obj", OBJ);
    bench.done(&["import", "a.stl", "-o", "a.scene"]);
    let told = bench.done(&["info", "a.scene"]);
    for line in [
        "  plant       E 0.000 to 2.000, N 0.000 to 3.000, U 0.005 to 0.005 m\n",
        "  axes        x east, y north, z up; in millimetres\n",
    ] {
        assert!(told.contains(line), "{told}");
    }
    let json = info(&bench, "a.scene");
    assert_eq!(json["source_frames"], json!([{ "up": "z", "metres_per_unit": 0.001 }]));
    assert_eq!(json["plant"]["origin"], json!([0.0, 0.0, 0.0]));
    assert_eq!(json["plant"]["north_deg"], json!(0.0));

    let flags = ["--origin=-1000,2000.5,10", "--north", "90"];
    bench.done(&[&["import", "b.obj", "a.stl", "-o", "ab.scene"][..], &flags].concat());
    let told = bench.done(&["info", "ab.scene"]);
    for line in [
        // North is x, and east the scene's z: of the plate up to 3, of the other one from -3.
        "  plant       E -1003.000 to -997.000, N 2000.500 to 2002.500, U 10.000 to 10.005 m; the files' \
         origin is at E -1000.000, N 2000.500, U 10.000 m; north is 90 degrees clockwise from theirs\n",
        "  axes        b.obj: x east, y up, z south; in metres; a.stl: x east, y north, z up; in \
         millimetres\n",
    ] {
        assert!(told.contains(line), "{told}");
    }
    let plant = &info(&bench, "ab.scene")["plant"];
    assert_eq!((&plant["origin"], &plant["north_deg"]), (&json!([-1000.0, 2000.5, 10.0]), &json!(90.0)));
    // Nothing has moved by that.
    bench.done(&["import", "b.obj", "a.stl", "-o", "plain.scene"]);
    let [placed, plain] = ["ab.scene", "plain.scene"].map(|scene| info(&bench, scene));
    assert_eq!((&placed["min"], &placed["max"]), (&plain["min"], &plain["max"]));
}

/// Scenes of files like glTF are written as the release before reads them, and its scenes are read.
#[test]
fn scenes_without_coordinates_have_those_of_gltf() {
    let bench = Bench::empty();
    bench.write("b.obj", OBJ);
    bench.done(&["import", "b.obj", "-o", "b.scene"]);
    bench.done(&["generate", "plant", "--objects", "20", "-o", "plant.scene"]);
    let before = concat!(env!("CARGO_MANIFEST_DIR"), "/roles/cook/tests/format-8/instances");
    fs::copy(before, bench.path("before.scene")).unwrap();
    for scene in ["b.scene", "plant.scene", "before.scene"] {
        assert_eq!(fs::read(bench.path(scene)).unwrap()[8..12], [8, 0, 0, 0], "{scene}");
        assert!(bench.done(&["info", scene]).contains("  axes        x east, y up, z south; in metres\n"));
        assert_eq!(info(&bench, scene)["source_frames"], json!([]), "{scene}");
    }
}

#[test]
fn a_wrong_origin_or_north_is_refused_with_its_reason() {
    let bench = Bench::empty();
    bench.write("b.obj", OBJ);
    let import = |flag: &str| bench.trimaran(&["import", "b.obj", "-o", "b.scene", flag]);
    for (flag, words) in [
        ("--origin=1,2", "not 2"),
        ("--origin=1,2,3,4", "not 4"),
        ("--origin=1,x,3", "\"x\" is not a number"),
        ("--origin=1,,3", "\"\" is not a number"),
        ("--origin=1,inf,3", "\"inf\" is not a number"),
        ("--origin=1,NaN,3", "\"NaN\" is not a number"),
        ("--origin=1,2,1e13", "at most 10^12 m"),
        ("--north=east", "\"east\" is not a number"),
        ("--north=361", "from -360 to 360 degrees"),
    ] {
        let refused = import(flag);
        assert_eq!(refused.status.code(), Some(2), "{flag}");
        assert!(said(&refused).contains(words), "{flag}: {}", said(&refused));
        assert!(!bench.path("b.scene").exists());
    }
    for flag in ["--origin= 1e7, -2e7 ,0", "--north=-12.5"] {
        assert!(import(flag).status.success(), "{flag}");
    }
}
