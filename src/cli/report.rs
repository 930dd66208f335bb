//! `trimaran report`: completes the report of a walk that was stopped.

use std::path::PathBuf;

use trimaran::{
    report::{Writer, text},
    walkthrough::{Unchecked, Walk, Written, write_report},
};
use trimaran_transport::causes;

use super::{
    Failure,
    args::ReportArgs,
    print_json, progress,
    recording::{self, Grace, open_folder},
    walking::{self, open, upload},
};

pub(super) fn run(args: &ReportArgs) -> Result<(), Failure> {
    let unchecked = Unchecked::read(&args.folder).map_err(Failure::bad_input)?;
    let scene = args.scene.clone().unwrap_or_else(|| PathBuf::from(&unchecked.run.scene.file));
    let file = open(&scene)?;
    let plan = unchecked.plan().map_err(Failure::bad_input)?;
    recording::check(&plan, None)?;
    let path = unchecked.path(&file.scene, &scene).map_err(Failure::bad_input)?;
    let records = unchecked.records(&file.scene, &path).map_err(Failure::bad_input)?;
    let drawn = upload(&file, &args.device.gpu_options())?;
    let folder = open_folder(Writer::open, &args.folder)?;
    let runtime = walking::runtime()?;
    let grace = Grace::of(&walking::stop_on_signal(&runtime));
    let walk = Walk { file: &file, drawn: &drawn, plan: &plan, path: &path };
    let bar = progress::bar("reporting", records.len() as u64);
    let Unchecked { run, ended, .. } = unchecked;
    let mut advance = |_| bar.inc(1);
    let written =
        write_report(folder, None, walk, run, &records, ended, &mut advance, &grace.into_gives_up());
    bar.finish_and_clear();
    let Written { report, incomplete, .. } = written.map_err(Failure::broken)?;
    if args.json {
        print_json(&report.summary)?;
    } else {
        print!("{}", text::summary(&report));
        println!("report: {}", args.folder.join("report.html").display());
    }
    match incomplete {
        None => Ok(()),
        Some(why) => {
            Err(Failure::incomplete(format!("the report lacks pictures and checks: {}", causes(&why))))
        }
    }
}
