//! Crashes, partitions and changes of links while programs run.

use std::future::{pending, poll_fn};
use std::io::{ErrorKind, IoSliceMut};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use proptest::prelude::*;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran_net::{
    Instant, Net, RecvMeta, Stream, TcpOptions, Transmit, UdpSocket, UdpSocketOptions, sleep_until, until,
};
use trimaran_netsim::link::{Framing, LinkModel, LinkTally, Loss, Probability, Rate};
use trimaran_netsim::{Class, Control, HostId, SetLinkError, SimNet, Simulation, Topology};

const DELAY: Duration = Duration::from_millis(10);

/// `a`, `b` and `c` at a switch.
fn star(rate: u64) -> (Topology, Simulation, [SimNet; 3]) {
    let line = LinkModel::clean(Rate::new(rate), DELAY);
    let topology = Topology::star(&["a", "b", "c"], &line, &line);
    let simulation = Simulation::new(&topology, 1);
    let nets = ["a", "b", "c"].map(|name| simulation.named(name).unwrap());
    (topology, simulation, nets)
}

async fn dial(from: &SimNet, to: &SimNet, options: TcpOptions) -> (Stream, Stream) {
    let (mut listener, at) = to.listen_tcp("0.0.0.0:0".parse().unwrap(), options).unwrap();
    let to = SocketAddr::new(to.host().v4(), at.port());
    let (ours, theirs) = tokio::join!(from.connect_tcp(to, options), listener.accept());
    (ours.unwrap(), theirs.unwrap())
}

fn bind(net: &SimNet) -> Arc<dyn UdpSocket> {
    net.bind_udp("0.0.0.0:700".parse().unwrap(), UdpSocketOptions::default()).unwrap()
}

fn send(socket: &dyn UdpSocket, to: HostId, contents: &[u8]) {
    let destination = SocketAddr::new(to.v4(), 700);
    let transmit = Transmit { destination, ecn: None, contents, segment_size: None, src_ip: None };
    socket.try_send(&transmit).unwrap();
}

async fn receive(socket: &dyn UdpSocket) -> std::io::Result<Vec<u8>> {
    let (mut buffer, mut meta) = (vec![0; 2000], [RecvMeta::default()]);
    poll_fn(|cx| socket.poll_recv(cx, &mut [IoSliceMut::new(&mut buffer)], &mut meta)).await?;
    buffer.truncate(meta[0].len);
    Ok(buffer)
}

async fn sleep(net: &SimNet, millis: u64) {
    sleep_until(net, net.now().after(Duration::from_millis(millis))).await;
}

fn packets(simulation: &Simulation, from: HostId, to: HostId) -> u64 {
    simulation.sent_by_class(from, to).values().map(|sent| sent.packets).sum()
}

fn dropped(simulation: &Simulation, of: impl Fn(&LinkTally) -> u64) -> u64 {
    let links = simulation.links();
    assert!(links.iter().all(LinkTally::is_balanced), "{links:?}");
    links.iter().map(of).sum()
}

#[test]
fn a_crash_says_nothing_and_the_peer_finds_out_by_its_own_timeouts() {
    let (_, simulation, [a, b, _]) = star(1_000_000_000);
    let control = simulation.control();
    simulation
        .run(async {
            let options = TcpOptions::default().with_user_timeout(Some(Duration::from_secs(8)));
            let (mut idle, _idle_there) = dial(&a, &b, options).await;
            let heard = a.now();
            let (mut busy, _busy_there) = dial(&a, &b, options).await;
            sleep(&a, 1000).await;
            let said = packets(&simulation, b.host(), a.host());
            control.crash(b.host());
            let crashed = a.now();
            busy.writer.write_all(b"anybody?").await.unwrap();
            let mut byte = [0];
            let gave_up = busy.reader.read(&mut byte).await.unwrap_err();
            assert_eq!(
                (gave_up.kind(), a.now().since(crashed)),
                (ErrorKind::TimedOut, Duration::from_secs(8))
            );
            let silent = idle.reader.read(&mut byte).await.unwrap_err();
            // 5 s of silence, and nine probes 2 s after each other. Its last segment came half a round trip
            // before the listener had the connection.
            let expected = Duration::from_secs(5 + 9 * 2) - 2 * DELAY;
            assert_eq!(silent.kind(), ErrorKind::TimedOut);
            assert!(expected.abs_diff(a.now().since(heard)) < Duration::from_millis(1), "{:?}", a.now());
            assert_eq!(packets(&simulation, b.host(), a.host()), said, "no FIN and no reset");
        })
        .unwrap();
    assert!(dropped(&simulation, |link| link.dropped.down.packets) > 10);
}

