//! STEP and IGES by a converter: the real one where it is built, and scripts that fail as it may. IFC has the
//! same way to its own.
#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use tempfile::TempDir;
use trimaran_cook::import::{
    CadError, Converters, Engine, ImportError, ImportLimits, ImportOptions, Imported, PlantFrame, UpAxis,
    WarningKind, import,
};

use crate::import_files::{floats, glb, names};

const STEP: &[u8] = b"ISO-10303-21;\nHEADER;\n";

/// A folder with a file to import, and a script that stands for the converter.
struct Bench {
    folder: TempDir,
    options: ImportOptions,
}

impl Bench {
    /// The script is called as either converter is, with its arguments in `$1` to `$7`.
    fn new(script: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let program = folder.path().join("converter");
        let text = folder.path().join("script");
        fs::write(&text, format!("#!/bin/sh\ncd '{}'\n{script}\n", folder.path().display())).unwrap();
        // Another process writes it: a file that this one has open, or a fork of it, cannot be run.
        let made = Command::new("install").args(["-m", "755"]).args([&text, &program]).status().unwrap();
        assert!(made.success());
        fs::write(folder.path().join("pump.step"), STEP).unwrap();
        let both = (Some(program.clone()), Some(program));
        let converters = Converters { occt: both.0, ifc: both.1, ..Converters::default() };
        Self { folder, options: ImportOptions { converters, ..ImportOptions::default() } }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn read(&self) -> Result<Imported, ImportError> {
        import(&[self.path("pump.step")], &self.options, &mut |_| {})
    }

    fn error(&self) -> CadError {
        match self.read() {
            Err(ImportError::Cad { source, .. }) => source,
            other => panic!("{other:?}"),
        }
    }

    /// The folder that the script got, which it must have written into `folder`.
    fn temporary(&self) -> PathBuf {
        fs::read_to_string(self.path("folder")).unwrap().trim().into()
    }
}

/// A glTF file of a triangle, placed twice.
fn triangle() -> Vec<u8> {
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0,"name":"left"},{"mesh":1,"name":"right"}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]},{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36}]}"#;
    glb(json, &floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
}

#[test]
fn the_result_of_the_converter_is_the_model_and_its_lines_are_progress_and_warnings() {
    let bench = Bench::new(
        "echo \"$@\" >arguments; echo $3 >folder; cp made.glb $3/model.glb\n\
         echo progress 7 x; echo some words; echo unmeshed 3 flange 1; echo progress 100",
    );
    fs::write(bench.path("made.glb"), triangle()).unwrap();
    let mut percents = Vec::new();
    let imported = import(&[bench.path("pump.step")], &bench.options, &mut |progress| {
        percents.push((progress.converted, progress.files_done));
    });
    let imported = imported.unwrap();
    assert_eq!(percents, [(Some(7), 0), (Some(100), 0), (None, 1)]);
    assert_eq!((names(&imported), imported.model.meshes.len()), (vec!["left", "right"], 1));
    assert_eq!(imported.model.sources[0].name, "pump.step");
    assert_eq!(imported.report.counts(), [(WarningKind::SurfaceUnmeshed, 3)]);
    assert_eq!(imported.report.warnings[0].objects, ["flange 1"]);
    assert!(!bench.temporary().exists(), "the temporary folder was left behind");
    let arguments = fs::read_to_string(bench.path("arguments")).unwrap();
    let memory = bench.options.limits.memory(STEP.len() as u64);
    let expected = format!(
        "step {} {} 0.001 z {memory} pump\n",
        bench.path("pump.step").display(),
        bench.temporary().display()
    );
    assert_eq!(arguments, expected);
}

