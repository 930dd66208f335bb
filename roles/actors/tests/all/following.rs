//! Displays that follow another one get exactly its frames, and nothing is culled for them.

use std::{collections::BTreeSet, thread};

use trimaran_actors::{FrameEvent, Link, NewSession, Sharing, Stop, Stopper};
use trimaran_proto::{
    Camera, Demand, DrawableId, FrameNumber, LeaderKey, RoleMessage, Supply, ViewReader, ViewState,
    ViewVersion, items, put_item,
};

use crate::common::{Broken, Device, Fault, Task};
use crate::sessions::{SIDE, Service, camera};

const LEADER: LeaderKey = LeaderKey(7);

/// A device that fails as soon as something is culled.
fn broken() -> Device {
    Device::failing(Task::Begin, 0, Fault::Fails(Broken::NoMemory))
}

/// Sessions of one service; the first one has the first device.
fn with_sessions(
    service: &Service,
    devices: impl IntoIterator<Item = Device>,
    supplies: bool,
    walk: impl AsyncFnOnce(&Sharing, Vec<Link>),
) {
    let sharing = Sharing::default();
    let (stopper, stop) = Stop::new();
    thread::scope(|scope| {
        let mut links = Vec::new();
        for device in devices {
            let (session, far) = service.session(SIDE);
            let session = NewSession { sharing: sharing.clone(), ..session };
            links.push(far);
            let (stop, scene) = (stop.clone(), supplies.then_some(&service.scene));
            scope.spawn(move || service.supply(session, device, scene, &stop));
        }
        service.completes(walk(&sharing, links));
        Stopper::stop(&stopper);
    });
}

async fn say(link: &mut Link, message: RoleMessage) {
    link.messages_tx.send(&message).await.unwrap();
}

/// The next message that is no statistics.
async fn hears(link: &mut Link) -> RoleMessage {
    loop {
        match link.messages_rx.recv().await.unwrap() {
            RoleMessage::Stats(_) => {}
            message => return message,
        }
    }
}

/// The view state that the link's next messages tell of.
async fn view(link: &mut Link) -> (ViewVersion, ViewState) {
    let mut reader = ViewReader::default();
    loop {
        let RoleMessage::View { version, part, last } = hears(link).await else { panic!("no view state") };
        if let Some(state) = reader.take(version, &part, last).unwrap() {
            return (version, state);
        }
    }
}

/// The next frame.
async fn frame(link: &mut Link) -> (FrameNumber, Camera, Vec<DrawableId>) {
    let FrameEvent::Begin(start) = link.frames_rx.recv().await.unwrap() else { panic!("no beginning") };
    let mut ids = Vec::new();
    loop {
        match link.frames_rx.recv().await.unwrap() {
            FrameEvent::Batch(batch) => ids.extend(batch.iter()),
            FrameEvent::End(_) => return (start.frame, start.header, ids),
            FrameEvent::Begin(start) => panic!("{start:?}"),
        }
    }
}

async fn asks(link: &mut Link, camera: Camera) -> Vec<DrawableId> {
    link.latest_tx.publish(camera).unwrap();
    let (_, header, ids) = frame(link).await;
    assert_eq!(header, camera);
    let RoleMessage::Stats(stats) = link.messages_rx.recv().await.unwrap() else { panic!("no statistics") };
    assert_eq!(stats.frame, camera.frame());
    ids
}

async fn follows(link: &mut Link, first: u32) {
    say(link, RoleMessage::Follow { leader: LEADER }).await;
    assert_eq!(hears(link).await, RoleMessage::Followed { leader: LEADER, first: FrameNumber(first) });
}