#[test]
fn a_crash_ends_tasks_and_sockets_and_a_restart_begins_with_none() {
    let (_, simulation, [a, b, _]) = star(1_000_000_000);
    let control = simulation.control();
    simulation
        .run(async {
            let (alive, ended) = tokio::sync::oneshot::channel::<()>();
            b.spawn(Box::pin(async move {
                let _alive = alive;
                pending::<()>().await;
            }));
            let (socket, options) = (bind(&b), TcpOptions::default());
            let (mut ours, mut theirs) = dial(&a, &b, options).await;
            let mut byte = [0];
            let crash = async {
                sleep(&a, 100).await;
                control.crash(b.host());
            };
            // Both already wait when it crashes.
            let (read, datagram, ()) = tokio::join!(theirs.reader.read(&mut byte), receive(&*socket), crash);
            assert_eq!(read.unwrap_err().kind(), ErrorKind::NotConnected);
            assert_eq!(datagram.unwrap_err().kind(), ErrorKind::NotConnected);
            assert!(ended.await.is_err(), "the task is dropped");
            let here = "0.0.0.0:0".parse().unwrap();
            let to = SocketAddr::new(a.host().v4(), 9);
            for refused in [
                b.bind_udp(here, UdpSocketOptions::default()).unwrap_err(),
                b.listen_tcp(here, options).map(|_| ()).unwrap_err(),
                b.connect_tcp(to, options).await.unwrap_err(),
            ] {
                assert_eq!(refused.kind(), ErrorKind::NetworkDown);
            }
            control.restart(b.host());
            let again = bind(&b);
            drop(socket); // from before the crash: the port belongs to the other one now
            send(&*bind(&a), b.host(), b"hello");
            assert_eq!(receive(&*again).await.unwrap(), b"hello");
            // A segment of a connection that it knows nothing of.
            ours.writer.write_all(b"still there?").await.unwrap();
            assert_eq!(ours.reader.read(&mut byte).await.unwrap_err().kind(), ErrorKind::ConnectionReset);
        })
        .unwrap();
}

#[test]
fn a_listener_from_before_a_crash_takes_nothing_from_its_successor() {
    let (_, simulation, [a, b, _]) = star(1_000_000_000);
    let (control, options) = (simulation.control(), TcpOptions::default());
    simulation
        .run(async {
            let at = "0.0.0.0:80".parse().unwrap();
            let (mut before, _) = b.listen_tcp(at, options).unwrap();
            control.crash(b.host());
            control.restart(b.host());
            let (mut after, _) = b.listen_tcp(at, options).unwrap();
            assert_eq!(before.accept().await.unwrap_err().kind(), ErrorKind::NotConnected);
            drop(before);
            let to = SocketAddr::new(b.host().v4(), 80);
            let (ours, theirs) = tokio::join!(a.connect_tcp(to, options), after.accept());
            assert!(ours.is_ok() && theirs.is_ok(), "{ours:?} {theirs:?}");
        })
        .unwrap();
}

/// It connects from another port than before, so the old connection at the other end is not in its way.
#[test]
fn a_host_that_restarts_gets_in_where_its_old_connection_is_still_open() {
    let (_, simulation, [a, b, _]) = star(1_000_000_000);
    let (control, options) = (simulation.control(), TcpOptions::default());
    simulation
        .run(async {
            let (mut listener, _) = b.listen_tcp("0.0.0.0:80".parse().unwrap(), options).unwrap();
            let to = SocketAddr::new(b.host().v4(), 80);
            let (_gone, old) = tokio::join!(a.connect_tcp(to, options), listener.accept());
            control.crash(a.host());
            control.restart(a.host());
            let soon = a.now().after(6 * DELAY + Duration::from_millis(1));
            let both = async { tokio::join!(a.connect_tcp(to, options), listener.accept()) };
            let (new, theirs) = until(&a, soon, both).await.expect("a round trip and a half");
            assert!(new.is_ok() && theirs.is_ok(), "{new:?} {theirs:?}");
            // The first probe of the old one finds nobody.
            let end = old.unwrap().reader.read(&mut [0]).await.unwrap_err();
            assert_eq!(end.kind(), ErrorKind::ConnectionReset);
        })
        .unwrap();
}

