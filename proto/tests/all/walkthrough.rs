//! Trimaran's protocol as links see it: through the trait, and its coding through the trait's objects.

use bytes::Bytes;
use trimaran_proto::{
    BatchSize, CloseCode, CodedViolation, CodingFault, FrameNumber, IdBatch, IdCoding, Identity, LodRule,
    OcclusionTestKind, RejectionCode, Role, SceneHash, SceneOutline, SessionKey, Settings, Viewport,
    Walkthrough,
};
use trimaran_wire::{
    BatchDecoder, BatchEncoder, Batching, CloseReason, CodingError, Delivery, Explanation, FrameEnd,
    MAX_HELLO, Protocol, ProtocolName, Rejection,
};

type Encoder = Box<dyn BatchEncoder<trimaran_proto::DrawableId>>;
type Decoder = Box<dyn BatchDecoder<trimaran_proto::DrawableId>>;

fn settings() -> Settings {
    Settings {
        viewport: Viewport::new(65_536, 65_536).unwrap(),
        lod: LodRule::new(2.0).unwrap().stopping_at_few_pixels(true),
        batch: BatchSize::MAX,
        coding: IdCoding::Changes,
        occlusion_test: OcclusionTestKind::Hzb,
    }
}

fn identity(role: Role, settings: Option<Settings>) -> Identity {
    let session = settings.map(|settings| (SessionKey(u64::MAX), settings));
    Identity { role, scene: Some(SceneHash(u128::MAX).into()), session }
}

fn batch(ids: impl IntoIterator<Item = u32>) -> IdBatch {
    IdBatch::new(ids.into_iter().flat_map(u32::to_le_bytes).collect()).unwrap()
}

fn end(frame: u32, items: usize) -> FrameEnd {
    FrameEnd { frame: FrameNumber(frame), items: items as u32, hash: 0 }
}

fn ends(delivery: Delivery, max_items: u32) -> (Encoder, Decoder) {
    (Walkthrough::encoder(delivery).unwrap(), Walkthrough::decoder(max_items).unwrap())
}

/// Sends a frame of one batch without loss. Returns the number of bytes.
fn send((encoder, decoder): &mut (Encoder, Decoder), frame: u32, ids: &IdBatch) -> usize {
    let number = FrameNumber(frame);
    encoder.begin(number);
    decoder.begin(number);
    let coded = encoder.encode(ids);
    let bytes = coded.as_ref().map_or(ids.as_bytes().len(), Bytes::len);
    match coded {
        Some(coded) => {
            assert_eq!(Walkthrough::count_coded(&coded), Some(ids.count()));
            assert_eq!(&decoder.decode(&coded).unwrap(), ids);
        }
        None => decoder.plain(ids),
    }
    encoder.end(&end(frame, ids.count()));
    decoder.end(&end(frame, ids.count()));
    bytes
}

fn violation(refused: Result<IdBatch, CodingError>) -> CodedViolation {
    *refused.unwrap_err().0.downcast_ref().unwrap()
}

#[test]
fn in_order_each_frame_refers_to_the_one_before() {
    let mut ends = ends(Delivery::Ordered, u32::MAX);
    let ids = batch((0..1000).map(|id| 1000 * id));
    assert!(send(&mut ends, 0, &ids) > 1000);
    assert!(send(&mut ends, 1, &ids) < 10);
    assert_eq!(send(&mut ends, 2, &batch([9, 8])), 8, "ids that do not rise travel plain");
    assert!(send(&mut ends, 3, &ids) > 1000);
}

#[test]
fn where_frames_get_lost_only_a_confirmed_one_is_referred_to() {
    let mut ends = ends(Delivery::Lossy, u32::MAX);
    let (ids, others) = (batch((0..1000).map(|id| 1000 * id)), batch((0..1000).map(|id| 1000 * id + 500)));
    send(&mut ends, 0, &ids);
    send(&mut ends, 1, &others);
    assert!(send(&mut ends, 2, &others) > 1000, "nothing is confirmed");
    ends.0.confirmed(FrameNumber(1));
    ends.0.confirmed(FrameNumber(0));
    assert!(send(&mut ends, 3, &others) < 10, "a confirmation that comes late takes nothing back");
    assert!(send(&mut ends, 4, &ids) > 1000);
}

#[test]
fn a_confirmed_frame_that_is_long_gone_is_not_referred_to() {
    let mut ends = ends(Delivery::Lossy, u32::MAX);
    let ids = batch((0..1000).map(|id| 1000 * id));
    let alone = send(&mut ends, 0, &ids);
    ends.0.confirmed(FrameNumber(0));
    for frame in 1..9 {
        assert!(send(&mut ends, frame, &ids) < 10, "frame {frame}");
    }
    assert_eq!(send(&mut ends, 9, &ids), alone);
}