#[test]
fn followers_get_the_leaders_frames_and_nothing_is_culled_for_them() {
    let service = Service::of(100);
    let devices = [Device::default(), broken(), broken(), broken()];
    with_sessions(&service, devices, false, async |_, links| {
        let [mut leader, mut one, mut two, mut late] = <[Link; 4]>::try_from(links).unwrap();
        say(&mut leader, RoleMessage::Lead { leader: LEADER }).await;
        let ids = asks(&mut leader, camera(1, 0)).await;
        assert!(!ids.is_empty());
        let settings = crate::common::settings(SIDE, 2.0);
        for follower in [&mut one, &mut two] {
            follows(follower, 0).await;
            assert_eq!(view(follower).await, (ViewVersion(0), settings.into()));
            assert_eq!(frame(follower).await, (FrameNumber(0), camera(1, 0), ids.clone()));
        }
        for number in 2..6 {
            let ids = asks(&mut leader, camera(number, 0)).await;
            for follower in [&mut one, &mut two] {
                assert_eq!(frame(follower).await, (FrameNumber(number - 1), camera(number, 0), ids.clone()));
            }
        }
        // Another view state.
        let state = ViewState::from(crate::common::settings(SIDE / 2, 3.0));
        for message in state.to_messages(ViewVersion(1)).unwrap() {
            say(&mut leader, message).await;
        }
        let ids = asks(&mut leader, camera(9, 1)).await;
        for follower in [&mut one, &mut two] {
            assert_eq!(view(follower).await, (ViewVersion(1), state.clone()));
            assert_eq!(frame(follower).await, (FrameNumber(5), camera(9, 1), ids.clone()));
        }
        // A late one gets the present frame.
        follows(&mut late, 0).await;
        assert_eq!(view(&mut late).await, (ViewVersion(1), state));
        assert_eq!(frame(&mut late).await, (FrameNumber(0), camera(9, 1), ids));
        // All are told when the leader is lost.
        drop(leader);
        for (follower, sent) in [(&mut one, 6), (&mut two, 6), (&mut late, 1)] {
            let first = FrameNumber(sent);
            assert_eq!(hears(follower).await, RoleMessage::Unfollowed { leader: LEADER, first });
        }
    });
}

/// The number of the frame with this camera. The leader has it a moment before its followers, so the one
/// before may come first.
async fn frame_at(link: &mut Link, camera: Camera) -> u32 {
    loop {
        let (number, seen, _) = frame(link).await;
        if seen == camera {
            return number.0;
        }
        assert!(seen.frame() < camera.frame(), "{seen:?}");
    }
}

#[test]
fn a_display_goes_on_with_its_own_camera() {
    let service = Service::of(100);
    let devices = [(); 3].map(|()| Device::default());
    with_sessions(&service, devices, false, async |_, links| {
        let [mut leader, mut other, mut display] = <[Link; 3]>::try_from(links).unwrap();
        // Nobody leads yet.
        say(&mut display, RoleMessage::Follow { leader: LEADER }).await;
        let unfollowed = |first| RoleMessage::Unfollowed { leader: LEADER, first: FrameNumber(first) };
        assert_eq!(hears(&mut display).await, unfollowed(0));
        asks(&mut display, camera(3, 0)).await;
        // The one that has a key keeps it, and a display begins to lead with its last frame.
        asks(&mut leader, camera(1, 0)).await;
        asks(&mut other, camera(2, 0)).await;
        say(&mut leader, RoleMessage::Lead { leader: LEADER }).await;
        asks(&mut leader, camera(3, 0)).await;
        say(&mut other, RoleMessage::Lead { leader: LEADER }).await;
        asks(&mut other, camera(4, 0)).await;
        follows(&mut display, 1).await;
        view(&mut display).await;
        let seen = frame_at(&mut display, camera(3, 0)).await;
        // It has the number of the leader's last frame, and of its own one.
        say(&mut display, RoleMessage::Unfollow { leader: LEADER }).await;
        assert_eq!(hears(&mut display).await, unfollowed(seen + 1));
        asks(&mut display, camera(3, 0)).await;
        asks(&mut leader, camera(5, 0)).await;
        // A camera that overtakes the wish to go on alone is not lost.
        follows(&mut display, seen + 2).await;
        view(&mut display).await;
        let seen = frame_at(&mut display, camera(5, 0)).await;
        display.latest_tx.publish(camera(60, 0)).unwrap();
        asks(&mut leader, camera(6, 0)).await;
        let seen = seen.max(frame_at(&mut display, camera(6, 0)).await);
        say(&mut display, RoleMessage::Unfollow { leader: LEADER }).await;
        assert_eq!(hears(&mut display).await, unfollowed(seen + 1));
        assert_eq!(frame(&mut display).await.1, camera(60, 0));
        // A leader that follows leads no more.
        follows(&mut display, seen + 2).await;
        view(&mut display).await;
        frame(&mut display).await;
        let key = LeaderKey(8);
        say(&mut other, RoleMessage::Lead { leader: key }).await;
        loop {
            say(&mut leader, RoleMessage::Follow { leader: key }).await;
            match hears(&mut leader).await {
                RoleMessage::Followed { leader, .. } if leader == key => break,
                // It does not lead yet.
                answer => assert!(matches!(answer, RoleMessage::Unfollowed { .. }), "{answer:?}"),
            }
        }
        assert_eq!(hears(&mut display).await, unfollowed(seen + 3));
        view(&mut leader).await;
        assert_eq!(frame(&mut leader).await.1, camera(4, 0));
    });
}

