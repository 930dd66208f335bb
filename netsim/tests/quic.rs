//! QUIC, the very one that real links use, in virtual time: the conformance suite, exact times, and the same
//! run each time.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../../transport/tests/common/mod.rs"]
mod common;
#[path = "virtual_time/priorities.rs"]
mod priorities;
#[path = "virtual_time/mod.rs"]
#[macro_use]
mod virtual_time;

use std::sync::Arc;
use std::time::Duration;

use common::conformance::Pairs;
use common::{camera, identity, ids, receive, start};
use trimaran_netsim::link::{Conditions, LinkModel, LinkTally, Loss, Phase, Probability, Rate};
use trimaran_netsim::{SimNet, Simulation, Topology};
use trimaran_proto::{Goodbye, Role};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, Instant, Link, LinkConfig, Listener, Net, Options, connect, sleep_until};

/// Two machines of a simulation.
struct Quic {
    here: SimNet,
    there: SimNet,
}

impl Pairs for Quic {
    const HEADER: u64 = 4;
    const HANDSHAKE: u64 = 1;

    async fn pair(&self, link: LinkConfig) -> (Link, Link) {
        let (ours, theirs) = acquainted(link);
        let (here, there) = (net(&self.here), net(&self.there));
        let endpoint = "quic://0.0.0.0:0".parse().unwrap();
        let mut listener = Listener::bind(&here, &endpoint, identity(Role::SwitchA), &ours).await.unwrap();
        let Endpoint::Quic(at) = listener.local_endpoint() else { panic!("not QUIC") };
        let endpoint = format!("quic://here:{}", at.port).parse().unwrap();
        let soon = here.now().after(Duration::from_secs(60));
        let (there, here) = tokio::join!(
            connect(&there, &endpoint, identity(Role::Display), &theirs, soon),
            listener.accept(soon),
        );
        (here.unwrap(), there.unwrap())
    }

    fn net(&self) -> Arc<dyn Net> {
        net(&self.here)
    }
}

fn net(net: &SimNet) -> Arc<dyn Net> {
    Arc::new(net.clone())
}

fn acquainted(link: LinkConfig) -> (Options, Options) {
    let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
    let (a, b) = (keys("a"), keys("b"));
    let with = |keys: &Keys, peer: &Keys| {
        let security = Some(Security { keys: keys.clone(), peers: vec![peer.public().clone().into()] });
        Options { link, security, ..Options::default() }
    };
    (with(&a, &b), with(&b, &a))
}

fn machines(link: &LinkModel, seed: u64) -> (Simulation, Quic) {
    let mut topology = Topology::new();
    let (here, there) = (topology.host("here"), topology.host("there"));
    topology.join(topology.node(here), topology.node(there), link.clone(), link.clone());
    let simulation = Simulation::new(&topology, seed);
    let pairs = Quic { here: simulation.net(here), there: simulation.net(there) };
    (simulation, pairs)
}

fn gigabit() -> LinkModel {
    LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(5))
}

conformance_in_virtual_time!(|| machines(&gigabit(), 1));

#[test]
fn an_older_frame_is_complete_first() {
    let (simulation, pairs) = machines(&priorities::narrow(), 1);
    simulation.run(priorities::an_older_frame_is_complete_first(&pairs)).unwrap();
}

#[test]
fn a_camera_goes_before_a_frame() {
    let (simulation, pairs) = machines(&priorities::narrow(), 1);
    simulation.run(priorities::a_camera_goes_before_a_frame(&pairs)).unwrap();
}

/// Sends 50 frames of 4000 ids over a link that loses a hundredth of all packets. Gives the hash of the
/// trace, when it was done, and how many packets were lost.
fn lossy_session(seed: u64) -> (u64, u64, u64) {
    let mut link = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(2));
    link.conditions.loss = Loss::Independent(Probability::new(0.01).unwrap());
    let (simulation, pairs) = machines(&link, seed);
    simulation
        .run(async {
            let (mut a, mut display) = pairs.pair(LinkConfig::default()).await;
            for frame in 0..50 {
                display.latest_tx.publish(camera(frame)).unwrap();
                a.frames_tx.begin(start(frame)).await.unwrap();
                a.frames_tx.push(&ids(4000)).await.unwrap();
                a.frames_tx.finish().await.unwrap();
                assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(4000));
            }
        })
        .unwrap();
    let links = simulation.links();
    assert!(links.iter().all(LinkTally::is_balanced));
    let lost = links.iter().map(|link| link.dropped.lost.packets).sum();
    (simulation.trace_hash(), simulation.now().as_nanos(), lost)
}

#[test]
fn the_same_seed_gives_the_same_packets_at_the_same_nanoseconds() {
    let first = lossy_session(7);
    assert!(first.2 > 5, "nothing was lost: {first:?}");
    assert_eq!(lossy_session(7), first);
    assert_ne!(lossy_session(8).0, first.0);
    // Of every build: what is encrypted differs, but neither its sizes nor its times.
    assert_eq!(first, (16_123_674_567_521_039_074, 373_323_602, 14));
}

#[test]
fn a_handshake_takes_whole_round_trips() {
    // Without a rate all time is delay.
    for delay in [Duration::from_micros(5), Duration::from_micros(50), Duration::from_millis(20)] {
        let (simulation, pairs) = machines(&LinkModel::clean(None, delay), 1);
        simulation.run(pairs.pair(LinkConfig::default())).unwrap();
        // The proof of the address there and back; the keys; the hello, and its answer.
        assert_eq!(simulation.now().as_nanos(), 6 * delay.as_nanos() as u64);
    }
}

#[test]
fn who_leaves_waits_half_a_second_for_a_peer_that_has_left_and_cannot_tell_what_has_arrived() {
    let clean = LinkModel::clean(None, Duration::from_millis(5));
    let nothing = Loss::Independent(Probability::new(1.0).unwrap());
    let conditions = Conditions { loss: nothing, ..clean.conditions };
    let cut = LinkModel { phases: vec![Phase { at: Duration::from_secs(1), conditions }], ..clean.clone() };
    let mut topology = Topology::new();
    let (here, there) = (topology.host("here"), topology.host("there"));
    topology.join(topology.node(here), topology.node(there), cut, clean);
    let simulation = Simulation::new(&topology, 1);
    let pairs = Quic { here: simulation.net(here), there: simulation.net(there) };
    let took = simulation.run(async {
        let (a, display) = pairs.pair(LinkConfig::default()).await;
        sleep_until(&*pairs.net(), Instant::from_nanos(2_000_000_000)).await;
        // It hears nothing, and nothing tells it that its own goodbye has arrived.
        let Link { frames_tx, latest_tx, .. } = display;
        let left = async {
            tokio::join!(frames_tx.goodbye(Goodbye::Finished), latest_tx.goodbye(Goodbye::Finished))
        };
        tokio::select! {
            said = a.goodbye(Goodbye::Finished) => said.unwrap(),
            left = left => panic!("nobody can have answered it: {left:?}"),
        }
        pairs.net().now().since(Instant::from_nanos(2_000_000_000))
    });
    // Its word is 5 ms on its way; quinn's last packet leaves at once.
    let (least, most) = (Duration::from_millis(505), Duration::from_millis(510));
    let took = took.unwrap();
    assert!((least..most).contains(&took), "{took:?}");
}
