//! Whole sessions in virtual time, over each transport.

use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

use trimaran::report::{Frame, Projection, Report, Run, schema::Ended};
use trimaran::simulate::{
    Knobs, Load, Outcome, Scenario, Times, Transport, Workload, WorkloadError, pooled, simulate,
    simulate_watched,
};
use trimaran_actors::Schedule;
use trimaran_netsim::Profile;
use trimaran_proto::BatchSize;

const INDEPENDENT: Schedule = Schedule::Independent;
const ALL: [Transport; 4] = [Transport::Tcp, Transport::Quic, Transport::Udp, Transport::UdpDeadline];

fn load(nodes: u32, ms: u64) -> Load {
    let time = Duration::from_millis(ms);
    Load { nodes, or: time, hc: time, rvg: time }
}

fn run(network: &str, link: Transport, batch: u32, load: Load, seed: u64) -> Outcome {
    run_by(INDEPENDENT, network, link, batch, load, seed)
}

fn run_by(schedule: Schedule, network: &str, link: Transport, batch: u32, load: Load, seed: u64) -> Outcome {
    let network = Profile::find(network).unwrap();
    let batch = BatchSize::new(batch).unwrap();
    let (workload, knobs) = (Workload::steady(load), Knobs::default());
    simulate(&Scenario {
        network,
        link,
        cullers: 2,
        schedule,
        batch,
        frames: 60,
        seed,
        workload,
        geometry: None,
        knobs,
    })
    .unwrap()
}

#[test]
fn every_transport_shows_every_frame_once_and_the_parts_of_its_time_add_up() {
    for link in ALL {
        let outcome = run("fast-ethernet", link, 1024, load(4000, 5), 1);
        assert_eq!(outcome.times.len(), 60);
        for pair in outcome.times.windows(2) {
            assert!(pair[0].shown < pair[1].shown, "{link:?}");
        }
        for (times, split) in outcome.times.iter().zip(outcome.splits()) {
            assert_eq!(split.total(), times.shown.since(times.published), "{link:?}: {times:?}");
        }
        for times in &outcome.times[1..] {
            let moments = [
                times.published,
                times.taken,
                times.fed,
                times.occluded,
                times.culled,
                times.arrived,
                times.shown,
            ];
            assert!(moments.is_sorted(), "{link:?}: {times:?}");
            assert_eq!(times.culled.since(times.occluded), Duration::from_millis(5));
            assert!(times.shown.since(times.arrived) >= Duration::from_millis(5));
        }
        // The ids of 4000 nodes, only for the display.
        assert_eq!(outcome.bytes.ids, 4.0 * 4000.0, "{link:?}");
        let bytes = &outcome.bytes;
        let parts = bytes.ids
            + bytes.messages
            + bytes.transport
            + bytes.transport_headers
            + bytes.ip_headers
            + bytes.link_layer;
        assert!((parts - bytes.total).abs() < 1.0, "{link:?}: {bytes:?}");
    }
}

#[test]
fn ids_for_the_other_culler_are_counted_as_ids() {
    for link in ALL {
        let outcome = run_by(Schedule::Switch, "fast-ethernet", link, 1024, load(4000, 5), 1);
        // The cullers meet while the first frames are culled, and the last ones' account comes too late.
        let copies = outcome.bytes.ids / (4.0 * 4000.0);
        assert!((1.9..2.0).contains(&copies), "{link:?}: {copies}");
    }
}

#[test]
fn an_idle_network_costs_the_time_of_the_bits() {
    // The last batch of 100 ids leaves when culling ends; its end, and the ids, take two hops of 100 Mbit/s.
    let outcome = run("fast-ethernet", Transport::Tcp, 100, load(100, 5), 1);
    let times = outcome.times[30];
    let us = times.arrived.since(times.culled).as_secs_f64() * 1e6;
    // A segment of 404 bytes of ids costs 2 x (66 + 404 + 24) x 0.08 us and 10 us of delay at least. Three
    // short segments may follow it: the frame's end, its statistics on the link's third connection, an
    // acknowledgement.
    assert!(us > 2.0 * 494.0 * 0.08 + 10.0 && us < 160.0, "{us} us");
}

#[test]
fn the_same_seed_gives_the_same_session_and_another_one_another() {
    for link in ALL {
        let [first, again, other] = [7, 7, 8].map(|seed| run("wifi", link, 1024, load(2000, 4), seed));
        assert_eq!((&first.trace_hashes, &first.times), (&again.trace_hashes, &again.times), "{link:?}");
        assert_ne!(first.trace_hashes, other.trace_hashes, "{link:?}");
    }
}

#[test]
fn small_batches_cost_headers_as_the_corrected_formula_says_where_each_is_a_packet_of_its_own() {
    let [ten, thousand] = [10, 1000].map(|batch| run("10g", Transport::Tcp, batch, load(4000, 5), 1));
    assert!(ten.bytes.total > 1.5 * thousand.bytes.total, "{} {}", ten.bytes.total, thousand.bytes.total);
    // With its own headers (TCP 32, IP 20, Ethernet 18, a message's 4) rather than the paper's 50, and
    // acknowledgements.
    assert!(ten.bytes.total > ten.bytes.corrected && ten.bytes.total < 3.0 * ten.bytes.corrected);
    assert!(ten.bytes.paper > 2.0 * ten.bytes.corrected);
}

