//! TCP in virtual time: Linux's behaviour with lost, late, or too many packets.

use std::io::ErrorKind;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use trimaran_net::{Instant, Net, Stream, TcpOptions, sleep_until};
use trimaran_netsim::link::{Conditions, LinkModel, LinkTally, Loss, Phase, Probability, QueueModel, Rate};
use trimaran_netsim::{Class, HostId, SimNet, Simulation};

use crate::two_hosts;

fn connected(there: &LinkModel, back: &LinkModel) -> (Simulation, [SimNet; 2], [HostId; 2]) {
    let (simulation, hosts) = two_hosts(there, back, 1);
    let nets = hosts.map(|host| simulation.net(host));
    (simulation, nets, hosts)
}

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// A path without a rate: all time is delay.
fn way(delay: Duration) -> LinkModel {
    LinkModel::clean(None, delay)
}

/// The path, but every packet within this time is lost.
fn losing(link: LinkModel, from: Duration, to: Duration) -> LinkModel {
    let certain = Loss::Independent(Probability::one());
    let phase = |at, loss| Phase { at, conditions: Conditions { loss, ..link.conditions } };
    LinkModel { phases: vec![phase(from, certain), phase(to, Loss::None)], ..link }
}

async fn dial(nets: &[SimNet; 2], options: TcpOptions) -> (Stream, Stream) {
    let [here, there] = nets;
    let (mut listener, at) = there.listen_tcp("0.0.0.0:0".parse().unwrap(), options).unwrap();
    let to = here.resolve(&format!("there:{}", at.port())).await.unwrap()[0];
    let (ours, theirs) = tokio::join!(here.connect_tcp(to, options), listener.accept());
    (ours.unwrap(), theirs.unwrap())
}

/// Sends `bytes` from one to the other after `pause`, and returns how long it took from then on.
async fn carry(nets: &[SimNet; 2], options: TcpOptions, bytes: usize, pause: Duration) -> Duration {
    let (mut ours, mut theirs) = dial(nets, options).await;
    let clock = &nets[0];
    let write = async {
        ours.writer.write_all(&vec![7; bytes]).await.unwrap();
        ours.writer.shutdown().await.unwrap();
    };
    let read = async {
        sleep_until(clock, clock.now().after(pause)).await;
        let start = clock.now();
        let mut got = Vec::new();
        theirs.reader.read_to_end(&mut got).await.unwrap();
        assert!(got.len() == bytes && got.iter().all(|b| *b == 7));
        clock.now().since(start)
    };
    tokio::join!(write, read).1
}

/// Options without timers that are not tested.
fn plain() -> TcpOptions {
    TcpOptions::default().with_keepalive(None).with_user_timeout(None)
}

const FULL: usize = 1448;

/// Sends `first` bytes, and at one second exactly, when all is quiet, `second`. Returns when the last of it
/// was read, counted from then.
fn delivery(
    there: &LinkModel,
    back: &LinkModel,
    first: usize,
    second: usize,
) -> (Duration, Simulation, [HostId; 2]) {
    let (simulation, nets, hosts) = connected(there, back);
    let took = simulation
        .run(async {
            let (mut ours, mut theirs) = dial(&nets, plain()).await;
            let clock = nets[0].clone();
            let start = clock.now().after(Duration::from_secs(10));
            let start = Instant::from_nanos(start.as_nanos() / 1_000_000_000 * 1_000_000_000);
            let write = async {
                ours.writer.write_all(&vec![1; first]).await.unwrap();
                sleep_until(&clock, start).await;
                ours.writer.write_all(&vec![2; second]).await.unwrap();
            };
            let read = async {
                let mut got = vec![0; first + second];
                theirs.reader.read_exact(&mut got).await.unwrap();
                assert!(got[..first].iter().all(|b| *b == 1) && got[first..].iter().all(|b| *b == 2));
                clock.now().since(start)
            };
            tokio::join!(write, read).1
        })
        .unwrap();
    (took, simulation, hosts)
}

#[test]
fn a_connection_takes_a_round_trip_and_a_refusal_as_well() {
    let (simulation, nets, hosts) = connected(&way(ms(5)), &way(ms(5)));
    simulation.run(dial(&nets, plain())).unwrap();
    assert_eq!(simulation.now().as_nanos(), 15_000_000, "the listener has it half a round trip later");
    let sent = &simulation.sent_by_class(hosts[0], hosts[1])[&Class::Handshake];
    assert_eq!(
        (sent.packets, sent.transport_headers),
        (1, 40),
        "maximum segment size, SACK, timestamps, scale"
    );

    let closed = SocketAddr::new(hosts[1].v4(), 9);
    let refused = simulation.run(nets[0].connect_tcp(closed, plain())).unwrap().unwrap_err();
    assert_eq!((refused.kind(), simulation.now().as_nanos()), (ErrorKind::ConnectionRefused, 25_000_000));
}

