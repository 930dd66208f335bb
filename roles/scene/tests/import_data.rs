//! Imports real scenes and compares counts with what is known of them. Needs the data folder: see `data_folder`.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests: a failure is a test's failure")]

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::{env, fs};

use glam::DVec3;
use trimaran_scene::import::{ImportOptions, Imported, PrimitiveCounts, import};

/// The folder of real scenes, from the environment variable `TRIMARAN_DATA`. Without it a test says that it is skipped,
/// unless `TRIMARAN_REQUIRE_DATA` is 1.
fn data_folder() -> Option<PathBuf> {
    let folder = env::var_os("TRIMARAN_DATA").map(PathBuf::from);
    if folder.is_none() {
        assert_ne!(env::var("TRIMARAN_REQUIRE_DATA").as_deref(), Ok("1"), "TRIMARAN_DATA is not set");
        println!("skipped: TRIMARAN_DATA is not set");
    }
    folder
}

/// Unpacks `name`.xz of the data folder into the tests' own folder, once.
fn unpacked(folder: &Path, name: &str) -> PathBuf {
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    if !target.exists() {
        let partial = target.with_extension(format!("part{}", std::process::id()));
        let status = Command::new("xz")
            .arg("-dc")
            .arg(folder.join(format!("{name}.xz")))
            .stdin(Stdio::null())
            .stdout(fs::File::create(&partial).unwrap())
            .status()
            .unwrap_or_else(|error| panic!("xz unpacks the data, and cannot be run: {error}"));
        assert!(status.success(), "xz could not unpack {name}");
        fs::rename(&partial, &target).unwrap();
    }
    target
}

fn import_glb(folder: &Path, name: &str) -> Imported {
    import(&[unpacked(folder, name)], &ImportOptions::default(), &mut |_| {}).unwrap()
}

#[test]
fn platform_in_14_copies() {
    let Some(folder) = data_folder() else { return };
    let Imported { model, report } = import_glb(&folder, "huldra_x14_13Mtri.glb");
    assert_eq!((report.objects, report.meshes), (135_830, 3_951));
    assert_eq!((report.triangles, report.unique_triangles), (12_804_256, 658_592));
    assert_eq!(report.warnings, []);
    assert_eq!(model.sources[0].name, "huldra_x14_13Mtri.glb");
}

#[test]
fn town_hall_with_sheared_nodes() {
    let Some(folder) = data_folder() else { return };
    let Imported { model, report } = import_glb(&folder, "ldraw_town_hall_1.3Mtri.glb");
    assert_eq!((report.objects, report.meshes), (2_799, 345));
    assert_eq!((report.triangles, report.unique_triangles), (1_307_423, 309_303));

    // Axes more than 0.1 milliradian off a right angle.
    let sheared = model.objects.iter().filter(|object| {
        let m = object.to_world.matrix3;
        let cosine = |a: DVec3, b: DVec3| a.dot(b).abs() / (a.length() * b.length());
        [cosine(m.x_axis, m.y_axis), cosine(m.y_axis, m.z_axis), cosine(m.z_axis, m.x_axis)]
            .iter()
            .any(|&cosine| cosine > 1e-4)
    });
    assert_eq!(sheared.count(), 22);
    let nodes: HashSet<u32> = model.objects.iter().map(|object| object.source_index).collect();
    assert_eq!(nodes.len(), 2_799);
    // The parts are placed y down, and the root turns y and z around: the hall stands on its floor.
    let heights = model.objects.iter().map(|object| object.to_world.translation.y);
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), y| (low.min(y), high.max(y)));
    assert!(low == 0.0 && (0.49..0.50).contains(&high), "from {low} to {high}");
}

#[test]
fn city_at_full_size() {
    let Some(folder) = data_folder() else { return };
    let Imported { report, .. } = import_glb(&folder, "ldraw_city_88Mtri.glb");
    assert_eq!((report.objects, report.meshes), (128_635, 1_791));
    assert_eq!((report.triangles, report.unique_triangles), (87_606_788, 2_582_126));
}

fn platform_files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join("huldra")).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|ending| ending == "RVM"));
    files.sort();
    assert_eq!(files.len(), 8);
    files
}

#[test]
fn platform_from_its_review_files() {
    let Some(folder) = data_folder() else { return };
    let files = platform_files(&folder);
    let Imported { model, report } = import(&files, &ImportOptions::default(), &mut |_| {}).unwrap();
    assert_eq!((report.files, report.objects, report.meshes), (8, 9_720, 9_720));
    let kinds = PrimitiveCounts {
        pyramids: 679,
        boxes: 4_181,
        rectangular_tori: 299,
        circular_tori: 318,
        elliptical_dishes: 147,
        spherical_dishes: 62,
        snouts: 1_141,
        cylinders: 6_824,
        spheres: 0,
        lines: 129,
        facet_groups: 1_475,
    };
    assert_eq!(report.primitives, kinds);
    assert_eq!(model.sources[3].name, "HA-MECH.RVM");
    // A tessellator that lets both directions of a torus use up the whole tolerance makes 0.92 million.
    assert!((900_000..1_100_000).contains(&report.triangles), "{}", report.triangles);
    // Sheared snouts and eccentric pyramids, whose stored boxes are loose; an independent reader finds 232.
    assert!(report.box_mismatches <= 232, "{}", report.box_mismatches);
}