#[test]
fn other_times_take_the_place_of_the_recorded_ones() {
    let ms = Duration::from_millis;
    let times = Times { hc: Some(ms(8)), rvg: Some(ms(2)), ..Times::default() };
    let workload = Workload::steady(load(100, 4)).taking(times);
    assert_eq!(workload.of(7), Load { nodes: 100, or: ms(4), hc: ms(8), rvg: ms(2) });
    let finds = workload.finds(7, BatchSize::new(40).unwrap());
    let us = Duration::from_micros;
    assert_eq!(finds, [(40, us(3200)), (80, us(6400)), (100, us(8000))]);
}

#[test]
fn what_cannot_come_in_time_is_given_up_and_the_session_goes_on() {
    let run = |ms: u64, repair_percent| {
        let knobs = Knobs { deadline: Duration::from_millis(ms), repair_percent, ..Knobs::default() };
        let network = Profile::find("wifi").unwrap();
        let batch = BatchSize::new(1024).unwrap();
        let workload = Workload::steady(load(4000, 5));
        let link = Transport::UdpDeadline;
        simulate(&Scenario {
            network,
            link,
            cullers: 2,
            schedule: INDEPENDENT,
            batch,
            frames: 200,
            seed: 3,
            workload,
            geometry: None,
            knobs,
        })
        .unwrap()
    };
    let [hasty, patient] = [run(1, 0), run(1000, 0)];
    assert_eq!((hasty.times.len(), patient.incomplete), (200, 0));
    assert!(hasty.incomplete > 10, "{}", hasty.incomplete);
    for (frame, came) in &hasty.remains {
        let times = &hasty.times[*frame as usize];
        assert_eq!(came.len() as u32 + times.missing, 4000, "frame {frame}");
        assert!(came.is_sorted(), "frame {frame}");
    }
    assert_eq!(hasty.remains.len() as u32, hasty.incomplete);
    let both = pooled(&[hasty.clone(), hasty.clone()]);
    assert_eq!((both.len(), both[0].frames, both[0].incomplete), (1, 400, 2 * hasty.incomplete));
    assert_eq!(both[0].latency_ms.p50, hasty.latency_ms.p50);
    assert_eq!(pooled(&[hasty, patient]).len(), 2, "another deadline is another run");
}

/// To the display the wifi path has two delays of 1 ms, plus the transmission time.
#[test]
fn a_deadline_no_longer_than_the_way_is_hopeless() {
    let run = |us: u64, link| {
        let knobs = Knobs { deadline: Duration::from_micros(us), repair_percent: 0, ..Knobs::default() };
        let (network, batch) = (Profile::find("wifi").unwrap(), BatchSize::new(1024).unwrap());
        let workload = Workload::steady(load(4000, 5));
        let scenario = Scenario {
            network,
            link,
            cullers: 2,
            schedule: INDEPENDENT,
            batch,
            frames: 20,
            seed: 1,
            workload,
            geometry: None,
            knobs,
        };
        let shown = Cell::new(0);
        let outcome = simulate_watched(&scenario, None, || shown.set(shown.get() + 1)).unwrap();
        assert_eq!(shown.get(), 20, "each picture is told of");
        (outcome.deadline_too_short, scenario.gives_up_everything(), outcome.incomplete)
    };
    let (told, warned, incomplete) = run(2000, Transport::UdpDeadline);
    assert!(told && warned && incomplete >= 18, "{told} {warned} {incomplete}");
    let (told, warned, incomplete) = run(30_000, Transport::UdpDeadline);
    assert!(!told && !warned && incomplete < 5, "{told} {warned} {incomplete}");
    assert_eq!(run(2000, Transport::Udp), (false, false, 0), "no deadline holds there");
}

#[test]
fn a_frame_that_lacked_something_does_not_say_what_was_sent() {
    let frame = |number: u32, lacking| Frame {
        frame: number,
        or_ms: Some(1.0),
        hc_ms: Some(1.0),
        rvg_ms: Some(1.0),
        nodes_drawn: Some(u64::from(100 + number)),
        lacking,
        ..Frame::default()
    };
    let projection = Projection { width: 8, height: 8, vfov_deg: 60.0, near: 0.1 };
    let frames = vec![frame(0, 0), frame(1, 7), frame(2, 0)];
    let report = Report::new(Run::default(), projection, frames, None, Ended::default());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.json");
    std::fs::write(&path, serde_json::to_vec(&report).unwrap()).unwrap();
    let workload = Workload::recorded(&path).unwrap();
    assert_eq!([0, 1].map(|frame| workload.of(frame).nodes), [100, 102]);
    assert_eq!(workload.frames(), 2);
}

#[test]
fn a_trace_that_is_none_is_named() {
    let missing = Workload::recorded(Path::new("no/such/report.json")).unwrap_err();
    assert!(
        matches!(&missing, WorkloadError::Read { .. }) && missing.to_string().contains("no/such/report.json")
    );
    let wrong = Workload::recorded(&Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap_err();
    assert!(matches!(wrong, WorkloadError::Parse { .. }), "{wrong}");
}