#[test]
fn axes_and_packed_files_reach_the_converter() {
    let mut bench = Bench::new("cat $2 >got; echo $1 $5 >>got; echo $3 >folder; cp made.glb $3/model.glb");
    fs::write(bench.path("made.glb"), triangle()).unwrap();
    bench.options.up = Some(UpAxis::Y);
    let line = format!("{:72}S      1\n", "made by a test");
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packer, line.as_bytes()).unwrap();
    fs::write(bench.path("pump.igs.gz"), packer.finish().unwrap()).unwrap();
    let imported = import(&[bench.path("pump.igs.gz")], &bench.options, &mut |_| {}).unwrap();
    assert_eq!(fs::read_to_string(bench.path("got")).unwrap(), format!("{line}iges y\n"));
    // The converter's output has y up, whichever axis the file has.
    let mesh = &imported.model.meshes[0];
    assert!(mesh.positions.contains(&glam::Vec3::Y), "{:?}", mesh.positions);
    assert!(!bench.temporary().exists(), "the temporary folder was left behind");
}

#[test]
fn each_failure_of_the_converter_is_an_error_that_leaves_nothing_behind() {
    let fails = |then: &str| {
        let bench = Bench::new(&format!("echo $3 >folder; echo part >$3/model.glb; {then}"));
        let error = bench.error();
        assert!(!bench.temporary().exists(), "{then}: the temporary folder was left behind");
        error
    };
    let CadError::Refused { said } = fails("echo no entity >&2; exit 2") else { panic!() };
    assert_eq!(said, "no entity");
    let limit = ImportLimits::default().memory(STEP.len() as u64);
    assert!(matches!(fails("exit 3"), CadError::Memory { limit: l } if l == limit));
    let CadError::Crashed { status, .. } = fails("kill -SEGV $$") else { panic!() };
    assert!(status.contains("signal: 11"), "{status}");
    assert!(matches!(fails("exit 139"), CadError::Crashed { .. }));
    for (then, reason) in [("echo no module >&2; exit 4", "no module"), ("exec /lost/python", "/lost/python")]
    {
        let error = fails(then).to_string();
        assert!(error.contains("trimaran-occt cannot load its engine") && error.contains(reason), "{error}");
    }
    // It says that it is done, and its result is no glTF file.
    assert!(matches!(fails("exit 0"), CadError::Gltf(_)));
    assert!(matches!(fails("rm $3/model.glb"), CadError::Folder(_)));
    // It writes much more to standard error than a pipe holds.
    let CadError::Refused { said } = fails("yes word | head -c 300000 >&2; exit 2") else { panic!() };
    assert_eq!(said.len(), 999);
}

#[test]
fn a_converter_that_is_silent_too_long_is_ended() {
    let mut bench = Bench::new("echo $3 >folder; echo $$ >pid; echo progress 1; exec sleep 3600");
    bench.options.converters.timeout = Duration::from_millis(500);
    let error = bench.error();
    assert!(matches!(error, CadError::Hung { .. }), "{error}");
    assert!(
        error.to_string().contains("for 0.5 seconds") && error.to_string().contains("--converter-timeout")
    );
    assert!(!bench.temporary().exists(), "the temporary folder was left behind");
    let process = fs::read_to_string(bench.path("pid")).unwrap();
    assert!(!Path::new("/proc").join(process.trim()).exists(), "the converter goes on");
}

#[test]
fn a_converter_that_is_not_there_is_an_error_that_says_how_to_get_it() {
    let mut bench = Bench::new("");
    bench.options.converters.occt = Some(bench.path("lost"));
    let said = bench.read().unwrap_err().to_string();
    assert!(said.contains("cannot start") && said.contains("lost") && said.contains("./x occt"), "{said}");
    bench.options.converters.occt = None;
    let said = bench.read().unwrap_err().to_string();
    assert!(said.contains("pump.step: STEP and IGES are read by") && said.contains("FreeCAD"), "{said}");
}