#[test]
fn what_waits_in_the_queue_of_a_host_is_lost_with_it_and_what_is_on_the_line_is_not() {
    let (_, simulation, [a, b, _]) = star(1_000_000); // a packet takes 12.3 ms
    let control = simulation.control();
    let got = simulation.run(async {
        let (here, there) = (bind(&a), bind(&b));
        (0..10).for_each(|_| send(&*here, b.host(), &[0; 1472]));
        sleep(&a, 20).await;
        control.crash(a.host());
        let (mut got, end) = (0, a.now().after(Duration::from_secs(10)));
        while until(&b, end, receive(&*there)).await.is_some() {
            got += 1;
        }
        got
    });
    assert_eq!((got, dropped(&simulation, |link| link.dropped.down.packets)), (Ok(2), 8));
}

#[test]
fn a_partition_drops_what_is_in_flight_both_ways_and_leaves_others_alone() {
    let (_, simulation, [a, b, c]) = star(1_000_000_000);
    let control = simulation.control();
    simulation
        .run(async {
            let [at_a, at_b, at_c] = [&a, &b, &c].map(bind);
            let soon = || a.now().after(Duration::from_millis(100));
            send(&*at_a, b.host(), b"in flight");
            sleep(&a, 15).await;
            control.partition(b.host(), a.host());
            send(&*at_a, b.host(), b"there");
            send(&*at_b, a.host(), b"back");
            assert_eq!(until(&a, soon(), receive(&*at_b)).await.map(Result::unwrap), None);
            assert_eq!(until(&a, soon(), receive(&*at_a)).await.map(Result::unwrap), None);
            send(&*at_a, c.host(), b"to another");
            assert_eq!(receive(&*at_c).await.unwrap(), b"to another");
            send(&*at_c, b.host(), b"from another");
            assert_eq!(receive(&*at_b).await.unwrap(), b"from another");
            send(&*at_a, b.host(), b"healed before it would come out");
            control.heal(a.host(), b.host());
            send(&*at_a, b.host(), b"again");
            assert_eq!(receive(&*at_b).await.unwrap(), b"again");
        })
        .unwrap();
    assert_eq!(dropped(&simulation, |link| link.dropped.partitioned.packets), 4);
}

#[test]
fn tcp_goes_on_after_a_partition_by_retransmission() {
    let (_, simulation, [a, b, _]) = star(10_000_000);
    let control = simulation.control();
    let took = simulation.run(async {
        let (mut ours, mut theirs) = dial(&a, &b, TcpOptions::default()).await;
        let begun = a.now();
        let data: Vec<u8> = (0..1_000_000_u32).map(|byte| byte as u8).collect();
        let write = async {
            ours.writer.write_all(&data).await.unwrap();
            ours.writer.shutdown().await.unwrap();
        };
        let cut = async {
            sleep(&a, 200).await;
            control.partition(a.host(), b.host());
            sleep(&a, 3000).await;
            control.heal(a.host(), b.host());
        };
        let mut got = Vec::new();
        let (read, (), ()) = tokio::join!(theirs.reader.read_to_end(&mut got), write, cut);
        read.unwrap();
        assert!(got == data);
        a.now().since(begun)
    });
    // 0.85 s alone. The cut lasts 3 s, and the next retransmission after it comes no more than as much later.
    let took = took.unwrap().as_secs_f64();
    assert!((3.85..7.0).contains(&took), "{took}");
    let again = simulation.sent_by_class(a.host(), b.host())[&Class::Retransmission].packets;
    assert!(again > 3, "{again}");
    assert!(dropped(&simulation, |link| link.dropped.partitioned.packets) > 3);
}

/// The arrivals of ten full packets sent at once, in nanoseconds, where `change` comes after 300 us.
fn arrivals(change: impl FnOnce(&Topology, &Control)) -> Vec<u64> {
    let line = LinkModel::clean(Rate::new(100_000_000), DELAY);
    let topology = Topology::pair(["a", "b"], &line, &line);
    let simulation = Simulation::new(&topology, 1);
    let [a, b] = ["a", "b"].map(|name| simulation.named(name).unwrap());
    let control = simulation.control();
    let arrivals = simulation.run(async {
        let (here, there) = (bind(&a), bind(&b));
        (0..10).for_each(|_| send(&*here, b.host(), &[0; 1472]));
        sleep_until(&a, Instant::from_nanos(300_000)).await;
        change(&topology, &control);
        let mut arrivals = Vec::new();
        for _ in 0..10 {
            receive(&*there).await.unwrap();
            arrivals.push(b.now().as_nanos());
        }
        arrivals
    });
    arrivals.unwrap()
}

