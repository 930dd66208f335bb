//! Idle timeouts that differ: the shorter one holds for both sides.

use std::time::Duration;

use trimaran_transport::conformance::{Pairs, send_frame};
use trimaran_transport::{LinkConfig, Net, RecvError, sleep_until, until};

use crate::hosts::{Link, Machines, acquainted, gigabit};

const SECOND: Duration = Duration::from_secs(1);

fn machines(scheme: &'static str) -> (trimaran_netsim::Simulation, Machines) {
    let overhead = trimaran_transport::conformance::Overhead { header_bytes: 0, handshake: 1, coded: true };
    Machines::joined([&gigabit(), &gigabit()], 1, scheme, overhead, acquainted())
}

/// A second on one side, half a minute on the other.
fn timeouts() -> [LinkConfig; 2] {
    [SECOND, 30 * SECOND].map(|idle_timeout| LinkConfig::default().with_idle_timeout(idle_timeout))
}

async fn hear_nothing(net: &dyn Net, link: &mut Link) {
    let heard = until(net, net.now().after(10 * SECOND), link.frames_rx.recv()).await;
    assert!(heard.is_none(), "{heard:?}");
}

/// Neither side sends anything for ten seconds, and both listen.
#[test]
fn a_quiet_link_lives_with_any_two_timeouts() {
    for scheme in ["tcp", "quic", "udp"] {
        for turned in [false, true] {
            let (simulation, machines) = machines(scheme);
            let [a, b] = timeouts();
            let quiet = async {
                let net = machines.net();
                let (mut here, mut there) = machines.join(if turned { [b, a] } else { [a, b] }).await;
                tokio::join!(hear_nothing(&*net, &mut here), hear_nothing(&*net, &mut there));
                send_frame(&mut there.frames_tx, 0, &[]).await.unwrap();
                here.frames_rx.recv().await.unwrap();
            };
            simulation.run(quiet).unwrap();
        }
    }
}

/// Here is not the side with the short timeout. Its peer's machine is cut off.
#[test]
fn the_shorter_timeout_ends_the_link_for_both() {
    use trimaran_netsim::link::{Conditions, Loss, Phase, Probability};
    for scheme in ["tcp", "quic", "udp"] {
        let way = gigabit();
        let conditions = Conditions { loss: Loss::Independent(Probability::one()), ..way.conditions };
        let cut = gigabit();
        let cut =
            trimaran_netsim::link::LinkModel { phases: vec![Phase { at: 5 * SECOND, conditions }], ..cut };
        let (_, Machines { overhead, options, .. }) = machines(scheme);
        let (simulation, machines) = Machines::joined([&cut, &cut], 1, scheme, overhead, options);
        let [short, long] = timeouts();
        let lose = async {
            let net = machines.net();
            let (mut here, _there) = machines.join([long, short]).await;
            let end = here.frames_rx.recv().await.unwrap_err();
            assert!(matches!(end, RecvError::Lost { .. }), "{scheme}: {end:?}");
            let at = net.now().as_nanos() / 1_000_000;
            assert!((5_700..7_000).contains(&at), "{scheme}: lost after {at} ms");
            sleep_until(&*net, net.now()).await;
        };
        simulation.run(lose).unwrap();
    }
}
