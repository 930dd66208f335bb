//! Virtual time seen by programs: exact to the nanosecond, and the same in every run and every build.

use std::future::poll_fn;
use std::io::IoSliceMut;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use trimaran_net::{Instant, Net, RecvMeta, Transmit, UdpSocket, UdpSocketOptions, sleep_until, until};
use trimaran_netsim::link::{
    Distribution, GilbertElliott, Jitter, LinkModel, LinkTally, Loss, Probability, Rate,
};
use trimaran_netsim::{Class, HostId, SimNet, Simulation, Stalled, Topology};

use crate::two_hosts;

fn pair(link: &LinkModel, seed: u64) -> (Simulation, [HostId; 2]) {
    two_hosts(link, link, seed)
}

fn bind(net: &SimNet) -> Arc<dyn UdpSocket> {
    net.bind_udp("0.0.0.0:700".parse().unwrap(), UdpSocketOptions::default()).unwrap()
}

fn send(socket: &dyn UdpSocket, destination: SocketAddr, contents: &[u8]) {
    socket
        .try_send(&Transmit { destination, ecn: None, contents, segment_size: None, src_ip: None })
        .unwrap();
}

async fn receive(socket: &dyn UdpSocket) -> (SocketAddr, Vec<u8>) {
    let mut buffer = vec![0; 2000];
    let mut meta = [RecvMeta::default()];
    let filled = poll_fn(|cx| socket.poll_recv(cx, &mut [IoSliceMut::new(&mut buffer)], &mut meta)).await;
    assert_eq!(filled.unwrap(), 1);
    buffer.truncate(meta[0].len);
    (meta[0].addr, buffer)
}

/// Echoes all datagrams.
async fn echo(socket: Arc<dyn UdpSocket>) {
    loop {
        let (from, data) = receive(&*socket).await;
        send(&*socket, from, &data);
    }
}

/// Sends `count` datagrams to an echo, one each `every`; returns the number and time of each that came back.
fn pings(simulation: &Simulation, hosts: [HostId; 2], count: u64, every: Duration) -> Vec<(u64, u64)> {
    let [near, far] = hosts.map(|host| simulation.net(host));
    far.spawn(Box::pin(echo(bind(&far))));
    let (socket, got) = (bind(&near), Arc::new(Mutex::new(Vec::new())));
    let (reader, log, clock) = (Arc::clone(&socket), Arc::clone(&got), near.clone());
    near.spawn(Box::pin(async move {
        loop {
            let (_, data) = receive(&*reader).await;
            log.lock()
                .unwrap()
                .push((u64::from_le_bytes(data[..8].try_into().unwrap()), clock.now().as_nanos()));
        }
    }));
    let to = SocketAddr::new(hosts[1].v4(), 700);
    simulation
        .run(async {
            for number in 0..count {
                send(&*socket, to, &number.to_le_bytes());
                sleep_until(&near, near.now().after(every)).await;
            }
            sleep_until(&near, near.now().after(Duration::from_secs(10))).await;
        })
        .unwrap();
    got.lock().unwrap().clone()
}

#[test]
fn five_microseconds_one_way_are_ten_thousand_nanoseconds_there_and_back() {
    let (simulation, hosts) = pair(&LinkModel::clean(None, Duration::from_micros(5)), 1);
    assert_eq!(pings(&simulation, hosts, 1, Duration::ZERO), [(0, 10_000)]);
}

#[test]
fn a_switch_stores_and_forwards() {
    let link = LinkModel::clean(Rate::new(100_000_000), Duration::from_nanos(500));
    let topology = Topology::star(&["a", "b", "c"], &link, &link);
    let simulation = Simulation::new(&topology, 1);
    let hosts = [topology.find("a").unwrap(), topology.find("c").unwrap()];
    // 8 bytes of payload make the shortest frame: 84 bytes on the line, four times.
    assert_eq!(pings(&simulation, hosts, 1, Duration::ZERO), [(0, 4 * (84 * 8 * 10 + 500))]);
    let sent = simulation.sent_by_class(hosts[0], hosts[1])[&Class::SmallDatagram];
    assert_eq!((sent.packets, sent.payload, sent.transport_headers, sent.ip_headers), (1, 8, 8, 20));
    assert_eq!((sent.link_layer, sent.bytes()), (28, 64));
}