#[test]
fn a_frame_that_lacks_ids_is_no_reference() {
    let (mut encoder, mut decoder) = ends(Delivery::Ordered, u32::MAX);
    let (first, second) = (batch(0..500), batch(500..1000));
    encoder.begin(FrameNumber(4));
    decoder.begin(FrameNumber(4));
    for batch in [&first, &second] {
        encoder.encode(batch);
    }
    decoder.plain(&first);
    encoder.end(&end(4, 1000));
    decoder.end(&end(4, 1000));
    encoder.begin(FrameNumber(5));
    decoder.begin(FrameNumber(5));
    let coded = encoder.encode(&first).unwrap();
    let cause = CodingFault::UnknownReference { back: 1 };
    assert_eq!(violation(decoder.decode(&coded)), CodedViolation::Fault { frame: FrameNumber(5), cause });
}

/// The ids of all batches count, plain or coded, and those of other frames do not.
#[test]
fn no_frame_gets_more_ids_than_it_may_have() {
    let (mut encoder, mut decoder) = ends(Delivery::Ordered, 6);
    let three = batch([10, 20, 30]);
    for frame in 0..3 {
        encoder.begin(FrameNumber(frame));
        decoder.begin(FrameNumber(frame));
        let coded = encoder.encode(&three).unwrap();
        decoder.plain(&three);
        assert_eq!(decoder.decode(&coded).unwrap(), three);
        let cause = CodingFault::TooMany { most: 6 };
        let refused = violation(decoder.decode(&coded));
        assert_eq!(refused, CodedViolation::Fault { frame: FrameNumber(frame), cause });
        encoder.end(&end(frame, 6));
        decoder.end(&end(frame, 6));
    }
    let coded = encoder.encode(&three).unwrap();
    assert_eq!(violation(decoder.decode(&coded)), CodedViolation::OutsideFrame);
}

#[test]
fn what_cannot_be_read_stands_for_no_number_of_ids() {
    assert_eq!(Walkthrough::count_coded(&[]), None);
    assert_eq!(Walkthrough::count_coded(&[0, 1, 7]), Some(1));
    assert_eq!(Walkthrough::count_coded(&[0, 1]), None);
}

#[test]
fn the_displays_settings_decide_how_ids_travel() {
    let (culler, display) = (identity(Role::Culler, None), identity(Role::Display, Some(settings())));
    let coded = Batching { size: BatchSize::MAX, coded: true };
    assert_eq!(Walkthrough::batching(&culler, &display), Some(coded));
    assert_eq!(Walkthrough::batching(&display, &culler), Some(coded));
    assert_eq!(Walkthrough::batching(&culler, &culler), None);
    let met = identity(Role::Culler, Some(settings()));
    assert_eq!(Walkthrough::batching(&culler, &met), Some(coded), "a culler that meets another one has them");
    let batch = BatchSize::new(10).unwrap();
    let plain = Settings { coding: IdCoding::Plain, batch, ..settings() };
    let display = identity(Role::Display, Some(plain));
    assert_eq!(Walkthrough::batching(&culler, &display), Some(Batching { size: batch, coded: false }));
}

#[test]
fn a_peer_is_called_by_its_role() {
    for (role, name) in [(Role::Culler, "culler"), (Role::Display, "display")] {
        let hello = identity(role, None);
        assert_eq!(Walkthrough::name(&hello), name);
        assert_eq!(Walkthrough::role(&hello).as_deref(), Some(name));
    }
    assert_eq!(ProtocolName::new(Walkthrough::NAME).as_str(), "trimaran/4");
}

#[test]
fn a_listener_takes_peers_of_its_scene_whose_role_goes_with_its_own() {
    let (culler, display) = (identity(Role::Culler, None), identity(Role::Display, Some(settings())));
    // Only the display decides which cullers meet.
    let meeting = identity(Role::Culler, Some(settings()));
    let empty = Identity { scene: None, ..display };
    let scene = culler.scene.unwrap();
    let with = |scene| Identity { scene: Some(scene), ..display };
    let (other_scene, role) = (Err(RejectionCode::Scene as u16), Err(RejectionCode::Role as u16));
    for (listener, connector, expected) in [
        (display, culler, Ok(())),
        (culler, display, Ok(())),
        (culler, meeting, Ok(())),
        (culler, empty, Ok(())),
        (empty, culler, Ok(())),
        (display, display, role),
        (display, empty, role),
        (culler, culler, role),
        (display, with(SceneHash(1).into()), other_scene),
        // Equal fingerprints alone do not make received data valid.
        (culler, with(SceneOutline { nodes: 1, ..scene }), other_scene),
        (culler, with(SceneOutline { drawables: 1, ..scene }), other_scene),
        (culler, with(SceneOutline { geometries: 1, ..scene }), other_scene),
        (culler, with(SceneOutline { objects: 1, ..scene }), other_scene),
    ] {
        let admitted = Walkthrough::admit(&listener, &connector).map_err(|rejection| rejection.code);
        assert_eq!(admitted, expected, "{listener:?} and {connector:?}");
    }
    let why = Walkthrough::admit(&display, &with(SceneHash(1).into())).unwrap_err().to_string();
    assert!(why.contains("ffffffff") && why.contains("00000001"), "{why}");
}