/// Beyond what the lanes hold.
#[test]
fn a_slow_follower_skips_frames_and_holds_up_nobody() {
    const FRAMES: u32 = 400;
    let service = Service::of(100);
    let devices = [Device::default(), broken(), broken()];
    with_sessions(&service, devices, false, async |_, links| {
        let [mut leader, mut quick, mut slow] = <[Link; 3]>::try_from(links).unwrap();
        say(&mut leader, RoleMessage::Lead { leader: LEADER }).await;
        asks(&mut leader, camera(0, 0)).await;
        for follower in [&mut quick, &mut slow] {
            follows(follower, 0).await;
        }
        let mut ids = Vec::new();
        assert_eq!(frame(&mut quick).await.1, camera(0, 0));
        for number in 1..FRAMES {
            ids = asks(&mut leader, camera(number, 0)).await;
            assert_eq!(frame(&mut quick).await.1, camera(number, 0));
        }
        let mut seen = Vec::new();
        loop {
            let (_, header, found) = frame(&mut slow).await;
            seen.push(header.frame().0);
            if header.frame().0 == FRAMES - 1 {
                assert_eq!(found, ids);
                break;
            }
        }
        assert!(seen.is_sorted() && seen.len() < FRAMES as usize, "{}", seen.len());
    });
}

/// Takes all geometry of the leader's frame, these pieces, after that of coarser drawables in its place.
async fn takes_geometry(link: &mut Link, pieces: &BTreeSet<u32>) {
    let bulk = link.bulk.as_mut().unwrap();
    let mut block = Vec::new();
    assert!(put_item(&mut block, &Demand::Begin { coarser_first: true, ahead: 0 }));
    // A frame of its own, and not of its leader.
    assert!(put_item(&mut block, &Demand::Shown { frame: FrameNumber(1_000) }));
    bulk.tx.send(block.into()).await.unwrap();
    let (mut came, mut taken, mut stand_ins) = (BTreeSet::new(), 0, 0);
    while !pieces.is_subset(&came) {
        let block = bulk.rx.recv().await.unwrap();
        taken += block.len() as u64;
        for item in items(&block).unwrap() {
            match item {
                Supply::Geometry { number, length, offset, part } => {
                    let is_whole = offset as usize + part.len() == length as usize;
                    assert!(!is_whole || came.insert(number), "{number} came twice");
                }
                Supply::StandIn { .. } => stand_ins += 1,
                _ => {}
            }
        }
        let mut block = Vec::new();
        assert!(put_item(&mut block, &Demand::Taken { bytes: taken }));
        bulk.tx.send(block.into()).await.unwrap();
    }
    assert!(stand_ins > 0);
}

#[test]
fn the_geometry_of_followers_is_packed_once() {
    const FOLLOWERS: usize = 8;
    let service = Service::of(100);
    let devices = std::iter::once(Device::default()).chain((0..FOLLOWERS).map(|_| broken()));
    with_sessions(&service, devices, true, async |sharing, mut links| {
        let mut followers = links.split_off(1);
        let leader = &mut links[0];
        say(leader, RoleMessage::Lead { leader: LEADER }).await;
        let ids = asks(leader, camera(1, 0)).await;
        let geometry = |id: &DrawableId| service.scene.drawables().get(id.index()).unwrap().geometry;
        let pieces: BTreeSet<u32> = ids.iter().map(geometry).collect();
        for follower in &mut followers {
            follows(follower, 0).await;
            assert_eq!(frame(follower).await.2, ids);
            takes_geometry(follower, &pieces).await;
        }
        let counts = sharing.packing();
        println!("{FOLLOWERS} followers, {} pieces: {counts:?}", pieces.len());
        assert!(counts.requests >= (FOLLOWERS * pieces.len()) as u64);
        assert_eq!(counts.requests, FOLLOWERS as u64 * counts.packed);
    });
}