/// A link with every impairment.
fn rough() -> LinkModel {
    let share = |value| Probability::new(value).unwrap();
    let mut link = LinkModel::clean(Rate::new(7_000_000), Duration::from_micros(3700));
    link.conditions.jitter = Some(Jitter {
        deviation: Duration::from_millis(2),
        distribution: Distribution::Pareto,
        correlation: share(0.3),
        reorders: true,
    });
    link.conditions.loss = Loss::GilbertElliott(GilbertElliott {
        to_bad: share(0.02),
        to_good: share(0.3),
        lost_in_bad: share(0.8),
        lost_in_good: share(0.001),
    });
    link.conditions.duplicate = share(0.01);
    link.conditions.corrupt = share(0.01);
    link
}

#[test]
fn a_seed_gives_the_same_trace_in_every_build() {
    let run = |seed| {
        let (simulation, hosts) = pair(&rough(), seed);
        let got = pings(&simulation, hosts, 2000, Duration::from_micros(900));
        assert!(simulation.links().iter().all(LinkTally::is_balanced));
        (simulation.trace_hash(), got.len())
    };
    assert_eq!(run(42), run(42));
    assert_ne!(run(42).0, run(43).0);
    // Debug and release builds alike.
    assert_eq!(run(42), (674_502_133_913_459_974, 1778));
}

#[test]
fn timers_ring_at_their_nanosecond_whatever_they_were_set_to_before() {
    let (simulation, hosts) = pair(&LinkModel::clean(None, Duration::ZERO), 1);
    let net = simulation.net(hosts[0]);
    simulation
        .run(async {
            let mut timer = net.timer();
            for (first, second) in [(100, 7), (7, 100), (50, 50)] {
                let start = net.now();
                let at = |nanos| start.after(Duration::from_nanos(nanos));
                timer.reset(at(first));
                timer.reset(at(second));
                poll_fn(|cx| timer.poll(cx)).await;
                assert_eq!(net.now(), at(second));
                timer.reset(start);
                poll_fn(|cx| timer.poll(cx)).await;
                assert_eq!(net.now(), at(second), "the past is now");
            }
            let soon = net.now().after(Duration::from_nanos(1));
            assert_eq!(until(&net, soon, std::future::pending::<()>()).await, None);
            assert_eq!(net.now(), soon);
        })
        .unwrap();
}

#[test]
fn waiting_for_nothing_is_an_error_with_its_time() {
    let (simulation, hosts) = pair(&LinkModel::clean(None, Duration::ZERO), 1);
    let net = simulation.net(hosts[0]);
    let stalled = simulation.run(async {
        sleep_until(&net, Instant::from_nanos(77)).await;
        std::future::pending::<()>().await;
    });
    assert_eq!(stalled, Err(Stalled { at: Instant::from_nanos(77) }));
}

#[test]
fn ports_are_taken_once_and_free_again() {
    let (simulation, hosts) = pair(&LinkModel::clean(None, Duration::ZERO), 1);
    let net = simulation.net(hosts[0]);
    let bind =
        |at: &str| net.bind_udp(at.parse().unwrap(), UdpSocketOptions::default()).map_err(|e| e.kind());
    let first = bind("10.0.0.1:9").unwrap();
    assert_eq!(bind("0.0.0.0:9").unwrap_err(), std::io::ErrorKind::AddrInUse);
    assert_eq!(bind("10.0.0.2:9").unwrap_err(), std::io::ErrorKind::AddrNotAvailable, "the other host's");
    assert_ne!(bind("10.0.0.1:0").unwrap().local_addr().unwrap().port(), 0);
    drop(first);
    bind("0.0.0.0:9").unwrap();
}