#[test]
fn a_code_is_of_its_own_rejections() {
    let codes = [RejectionCode::Scene, RejectionCode::Role];
    for code in codes {
        let rejection = Rejection::new(code as u16, "");
        let of: Vec<RejectionCode> = codes.into_iter().filter(|code| code.is_of(&rejection)).collect();
        assert_eq!(of, [code]);
    }
}

#[test]
fn a_peer_that_leaves_says_why_to_programs_and_people() {
    for (close, code, what) in [
        (CloseCode::Finished, 0, "the session is over"),
        (CloseCode::Interrupted, 1, "it was interrupted"),
        (CloseCode::Failed, 2, "it failed"),
        (CloseCode::DeviceFailed, 4, "its device failed"),
        (CloseCode::Replaced, 5, "it has a newer link for the same session"),
    ] {
        let reason = close.reason();
        assert_eq!((reason.code, reason.why.as_str()), (code, what));
        assert_eq!(CloseCode::of(&reason), Some(close));
        let because = close.because("no power");
        assert_eq!(because.why.as_str(), format!("{what}: no power"));
        assert_eq!(CloseCode::of(&because), Some(close));
    }
    for code in [3, 6, CloseReason::REFUSED] {
        assert_eq!(CloseCode::of(&CloseReason::new(code, "it failed")), None);
    }
    assert_eq!(CloseCode::Failed.because(&"x".repeat(1000)).why.as_str().len(), Explanation::MAX_BYTES);
}

#[test]
fn the_longest_identity_fits_a_hello() {
    let scene = SceneOutline {
        hash: SceneHash(u128::MAX),
        nodes: u32::MAX,
        drawables: u32::MAX,
        geometries: u32::MAX,
        objects: u32::MAX,
    };
    let longest = Identity { scene: Some(scene), ..identity(Role::Display, Some(settings())) };
    assert!(postcard::to_stdvec(&longest).unwrap().len() <= MAX_HELLO);
}

/// The reason for a mismatch between peers is told in full.
#[test]
fn the_longest_rejection_is_not_cut() {
    let display = identity(Role::Display, Some(settings()));
    let why = Walkthrough::admit(&display, &display).unwrap_err();
    assert!(why.to_string().ends_with("connect displays with cullers"), "{why}");
    let why = Walkthrough::admit(
        &identity(Role::Display, None),
        &Identity { scene: Some(SceneHash(0).into()), ..identity(Role::Culler, None) },
    );
    assert!(why.unwrap_err().to_string().ends_with("give both the same cooked file"));
}

#[test]
fn a_relay_takes_displays_but_no_culler_and_serves_nobody_the_scene() {
    let relay = Identity { scene: None, ..identity(Role::Relay, None) };
    let leads = identity(Role::Display, Some(settings()));
    let admit = |ours: &Identity, theirs: &Identity| Walkthrough::admit(ours, theirs).map_err(|why| why.code);
    let (scene, role) = (RejectionCode::Scene as u16, RejectionCode::Role as u16);
    assert_eq!(admit(&relay, &leads), Ok(()));
    assert_eq!(admit(&relay, &identity(Role::Display, None)), Ok(()));
    assert_eq!(admit(&relay, &Identity { scene: None, ..leads }), Err(scene));
    assert_eq!(admit(&relay, &Identity { scene: None, ..identity(Role::Display, None) }), Ok(()));
    for (listener, connector) in [(Role::Relay, Role::Culler), (Role::Culler, Role::Relay)] {
        assert_eq!(admit(&identity(listener, None), &identity(connector, None)), Err(role));
    }
}

#[test]
fn only_a_display_of_a_session_has_a_place_to_come_back_to() {
    let place = |role, settings| Walkthrough::place(&identity(role, settings));
    assert_eq!(place(Role::Display, Some(settings())), Some(u64::MAX));
    assert_eq!(place(Role::Display, None), None);
    assert_eq!(place(Role::Culler, Some(settings())), None);
}
