//! The effects of a linked peer on a service of pages: attacks on a real one, with an honest display walking
//! beside.

use std::{net::TcpListener, thread, time::Duration};

use trimaran_actors::{FrameStart, Link};
use trimaran_proto::{
    Camera, Demand, DrawableId, FrameNumber, Identity, NumberList, Role, RoleMessage, SessionKey, put_item,
};

use crate::common::guests::{Display, Guests};

/// How many more kilobytes a service may take under an attack: allocators and threads keep some.
const ROOM: u64 = 64_000;

/// The culler's answer to a message about meetings.
async fn answer(display: &mut Display) -> RoleMessage {
    loop {
        match display.link.messages_rx.recv().await {
            Ok(RoleMessage::Stats(_)) => {}
            other => return other.unwrap(),
        }
    }
}

fn camera(frame: u32) -> Camera {
    Camera::new([0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.6, 0.1, FrameNumber(frame)).unwrap()
}

/// Messages about meetings never make the service connect anywhere.
#[test]
fn a_display_sends_the_service_nowhere() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    let victim = TcpListener::bind("127.0.0.1:0").unwrap();
    victim.set_nonblocking(true).unwrap();
    let victims = victim.local_addr().unwrap();
    guests.beside(|guests| {
        let mut display = guests.display(64, 64).unwrap();
        guests.block_on(async {
            for key in (0..200).map(SessionKey) {
                for at in [
                    format!("tcp://{victims}"),
                    format!("ws://{victims}/admin?x=1"),
                    format!("ws://{}/link", guests.at),
                    "unix:/run/docker.sock".to_owned(),
                    "inproc:elsewhere".to_owned(),
                ] {
                    let said = RoleMessage::Meet { key, at: Some(at) };
                    display.link.messages_tx.send(&said).await.unwrap();
                    assert_eq!(answer(&mut display).await, RoleMessage::Unmet { key });
                }
            }
        });
    });
    assert!(victim.accept().is_err(), "the service has connected to it");
    let lines = guests.log().lines().filter(|line| line.contains("meet")).count();
    assert!(lines <= 10, "a line a session: {}", guests.log());
    guests.stops();
}

/// A "culler" brought along by a display sends frame after frame, while the display sends no camera.
#[test]
fn a_culler_of_a_guests_own_piles_nothing_up() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    let mut key = SessionKey(0x5eed);
    guests.beside(|guests| {
        key = SessionKey(key.0 + 1);
        let mut display = guests.display(64, 64).unwrap();
        let outline = display.link.peer.hello.scene.unwrap();
        guests.block_on(async {
            display.link.messages_tx.send(&RoleMessage::Meet { key, at: None }).await.unwrap();
            assert_eq!(answer(&mut display).await, RoleMessage::Waits { key });
        });
        let session = Some((key, display.settings));
        let mut rogue: Link =
            guests.link(Identity { role: Role::Culler, scene: Some(outline), session }).unwrap();
        let before = guests.status("VmRSS");
        guests.block_on(async {
            assert_eq!(answer(&mut display).await, RoleMessage::Met { key });
            let ids: Vec<_> = (0..outline.drawables).map(DrawableId).collect();
            for frame in 0..4_000 {
                let start = FrameStart { frame: FrameNumber(frame), header: camera(frame) };
                rogue.frames_tx.begin(start).await.unwrap();
                rogue.frames_tx.push(&ids).await.unwrap();
                rogue.frames_tx.finish().await.unwrap();
            }
        });
        let after = guests.status("VmRSS");
        assert!(after < before + ROOM, "{before} kB, and {after} kB with 4,000 frames of a guest's own");
    });
    guests.stops();
}

/// A display cannot have anything that the scene lacks.
#[test]
fn what_a_display_says_that_it_has_takes_no_memory() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        let before = guests.status("VmRSS");
        let mut display = guests.display(64, 64).unwrap();
        let outline = display.link.peer.hello.scene.unwrap();
        guests.block_on(async {
            let bulk = display.link.bulk.as_mut().unwrap();
            let mut say = async |drawables: Vec<u32>| {
                let demand =
                    Demand::Holds { drawables: NumberList::of(drawables), geometries: NumberList::default() };
                let mut block = Vec::new();
                assert!(put_item(&mut block, &demand));
                bulk.tx.send(block.into()).await
            };
            // Any number of times, and with the scene's own numbers.
            for _ in 0..500 {
                say((0..outline.drawables.min(3_000)).collect()).await.unwrap();
            }
            let mut first = outline.drawables;
            while say((first..first + 3_000).collect()).await.is_ok() {
                first = first.checked_add(3_000).filter(|first| *first < u32::MAX - 3_000).unwrap();
            }
        });
        let why = guests.block_on(display.hears_the_end());
        assert!(why.contains("not in this scene") || why.contains("lost"), "{why}");
        let after = guests.status("VmRSS");
        assert!(after < before + ROOM, "{before} kB, and {after} kB behind it");
    });
    guests.stops();
}

/// Displays that vanish without a close, with pictures on their way to them: their connections are reset.
#[test]
fn displays_that_vanish_take_nobody_with_them() {
    let Some(mut guests) = Guests::start(&[]) else { return };
    guests.beside(|guests| {
        for round in 0..15 {
            let mut display = guests.display(256, 256).unwrap();
            for frame in 1..7 {
                display.look(frame);
                thread::sleep(Duration::from_millis(10));
            }
            thread::sleep(Duration::from_millis(3 * round));
            drop(display);
        }
    });
    assert!(!guests.log().contains("panicked"), "{}", guests.log());
    guests.stops();
}
