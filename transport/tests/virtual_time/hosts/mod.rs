//! Two machines in virtual time, and links between them over each transport.

pub(crate) mod lossy;
pub(crate) mod priorities;
pub(crate) mod silent;

use std::sync::Arc;
use std::time::Duration;

use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{HostId, SimNet, Simulation, Topology};
use trimaran_transport::conformance::{ARM, Overhead, PANEL, Pairs, Robot, greeting, meet};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{ConnectError, Endpoint, Host, LinkConfig, Net, Options, Protocol};

pub(crate) type Link = trimaran_transport::Link<Robot>;
pub(crate) type Listener = trimaran_transport::Listener<Robot>;

/// Makes a test of each case of the conformance suite, except those with threads: there are none here.
/// `$machines` gives a simulation, and pairs of links on it.
#[macro_export]
macro_rules! conformance_in_virtual_time {
    (@each $machines:expr; tasks: $($case:ident),+; threads: $($thread:ident),+;) => {
        $(
            #[test]
            fn $case() {
                let (simulation, machines) = $machines();
                simulation.run(trimaran_transport::conformance::$case(&machines)).unwrap();
            }
        )+
    };
    ($machines:expr) => {
        trimaran_transport::conformance_cases!(conformance_in_virtual_time!(@each $machines;));
    };
}

/// The suite's cases over a connection that `$machines` makes from a link and a seed; the order of sending,
/// and that a seed decides the run.
#[macro_export]
macro_rules! connection_in_virtual_time {
    (@in_order $machines:path: $($case:ident),+) => {
        $(
            #[test]
            fn $case() {
                let (simulation, machines) = $machines(&$crate::hosts::priorities::narrow(), 1);
                simulation.run($crate::hosts::priorities::$case(&machines)).unwrap();
            }
        )+
    };
    ($machines:path) => {
        conformance_in_virtual_time!(|| $machines(&$crate::hosts::gigabit(), 1));

        connection_in_virtual_time!(
            @in_order $machines: an_older_frame_is_complete_first,
            a_value_and_a_message_go_before_a_frame,
            everything_goes_before_blocks
        );

        #[test]
        fn the_same_seed_gives_the_same_packets_at_the_same_nanoseconds() {
            $crate::hosts::lossy::a_seed_decides_the_run($machines);
        }
    };
}

/// A line of a gigabit.
pub(crate) fn gigabit() -> LinkModel {
    LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(5))
}

/// A simulation of two machines, `here` and `there`; `way` leads from the first to the second.
pub(crate) fn two_hosts(way: &LinkModel, back: &LinkModel, seed: u64) -> (Simulation, [HostId; 2]) {
    let mut topology = Topology::new();
    let hosts = [topology.host("here"), topology.host("there")];
    topology.join(topology.node(hosts[0]), topology.node(hosts[1]), way.clone(), back.clone());
    (Simulation::new(&topology, seed), hosts)
}

/// The two machines, and the options of their links. The machine `here` listens.
pub(crate) struct Machines {
    pub(crate) scheme: &'static str,
    pub(crate) overhead: Overhead,
    /// Of `here` and of `there`.
    pub(crate) nets: [SimNet; 2],
    pub(crate) options: [Options; 2],
}

impl Machines {
    /// Machines joined by `way` and `back`, as [`two_hosts`], and their links over `scheme`.
    pub(crate) fn joined(
        [way, back]: [&LinkModel; 2],
        seed: u64,
        scheme: &'static str,
        overhead: Overhead,
        options: [Options; 2],
    ) -> (Simulation, Self) {
        let (simulation, hosts) = two_hosts(way, back, seed);
        let nets = hosts.map(|host| simulation.net(host));
        (simulation, Self { scheme, overhead, nets, options })
    }

    /// A pair of links with these configurations: that of `here`, then that of `there`.
    pub(crate) async fn join(&self, configs: [LinkConfig; 2]) -> (Link, Link) {
        let hellos = (greeting(ARM), greeting(PANEL));
        self.join_with(hellos, configs, Duration::from_secs(60)).await.unwrap()
    }

    async fn join_with<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        configs: [LinkConfig; 2],
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        let [here, there] = self.nets.clone().map(|net| Arc::new(net) as Arc<dyn Net>);
        let [mut ours, mut theirs] = self.options.clone();
        [ours.link, theirs.link] = configs;
        let anywhere = format!("{}://0.0.0.0:0", self.scheme).parse().unwrap();
        meet([&here, &there], &anywhere, [&ours, &theirs], hellos, within, from_elsewhere).await
    }
}

impl Pairs for Machines {
    fn overhead(&self) -> Overhead {
        self.overhead
    }

    async fn join<P: Protocol, Q: Protocol>(
        &self,
        hellos: (P::Hello, Q::Hello),
        config: LinkConfig,
        within: Duration,
    ) -> Result<(trimaran_transport::Link<P>, trimaran_transport::Link<Q>), ConnectError> {
        self.join_with(hellos, [config; 2], within).await
    }

    fn net(&self) -> Arc<dyn Net> {
        Arc::new(self.nets[0].clone())
    }
}

/// The address of a listener on the machine `here` for other machines.
pub(crate) fn seen_from_elsewhere(listener: &Listener) -> Endpoint {
    from_elsewhere(listener.local_endpoint())
}

fn from_elsewhere(at: &Endpoint) -> Endpoint {
    let mut at = at.clone();
    match &mut at {
        Endpoint::Tcp(at) | Endpoint::Quic(at) => at.host = here(),
        Endpoint::Udp(at) => at.at.host = here(),
        other => panic!("{other}"),
    }
    at
}

fn here() -> Host {
    Host::Name("here".parse().unwrap())
}

/// Options of two peers that know each other.
pub(crate) fn acquainted() -> [Options; 2] {
    let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
    let (ours, theirs) = (keys("ours"), keys("theirs"));
    [knowing(&ours, &theirs), knowing(&theirs, &ours)]
}

/// Options of a peer with these keys that knows the other.
pub(crate) fn knowing(keys: &Keys, other: &Keys) -> Options {
    let security = Some(Security { keys: keys.clone(), peers: vec![other.public().clone().into()].into() });
    Options::default().with_security(security)
}
