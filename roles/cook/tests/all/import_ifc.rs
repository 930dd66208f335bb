//! IFC by its converter, where that is made. How a converter is run is tested with that of STEP.
#![cfg(unix)]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::DVec3;
use tempfile::TempDir;
use trimaran_cook::import::{
    CadError, Converters, ImportError, ImportLimits, ImportOptions, Imported, PlantFrame, UpAxis,
    WarningKind, import,
};
use trimaran_scene::Attribute;

/// The converter, if it is named.
fn converter() -> Option<PathBuf> {
    let program = std::env::var_os("TRIMARAN_IFC");
    if program.is_none() {
        assert!(std::env::var_os("TRIMARAN_REQUIRE_IFC").is_none(), "TRIMARAN_IFC names no converter");
        println!("skipped: TRIMARAN_IFC names no converter");
    }
    program.map(PathBuf::from)
}

/// A file beside the tests.
fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/ifc").join(name)
}

fn read_with(path: &Path, options: &ImportOptions) -> Option<Result<Imported, ImportError>> {
    let converters = Converters { ifc: Some(converter()?), ..Converters::default() };
    Some(import(&[path.to_owned()], &ImportOptions { converters, ..options.clone() }, &mut |_| {}))
}

fn read(name: &str) -> Option<Imported> {
    Some(read_with(&file(name), &ImportOptions::default())?.unwrap())
}

/// The names of all groups, with their objects.
fn groups(Imported { model, .. }: &Imported) -> Vec<(&str, std::ops::Range<u32>)> {
    model.hierarchy.groups.iter().map(|group| (&*group.name, group.objects.clone())).collect()
}

fn names(Imported { model, .. }: &Imported) -> Vec<&str> {
    model.objects.iter().map(|object| &*object.name).collect()
}

fn as_map(attributes: &[Attribute]) -> BTreeMap<&str, &str> {
    attributes.iter().map(|one| (&*one.name, &*one.value)).collect()
}

/// The corners of an object's triangles in the world, metres.
fn corners(Imported { model, .. }: &Imported, object: usize) -> Vec<DVec3> {
    let object = &model.objects[object];
    let mesh = &model.meshes[object.mesh as usize];
    let corner = |&index: &u32| object.to_world.transform_point3(mesh.positions[index as usize].as_dvec3());
    mesh.indices.iter().map(corner).collect()
}

fn bounds(imported: &Imported, object: usize) -> (DVec3, DVec3) {
    let corners = corners(imported, object);
    (corners.iter().copied().reduce(DVec3::min).unwrap(), corners.iter().copied().reduce(DVec3::max).unwrap())
}

/// The volume within an object's triangles, which are to be closed and to face outwards.
fn volume(imported: &Imported, object: usize) -> f64 {
    let corners = corners(imported, object);
    let about = corners[0];
    let parts =
        corners.as_chunks::<3>().0.iter().map(|[a, b, c]| (a - about).dot((b - about).cross(c - about)));
    parts.sum::<f64>() / 6.0
}

fn assert_near(found: DVec3, expected: [f64; 3]) {
    assert!(found.abs_diff_eq(DVec3::from_array(expected), 1e-6), "{found} {expected:?}");
}

