//! `trimaran audit`: checks of culling on cases made for it.

use std::{collections::BTreeSet, sync::Arc};

use trimaran::audit::{hard, hard_count, table};
use trimaran_cull::LodRule;
use trimaran_gpu::{Gpu, GpuOptions};

use super::{
    Failure,
    args::{AuditCommand, HardArgs},
    print_json, progress,
    walking::{gpu_options, runtime},
};

pub(super) fn run(command: &AuditCommand) -> Result<(), Failure> {
    match command {
        AuditCommand::Hard(args) => run_hard(args),
    }
}

fn run_hard(args: &HardArgs) -> Result<(), Failure> {
    let devices = devices(&args.device)?;
    let rule = LodRule::new(args.epsilon).map_err(Failure::bad_input)?;
    let runtime = runtime()?;
    let count = hard_count().map_err(Failure::broken)? * (1 + devices.len());
    let bar = progress::bar("auditing", count as u64);
    let found = hard(&devices, rule, runtime.handle(), &|| bar.inc(1)).map_err(Failure::broken)?;
    bar.finish_and_clear();
    if args.json {
        print_json(&found)?;
    } else {
        print!("{}", table(&found));
    }
    if found.hold() { Ok(()) } else { Err(Failure::broken("a figure of a hard case is wrong; see above")) }
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
