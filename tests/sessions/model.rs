//! The report's model of one machine per role, against the roles' own state machines and links in virtual
//! time.

use std::fs;

use trimaran::{
    report::{Frame, Projection, Report, Run, schema::Ended},
    simulate::{Knobs, Scenario, Transport, Workload, simulate},
};
use trimaran_actors::Schedule;
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

const FRAMES: u32 = 120;

/// How many cullers, and how they share the frames.
type Cullers = (usize, Schedule);

/// A report of frames whose roles computed one after another, and took these milliseconds: OR, HC, RVG.
fn report(times: impl Fn(u32) -> [f64; 3], (cullers, schedule): Cullers) -> Report {
    let frame = |number| {
        let [or, hc, rvg] = times(number);
        Frame {
            frame: number,
            or_ms: Some(or),
            hc_ms: Some(hc),
            rvg_ms: Some(rvg),
            latency_ms: Some(or + hc + rvg),
            nodes_drawn: Some(u64::from(50 + number % 70)),
            ..Frame::default()
        }
    };
    let frames: Vec<Frame> = (0..FRAMES).map(frame).collect();
    let whole: f64 = (1..FRAMES).map(|number| times(number).iter().sum::<f64>()).sum();
    let projection = Projection { width: 8, height: 8, vfov_deg: 60.0, near: 0.1 };
    let (cullers, schedule) = (cullers as u32, schedule.name().to_owned());
    let run = Run { epsilon_px: 2.0, batch: 1024, alone: true, cullers, schedule, ..Run::default() };
    Report::new(run, projection, frames, Some(whole), Ended::finished(Some(FRAMES)))
}

/// Pictures a second of a simulated session with the report's computing times, on a network without delay,
/// and the median latency in milliseconds.
fn simulated(report: &Report, (cullers, schedule): Cullers) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let [network, walk] = ["ideal.toml", "report.json"].map(|name| folder.path().join(name));
    fs::write(&network, "about = \"takes no time\"\nsources = []\n[up]\n").unwrap();
    fs::write(&walk, serde_json::to_vec(report).unwrap()).unwrap();
    let scenario = Scenario {
        network: Profile::find(network.to_str().unwrap()).unwrap(),
        link: Transport::Tcp,
        cullers,
        schedule,
        // If ids feed another culler's OR, they come one by one.
        batch: BatchSize::new(if schedule == Schedule::Switch { 1 } else { 1024 }).unwrap(),
        frames: FRAMES,
        seed: 1,
        workload: Workload::recorded(&walk).unwrap(),
        geometry: None,
        knobs: Knobs::default(),
    };
    let outcome = simulate(&scenario).unwrap();
    (outcome.frames_per_second, outcome.latency_ms.p50)
}

/// A number from 0 to 1 that depends only on the frame and `salt`.
fn noise(frame: u32, salt: u32) -> f64 {
    let mixed = (frame.wrapping_mul(0x9e37_79b9) ^ salt.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0xc2b2_ae35);
    f64::from(mixed >> 8) / f64::from(1 << 24)
}

#[test]
fn the_model_is_what_the_simulator_gives_on_a_network_that_takes_no_time() {
    let (low, wide) = (|frame, salt| 1.0 + noise(frame, salt), |frame, salt| 30.0 * noise(frame, salt));
    let jump = |frame: u32| if frame.is_multiple_of(17) { 200.0 } else { 4.0 };
    type Times<'t> = &'t dyn Fn(u32) -> [f64; 3];
    let walks: [(&str, Times<'_>); 6] = [
        ("steady, bound by the cullers", &|_| [12.0, 3.0, 9.0]),
        ("steady, bound by the display", &|_| [5.0, 3.0, 14.0]),
        ("uneven, bound by now one and now the other", &|f| {
            [wide(f, 1), wide(f, 2), wide(f, 3) + wide(f, 4)]
        }),
        ("HC is short, as on real models", &|f| [10.0 * low(f, 1), 0.3 * low(f, 2), 11.0 * low(f, 3)]),
        ("now and then a frame takes long", &|f| [low(f, 1), jump(f), jump(f + 5)]),
        ("the display falls far behind and catches up", &|f| [8.0, 2.0, if f % 20 < 4 { 60.0 } else { 1.0 }]),
    ];
    let independent = [0, 1, 2, 3].map(|cullers| (cullers, Schedule::Independent));
    for cullers in independent.into_iter().chain([(2, Schedule::Switch)]) {
        for (name, times) in walks {
            let report = report(times, cullers);
            let model = report.summary.model.unwrap();
            let (simulated, latency) = simulated(&report, cullers);
            let off = model.fps / simulated - 1.0;
            // In the schedule `switch` ids come in batches, which the report does not model.
            let bound = if cullers.1 == Schedule::Switch { 0.03 } else { 1e-6 };
            assert!(off.abs() < bound, "{name}, {cullers:?}: {} and {simulated}", model.fps);
            if cullers.1 == Schedule::Independent {
                let later = model.latency_ms / latency - 1.0;
                assert!(later.abs() < bound, "{name}, {cullers:?}: {} and {latency} ms", model.latency_ms);
            }
            let unaccounted = model.fps_at_least / model.fps - 1.0;
            assert!(unaccounted.abs() < 1e-6, "{name}, {cullers:?}: all time is accounted for");
        }
    }
}