#[test]
fn an_opening_is_cut_out_of_its_wall_and_what_fills_it_is_in_the_wall() {
    let Some(imported) = read("wall.ifc") else { return };
    let expected =
        [("wall.ifc", 0..2), ("House", 0..2), ("Site", 0..2), ("Building", 0..2), ("First floor", 0..2)];
    assert_eq!(groups(&imported)[..5], expected);
    assert_eq!(groups(&imported)[5..], [("South wall", 0..2)]);
    assert_eq!(names(&imported), ["South wall", "Pane"]);
    // The wall is 4 x 0.3 x 3 m, and its hole 1 x 0.3 x 1.2 m.
    assert!((volume(&imported, 0) - (3.6 - 0.36)).abs() < 1e-6, "{}", volume(&imported, 0));
    assert!((volume(&imported, 1) - 0.06).abs() < 1e-6, "{}", volume(&imported, 1));
    // The site is at (10, 20, 0), and the storey 3 m above it. North is -z.
    let (low, high) = bounds(&imported, 0);
    assert_near(low, [10.0, 3.0, -20.3]);
    assert_near(high, [14.0, 6.0, -20.0]);
    let colour = |object: usize| {
        let mesh = &imported.model.meshes[imported.model.objects[object].mesh as usize];
        assert!(mesh.colours.iter().all(|colour| *colour == mesh.colours[0]));
        mesh.colours[0].0
    };
    assert_eq!((colour(0), colour(1)), ([51, 102, 204, 255], [102, 153, 255, 102]));
    assert_eq!(imported.report.counts(), [(WarningKind::SpaceLeftOut, 1)]);
    assert_eq!(imported.report.warnings[0].objects, ["Room 1"]);

    // The map's scale says that it is in metres.
    let PlantFrame { origin, north_deg } = imported.model.coordinates.plant;
    assert_eq!(origin, [500_000.0, 5_400_000.0, 120.0]);
    assert!((north_deg - 0.6_f64.atan2(0.8).to_degrees()).abs() < 1e-9, "{north_deg}");
    let hierarchy = &imported.model.hierarchy;
    let project = as_map(&hierarchy.groups[1].attributes);
    let place = ["IfcMapConversion.Eastings", "IfcMapConversion.Northings", "IfcProjectedCRS.Name"];
    assert_eq!(place.map(|name| project[name]), ["500000", "5400000", "EPSG:25832"]);
    let site = as_map(&hierarchy.groups[2].attributes);
    assert_eq!((site["RefLatitude"], site["RefLongitude"]), ("48.5°", "9.25°"));
    let wall = as_map(hierarchy.attributes_of(0));
    assert_eq!(wall, as_map(&hierarchy.groups[5].attributes));
    let expected = [
        ("GlobalId", "0000000000000000000008"),
        ("IFC class", "IfcWall"),
        ("PredefinedType", "SOLIDWALL"),
        ("Tag", "W-1"),
    ];
    assert_eq!(wall, BTreeMap::from(expected));
}

/// A place by its latitude and longitude.
const DEGREES: &str = "IFCRIGIDOPERATION(#10,#12,IFCPLANEANGLEMEASURE(48.5),IFCPLANEANGLEMEASURE(9.),3.)";

#[test]
fn a_map_conversion_says_where_the_model_stands_if_it_can_be_understood() {
    let conversion = "5400000.,120.,0.8,0.6,0.001);";
    let with = |changes: &[(&str, &str)]| read_text(&changed("wall.ifc", changes)).map(Result::unwrap);
    let (none, turned) = (PlantFrame::default(), -90.0);
    let in_metres = PlantFrame { origin: [500_000.0, 5_400_000.0, 120.0], north_deg: 0.0 };
    let in_millimetres = PlantFrame { origin: [500.0, 5400.0, 0.12], north_deg: 0.0 };
    let metre = ("#5=IFCC", "#888=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);\n#5=IFCC");
    let map_in_metres = ("'EPSG:25832',$,$,$,$,$,$", "'EPSG:25832',$,$,$,$,$,#888");
    let own = (
        "#10=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#6,$)",
        "#10=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-5,#21,$)",
    );
    let said = |numbers: &'static str| (conversion, numbers);
    for (changes, expected, warned) in [
        (vec![said("5400000.,120.,0.,-1.,0.001);")], PlantFrame { north_deg: turned, ..in_metres }, None),
        (vec![said("5400000.,120.,$,$,$);")], in_millimetres, None),
        (vec![said("5400000.,120.,$,$,$);"), metre, map_in_metres], in_metres, None),
        // A surveyor's grid.
        (vec![said("5400000.,120.,1.,0.,0.0009996);")], in_metres, Some((WarningKind::MapScaled, "0.9996"))),
        (
            vec![said("5400000.,120.,1.,0.,0.5);")],
            none,
            Some((WarningKind::MapUnread, "its scale 0.5 does not fit its units")),
        ),
        (
            vec![
                ("('IFC4')", "('IFC4X3_ADD2')"),
                ("IFCMAPCONVERSION(#10,#12,500000.,5400000.,120.,0.8,0.6,0.001)", DEGREES),
            ],
            none,
            Some((WarningKind::MapUnread, "its coordinates are angles")),
        ),
        (vec![own], none, Some((WarningKind::MapUnread, "its context has an origin or axes of its own"))),
    ] {
        let Some(imported) = with(&changes) else { return };
        assert_eq!(imported.model.coordinates.plant, expected, "{changes:?}");
        let mut warnings =
            imported.report.warnings.iter().filter(|one| one.kind != WarningKind::SpaceLeftOut);
        let found = warnings.next().map(|one| (one.kind, &*one.objects[0]));
        assert_eq!((found, warnings.next()), (warned, None), "{changes:?}");
    }
    // The flags count more.
    let plant = PlantFrame { origin: [1.0, 2.0, 3.0], north_deg: 4.0 };
    let options = ImportOptions { plant: Some(plant), ..ImportOptions::default() };
    let imported = read_with(&file("wall.ifc"), &options).unwrap().unwrap();
    assert_eq!(imported.model.coordinates.plant, plant);
}

