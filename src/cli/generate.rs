//! `trimaran generate`: models of any size for machines without data.

use serde_json::json;
use trimaran::page::Preparation;
use trimaran_cook::{
    CookOptions, Model,
    generate::{PlantOptions, TankerOptions, plant, tanker},
};

use super::{
    Failure,
    args::{GenerateArgs, Kind},
    cooking,
    info::SceneSummary,
    output, print_json,
};

pub(super) fn run(args: &GenerateArgs) -> Result<(), Failure> {
    output::check(&args.output, &output::SCENE, &[]).map_err(Failure::bad_input)?;
    let model = generate(args);
    // Any size may be asked for.
    let options = CookOptions { max_nodes: usize::MAX, ..CookOptions::default() };
    let scene = cooking::cook_and_save(&model, &options, &args.output, &Preparation::default())?;
    let summary = SceneSummary::of(&args.output, &scene).map_err(Failure::bad_input)?;
    if args.json {
        return print_json(&json!({ "scene": summary }));
    }
    summary.print();
    Ok(())
}

fn generate(args: &GenerateArgs) -> Model {
    match args.kind {
        Kind::Plant => {
            let base =
                if args.paper { PlantOptions::paper(args.seed) } else { PlantOptions::small(args.seed) };
            let (objects, triangles) = size((base.objects, base.triangles), args);
            plant(&PlantOptions { objects, triangles, ..base })
        }
        Kind::Tanker => {
            let base =
                if args.paper { TankerOptions::paper(args.seed) } else { TankerOptions::small(args.seed) };
            let (objects, triangles) = size((base.objects, base.triangles), args);
            tanker(&TankerOptions { objects, triangles, ..base })
        }
    }
}

/// Objects and triangles as asked for. The one that is not given keeps the base's triangles per object.
fn size((objects, triangles): (usize, usize), args: &GenerateArgs) -> (usize, usize) {
    let each = triangles as f64 / objects as f64;
    let asked_triangles = args.triangles.map(|count| usize::try_from(count).unwrap_or(usize::MAX));
    match (args.objects.map(|count| count as usize), asked_triangles) {
        (Some(objects), Some(triangles)) => (objects, triangles),
        (Some(objects), None) => (objects, (objects as f64 * each) as usize),
        (None, Some(triangles)) => ((triangles as f64 / each).max(1.0) as usize, triangles),
        (None, None) => (objects, triangles),
    }
}
