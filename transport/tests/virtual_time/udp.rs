//! The project's own connection over datagrams in virtual time: the conformance suite, and the same run each
//! time.

use std::time::Duration;

use trimaran_netsim::Simulation;
use trimaran_netsim::link::{Conditions, LinkModel, Loss, Phase, Probability, Rate};
use trimaran_transport::conformance::{Overhead, Pairs, Robot, command, finished, points, pose, send_frame};
use trimaran_transport::udp::{Repair, Trust, UdpOptions};
use trimaran_transport::{
    FrameEvent, FrameOutcome, LinkConfig, MessageReceiver, MessageSender, Options, RecvError, UdpMode,
    UdpSocketOptions, sleep_until,
};

use crate::hosts::Machines;
use crate::hosts::priorities::{beside_blocks, blocks_alone, narrow};

fn machines(link: &LinkModel, seed: u64) -> (Simulation, Machines) {
    machines_between(link, link, seed, UdpOptions::default())
}

fn machines_between(way: &LinkModel, back: &LinkModel, seed: u64, udp: UdpOptions) -> (Simulation, Machines) {
    let overhead = Overhead { header_bytes: 0, handshake: 1, coded: true };
    let udp = udp.with_trust(Trust::SharedKey([9; 32].into()));
    let options = Options::default().with_udp(udp);
    Machines::joined([way, back], seed, "udp", overhead, [options.clone(), options])
}

connection_in_virtual_time!(machines);

/// An endless sender of blocks keeps few packets in flight. A frame and a message come as soon as on an empty
/// line, except for packets too few to show in the round trips.
#[test]
fn a_frame_and_a_message_come_beside_blocks_as_soon_as_without() {
    let longest = |blocks| {
        let (simulation, machines) = machines(&narrow(), 1);
        simulation.run(beside_blocks(&machines, blocks)).unwrap()
    };
    let (alone, beside) = (longest(0), longest(40));
    for (alone, beside) in alone.into_iter().zip(beside) {
        // A packet takes 1 ms over this line.
        assert!(beside < alone + Duration::from_millis(4), "{beside:?} beside blocks, {alone:?} alone");
    }
}

/// The few blocks in flight still use most of the line, which takes 524 ms for these.
#[test]
fn blocks_alone_have_most_of_a_line() {
    let (simulation, machines) = machines(&narrow(), 1);
    let took = simulation.run(blocks_alone(&machines)).unwrap();
    assert!(took < Duration::from_millis(700), "{took:?}");
}

/// A closing half sends pending data whenever it is polled. That must not wake a driver that waits for room
/// in its socket: the two would wake each other for ever, and no time would pass.
#[test]
fn links_close_while_their_sockets_are_full() {
    let socket = UdpSocketOptions::default().with_send_buffer(Some(2048));
    let options = UdpOptions::default().with_socket(socket);
    let (simulation, machines) = machines_between(&narrow(), &narrow(), 1, options);
    let talk = async {
        let (mut arm, mut panel) = machines.pair(LinkConfig::default()).await;
        let points: Vec<_> = (0..50_000).collect();
        send_frame(&mut arm.frames_tx, 0, &points).await.unwrap();
        send_frame(&mut panel.frames_tx, 0, &points).await.unwrap();
        let (one, other) = tokio::join!(arm.close(finished()), panel.close(finished()));
        assert!(one.is_ok() && other.is_ok(), "{one:?} {other:?}");
    };
    simulation.run(talk).unwrap();
}

/// On a lossy path with time for one retransmission frames arrive whole or with gaps, but never wrong.
#[test]
fn with_deadlines_a_lost_frame_spoils_no_later_one() {
    let mut way = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(3));
    way.conditions.loss = Loss::Independent(Probability::new(0.15).unwrap());
    let deadline = Duration::from_millis(14);
    let options =
        UdpOptions::default().with_mode(UdpMode::Deadline).with_deadline(deadline).with_repair(Repair::Off);
    let (simulation, machines) = machines_between(&way, &way, 1, options);
    let visible = |frame: u32| -> Vec<u32> {
        (0..4000).filter(|point| !(point + 3 * frame).is_multiple_of(100)).map(|point| 500 * point).collect()
    };
    let talk = async {
        let mut link = LinkConfig::default();
        link.batching.coded = true;
        let (mut arm, mut panel) = machines.pair(link).await;
        let (mut whole, mut gaps, mut bytes) = (0, 0, u64::MAX);
        for frame in 0..500 {
            // Until the outcome of the last frame is known.
            sleep_until(&*machines.net(), machines.net().now().after(deadline)).await;
            let before = arm.stats.read();
            send_frame(&mut arm.frames_tx, frame, &visible(frame)).await.unwrap();
            bytes = bytes.min((arm.stats.read() - before).sent.batches.bytes);
            let (mut points, sent) = (Vec::new(), visible(frame));
            loop {
                match panel.frames_rx.recv().await.unwrap() {
                    FrameEvent::Batch(batch) => points.extend(batch.iter()),
                    FrameEvent::End(FrameOutcome::Complete(_)) => {
                        assert_eq!(points, sent);
                        whole += 1;
                        break;
                    }
                    FrameEvent::End(FrameOutcome::Incomplete { .. }) => {
                        assert!(
                            points.iter().all(|point| sent.binary_search(point).is_ok()),
                            "frame {frame}"
                        );
                        gaps += 1;
                        break;
                    }
                    FrameEvent::Begin(_) => {}
                }
            }
        }
        (whole, gaps, bytes)
    };
    let (whole, gaps, bytes) = simulation.run(talk).unwrap();
    // Some travelled coded.
    assert!(whole >= 20 && gaps >= 20 && bytes < 2000, "{whole} whole, {gaps} with gaps, {bytes} bytes");
}