#[test]
fn mapped_items_share_a_mesh_and_parts_are_in_their_assembly() {
    let Some(imported) = read("columns.ifc") else { return };
    assert_eq!(
        (imported.report.objects, imported.report.meshes, imported.report.unique_triangles),
        (3, 1, 12)
    );
    assert_eq!(imported.report.warnings, []);
    // The project has no name, so it has that of the file.
    let expected =
        [("columns.ifc", 0..3), ("columns", 0..3), ("Hall", 0..3), ("Ground", 0..3), ("Frame", 1..3)];
    assert_eq!(groups(&imported), expected);
    assert_eq!(names(&imported), ["IfcColumn", "left", "right"]);
    for (object, low, high) in [
        (0, [-0.1, 0.0, -8.2], [0.1, 3.0, -7.8]),
        (1, [-0.2, 0.0, -0.1], [0.2, 3.0, 0.1]),
        (2, [4.8, 0.0, -0.1], [5.2, 3.0, 0.1]),
    ] {
        assert_near(bounds(&imported, object).0, low);
        assert_near(bounds(&imported, object).1, high);
    }
    let third = as_map(imported.model.hierarchy.attributes_of(0));
    assert_eq!((third["Type"], third["Tag"]), ("C 400x200", "C-3"));
}

#[test]
fn properties_have_their_units_and_names_all_their_letters() {
    let Some(imported) = read("pipe.ifc") else { return };
    // Half a character is left out.
    assert_eq!(names(&imported), ["Rohr Ø100 ä '日本' 🔧 "]);
    assert_eq!(groups(&imported), [("pipe.ifc", 0..1), ("Plant", 0..1)]);
    assert_eq!(imported.report.warnings, []);
    let expected = [
        ("Classification", "Pr_65_52 Pipes"),
        ("Description", "two\nlines"),
        ("GlobalId", "2000000000000000000002"),
        ("Groups", "Cooling water"),
        ("IFC class", "IfcPipeSegment"),
        ("Maker.Name", "ACME"),
        ("Maker.Year", "2024"),
        ("Material", "steel, paint"),
        ("PredefinedType", "RIGIDSEGMENT"),
        ("Pset.Coating.Thickness", "0.3 mm"),
        ("Pset.Flow", "1: 0.1, 2: 0.4"),
        ("Pset.Insulated", "false"),
        ("Pset.Length", "2400 mm"),
        ("Pset.Pressure", "600 kPa"),
        ("Pset.Status", "NEW, TEMPORARY"),
        ("Pset.Supports", "300 mm, 2100 mm"),
        ("Pset.Temperature", "6.5 °C to 12 °C"),
        ("Pset.Transmittance", "0.25 W/(m²·K)"),
        ("Qto.GrossWeight", "52.5 kg"),
        ("Qto.OuterSurface", "0.754 m²"),
        ("Qto.Welds", "2"),
        ("Tag", "P-1"),
        ("Type", "Steel pipe"),
    ];
    assert_eq!(as_map(imported.model.hierarchy.attributes_of(0)), BTreeMap::from(expected));
    // 2.4 m along x, of radius 50 mm.
    let (low, high) = bounds(&imported, 0);
    assert!(
        (low.x, high.x) == (0.0, 2.4) || (low.x.abs() < 1e-6 && (high.x - 2.4).abs() < 1e-6),
        "{low} {high}"
    );
    assert!((0.045..=0.050_001).contains(&high.y), "{high}");
}

