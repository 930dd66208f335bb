//! A display and its cullers as processes, some of which are lost or come late: the walk goes on, no frame is
//! missing, and a culler that comes again gets frames again.

use std::{thread, time::Duration};

use crate::common::deployment::{Deployment, ENDLESS, culled_by, notes};
use crate::common::ports::unused_port;
use crate::common::program::Process;

const TRANSPORTS: [&str; 3] = ["tcp", "quic", "udp"];
/// Frames of a walk that is to end by itself.
const SHORT: [&str; 2] = ["--frames", "10"];

fn deploy(transport: &str) -> Deployment {
    Deployment::here(transport, [(); 2].map(|()| unused_port()))
}

#[test]
fn a_culler_that_is_started_again_is_taken_back_and_no_frame_is_missing() {
    // A stopped process says so itself: it is missed long before the idle timeout.
    let stopped = ["-o", "link.idle_timeout_s=100"];
    for transport in TRANSPORTS {
        for (killed, more) in [(true, &[][..]), (false, &stopped)] {
            let deployment = deploy(transport);
            let [_kept, culler] = deployment.start_cullers(more);
            let mut display = deployment.start("display", more);
            deployment.shows(20);
            if killed {
                culler.kill();
            } else {
                culler.interrupt();
                culler.ends(0);
            }
            let _again = deployment.start("culler-2", more);
            let lost = display.says("culler 2 was lost before");
            assert!(killed || lost.contains("it was interrupted"), "{transport}: {lost}");
            display.says("culler 2 came before");
            deployment.shows(20);
            let (report, _) = deployment.interrupted(display);
            assert!(notes(&report, &["culler 2 was lost before"]), "{transport}: {}", report["run"]);
            assert!(notes(&report, &["culler 2 came before"]), "{transport}: {}", report["run"]);
            assert!(!notes(&report, &["culler 1 was lost"]), "{transport}: {}", report["run"]);
            if killed {
                deployment.whole_report();
            }
        }
    }
}

/// Like a suspended machine: the display counts it as lost, and it learns of that once it goes on.
#[test]
fn a_culler_that_sleeps_for_longer_than_the_idle_timeout_is_taken_back() {
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let [_kept, culler] = deployment.start_cullers(&[]);
        let mut display = deployment.start("display", &[]);
        deployment.shows(20);
        culler.signal("STOP");
        display.says("culler 2 was lost before");
        deployment.shows(20);
        culler.signal("CONT");
        display.says("culler 2 came before");
        deployment.shows(20);
        let (report, _) = deployment.interrupted(display);
        assert!(notes(&report, &["culler 2 came before"]), "{transport}: {}", report["run"]);
        culler.interrupt();
        culler.ends(0);
    }
}

#[test]
fn a_walk_goes_on_without_any_culler_and_takes_all_back() {
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let cullers = deployment.start_cullers(&[]);
        let mut display = deployment.start("display", &[]);
        deployment.shows(20);
        cullers.into_iter().for_each(Process::kill);
        for _ in 0..2 {
            display.says("was lost before");
        }
        deployment.shows(20);
        let _again = deployment.start_cullers(&[]);
        for _ in 0..2 {
            display.says("came before");
        }
        deployment.shows(20);
        let (report, _) = deployment.interrupted(display);
        assert_eq!(culled_by(&report), ["culler 1", "culler 2", "display"], "{transport}");
        for culler in ["culler 1", "culler 2"] {
            assert!(notes(&report, &[culler, "was lost before"]), "{transport}: {}", report["run"]);
            assert!(notes(&report, &[culler, "came before"]), "{transport}: {}", report["run"]);
        }
        deployment.whole_report();
    }
}

