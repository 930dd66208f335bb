//! `trimaran import`: CAD files to a cooked scene.

use serde_json::json;
use trimaran_cook::CookOptions;
use trimaran_cook::import::{ImportLimits, ImportOptions, ImportReport, UpAxis, import};

use super::{
    Failure,
    args::{ImportArgs, Up},
    cooking,
    info::SceneSummary,
    number, print_json, progress,
};

pub(super) fn run(args: &ImportArgs) -> Result<(), Failure> {
    let options = ImportOptions {
        chord_tolerance: args.chord_tolerance * 1e-3,
        up: args.up.map(|up| match up {
            Up::Y => UpAxis::Y,
            Up::Z => UpAxis::Z,
        }),
        unit: args.unit,
        limits: ImportLimits {
            triangles: args.limits.max_triangles,
            vertices: args.limits.max_vertices,
            objects: args.limits.max_objects,
            depth: args.limits.max_depth,
        },
    };
    let cook_options = CookOptions { max_nodes: args.limits.max_nodes, ..CookOptions::default() };
    let bar = progress::bar("reading", args.files.len() as u64);
    let imported =
        import(&args.files, &options, &mut |progress| bar.set_position(progress.files_done as u64))
            .map_err(Failure::bad_input)?;
    bar.finish_and_clear();
    if !args.json {
        print_report(&imported.report);
    }
    let scene = cooking::cook_and_save(&imported.model, &cook_options, &args.output)?;
    let summary = SceneSummary::of(&args.output, &scene);
    if args.json {
        return print_json(&json!({ "import": report_json(&imported.report), "scene": summary }));
    }
    summary.print();
    Ok(())
}

fn print_report(report: &ImportReport) {
    println!(
        "read {} files: {} objects, {} triangles ({} stored, the rest instances)",
        report.files,
        number(report.objects),
        number(report.triangles),
        number(report.unique_triangles)
    );
    if report.box_mismatches > 0 {
        println!(
            "  {} primitives differ by more than 5 % from the box stored with them",
            number(report.box_mismatches)
        );
    }
    for (warning, count) in &report.warnings {
        println!("  {} {warning}", number(*count));
    }
}

fn report_json(report: &ImportReport) -> serde_json::Value {
    let warnings: Vec<_> = report
        .warnings
        .iter()
        .map(|(warning, count)| json!({ "what": warning.to_string(), "count": count }))
        .collect();
    json!({
        "files": report.files,
        "objects": report.objects,
        "meshes": report.meshes,
        "triangles": report.triangles,
        "unique_triangles": report.unique_triangles,
        "box_mismatches": report.box_mismatches,
        "warnings": warnings,
    })
}