#[test]
fn a_finer_tolerance_makes_more_triangles_and_up_is_an_option() {
    let pipe = |options: ImportOptions| Some(read_with(&file("pipe.ifc"), &options)?.unwrap());
    let with = |chord_tolerance| pipe(ImportOptions { chord_tolerance, ..ImportOptions::default() });
    let (Some(coarse), Some(fine)) = (with(0.01), with(0.0001)) else { return };
    assert!(fine.report.triangles > 2 * coarse.report.triangles, "{:?} {:?}", fine.report, coarse.report);
    let options = ImportOptions { up: Some(UpAxis::Y), ..ImportOptions::default() };
    let Some(turned) = read_with(&file("wall.ifc"), &options) else { return };
    assert_near(bounds(&turned.unwrap(), 0).0, [10.0, 20.0, 3.0]);
}

/// A ZIP archive of stored files.
fn archive(folder: &TempDir, files: &[&Path]) -> PathBuf {
    let path = folder.path().join("model.ifczip");
    let script = "import sys, zipfile, os\n\
                  with zipfile.ZipFile(sys.argv[1], 'w', zipfile.ZIP_DEFLATED) as z:\n \
                  [z.write(f, os.path.basename(f)) for f in sys.argv[2:]]";
    let made = Command::new("python3").args(["-c", script]).arg(&path).args(files).status().unwrap();
    assert!(made.success());
    path
}

#[test]
fn an_archive_is_unpacked_and_one_without_a_model_or_too_large_is_refused() {
    if converter().is_none() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let note = folder.path().join("note.txt");
    fs::write(&note, "no model").unwrap();
    let read = |files: &[&Path]| read_with(&archive(&folder, files), &ImportOptions::default()).unwrap();
    assert_eq!(names(&read(&[&note, &file("wall.ifc")]).unwrap()), ["South wall", "Pane"]);
    let said = |files: &[&Path]| read(files).unwrap_err().to_string();
    assert!(said(&[&note]).contains("holds no .ifc file"), "{}", said(&[&note]));
    let large = folder.path().join("large.ifc");
    fs::write(&large, vec![b' '; 80 << 20]).unwrap();
    assert!(said(&[&large]).contains("unpacks to more than"), "{}", said(&[&large]));
    let damaged = archive(&folder, &[&file("wall.ifc")]);
    let bytes = fs::read(&damaged).unwrap();
    fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
    let said = read_with(&damaged, &ImportOptions::default()).unwrap().unwrap_err().to_string();
    assert!(said.contains("model.ifczip: it cannot be converted: it cannot be unpacked"), "{said}");
}

/// The text of a file with other parts in it.
fn changed(name: &str, changes: &[(&str, &str)]) -> String {
    let mut text = fs::read_to_string(file(name)).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{old}");
        text = text.replace(old, new);
    }
    text
}

fn read_text(text: &str) -> Option<Result<Imported, ImportError>> {
    read_bytes(text.as_bytes())
}