#[test]
fn a_converter_is_found_beside_the_program_or_in_path() {
    let (folder, other) = (TempDir::new().unwrap(), TempDir::new().unwrap());
    let here = folder.path().join("trimaran");
    let elsewhere = other.path().join("trimaran");
    let folders = std::env::join_paths([other.path(), folder.path()]).unwrap();
    for (engine, name) in [(Engine::OpenCascade, "trimaran-occt"), (Engine::IfcOpenShell, "trimaran-ifc")] {
        assert_eq!(engine.find(Some(&here), Some(&folders)), None);
        let program = folder.path().join(name);
        fs::write(&program, "").unwrap();
        assert_eq!(engine.find(Some(&here), None).as_ref(), Some(&program));
        assert_eq!(engine.find(Some(&elsewhere), Some(&folders)), Some(program));
        assert_eq!(engine.find(Some(&elsewhere), None), None);
    }
}

/// Of several files the first one that says a place counts, and another place is told.
#[test]
fn files_of_several_places_on_a_map_are_told() {
    let bench = Bench::new(
        "cp made.glb $3/model.glb\n\
         case $7 in a) ;; b|c) echo plant 1e6 -2.5 30.0 12.5 ;; d) echo plant 1e6 0.0 30.0 12.5 ;; esac",
    );
    fs::write(bench.path("made.glb"), triangle()).unwrap();
    let read = |names: &[&str], options: &ImportOptions| {
        let paths: Vec<_> = names.iter().map(|name| bench.path(&format!("{name}.ifc"))).collect();
        paths.iter().for_each(|path| fs::write(path, STEP).unwrap());
        import(&paths, options, &mut |_| {}).unwrap()
    };
    let place = PlantFrame { origin: [1e6, -2.5, 30.0], north_deg: 12.5 };
    let found = read(&["a", "b", "c"], &bench.options);
    assert_eq!((found.model.coordinates.plant, &*found.report.warnings), (place, &[][..]));
    let found = read(&["b", "a", "d"], &bench.options);
    assert_eq!(found.model.coordinates.plant, place);
    let [warning] = &found.report.warnings[..] else { panic!("{:?}", found.report.warnings) };
    assert_eq!((warning.kind, &*warning.file, warning.count), (WarningKind::ElsewhereOnMap, "d.ifc", 1));
    let given = PlantFrame { origin: [0.0; 3], north_deg: 0.0 };
    let found = read(&["b", "d"], &ImportOptions { plant: Some(given), ..bench.options.clone() });
    assert_eq!((found.model.coordinates.plant, &*found.report.warnings), (given, &[][..]));
}

#[test]
fn ifc_has_a_converter_of_its_own_that_is_called_the_same_way() {
    let mut bench = Bench::new(
        "cat $2 >got; echo $1 $5 $7 >>got; cp made.glb $3/model.glb\n\
         echo spaces 4 Room 1; echo unread 2 pump; echo unmeshed 1 wall",
    );
    bench.options.converters.occt = None;
    fs::write(bench.path("made.glb"), triangle()).unwrap();
    // Packed by ZIP, which the converter unpacks, or by gzip, which the import does.
    let mut packer = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut packer, STEP).unwrap();
    for (name, file, got) in [
        ("hall.ifc", STEP, STEP),
        ("hall.ifczip", b"PK\x03\x04..", b"PK\x03\x04.."),
        ("hall.ifc.gz", &packer.finish().unwrap(), STEP),
    ] {
        fs::write(bench.path(name), file).unwrap();
        let imported = import(&[bench.path(name)], &bench.options, &mut |_| {}).unwrap();
        let counts = [
            (WarningKind::SpaceLeftOut, 4),
            (WarningKind::PropertiesUnread, 2),
            (WarningKind::SurfaceUnmeshed, 1),
        ];
        assert_eq!(imported.report.counts(), counts, "{name}");
        assert_eq!(fs::read(bench.path("got")).unwrap(), [got, b"ifc z hall\n"].concat(), "{name}");
    }
    bench.options.converters.ifc = None;
    let said = import(&[bench.path("hall.ifc")], &bench.options, &mut |_| {}).unwrap_err().to_string();
    assert!(said.contains("hall.ifc: IFC models are read by the program trimaran-ifc"), "{said}");
    assert!(
        said.contains("./x ifc") && said.contains("TRIMARAN_IFC") && said.contains("IfcConvert"),
        "{said}"
    );
}