#[test]
fn a_socket_takes_no_more_than_its_send_buffer_until_packets_have_left() {
    let (simulation, hosts) = pair(&LinkModel::clean(Rate::new(1_000_000), Duration::ZERO), 1);
    let net = simulation.net(hosts[0]);
    let options = UdpSocketOptions::default().with_send_buffer(Some(10_000));
    let socket = net.bind_udp("0.0.0.0:0".parse().unwrap(), options).unwrap();
    let destination = SocketAddr::new(hosts[1].v4(), 9);
    let contents = &[0; 1000];
    let transmit = Transmit { destination, ecn: None, contents, segment_size: None, src_ip: None };
    let mut sent = 0;
    while socket.try_send(&transmit).is_ok() {
        sent += 1;
    }
    // Linux charges 2304 bytes each and allows twice the requested size.
    assert_eq!(sent, 20_000_usize.div_ceil(2304));
    simulation
        .run(async {
            let mut poller = Arc::clone(&socket).poller();
            poll_fn(|cx| poller.as_mut().poll_writable(cx)).await.unwrap();
        })
        .unwrap();
    assert_eq!(simulation.now().as_nanos(), (1000 + 28 + 38) * 8 * 1000);
    assert!(socket.try_send(&transmit).is_ok());
}

#[test]
fn timers_with_a_grain_ring_when_a_runtime_that_sleeps_whole_ticks_wakes() {
    let (simulation, hosts) = pair(&LinkModel::clean(None, Duration::ZERO), 1);
    let [exact, other] = hosts.map(|host| simulation.net(host));
    let coarse = exact.clone().with_timer_grain(Duration::from_millis(1));
    let rang = |net: &SimNet, at: u64| {
        let rang = async move {
            sleep_until(net, Instant::from_nanos(at)).await;
            net.now().as_nanos()
        };
        simulation.run(rang).unwrap()
    };
    assert_eq!(rang(&coarse, 300_000), 1_000_000, "it went to sleep on a tick");
    assert_eq!(rang(&coarse, 2_000_000), 2_000_000, "a multiple is its own");
    assert_eq!(rang(&exact, 2_234_567), 2_234_567);
    assert_eq!(rang(&coarse, 2_300_000), 3_234_567, "a tick after it went to sleep");
    assert_eq!(rang(&coarse, 4_234_568), 5_234_567, "and two more");
    assert_eq!(rang(&other, 5_500_000), 5_500_000, "another host's wake-ups are its own");
    assert_eq!(rang(&coarse, 5_900_000), 6_234_567);
    // It looks at its timers, no matter what wakes it.
    let (woken, late) = simulation
        .run(async {
            tokio::join!(sleep_until(&exact, Instant::from_nanos(7_100_000)), async {
                sleep_until(&coarse, Instant::from_nanos(6_300_000)).await;
                coarse.now().as_nanos()
            })
        })
        .unwrap();
    assert_eq!((woken, late), ((), 7_100_000));
    assert_eq!(rang(&coarse, 7_200_000), 8_100_000);
}

#[test]
fn a_simulation_in_step_with_a_clock_lets_nothing_happen_early_and_hears_other_threads() {
    let delay = Duration::from_millis(30);
    let (simulation, hosts) = pair(&LinkModel::clean(None, delay), 1);
    let [near, far] = hosts.map(|host| simulation.net(host));
    far.spawn(Box::pin(echo(bind(&far))));
    let socket = bind(&near);
    let to = SocketAddr::new(hosts[1].v4(), 700);
    let (said, mut heard) = tokio::sync::mpsc::unbounded_channel::<u8>();
    let speaker = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(20));
        said.send(7).unwrap();
    });
    #[expect(clippy::disallowed_methods, reason = "the clock that the simulation keeps step with")]
    let begun = std::time::Instant::now();
    let clock = || Instant::from_nanos(u64::try_from(begun.elapsed().as_nanos()).unwrap());
    let (spoken, back) = simulation.run_in_step(clock, async {
        let byte = heard.recv().await.unwrap();
        let spoken = near.now();
        send(&*socket, to, &[byte]);
        let (_, echoed) = receive(&*socket).await;
        assert_eq!(echoed, [7]);
        (spoken, near.now())
    });
    speaker.join().unwrap();
    assert!(spoken.as_nanos() >= 20_000_000, "{spoken:?}");
    assert_eq!(back.since(spoken), 2 * delay, "the links take exactly their time");
    assert!(begun.elapsed() >= Duration::from_millis(80));
}
