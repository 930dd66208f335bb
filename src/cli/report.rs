//! `trimaran report`: completes the report of a walk that was stopped, or puts many walks on one page.

use std::{
    io,
    path::{Path, PathBuf},
};

use trimaran::{
    report::{Writer, many_walks::ManyWalks, text, write_whole},
    walkthrough::{Unchecked, Walk, Written, write_report},
};
use trimaran_transport::causes;

use super::{
    Failure,
    args::ReportArgs,
    output, print_json, progress,
    recording::{self, Grace, open_folder},
    walking::{self, open, upload},
};

pub(super) fn run(args: &ReportArgs) -> Result<(), Failure> {
    match (&args.together, &args.folders[..]) {
        (Some(page), folders) => put_together(folders, page, args.json),
        (None, [folder]) => complete(folder, args),
        (None, _) => Err(Failure::bad_input(
            "a report is completed in one folder; --together PAGE.html puts the walks of several on one page",
        )),
    }
}

/// Writes one page about the walks in these folders.
fn put_together(folders: &[PathBuf], page: &Path, json: bool) -> Result<(), Failure> {
    let read: Vec<_> = folders
        .iter()
        .flat_map(|folder| ["report.html", "report.json"].map(|name| folder.join(name)))
        .collect();
    output::check(page, &output::PAGE, &read).map_err(Failure::bad_input)?;
    let walks = ManyWalks::read(folders);
    write_whole(page, &walks.page(page)).map_err(|cause| {
        let said = format!("cannot write {}: {cause}", page.display());
        match cause.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Failure::broken(said),
            _ => Failure::bad_input(said),
        }
    })?;
    if json {
        print_json(&walks)?;
    } else {
        print!("{}", walks.text());
        println!("page: {}", page.display());
    }
    walks.gaps().map_or(Ok(()), |gaps| Err(Failure::incomplete(gaps)))
}

/// Adds the pictures and checks that a report lacks.
fn complete(folder: &Path, args: &ReportArgs) -> Result<(), Failure> {
    let unchecked = Unchecked::read(folder).map_err(Failure::bad_input)?;
    let scene = args.scene.clone().unwrap_or_else(|| PathBuf::from(&unchecked.run.scene.file));
    let file = open(&scene)?;
    let plan = unchecked.plan().map_err(Failure::bad_input)?;
    recording::check(&plan, None)?;
    let path = unchecked.path(&file.scene, &scene).map_err(Failure::bad_input)?;
    let records = unchecked.records(&file.scene, &path).map_err(Failure::bad_input)?;
    let drawn = upload(&file, &args.device.gpu_options())?;
    let writer = open_folder(Writer::open, folder)?;
    let runtime = walking::runtime()?;
    let grace = Grace::of(&walking::stop_on_signal(&runtime));
    let walk = Walk { file: &file, drawn: &drawn, plan: &plan, path: &path };
    let bar = progress::bar("reporting", records.len() as u64);
    let Unchecked { run, ended, .. } = unchecked;
    let mut advance = |_| bar.inc(1);
    let written =
        write_report(writer, None, walk, run, &records, ended, &mut advance, &grace.into_gives_up());
    bar.finish_and_clear();
    let Written { report, incomplete, .. } = written.map_err(Failure::broken)?;
    if args.json {
        print_json(&report.summary)?;
    } else {
        print!("{}", text::summary(&report));
        println!("report: {}", folder.join("report.html").display());
    }
    match incomplete {
        None => Ok(()),
        Some(why) => {
            Err(Failure::incomplete(format!("the report lacks pictures and checks: {}", causes(&why))))
        }
    }
}