/// Where most frames are given up, every message arrives once, in order, both ways.
#[test]
fn with_deadlines_and_heavy_loss_every_message_arrives() {
    const COUNT: u32 = 200;
    let mut way = LinkModel::clean(Rate::new(100_000_000), Duration::from_millis(3));
    way.conditions.loss = Loss::Independent(Probability::new(0.3).unwrap());
    let options = UdpOptions::default()
        .with_mode(UdpMode::Deadline)
        .with_deadline(Duration::from_millis(14))
        .with_repair(Repair::Off);
    let (simulation, machines) = machines_between(&way, &way, 1, options);
    let talk = async {
        let (arm, panel) = machines.pair(LinkConfig::default()).await;
        let (mut frames_tx, mut frames_rx) = (arm.frames_tx, panel.frames_rx);
        let say = async |mut tx: MessageSender<Robot>| {
            for number in 0..COUNT {
                tx.send(&command(number)).await.unwrap();
                sleep_until(&*machines.net(), machines.net().now().after(Duration::from_millis(5))).await;
            }
            tx
        };
        let hear = async |mut rx: MessageReceiver<Robot>| {
            for number in 0..COUNT {
                assert_eq!(rx.recv().await.unwrap(), command(number));
            }
            rx
        };
        let frames = async {
            for frame in 0.. {
                send_frame(&mut frames_tx, frame, &points(1000)).await.unwrap();
                sleep_until(&*machines.net(), machines.net().now().after(Duration::from_millis(16))).await;
            }
        };
        let mut gaps = 0;
        let read = async {
            loop {
                if let FrameEvent::End(FrameOutcome::Incomplete { .. }) = frames_rx.recv().await.unwrap() {
                    gaps += 1;
                }
            }
        };
        let messages = async {
            tokio::join!(
                say(arm.messages_tx),
                hear(arm.messages_rx),
                say(panel.messages_tx),
                hear(panel.messages_rx)
            )
        };
        tokio::select! {
            biased;
            _ends = messages => {}
            () = frames => {}
            () = read => {}
        }
        gaps
    };
    let gaps = simulation.run(talk).unwrap();
    assert!(gaps > 10, "only {gaps} frames with gaps");
}

/// A network cut one way only is no fault of the peer: it may connect again.
#[test]
fn a_peer_that_hears_nothing_any_more_is_lost_though_it_can_be_heard() {
    let way = LinkModel::clean(None, Duration::from_millis(1));
    let cut = Duration::from_secs(1);
    let conditions = Conditions { loss: Loss::Independent(Probability::one()), ..way.conditions };
    let until_then = LinkModel { phases: vec![Phase { at: cut, conditions }], ..way.clone() };
    let (simulation, machines) = machines_between(&until_then, &way, 1, UdpOptions::default());
    let talk = async {
        let net = machines.net();
        let (mut here, mut there) = machines.pair(LinkConfig::default()).await;
        sleep_until(&*net, net.now().after(cut)).await;
        here.latest_tx.publish(pose(0)).unwrap();
        let mut frame = 0;
        let goes_on = async {
            loop {
                frame += 1;
                if there.latest_tx.publish(pose(frame)).is_err() {
                    std::future::pending::<()>().await;
                }
                sleep_until(&*net, net.now().after(Duration::from_millis(100))).await;
            }
        };
        tokio::select! {
            end = here.frames_rx.recv() => end.unwrap_err(),
            () = goes_on => unreachable!("it never ends"),
        }
    };
    let end = simulation.run(talk).unwrap();
    assert!(matches!(end, RecvError::Lost { .. }), "{end:?}");
    assert!(simulation.now().as_nanos() < 22_000_000_000, "{}", simulation.now().as_nanos());
}
