//! How many packets the ids of a frame take, by transport and batch size, counted one by one.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../../transport/tests/common/mod.rs"]
mod common;

use std::sync::Arc;
use std::time::Duration;

use common::{identity, ids, receive, start};
use trimaran_netsim::link::{LinkModel, Rate};
use trimaran_netsim::{Simulation, Topology};
use trimaran_proto::{BatchSize, Role};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, Link, LinkConfig, Listener, Net, Options, connect, sleep_until};

/// As many as in the paper's model of bandwidth.
const IDS: u32 = 4000;

/// What one frame of [`IDS`] ids took over `transport` in batches of `batch`, each packet of either direction
/// counted: where all ids are found at once, or, if not, where each batch is alone.
fn packets(transport: &str, batch: u32, at_once: bool) -> u64 {
    let mut topology = Topology::new();
    let (here, there) = (topology.host("here"), topology.host("there"));
    let gigabit = LinkModel::clean(Rate::new(1_000_000_000), Duration::from_micros(5));
    topology.join(topology.node(here), topology.node(there), gigabit.clone(), gigabit);
    let simulation = Simulation::new(&topology, 1);
    let nets: [Arc<dyn Net>; 2] = [Arc::new(simulation.net(here)), Arc::new(simulation.net(there))];
    let offered = || simulation.links().iter().map(|link| link.offered.packets).sum::<u64>();
    simulation
        .run(async {
            let (mut a, mut display) = pair(&nets, transport, batch).await;
            // Frames before it open the window, and teach how large a datagram may be.
            for frame in 0..10 {
                send(&mut a, frame, &ids(IDS)).await;
                receive(&mut display.frames_rx).await.unwrap();
                pause(&nets[0]).await;
            }
            let before = offered();
            if at_once {
                send(&mut a, 10, &ids(IDS)).await;
            } else {
                a.frames_tx.begin(start(10)).await.unwrap();
                for found in ids(IDS).chunks(batch as usize) {
                    a.frames_tx.push(found).await.unwrap();
                    sleep_until(&*nets[0], nets[0].now().after(Duration::from_micros(12))).await;
                }
                a.frames_tx.finish().await.unwrap();
            }
            assert_eq!(receive(&mut display.frames_rx).await.unwrap().ids, ids(IDS));
            // Late acknowledgements.
            pause(&nets[0]).await;
            offered() - before
        })
        .unwrap()
}

async fn pair([here, there]: &[Arc<dyn Net>; 2], transport: &str, batch: u32) -> (Link, Link) {
    let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
    let (a, b) = (keys("a"), keys("b"));
    let link = LinkConfig { batch: BatchSize::new(batch).unwrap(), ..LinkConfig::default() };
    let options = |own: &Keys, peer: &Keys| {
        let security = Some(Security { keys: own.clone(), peers: vec![peer.public().clone().into()] });
        Options { link, security, ..Options::default() }
    };
    let (ours, theirs) = (options(&a, &b), options(&b, &a));
    let endpoint: Endpoint = format!("{transport}://0.0.0.0:7400").parse().unwrap();
    let mut listener = Listener::bind(here, &endpoint, identity(Role::SwitchA), &ours).await.unwrap();
    let endpoint = format!("{transport}://here:7400").parse().unwrap();
    let soon = here.now().after(Duration::from_secs(60));
    let (there, here) = tokio::join!(
        connect(there, &endpoint, identity(Role::Display), &theirs, soon),
        listener.accept(soon),
    );
    (here.unwrap(), there.unwrap())
}

async fn send(a: &mut Link, frame: u32, found: &[trimaran_proto::DrawableId]) {
    a.frames_tx.begin(start(frame)).await.unwrap();
    a.frames_tx.push(found).await.unwrap();
    a.frames_tx.finish().await.unwrap();
}

async fn pause(net: &Arc<dyn Net>) {
    sleep_until(&**net, net.now().after(Duration::from_millis(100))).await;
}

/// Batches that are found at once share packets: there are about as many as the bytes need, and what
/// acknowledges them.
#[test]
fn batches_that_are_found_at_once_share_packets() {
    for (transport, most) in [("tcp", 30), ("quic", 30), ("udp", 30)] {
        let counts = [1, 10, 100, 1000].map(|batch| packets(transport, batch, true));
        println!("{transport}: {counts:?}");
        for (batch, count) in [1, 10, 100, 1000].into_iter().zip(counts) {
            // A message's header is 4 bytes, as much as an id; datagrams of our own have none.
            let most = if batch == 1 && transport != "udp" { 2 * most } else { most };
            assert!(count <= most, "{count} packets over {transport} in batches of {batch}");
        }
    }
}

/// And a batch that is found alone waits for nobody.
#[test]
fn a_batch_that_is_found_alone_is_a_packet() {
    for transport in ["tcp", "quic", "udp"] {
        let count = packets(transport, 100, false);
        println!("{transport}: {count}");
        assert!(count >= 40, "{count} packets over {transport}");
    }
}
