//! Floods of handshakes from strangers, over each transport in virtual time: a peer still gets in.

use std::sync::Arc;
use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{SimNet, Simulation, Topology};
use trimaran_transport::conformance::{ARM, GRIPPER, PANEL, Robot, greeting};
use trimaran_transport::keys::Keys;
use trimaran_transport::{
    Endpoint, HostPort, Instant, Net, Options, TcpOptions, TurnedAway, connect, sleep_until, until,
};

use crate::hosts::silent::SilentNet;
use crate::hosts::{Listener, knowing, seen_from_elsewhere};

const MS: Duration = Duration::from_millis(1);
const SECOND: Duration = Duration::from_secs(1);

/// The source of the flood.
#[derive(Clone, Copy)]
enum Flood {
    OneAddress,
    ManyAddresses,
    /// The peer's own: both are behind one router.
    SameAddress,
}

/// A peer that knows the listener, the listener, and a stranger that the listener does not know.
fn acquainted() -> [Options; 3] {
    let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
    let (peer, listener, stranger) = (keys("peer"), keys("listener"), keys("stranger"));
    [knowing(&peer, &listener), knowing(&listener, &peer), knowing(&stranger, &listener)]
}

/// Begins a handshake as a stranger, is silent for a quarter of a second, and vanishes without a close.
async fn begin(net: SimNet, at: Endpoint, options: Options) {
    let by = net.now().after(SECOND / 4);
    match &at {
        Endpoint::Tcp(HostPort { port, .. }) => {
            let to = net.resolve(&format!("here:{port}")).await.unwrap()[0];
            let _stream = net.connect_tcp(to, TcpOptions::default()).await;
            sleep_until(&net, by).await;
        }
        _ => {
            let silent = Arc::new(SilentNet::new(net));
            let as_net = Arc::clone(&silent) as Arc<dyn Net>;
            let link = connect::<Robot>(&as_net, &at, greeting(GRIPPER), &options, by);
            let link = until(&*as_net, by, link).await;
            silent.leave();
            assert!(!matches!(link, Some(Ok(_))), "a stranger got in: {link:?}");
        }
    }
}

/// Begins a thousand handshakes a second in turn from each of `nets`, for ever.
async fn flood(clock: Arc<dyn Net>, nets: Vec<SimNet>, at: Endpoint, options: Options) {
    for net in nets.iter().cycle() {
        clock.spawn(Box::pin(begin(net.clone(), at.clone(), options.clone())));
        sleep_until(&*clock, clock.now().after(MS)).await;
    }
}

/// How long a peer takes to connect half a second into the flood, and the refused handshakes.
fn joins_during(flooded: Flood, scheme: &str) -> (Duration, TurnedAway) {
    let strangers: Vec<String> = (0..40).map(|number| format!("stranger {number}")).collect();
    let mut names = vec!["here", "there"];
    names.extend(strangers.iter().map(String::as_str));
    let line = LinkModel::clean(Rate::new(1_000_000_000), Duration::from_millis(1));
    let topology = Topology::star(&names, &line, &line);
    let simulation = Simulation::new(&topology, 1);
    let net = |name: &str| simulation.net(topology.find(name).unwrap());
    let nets: Vec<_> = match flooded {
        Flood::OneAddress => vec![net("stranger 0")],
        Flood::ManyAddresses => strangers.iter().map(|name| net(name)).collect(),
        Flood::SameAddress => vec![net("there")],
    };
    let (here, there): (Arc<dyn Net>, Arc<dyn Net>) = (Arc::new(net("here")), Arc::new(net("there")));
    let [peer, ours, stranger] = acquainted();
    let joined = async {
        let everywhere = format!("{scheme}://0.0.0.0:0").parse().unwrap();
        let mut listener = Listener::bind(&here, &everywhere, greeting(ARM), &ours).await.unwrap();
        let at = seen_from_elsewhere(&listener);
        here.spawn(Box::pin(flood(Arc::clone(&here), nets, at.clone(), stranger)));
        sleep_until(&*here, Instant::from_nanos(0).after(SECOND / 2)).await;
        let (begun, by) = (here.now(), here.now().after(30 * SECOND));
        let (there, link) =
            tokio::join!(connect::<Robot>(&there, &at, greeting(PANEL), &peer, by), listener.accept(by));
        let turned_away = listener.turned_away();
        assert!(there.is_ok() && link.is_ok(), "{there:?} {link:?} {turned_away:?}");
        (here.now().since(begun), turned_away)
    };
    simulation.run(joined).unwrap()
}

/// Makes a test of each transport.
macro_rules! over_each {
    ($($transport:ident)+) => { $(
        mod $transport {
            use super::*;

            #[test]
            fn a_flood_from_one_address_holds_up_no_peer_for_a_second() {
                let (took, turned_away) = joins_during(Flood::OneAddress, stringify!($transport));
                assert!(took < SECOND, "{took:?}, {turned_away:?}");
                assert!(turned_away.from_address > 0, "{turned_away:?}");
            }

            #[test]
            fn a_flood_from_many_addresses_holds_up_no_peer_for_a_second() {
                let (took, turned_away) = joins_during(Flood::ManyAddresses, stringify!($transport));
                assert!(took < SECOND, "{took:?}, {turned_away:?}");
            }

            #[test]
            fn a_peer_at_the_address_that_a_flood_comes_from_gets_in_soon() {
                let (took, turned_away) = joins_during(Flood::SameAddress, stringify!($transport));
                assert!(took < 10 * SECOND, "{took:?}, {turned_away:?}");
            }
        }
    )+ };
}

over_each!(tcp quic udp);
