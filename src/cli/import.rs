//! `trimaran import`: CAD files to a cooked scene.

use std::{env, path::PathBuf, time::Duration};

use serde_json::json;
use trimaran::page::Preparation;
use trimaran_cook::CookOptions;
use trimaran_cook::import::{
    Converters, Engine, ImportLimits, ImportOptions, ImportReport, Imported, PlantFrame, Progress, UpAxis,
    Warning, import,
};

use super::{
    Failure,
    args::{ImportArgs, Origin, ReadingArgs, Up},
    cooking,
    info::SceneSummary,
    number, output, plural, print_json, progress,
    terminal::word,
};

/// The first stage.
pub(super) const READING: &str = "reading";

pub(super) fn run(args: &ImportArgs) -> Result<(), Failure> {
    output::check(&args.output, &output::SCENE, &args.files).map_err(Failure::bad_input)?;
    let preparation = Preparation::default();
    let imported = read(&args.files, &args.reading, &preparation)?;
    if !args.json {
        print_report(&imported.report);
    }
    let scene =
        cooking::cook_and_save(&imported.model, &args.reading.cook_options(), &args.output, &preparation)?;
    let summary = SceneSummary::of(&args.output, &scene).map_err(Failure::bad_input)?;
    if args.json {
        return print_json(&json!({ "import": report_json(&imported.report), "scene": summary }));
    }
    summary.print();
    Ok(())
}

/// Reads the files of a model, with a progress bar, and the progress in `preparation` as well. With `--strict`
/// a warning is an error.
pub(super) fn read(
    files: &[PathBuf],
    reading: &ReadingArgs,
    preparation: &Preparation,
) -> Result<Imported, Failure> {
    let bar = progress::bar(READING, files.len() as u64);
    preparation.begin(READING, files.len());
    let read = &mut |progress: Progress<'_>| {
        bar.set_position(progress.files_done as u64);
        bar.set_message(progress.converted.map_or(READING.into(), |done| format!("{done} % converted")));
        preparation.advance(usize::from(progress.converted.is_none()));
    };
    let imported = import(files, &reading.import_options(), read).and_then(Imported::with_objects);
    let imported = imported.map_err(Failure::bad_input)?;
    bar.finish_and_clear();
    if reading.strict && !imported.report.warnings.is_empty() {
        let warnings: Vec<String> = imported.report.warnings.iter().map(|one| format!("\n  {one}")).collect();
        let why =
            format!("--strict makes these warnings errors, and nothing was written:{}", warnings.concat());
        return Err(Failure::bad_input(why));
    }
    Ok(imported)
}

impl ReadingArgs {
    fn import_options(&self) -> ImportOptions {
        ImportOptions {
            chord_tolerance: self.chord_tolerance * 1e-3,
            up: self.up.map(|up| match up {
                Up::Y => UpAxis::Y,
                Up::Z => UpAxis::Z,
            }),
            unit: self.unit,
            plant: (self.origin.is_some() || self.north.is_some()).then(|| PlantFrame {
                origin: self.origin.map_or([0.0; 3], |Origin(origin)| origin),
                north_deg: self.north.unwrap_or(0.0),
            }),
            limits: ImportLimits {
                triangles: self.limits.max_triangles,
                vertices: self.limits.max_vertices,
                objects: self.limits.max_objects,
                depth: self.limits.max_depth,
                attribute_bytes: self.limits.max_attribute_bytes,
            },
            converters: Converters {
                occt: converter(Engine::OpenCascade),
                ifc: converter(Engine::IfcOpenShell),
                timeout: Duration::try_from_secs_f64(self.converter_timeout).unwrap_or(Duration::MAX),
            },
        }
    }

    pub(super) fn cook_options(&self) -> CookOptions {
        CookOptions { max_nodes: self.limits.max_nodes, ..CookOptions::default() }
    }
}

/// An engine's program: the one that the environment names, or the one beside this program or in `PATH`.
fn converter(engine: Engine) -> Option<PathBuf> {
    let named = env::var_os(engine.variable()).filter(|path| !path.is_empty());
    let found = || engine.find(env::current_exe().ok().as_deref(), env::var_os("PATH").as_deref());
    named.map(PathBuf::from).or_else(found)
}

/// Prints the content of a model, and its warnings.
pub(super) fn print_report(report: &ImportReport) {
    println!(
        "read {}: {}, {} ({} stored, the rest instances)",
        plural(report.files, "file", "files"),
        plural(report.objects, "object", "objects"),
        plural(report.triangles, "triangle", "triangles"),
        number(report.unique_triangles)
    );
    if report.box_mismatches > 0 {
        println!(
            "  {} by more than 5 % from the box stored with them",
            plural(report.box_mismatches, "primitive differs", "primitives differ")
        );
    }
    if report.parts > 0 {
        let (matched, parts) = (number(report.parts_matched), plural(report.parts, "part", "parts"));
        println!("  attributes: {matched} of {parts} matched");
    }
    for warning in &report.warnings {
        println!("  {}", word(&warning.to_string()));
    }
}

fn report_json(report: &ImportReport) -> serde_json::Value {
    let warnings: Vec<_> = report
        .warnings
        .iter()
        .map(|Warning { kind, file, detail, objects, count }| {
            json!({ "what": kind.to_string(), "file": file, "detail": detail, "objects": objects, "count": count })
        })
        .collect();
    json!({
        "files": report.files,
        "objects": report.objects,
        "meshes": report.meshes,
        "triangles": report.triangles,
        "unique_triangles": report.unique_triangles,
        "box_mismatches": report.box_mismatches,
        "parts": report.parts,
        "parts_matched": report.parts_matched,
        "warnings": warnings,
    })
}