fn read_bytes(text: &[u8]) -> Option<Result<Imported, ImportError>> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("model.ifc");
    fs::write(&path, text).unwrap();
    read_with(&path, &ImportOptions::default())
}

#[test]
fn a_hierarchy_that_is_a_circle_or_has_no_top_is_read_all_the_same() {
    // The building is in its own storey.
    let circle = changed("columns.ifc", &[("$,$,$,#1,(#20)", "$,$,$,#21,(#20)")]);
    let Some(imported) = read_text(&circle) else { return };
    let imported = imported.unwrap();
    assert_eq!(imported.report.objects, 3);
    assert_eq!(groups(&imported)[1], ("model", 0..3));
    // No project: its place in the file is empty, and so it has no units.
    let text = changed("columns.ifc", &[("#1=IFCPROJECT(", "/*"), ("(#10),#2);", "*/")]);
    let imported = read_text(&text).unwrap().unwrap();
    assert_eq!(groups(&imported)[1], ("model", 0..3));
    assert_near(bounds(&imported, 1).1, [0.2, 3.0, 0.1]);
}

#[test]
fn a_part_that_is_broken_costs_only_itself() {
    // A column without an extent, and a set of properties that has a building in it.
    let text = changed("columns.ifc", &[]);
    let broken = "#80=IFCEXTRUDEDAREASOLID(#32,#6,#7,0.);\n\
        #81=IFCSHAPEREPRESENTATION(#10,'Body','SweptSolid',(#80));\n\
        #82=IFCPRODUCTDEFINITIONSHAPE($,$,(#81));\n\
        #83=IFCCOLUMN('1000000000000000000020',$,'flat',$,$,#8,#82,$);\n\
        #84=IFCPROPERTYSINGLEVALUE('Good',$,IFCLABEL('yes'),$);\n\
        #85=IFCPROPERTYSET('1000000000000000000021',$,'Sound',$,(#84));\n\
        #86=IFCPROPERTYSET('1000000000000000000022',$,'Broken',$,(#20));\n\
        #87=IFCRELDEFINESBYPROPERTIES('1000000000000000000023',$,$,$,(#67),#85);\n\
        #88=IFCRELDEFINESBYPROPERTIES('1000000000000000000024',$,$,$,(#67),#86);\nENDSEC;\nEND-ISO";
    let Some(imported) = read_text(&text.replace("ENDSEC;\nEND-ISO", broken)) else { return };
    let imported = imported.unwrap();
    let counts = imported.report.counts();
    assert_eq!(counts[0], (WarningKind::SurfaceUnmeshed, 1), "{counts:?}");
    assert_eq!(imported.report.warnings[0].objects, ["flat"]);
    assert_eq!(imported.report.objects, 3);
    let good = imported.model.hierarchy.attributes.iter().flat_map(|of| &of.attributes);
    assert_eq!(good.filter(|one| &*one.name == "Sound.Good").count(), 1);
    // A class that the schema lacks, and a reference to it.
    let unknown = "#88=IFCTOASTER('?');\n#89=IFCMAPPEDITEM(#88,#37);\nENDSEC;\nEND-ISO";
    let imported = read_text(&changed("columns.ifc", &[("ENDSEC;\nEND-ISO", unknown)])).unwrap().unwrap();
    assert_eq!(
        (imported.report.objects, imported.report.counts()),
        (3, vec![(WarningKind::EntityLeftOut, 2)])
    );
    let said = &imported.report.warnings[0].objects[0];
    assert!(said.contains("'IFCTOASTER' not found in schema 'IFC2X3'"), "{said}");
    // A property that is in itself.
    let endless = changed("pipe.ifc", &[("'Coating',(#70)", "'Coating',(#69)")]);
    let imported = read_text(&endless).unwrap().unwrap();
    assert_eq!(imported.report.counts(), [(WarningKind::PropertiesUnread, 1)]);
    assert_eq!(as_map(imported.model.hierarchy.attributes_of(0))["Qto.Welds"], "2");
}

