//! `trimaran audit`: checks of culling on cases made for it.

mod search;

use std::{collections::BTreeSet, fs, sync::Arc};

use trimaran::audit::{Curves, hard, hard_count, page, table};
use trimaran_cull::LodRule;
use trimaran_gpu::{Gpu, GpuOptions};

use super::{
    Failure,
    args::{AuditCommand, HardArgs},
    output, print_json, progress,
    walking::{gpu_options, runtime},
};

pub(super) fn run(command: &AuditCommand) -> Result<(), Failure> {
    match command {
        AuditCommand::Hard(args) => run_hard(args),
        AuditCommand::Search(args) => search::run(args),
    }
}

fn run_hard(args: &HardArgs) -> Result<(), Failure> {
    if let Some(path) = &args.out {
        output::check(path, &output::AUDIT, &[]).map_err(Failure::bad_input)?;
    }
    let devices = devices(&args.device)?;
    let rule = LodRule::new(args.epsilon).map_err(Failure::bad_input)?;
    let runtime = runtime()?;
    let cases = (hard_count(&args.only) * (1 + devices.len())) as u64;
    let bar = progress::bar("auditing", cases + args.out.as_ref().map_or(0, |_| Curves::POINTS));
    let done = || bar.inc(1);
    let found = hard(&args.only, &devices, rule, runtime.handle(), &done).map_err(Failure::broken)?;
    let mut curves = Vec::new();
    if let Some(path) = &args.out {
        let measured = Curves { devices: &devices, rule, runtime: runtime.handle(), done: &done };
        curves = measured.all();
        let command = format!("trimaran audit hard --out {}", path.display());
        fs::write(path, page(&found, &curves, &command))
            .map_err(|cause| Failure::broken(format!("cannot write to {}: {cause}", path.display())))?;
    }
    bar.finish_and_clear();
    let holds = found.hold() && curves.iter().flat_map(|curve| &curve.points).all(|point| point.holds);
    if args.json {
        print_json(&serde_json::json!({ "holds": holds, "hard": found, "curves": curves }))?;
    } else {
        print!("{}", table(&found));
    }
    let wrong = curves.iter().flat_map(|curve| curve.points.iter().map(move |point| (curve, point)));
    for (curve, point) in wrong.filter(|(_, point)| !point.holds) {
        eprintln!("trimaran: {} at {}: {:?}", curve.of, point.at, point.figures);
    }
    if holds { Ok(()) } else { Err(Failure::broken("a figure is wrong; see above")) }
}

/// The devices with these names; all that can be used without any.
fn devices(names: &[String]) -> Result<Vec<Arc<Gpu>>, Failure> {
    let names: BTreeSet<String> = if names.is_empty() {
        let usable = Gpu::list().map_err(Failure::broken)?.into_iter().filter(|info| info.missing.is_empty());
        usable.map(|info| info.name).collect()
    } else {
        names.iter().cloned().collect()
    };
    let open =
        |name: &String| Gpu::open(&gpu_options(Some(name), None, GpuOptions::TIMEOUT.as_secs_f64(), false));
    names.iter().map(|name| open(name).map_err(Failure::broken)).collect()
}