#[test]
fn a_culler_that_comes_late_is_dealt_frames_from_then_on() {
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let _first = deployment.start("culler-1", &[]);
        let mut display = deployment.start("display", &["--join-timeout", "1"]);
        display.says("begins without 1 of 2 cullers");
        deployment.shows(20);
        let _late = deployment.start("culler-2", &[]);
        display.says("culler 2 came before");
        deployment.shows(20);
        let (report, _) = deployment.interrupted(display);
        assert!(culled_by(&report).contains(&"culler 2"), "{transport}: {:?}", culled_by(&report));
    }
}

#[test]
fn a_display_that_never_finds_a_culler_walks_alone() {
    let deployment = deploy("tcp");
    let said = deployment.start("display", &["--join-timeout", "0.5", "--frames", "10"]).ends(0);
    assert!(said.contains("begins without 2 of 2 cullers"), "{said}");
    let report = deployment.whole_report();
    assert_eq!((report["frames"].as_array().unwrap().len(), culled_by(&report)), (10, vec!["display"]));
}

/// Until its join_timeout the display waits for both: one that is lost meanwhile is reconnected.
#[test]
fn a_culler_that_is_killed_while_the_display_waits_for_the_other_one_is_taken_back() {
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let mut killed = deployment.start("culler-1", &[]);
        let mut display = deployment.start("display", &[]);
        killed.says("has joined");
        // The display has the whole link a moment later.
        thread::sleep(Duration::from_millis(500));
        killed.kill();
        let _cullers = deployment.start_cullers(&[]);
        display.says("culler 1 was lost before");
        display.says_all(&["has come", "culler 1"]);
        deployment.shows(20);
        let (report, _) = deployment.interrupted(display);
        assert!(culled_by(&report).contains(&"culler 1"), "{transport}: {}", report["run"]);
    }
}

/// Over datagrams a culler has not noticed yet that the earlier display was killed: it serves both.
#[test]
fn a_display_that_is_started_again_finds_its_cullers_at_once() {
    // Longer than a test may wait.
    let idle = ["-o", "link.idle_timeout_s=600"];
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let _cullers = deployment.start_cullers(&idle);
        for _ in 0..2 {
            let display = deployment.start("display", &idle);
            deployment.shows(5);
            display.kill();
        }
        let said = deployment.start("display", &[&idle[..], &SHORT].concat()).ends(0);
        assert!(!said.contains("begins without"), "{transport}: {said}");
        let report = deployment.whole_report();
        assert_eq!(report["frames"].as_array().unwrap().len(), 10, "{transport}");
        assert_eq!(culled_by(&report), ["culler 1", "culler 2"], "{transport}");
    }
}

#[test]
fn cullers_stay_when_a_display_is_interrupted_and_end_when_they_are_stopped() {
    for transport in TRANSPORTS {
        let deployment = deploy(transport);
        let mut cullers = deployment.start_cullers(&[]);
        let display = deployment.start("display", &[]);
        deployment.shows(5);
        let (report, said) = deployment.interrupted(display);
        assert!(said.contains("it was asked to stop"), "{transport}: {said}");
        assert!(report["frames"].as_array().unwrap().len() < ENDLESS);
        for culler in &mut cullers {
            culler.says("it was interrupted");
        }
        deployment.start("display", &SHORT).ends(0);
        assert_eq!(culled_by(&deployment.whole_report()), ["culler 1", "culler 2"], "{transport}");
        for culler in cullers {
            culler.interrupt();
            culler.ends(0);
        }
    }
}

/// If only the display can be reached.
#[test]
fn cullers_that_connect_find_the_display_that_is_there() {
    for transport in TRANSPORTS {
        let deployment = Deployment::with_listening_display(transport, unused_port());
        let _cullers = deployment.start_cullers(&[]);
        for _ in 0..2 {
            let mut display = deployment.start("display", &[]);
            for _ in 0..2 {
                display.says("has come");
            }
            deployment.shows(20);
            let (report, _) = deployment.interrupted(display);
            assert!(culled_by(&report).contains(&"culler 1"), "{transport}: {}", report["run"]);
        }
    }
}