#[test]
fn the_first_segment_is_repeated_after_a_second() {
    let (simulation, nets, _) = connected(&losing(way(ms(5)), ms(0), ms(1)), &way(ms(5)));
    simulation.run(dial(&nets, plain())).unwrap();
    assert_eq!(simulation.now().as_nanos(), 1_015_000_000);
}

#[test]
fn a_lost_packet_that_is_alone_waits_200_ms_and_a_round_trip() {
    let lossy = losing(way(ms(5)), ms(10_000), ms(10_001));
    let (took, ..) = delivery(&lossy, &way(ms(5)), 100, 100);
    assert_eq!(took, ms(10 + 200 + 5));
}

/// How many packets the first host sent again.
fn repeated(simulation: &Simulation, [here, there]: [HostId; 2]) -> u64 {
    simulation.sent_by_class(here, there).get(&Class::Retransmission).map_or(0, |sent| sent.packets)
}

/// Sends ten packets in a millisecond, a tenth each, and loses those in this range of tenths.
fn ten_packets(lost: std::ops::Range<u64>) -> (Duration, u64) {
    // 1538 bytes in a tenth of a millisecond.
    let link = LinkModel::clean(Rate::new(1538 * 8 * 10_000), ms(5));
    let at = |tenths: u64| ms(10_000) + Duration::from_micros(100 * tenths);
    let (took, simulation, hosts) =
        delivery(&losing(link.clone(), at(lost.start), at(lost.end)), &link, 2 * FULL, 10 * FULL);
    let again = repeated(&simulation, hosts);
    (took, again)
}

#[test]
fn a_loss_within_a_burst_is_repeated_as_soon_as_three_later_packets_are_acknowledged() {
    assert_eq!(ten_packets(0..0), (ms(6), 0));
    let (took, again) = ten_packets(3..4);
    // The seventh packet's acknowledgement leaves at 0.7 + 5 ms and is there 5 ms and a short packet later;
    // the retransmission comes 5.1 ms after that.
    let expected = 700 + 5000 + 5000 + 100 + 5000;
    assert_eq!(again, 1);
    assert!((took.as_micros() as i64 - expected).abs() < 50, "{took:?} {expected}");
}

#[test]
fn a_lost_end_of_a_burst_is_probed_for_after_two_round_trips_and_a_last_packet_later() {
    let (took, again) = ten_packets(8..10);
    assert_eq!(again, 2);
    // The eighth packet's acknowledgement comes after 10.9 ms; the round trips before took a little more than
    // 10. The probe brings a packet, and its acknowledgement the other one.
    let expected = 10.9 + 2.0 * 10.5 + 2.0 + 15.0 + 0.2;
    assert!((took.as_secs_f64() * 1e3 - expected).abs() < 1.0, "{took:?} {expected}");
    // The acknowledgement of one packet may be delayed: the probe waits for that as well.
    let (took, again) = ten_packets(9..10);
    assert_eq!(again, 1);
    assert!(took > ms(11 + 10 + 200 + 5) && took < ms(11 + 10 + 200 + 5 + 3), "{took:?}");
}

#[test]
fn a_burst_that_is_lost_altogether_is_probed_for_and_repeated() {
    let (took, again) = ten_packets(0..10);
    assert!((10..=11).contains(&again), "{again}");
    // The probe is the last packet; its acknowledgement shows that all before are lost.
    assert!(took > ms(30) && took < ms(80), "{took:?}");
}

#[test]
fn a_way_that_is_dead_for_seconds_is_tried_at_doubling_times() {
    let lossy = losing(way(ms(5)), ms(10_000), ms(13_000));
    let (took, ..) = delivery(&lossy, &way(ms(5)), 100, 100);
    // Probe at 210 ms, then 210, 420, 840, 1680 ms after each other: 210, 420, 840, 1680, 3360.
    assert_eq!(took, ms(3360 + 5));
}