/// The real converter, if it is named, and a file beside the tests.
fn real(name: &str, options: &ImportOptions) -> Option<Result<Imported, ImportError>> {
    let Some(program) = std::env::var_os("TRIMARAN_OCCT") else {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_OCCT").is_none(), "TRIMARAN_OCCT names no converter");
        println!("skipped: TRIMARAN_OCCT names no converter");
        return None;
    };
    let converters = Converters { occt: Some(program.into()), ..Converters::default() };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cad").join(name);
    Some(import(&[path], &ImportOptions { converters, ..options.clone() }, &mut |_| {}))
}

/// An assembly of two racks, each with two pins and a plate: millimetres, z up.
#[test]
fn an_assembly_has_names_colours_places_and_instances() {
    let Some(imported) = real("racks.step", &ImportOptions::default()) else { return };
    let Imported { model, report } = imported.unwrap();
    assert_eq!(report.warnings, []);
    assert_eq!((report.objects, report.meshes), (6, 2));
    let groups: Vec<_> = model.hierarchy.groups.iter().map(|g| (&*g.name, g.objects.clone())).collect();
    assert_eq!(
        groups,
        [("racks.step", 0..6), ("racks", 0..6), ("rack [rack 1]", 0..3), ("rack [rack 2]", 3..6)]
    );
    let names: Vec<_> = model.objects.iter().map(|object| &*object.name).collect();
    assert_eq!(names, ["plate", "pin [pin 1]", "pin [pin 2]", "plate", "pin [pin 1]", "pin [pin 2]"]);
    let place = |object: usize| model.objects[object].to_world.translation;
    // The second rack is 3 m above the first.
    assert!((place(3) - place(0)).abs_diff_eq(glam::DVec3::Y * 3.0, 1e-6), "{} {}", place(3), place(0));
    let colour = |object: usize| model.meshes[model.objects[object].mesh as usize].colours[0].0;
    assert_eq!((colour(0), colour(1)), ([255, 0, 0, 255], [0, 0, 255, 255]));
    // A pin is a cylinder of radius 0.1 m and height 1 m about z.
    let pin = &model.meshes[model.objects[1].mesh as usize];
    let high = pin.positions.iter().fold(glam::Vec3::ZERO, |high, p| high.max(p.abs()));
    assert!(high.abs_diff_eq(glam::Vec3::new(0.1, 1.0, 0.1), 1e-6), "{high}");
}

#[test]
fn a_finer_tolerance_makes_more_triangles() {
    let triangles = |chord_tolerance| {
        let imported = real("racks.step", &ImportOptions { chord_tolerance, ..ImportOptions::default() })?;
        Some(imported.unwrap().report.triangles)
    };
    let (Some(coarse), Some(fine)) = (triangles(0.01), triangles(0.0001)) else { return };
    assert!(fine > 3 * coarse, "{fine} and {coarse}");
}

#[test]
fn the_real_converter_names_bad_files_and_ends_where_the_memory_does() {
    let Some(cut) = real("cut.step", &ImportOptions::default()) else { return };
    let said = cut.unwrap_err().to_string();
    assert!(said.contains("cut.step: it cannot be converted"), "{said}");
    let limits = ImportLimits { triangles: 1, vertices: 1, objects: 1, depth: 9, attribute_bytes: 0 };
    let small = real("racks.step", &ImportOptions { limits, ..ImportOptions::default() }).unwrap();
    let Err(ImportError::Cad { source: CadError::Memory { .. }, .. }) = small else { panic!("{small:?}") };
}
