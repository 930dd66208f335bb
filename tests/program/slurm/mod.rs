//! The job scripts of `examples/slurm` on a real Slurm: a controller and three nodes.
//!
//! Needs Linux, root and Slurm. Elsewhere the tests say that they are skipped, and fail if
//! `TRIMARAN_REQUIRE_SLURM` is 1.

mod lab;

use std::fs;

use serde_json::Value;

use crate::common::deployment::{culled_by, notes};
use lab::Lab;

/// A short walk, every pose of which is a frame.
const SHORT: &str = "--frames 20 --width 64 --height 64 --audit-every 10";
/// A walk by the clock, of 6 s on any machine.
const LONG: &str = "--live 25 --frames 150 --width 64 --height 64 --audit-every 0";

/// Submits a walk with flags of `sbatch`, and waits until it has shown some frames.
fn walking(lab: &mut Lab, flags: &str) -> String {
    let job = lab.submit(&format!("{flags} walk.sbatch plant.scene walk {LONG}"));
    lab.waits("a walk", |lab| (lab.shown("walk") >= 10).then_some(()));
    job
}

/// The report of a walk, whose frames are all there once.
fn report(lab: &Lab, how: &str) -> Value {
    let report = lab.bench.report("walk");
    assert_eq!(report["summary"]["ended"]["how"], how, "{}", report["summary"]["ended"]);
    for (number, frame) in report["frames"].as_array().unwrap().iter().enumerate() {
        assert_eq!(frame["frame"], number, "{}", report["run"]["notes"]);
    }
    report
}

#[test]
fn a_job_ends_by_itself_with_the_exit_code_of_its_display() {
    let Some(mut lab) = Lab::start() else { return };
    let job = lab.submit(&format!("walk.sbatch plant.scene walk {SHORT}"));
    assert_eq!(lab.ended(&job), "COMPLETED 0:0", "{}", lab.log(&job));
    let report = report(&lab, "finished");
    assert_eq!((report["run"]["cullers"].as_u64(), report["run"]["link"].as_str()), (Some(2), Some("quic")));
    assert_eq!(culled_by(&report), ["culler 1", "culler 2"], "{}", lab.log(&job));
    assert_eq!(report["summary"]["cut_mismatch_pixels_total"], 0);
    // The cullers have ended with 0 as well, and the job's keys are gone.
    assert!(!lab.log(&job).contains("srun: error"), "{}", lab.log(&job));
    let left = fs::read_dir(lab.bench.path("walk")).unwrap();
    let left: Vec<_> = left.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 3, "frames and the report's two files: {left:?}");
    let wrong = lab.submit("walk.sbatch plant.scene walk --epsilon 0");
    assert_eq!(lab.ended(&wrong), "FAILED 2:0", "{}", lab.log(&wrong));
}

#[test]
fn a_job_goes_on_without_a_culler_that_is_killed() {
    let Some(mut lab) = Lab::start() else { return };
    // A culler that vanishes without a close is missed soon.
    let job = walking(&mut lab, "--export=ALL,TRIMARAN_LINK_IDLE_TIMEOUT_S=3");
    lab.run("kill -KILL $(processes culler | head -n 1)");
    assert_eq!(lab.ended(&job), "COMPLETED 0:0", "{}", lab.log(&job));
    let report = report(&lab, "finished");
    assert!(notes(&report, &["was lost before"]), "{}", report["run"]["notes"]);
}

#[test]
fn a_walk_goes_on_when_its_job_is_queued_again() {
    let Some(mut lab) = Lab::start() else { return };
    let job = walking(&mut lab, "");
    lab.run(&format!("scontrol requeue {job}"));
    // Slurm waits for two minutes otherwise. Within a second it takes the new start for the killed one.
    lab.waits("the queue", |lab| lab.state(&job).starts_with("PENDING").then_some(()));
    let before = lab.shown("walk");
    assert!(before >= 10, "it keeps its records");
    lab.run(&format!("scontrol update JobId={job} StartTime=now+2"));
    assert_eq!(lab.ended(&job), "COMPLETED 0:0", "{}", lab.log(&job));
    let report = report(&lab, "finished");
    assert!(notes(&report, &["the display stopped before frame"]), "{}", report["run"]["notes"]);
    assert!(report["frames"].as_array().unwrap().len() > before);
}

/// After `KillWait` Slurm kills what is left.
#[test]
fn a_job_that_is_cancelled_leaves_a_report() {
    let Some(mut lab) = Lab::start() else { return };
    let job = walking(&mut lab, "");
    lab.run(&format!("scancel {job}"));
    assert!(lab.ended(&job).starts_with("CANCELLED"), "{}", lab.log(&job));
    lab.waits("the display's end", |lab| lab.run("processes display").is_empty().then_some(()));
    report(&lab, "interrupted");
}

#[test]
fn a_job_array_of_twelve_walks_gives_one_page() {
    let Some(mut lab) = Lab::start() else { return };
    let walk = "role display --resumable --scene plant.scene --frames 3 --width 64 --height 64 --seed";
    lab.bench.write("walks.txt", (1..=12).map(|seed| format!("{walk} {seed}\n")).collect::<String>());
    let walks = lab.submit("--array=1-12 walks.sbatch walks.txt out");
    let page = lab.submit(&format!("--dependency=afterany:{walks} page.sbatch walks.txt out"));
    assert_eq!(lab.ended(&page), "COMPLETED 0:0", "{}", lab.log(&page));
    let page = fs::read_to_string(lab.bench.path("out/walks.html")).unwrap();
    assert!(page.contains("Each walk came to its end."), "{page}");
    for walk in 1..=12 {
        assert!(page.contains(&format!(r#"<a href="{walk}/report.html">"#)), "{walk}: {page}");
        assert_eq!(lab.bench.report(&format!("out/{walk}"))["run"]["seed"], walk);
    }
}
