//! How long the roles take.

use super::{card, over_frames, series, wide_card};
use crate::report::format::{figure, plural};
use crate::report::html::chart::{Chart, Mark};
use crate::report::html::timeline::Timeline;
use crate::report::schema::{Frame, Report};

pub(super) fn html(report: &Report) -> String {
    let frames = &report.frames;
    let timeline = Timeline::around_slowest(frames).map_or_else(String::new, |timeline| {
        let (first, last) = timeline.range();
        let finding =
            format!("{} of 3 machines are busy on average around the slowest frame", figure(timeline.busy()));
        let caption = format!(
            "Frames {first} to {last}. The switching pair takes turns: whoever drew the occluders of a frame culls it."
        );
        wide_card(&finding, &timeline.svg(), &caption)
    });
    let roles = card(
        &role_finding(frames),
        &role_times(frames).svg(),
        if report.run.alone {
            "Busy time, of roles that computed one after another: it holds no other role's work."
        } else {
            "Busy time: waiting for another role is not counted. Where roles share a machine, it holds what others took of its cores."
        },
    );
    let latency = card(
        &latency_finding(report),
        &latency(frames).svg(),
        "From a camera's publication to its own picture.",
    );
    roles + &latency + &timeline
}

fn role_times(frames: &[Frame]) -> Chart {
    let lines = [("or_ms", "OR", "or"), ("hc_ms", "HC", "hc"), ("rvg_ms", "RVG", "rvg")]
        .map(|(key, name, class)| series(frames, key, name, class, Mark::Line));
    let [or, hc, rvg] = lines;
    let measured = series(frames, "frame_ms", "frame time as measured here", "exact", Mark::Dashed);
    over_frames("ms a frame", vec![or, hc, rvg, measured], &["or_ms", "hc_ms", "rvg_ms", "frame_ms"])
}

fn role_finding(frames: &[Frame]) -> String {
    let mut slowest = [("OR", 0_u32), ("HC", 0), ("RVG", 0)];
    for frame in frames {
        if let (Some(or), Some(hc), Some(rvg)) = (frame.or_ms, frame.hc_ms, frame.rvg_ms) {
            let role = if or >= hc && or >= rvg { 0 } else { 1 + usize::from(rvg > hc) };
            slowest[role].1 += 1;
        }
    }
    let total: u32 = slowest.iter().map(|s| s.1).sum();
    match slowest.iter().max_by_key(|s| s.1) {
        Some((role, count)) if total > 0 => {
            let share = 100.0 * f64::from(*count) / f64::from(total);
            format!("{role} is the slowest role on {share:.0} % of the frames")
        }
        _ => "The roles' busy times".to_owned(),
    }
}

fn latency(frames: &[Frame]) -> Chart {
    over_frames(
        "ms",
        vec![series(frames, "latency_ms", "camera to picture", "drawn", Mark::Line)],
        &["latency_ms", "latency_frames"],
    )
}

fn latency_finding(report: &Report) -> String {
    let metrics = &report.summary.metrics;
    match (metrics.get("latency_ms"), metrics.get("latency_frames")) {
        (Some(ms), Some(frames)) => format!(
            "A camera is seen after {} ms and {} (medians)",
            figure(ms.median),
            plural(frames.median as u64, "frame", "frames")
        ),
        (Some(ms), None) => format!("A camera is seen after {} ms (median)", figure(ms.median)),
        _ => "Camera to picture".to_owned(),
    }
}