/// Linux 6.18's times in these cases over a path of 26 ms, in milliseconds: medians of runs of
/// `linux_tcp.py`, which is beside this test. It measured round trips of 52 to 55 ms. The kernel's timers
/// wait for a clock tick, and beyond 256 ms for eight of them: it is late by that where a timer ends the
/// wait.
#[test]
fn the_same_losses_cost_what_they_cost_in_linux() {
    let tenth = |tenths: u64| ms(10_000) + Duration::from_micros(100 * tenths);
    for (case, bytes, lost, linux) in [
        ("nothing", 10 * FULL, tenth(0)..tenth(0), 25.8),
        ("a lone packet", 100, tenth(0)..tenth(1), 298.6),
        ("the fourth of ten", 10 * FULL, tenth(3)..tenth(4), 76.1),
        ("the last two of ten", 10 * FULL, tenth(8)..tenth(10), 241.5),
        ("the last of ten", 10 * FULL, tenth(9)..tenth(10), 351.2),
        ("all of ten", 10 * FULL, tenth(0)..tenth(10), 344.6),
        ("a way dead for 3 s", 100, tenth(0)..ms(13_000), 4284.2),
    ] {
        let link = LinkModel::clean(Rate::new(1538 * 8 * 10_000), ms(26));
        let (took, ..) = delivery(&losing(link.clone(), lost.start, lost.end), &link, 4 * FULL, bytes);
        println!("{case}: {took:?}, and {linux} ms in Linux");
        let off = took.as_secs_f64() * 1e3 / linux - 1.0;
        assert!(off.abs() < 0.08, "{case}: {took:?}, and {linux} ms in Linux");
    }
}

/// Sends `bytes` as fast as possible; returns bytes a second.
fn throughput(link: &LinkModel, bytes: usize) -> (f64, Simulation, [HostId; 2]) {
    let (simulation, nets, hosts) = connected(link, &way(link.conditions.delay));
    let took = simulation.run(carry(&nets, plain(), bytes, Duration::ZERO)).unwrap();
    assert!(simulation.links().iter().all(LinkTally::is_balanced));
    (bytes as f64 / took.as_secs_f64(), simulation, hosts)
}

#[test]
fn a_long_transfer_fills_the_way() {
    for (megabits, delay, bytes) in [(100, 1, 20_000_000), (1000, 1, 100_000_000), (100, 10, 60_000_000)] {
        let rate = Rate::new(megabits * 1_000_000);
        let link = LinkModel { queue: QueueModel::default(), ..LinkModel::clean(rate, ms(delay)) };
        let (speed, ..) = throughput(&link, bytes);
        let best = megabits as f64 * 1e6 / 8.0 * FULL as f64 / 1538.0;
        assert!(speed > 0.9 * best && speed <= best, "{megabits} Mbit/s, {delay} ms: {speed} of {best}");
    }
}

#[test]
fn a_receive_buffer_that_is_fixed_limits_to_its_size_a_round_trip() {
    let (simulation, nets, _) = connected(&way(ms(10)), &way(ms(10)));
    let options = plain().with_recv_buffer(Some(100_000));
    let took = simulation.run(carry(&nets, options, 5_000_000, Duration::ZERO)).unwrap();
    let window = 5e6 / (took.as_secs_f64() / 0.02);
    assert!((85_000.0..=100_000.0).contains(&window), "{window}");
}

#[test]
fn random_loss_slows_it_down_as_the_response_function_of_reno_says() {
    // 1 % at 20 ms: at such small windows CUBIC is at least as fast as Reno (RFC 9438, section 4.3), that is
    // sqrt(3/2)/sqrt(p) packets a round trip.
    let mut link = LinkModel::clean(Rate::new(1_000_000_000), ms(10));
    link.conditions.loss = Loss::Independent(Probability::new(0.01).unwrap());
    let (speed, simulation, hosts) = throughput(&link, 20_000_000);
    let window = speed * 0.02 / FULL as f64;
    assert!((9.0..20.0).contains(&window), "{window} packets a round trip");
    let (again, lost) = (repeated(&simulation, hosts), simulation.links()[0].dropped.lost.packets);
    assert!(again >= lost && again < lost + lost / 10 + 3, "{again} repetitions for {lost} losses");
}

#[test]
fn a_receiver_that_reads_nothing_closes_the_window_and_opens_it_again() {
    let (simulation, nets, hosts) = connected(&way(ms(5)), &way(ms(5)));
    let options = plain().with_recv_buffer(Some(50_000));
    let waited = simulation.run(carry(&nets, options, 200_000, Duration::from_secs(7))).unwrap();
    assert!(waited < ms(100), "{waited:?}");
    let probes = simulation.sent_by_class(hosts[0], hosts[1])[&Class::Probe].packets;
    assert!((3..=6).contains(&probes), "{probes}: at 210 ms, and each time twice as long");
}

#[test]
fn packets_that_overtake_each_other_are_not_taken_for_lost_for_long() {
    let mut link = LinkModel::clean(Rate::new(50_000_000), ms(10));
    let share = Probability::new(0.01).unwrap();
    link.conditions.reorder = Some(trimaran_netsim::link::Reorder { share, by: ms(3) });
    let (speed, simulation, hosts) = throughput(&link, 20_000_000);
    let again = repeated(&simulation, hosts);
    let packets = simulation.links()[0].offered.packets;
    assert!(again * 200 < packets, "{again} repetitions in {packets} packets");
    assert!(speed > 0.7 * 50e6 / 8.0, "{speed}");
}