#[test]
fn a_link_that_is_set_anew_finishes_the_packet_on_the_line_and_sends_the_next_at_the_new_rate() {
    let nodes = |topology: &Topology| ["a", "b"].map(|name| topology.find_node(name).unwrap());
    let exact = |rates: [u64; 10]| -> Vec<u64> {
        let sums = rates.iter().scan(10_000_000, |at, time| {
            *at += time;
            Some(*at)
        });
        sums.collect()
    };
    let (fast, slow) = (123_040, 1_230_400);
    let slower = LinkModel::clean(Rate::new(10_000_000), DELAY);
    assert_eq!(arrivals(|_, _| ()), exact([fast; 10]));
    let set = |topology: &Topology, control: &Control| {
        let [a, b] = nodes(topology);
        assert_eq!(control.set_link(b, a, slower.clone()), Ok(()), "the other way is another link");
        assert_eq!(control.set_link(a, b, slower.clone()), Ok(()));
        assert_eq!(control.set_link(a, a, slower.clone()), Err(SetLinkError::NoLink));
        let framed = LinkModel { framing: Framing::Bytes(8), ..slower.clone() };
        assert_eq!(control.set_link(a, b, framed), Err(SetLinkError::Framing));
    };
    let expected = exact([fast, fast, fast, slow, slow, slow, slow, slow, slow, slow]);
    assert_eq!(arrivals(set), expected);
    let back = |topology: &Topology, control: &Control| {
        let [a, b] = nodes(topology);
        control.set_link(b, a, slower.clone()).unwrap();
    };
    assert_eq!(arrivals(back), exact([fast; 10]));
}

#[derive(Debug, Clone, Copy)]
enum Fault {
    Crash,
    Restart,
    Partition,
    Heal,
    SetLink(u64),
}

/// `a` sends to `b` and `c` while faults come, each so many milliseconds after the one before. Returns the
/// hash of the trace.
fn under_faults(seed: u64, faults: &[(u64, usize, Fault)]) -> u64 {
    let mut line = LinkModel::clean(Rate::new(2_000_000), DELAY);
    line.queue.packets = 20;
    line.conditions.loss = Loss::Independent(Probability::new(0.05).unwrap());
    let topology = Topology::star(&["a", "b", "c"], &line, &line);
    let simulation = Simulation::new(&topology, seed);
    let nets = ["a", "b", "c"].map(|name| simulation.named(name).unwrap());
    let control = simulation.control();
    for net in &nets {
        let (net, hosts) = (net.clone(), nets.clone().map(|net| net.host()));
        nets[0].spawn(Box::pin(async move {
            for number in 0..200_usize {
                if let Ok(socket) = net.bind_udp("0.0.0.0:0".parse().unwrap(), UdpSocketOptions::default()) {
                    send(&*socket, hosts[number % 3], &[0; 1000]);
                }
                sleep(&net, 3).await;
            }
        }));
    }
    let switch = topology.find_node("switch").unwrap();
    simulation
        .run(async {
            let clock = &nets[0];
            for (pause, host, fault) in faults {
                sleep(clock, *pause).await;
                let [host, next] = [*host, host + 1].map(|number| nets[number % 3].host());
                match fault {
                    Fault::Crash => control.crash(host),
                    Fault::Restart => control.restart(host),
                    Fault::Partition => control.partition(host, next),
                    Fault::Heal => control.heal(next, host),
                    Fault::SetLink(rate) => {
                        let model = LinkModel {
                            conditions: LinkModel::clean(Rate::new(*rate), DELAY).conditions,
                            ..line.clone()
                        };
                        control.set_link(topology.node(host), switch, model).unwrap();
                    }
                }
                let links = simulation.links();
                assert!(links.iter().all(LinkTally::is_balanced), "{links:?}");
            }
            sleep(clock, 60_000).await;
        })
        .unwrap();
    let links = simulation.links();
    assert!(
        links.iter().all(|link| link.is_balanced() && link.queued.packets + link.flying.packets == 0),
        "{links:?}"
    );
    simulation.trace_hash()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn under_any_faults_every_packet_is_accounted_for_and_a_seed_decides_the_run(
        seed: u64,
        faults in prop::collection::vec((0_u64..100, 0_usize..3, prop_oneof![
            Just(Fault::Crash), Just(Fault::Restart), Just(Fault::Partition), Just(Fault::Heal),
            (10_000_u64..10_000_000).prop_map(Fault::SetLink),
        ]), 0..20),
    ) {
        prop_assert_eq!(under_faults(seed, &faults), under_faults(seed, &faults));
    }
}