#[test]
fn letters_that_are_not_spelt_as_the_format_demands_are_kept() {
    let text = changed("columns.ifc", &[("'Frame'", "'Främe 🔧'"), ("'Ground'", "'H@ll'")]);
    // A byte order mark, UTF-8, and one name in Windows-1252.
    let bytes: Vec<u8> = text.bytes().map(|byte| if byte == b'@' { 0xE4 } else { byte }).collect();
    let Some(imported) = read_bytes(&[b"\xEF\xBB\xBF", &bytes[..]].concat()) else { return };
    let imported = imported.unwrap();
    let groups: Vec<_> = groups(&imported).into_iter().map(|(name, _)| name).collect();
    assert_eq!(groups[3..], ["Häll", "Främe 🔧"]);
    assert_eq!(imported.report.warnings, []);
}

#[test]
fn what_is_no_model_is_refused_with_the_reason() {
    let whole = changed("wall.ifc", &[]);
    let Some(Err(error)) = read_text(&whole[..whole.len() / 2]) else { return };
    assert!(error.to_string().contains("model.ifc: it cannot be converted: it is cut off"), "{error}");
    for (text, reason) in [
        (changed("wall.ifc", &[("'IFC4'", "'AUTOMOTIVE_DESIGN'")]), "AUTOMOTIVE_DESIGN"),
        (changed("columns.ifc", &[("#32,#6,#7,3.)", "#32,#6,#7,0.)")]), "no element with a surface"),
    ] {
        let error = read_text(&text).unwrap().unwrap_err().to_string();
        assert!(error.contains(reason), "{error}");
    }
}

#[test]
fn where_the_memory_ends_the_conversion_does() {
    let limits = ImportLimits { triangles: 1, vertices: 1, objects: 1, depth: 9, attribute_bytes: 0 };
    let options = ImportOptions { limits, ..ImportOptions::default() };
    let Some(small) = read_with(&file("wall.ifc"), &options) else { return };
    let Err(ImportError::Cad { source: CadError::Memory { .. }, .. }) = small else { panic!("{small:?}") };
}

/// An environment of Python without IfcOpenShell.
#[test]
fn a_python_without_the_engine_is_an_error_that_names_the_remedy() {
    let folder = TempDir::new().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("ifc/main.py");
    let program = folder.path().join("trimaran-ifc");
    let text = format!("#!/bin/sh\nexec python3 -E -S -s -B '{}' \"$@\"\n", script.display());
    let plain = folder.path().join("script");
    fs::write(&plain, text).unwrap();
    assert!(Command::new("install").args(["-m", "755"]).args([&plain, &program]).status().unwrap().success());
    let converters = Converters { ifc: Some(program), ..Converters::default() };
    let options = ImportOptions { converters, ..ImportOptions::default() };
    let error = import(&[file("wall.ifc")], &options, &mut |_| {}).unwrap_err().to_string();
    assert!(error.contains("trimaran-ifc cannot load its engine"), "{error}");
    assert!(error.contains("No module named 'ifcopenshell'") && error.contains("./x ifc"), "{error}");
}

#[test]
fn when_it_is_told_to_end_it_removes_its_folder() {
    let Some(program) = converter() else { return };
    let folder = TempDir::new().unwrap();
    let own = folder.path().join("own");
    fs::create_dir(&own).unwrap();
    // It waits for the file, which is a pipe that nobody writes.
    let pipe = folder.path().join("pipe.ifc");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    fs::write(own.join("input"), "left by the import").unwrap();
    let mut command = Command::new(program);
    command.arg("ifc").arg(&pipe).arg(&own).args(["0.001", "z", "8000000000", "pipe"]);
    let mut running = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    let out = running.stdout.take().unwrap();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(out), &mut line).unwrap();
    assert_eq!(line, "progress 0\n");
    let told = Command::new("kill").args(["-TERM", &running.id().to_string()]).status().unwrap();
    assert!(told.success());
    assert_eq!(running.wait().unwrap().code(), Some(1));
    assert!(!own.exists());
}
