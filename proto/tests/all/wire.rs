//! This crate writes and reads the worked examples of WIRE.md.

use std::collections::BTreeMap;
use std::time::Duration;

use bytes::Bytes;
use trimaran_proto::{
    BatchSize, Camera, CloseCode, CullCounts, Demand, DeviceTimes, DrawableId, FrameNumber, FrameStats,
    IdBatch, IdCoding, Identity, LeaderKey, LodRule, NumberList, OcclusionTestKind, RejectionCode, Role,
    RoleMessage, SceneHash, SceneOutline, Section, SectionPlane, Sections, SessionKey, Settings, Supply,
    ViewReader, ViewState, ViewVersion, Viewport, Walkthrough, items, put_item,
};
use trimaran_wire::{
    Accept, ChannelList, Decoder, Delivery, Fixed, Format, FrameEnd, FrameMessage, Hello, Item, Kind, Lane,
    Message, Protocol, ProtocolName, Refusal, SessionId, WireVersion, WireVersions, to_bytes,
};

const WIRE: &str = include_str!("../../WIRE.md");

fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    crate::examples::examples_of(WIRE)
}

fn camera() -> Camera {
    Camera::new([1.0, 2.0, -3.0], [0.0, 0.0, 0.0, 1.0], 0.5, 0.25, FrameNumber(7)).unwrap().in_view(VIEW)
}

const VIEW: ViewVersion = ViewVersion(3);

const KEY: SessionKey = SessionKey(0x5eed);
const LEADER: LeaderKey = LeaderKey(7);

const SCENE: SceneOutline =
    SceneOutline { hash: SceneHash(0x1234), nodes: 400, drawables: 600, geometries: 250, objects: 100 };

fn display() -> Identity {
    let settings = Settings {
        viewport: Viewport::new(1024, 768).unwrap(),
        lod: LodRule::new(2.0).unwrap(),
        batch: BatchSize::new(256).unwrap(),
        coding: IdCoding::Changes,
        occlusion_test: OcclusionTestKind::Raster,
    };
    Identity { role: Role::Display, scene: Some(SCENE), session: Some((KEY, settings)) }
}

fn empty_display() -> Identity {
    Identity { scene: None, ..display() }
}

fn culler() -> Identity {
    Identity { role: Role::Culler, scene: Some(SCENE), session: None }
}

fn stats() -> FrameStats {
    FrameStats {
        frame: FrameNumber(9),
        occluders_of: Some(FrameNumber(7)),
        or_start_ns: 1,
        or_end_ns: 300,
        device: DeviceTimes { drawing_ns: 200, pyramid_ns: 20, culling_ns: 60 },
        culling: CullCounts { visited: 5, emitted: 2, ..CullCounts::default() },
        ..FrameStats::default()
    }
}

fn ids(ids: impl IntoIterator<Item = u32>) -> Bytes {
    ids.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn postcard(value: &impl serde::Serialize) -> Bytes {
    postcard::to_stdvec(value).unwrap().into()
}

/// The ids of frame 9: 100 to 149 without 110 and 120 to 122, and 200 and 1000. Frame 7 had 100 to 149.
fn now() -> Bytes {
    ids((100..110).chain(111..120).chain(123..150).chain([200, 1000]))
}

fn frame_7() -> (IdBatch, FrameEnd) {
    (IdBatch::new(ids(100..150)).unwrap(), FrameEnd { frame: FrameNumber(7), items: 50, hash: 0 })
}

fn coded() -> Bytes {
    let mut encoder = Walkthrough::encoder(Delivery::Ordered).unwrap();
    let (before, end) = frame_7();
    encoder.begin(FrameNumber(7));
    encoder.encode(&before);
    encoder.end(&end);
    encoder.begin(FrameNumber(9));
    encoder.encode(&IdBatch::new(now()).unwrap()).unwrap()
}

fn view() -> ViewState {
    let plane = SectionPlane::new([0.0, 3.0, 0.0], [0.0, 1.0, 0.0]).unwrap();
    let (_, settings) = display().session.unwrap();
    ViewState {
        sections: Sections::new(&[Section::Plane(plane)]).unwrap(),
        hidden: [2, 3, 4, 7].into_iter().collect(),
        see_through: Some([300].into_iter().collect()),
        ..ViewState::from(settings)
    }
}

fn said() -> [(&'static str, RoleMessage); 5] {
    [
        ("stats", RoleMessage::Stats(stats())),
        ("meet", RoleMessage::Meet { key: KEY, at: Some("tcp://two:7400".to_owned()) }),
        ("switch", RoleMessage::Switch { key: KEY, first: FrameNumber(8) }),
        ("view", view().to_messages(VIEW).unwrap().remove(0)),
        ("followed", RoleMessage::Followed { leader: LEADER, first: FrameNumber(5) }),
    ]
}

fn numbers<const N: usize>(numbers: [u32; N]) -> NumberList {
    NumberList::of(numbers.into())
}

/// Blocks of a display.
fn demanded() -> [(&'static str, Vec<Demand>); 3] {
    let holds = Demand::Holds { drawables: numbers([4, 5, 134]), geometries: numbers([7]) };
    let lacks = Demand::Lacks { frame: FrameNumber(9), taken: 300, drawables: numbers([2, 258]) };
    let taken = Demand::Taken { bytes: 17_000 };
    let begin = Demand::Begin { coarser_first: true, ahead: 8 << 20 };
    [
        ("holds-and-begin", vec![holds, begin]),
        ("lacks", vec![lacks]),
        ("taken-and-shown", vec![taken, Demand::Shown { frame: FrameNumber(9) }]),
    ]
}

/// Blocks of a culler.
fn supplied() -> [(&'static str, Vec<Supply>); 3] {
    let part = Bytes::from_static(&[0xde, 0xad, 0xbe, 0xef]);
    let stand_in = Supply::StandIn { id: DrawableId(300), pieces: 2, drawables: numbers([2, 258]) };
    [
        ("geometry-part", vec![Supply::Geometry { number: 8, length: 300, offset: 296, part }]),
        ("stand-in", vec![stand_in]),
        ("ahead", vec![Supply::Ahead { geometries: numbers([8, 9]) }]),
    ]
}

fn block(items: &[impl serde::Serialize]) -> Message {
    let mut block = Vec::new();
    assert!(items.iter().all(|item| put_item(&mut block, item)));
    Message::Block(block.into())
}

const IDLE_TIMEOUT: Duration = Duration::from_secs(20);

fn hello(lane: Lane, identity: Identity) -> Message {
    Message::Hello(Hello {
        versions: WireVersions::SUPPORTED,
        protocol: ProtocolName::new(Walkthrough::NAME),
        session: SessionId(5),
        lane,
        idle_timeout: IDLE_TIMEOUT.into(),
        channels: ChannelList::default(),
        application: postcard(&identity),
    })
}

/// The messages that the examples spell out.
fn messages() -> Vec<(&'static str, Message)> {
    let header = to_bytes(&camera());
    let frames = [
        ("begin", FrameMessage::Begin { frame: FrameNumber(9), header: header.clone() }),
        ("ids", FrameMessage::Batch(ids([1, 258]))),
        ("coded-ids", FrameMessage::Coded(coded())),
    ];
    let (idle_timeout, application) = (IDLE_TIMEOUT.into(), postcard(&culler()));
    let accept = Accept { version: WireVersion::CURRENT, idle_timeout, application };
    let mut messages = vec![
        ("hello", hello(Lane::Latest, display())),
        ("hello-without-a-scene", hello(Lane::Bulk, empty_display())),
        ("accept", Message::Accept(accept)),
        ("refuse", Message::Refuse(Refusal::Rejected(Walkthrough::admit(&culler(), &culler()).unwrap_err()))),
        ("close", Message::Close(CloseCode::Failed.because("no GPU"))),
        ("camera", Message::Latest(header)),
    ];
    messages.extend(frames.map(|(name, message)| (name, Message::Frame(message))));
    messages.extend(said().map(|(name, said)| (name, Message::Message(postcard(&said)))));
    messages.extend(demanded().map(|(name, items)| (name, block(&items))));
    messages.extend(supplied().map(|(name, items)| (name, block(&items))));
    messages
}

fn read(name: &str) -> Message {
    let mut decoder = Decoder::new(Format::of::<Walkthrough>());
    decoder.push(&examples()[name]);
    decoder.next_message().unwrap().unwrap()
}

#[test]
fn the_examples_are_what_is_written_and_read_back() {
    crate::examples::check(&examples(), messages(), Format::of::<Walkthrough>(), 0);
}

#[test]
fn the_examples_read_back_as_what_they_stand_for() {
    for (name, identity) in [("hello", display()), ("hello-without-a-scene", empty_display())] {
        let Message::Hello(hello) = read(name) else { panic!("no hello") };
        assert_eq!(postcard::from_bytes(&hello.application), Ok(identity));
    }
    let Message::Accept(accept) = read("accept") else { panic!("no accept") };
    assert_eq!(postcard::from_bytes(&accept.application), Ok(culler()));
    let Message::Refuse(Refusal::Rejected(rejection)) = read("refuse") else { panic!("not refused") };
    assert!(RejectionCode::Role.is_of(&rejection));
    let Message::Close(reason) = read("close") else { panic!("no close") };
    assert_eq!(CloseCode::of(&reason), Some(CloseCode::Failed));
    let Message::Latest(value) = read("camera") else { panic!("no camera") };
    assert_eq!(Camera::read(&value), Ok(camera()));
    let Message::Frame(FrameMessage::Begin { header, .. }) = read("begin") else { panic!("no begin") };
    assert_eq!(Camera::read(&header), Ok(camera()));
    let Message::Frame(FrameMessage::Batch(bytes)) = read("ids") else { panic!("no ids") };
    assert_eq!(IdBatch::new(bytes).unwrap().iter().collect::<Vec<_>>(), [1, 258].map(DrawableId));
    for (name, expected) in said() {
        let Message::Message(said) = read(name) else { panic!("no {name}") };
        assert_eq!(postcard::from_bytes(&said), Ok(expected));
    }
    for (name, expected) in demanded() {
        let Message::Block(block) = read(name) else { panic!("no {name}") };
        assert_eq!(items(&block), Ok(expected));
    }
    for (name, expected) in supplied() {
        let Message::Block(block) = read(name) else { panic!("no {name}") };
        assert_eq!(items(&block), Ok(expected));
    }
    let RoleMessage::View { version, part, last } = view().to_messages(VIEW).unwrap().remove(0) else {
        panic!("no part of a view state")
    };
    assert_eq!(ViewReader::default().take(version, &part, last), Ok(Some(view())));

    let Message::Frame(FrameMessage::Coded(coded)) = read("coded-ids") else { panic!("no changes") };
    assert_eq!(Walkthrough::count_coded(&coded), Some(48));
    let mut decoder = Walkthrough::decoder(1000).unwrap();
    let (before, end) = frame_7();
    decoder.begin(FrameNumber(7));
    decoder.plain(&before);
    decoder.end(&end);
    decoder.begin(FrameNumber(9));
    assert_eq!(decoder.decode(&coded).unwrap().as_bytes(), &now());
}

#[test]
fn the_tables_of_lengths_and_codes_are_the_crates() {
    let format = Format::of::<Walkthrough>();
    assert_eq!((format.latest, format.header, format.item), (Camera::SIZE, Camera::SIZE, DrawableId::SIZE));
    for kind in Kind::ALL
        .into_iter()
        .filter(|kind| !matches!(kind, Kind::KeepAlive | Kind::ChannelsHello | Kind::End))
    {
        let (min, max) = kind.lengths(&format).into_inner();
        let lengths = if min == max { format!("{min}") } else { format!("{min} to {max}") };
        let row = format!("| `{:#04x}` | {kind} | {lengths} |", kind.code());
        assert!(WIRE.contains(&row), "no row {row:?}");
    }
    for (code, name) in [
        (CloseCode::Finished as u16, "finished"),
        (CloseCode::Interrupted as u16, "interrupted"),
        (CloseCode::Failed as u16, "failed"),
        (CloseCode::DeviceFailed as u16, "device failed"),
        (CloseCode::Replaced as u16, "replaced"),
        (RejectionCode::Scene as u16, "scene"),
        (RejectionCode::Role as u16, "role"),
    ] {
        assert!(WIRE.contains(&format!("| {code} | {name} |")), "no row of {name}");
    }
    assert!(WIRE.contains(&format!("The protocol `{}`", Walkthrough::NAME)));
    let first = FrameNumber(0);
    for (name, message) in [
        ("stats", RoleMessage::Stats(stats())),
        ("meet", RoleMessage::Meet { key: KEY, at: None }),
        ("met", RoleMessage::Met { key: KEY }),
        ("unmet", RoleMessage::Unmet { key: KEY }),
        ("switch", RoleMessage::Switch { key: KEY, first }),
        ("switched", RoleMessage::Switched { key: KEY }),
        ("part", RoleMessage::Part),
        ("view", view().to_messages(VIEW).unwrap().remove(0)),
        ("waits", RoleMessage::Waits { key: KEY }),
        ("lead", RoleMessage::Lead { leader: LEADER }),
        ("follow", RoleMessage::Follow { leader: LEADER }),
        ("unfollow", RoleMessage::Unfollow { leader: LEADER }),
        ("followed", RoleMessage::Followed { leader: LEADER, first }),
        ("unfollowed", RoleMessage::Unfollowed { leader: LEADER, first }),
    ] {
        let number = postcard(&message)[0];
        assert!(WIRE.contains(&format!("| {number} | {name} |")), "no row of {name}");
    }
}

/// The rows of a table whose first cells are a number and a name.
fn rows(head: &str) -> Vec<(u8, &'static str)> {
    let (_, table) = WIRE.split_once(head).unwrap();
    let lines = table.lines().skip(2).take_while(|line| line.starts_with('|'));
    let row = |line: &'static str| {
        let mut cells = line.split('|').skip(1).map(str::trim);
        (cells.next().unwrap().parse().unwrap(), cells.next().unwrap())
    };
    lines.map(row).collect()
}

#[test]
fn the_tables_of_items_of_blocks_are_the_crates() {
    let list = NumberList::default;
    let frame = FrameNumber(0);
    let demands = [
        ("begin", Demand::Begin { coarser_first: false, ahead: 0 }),
        ("end", Demand::End),
        ("holds", Demand::Holds { drawables: list(), geometries: list() }),
        ("lacks", Demand::Lacks { frame, taken: 0, drawables: list() }),
        ("dropped", Demand::Dropped { geometries: list() }),
        ("taken", Demand::Taken { bytes: 0 }),
        ("shown", Demand::Shown { frame }),
    ];
    let demands = demands.map(|(name, demand)| (postcard(&demand)[0], name));
    assert_eq!(rows("| number | item | values | what it says |"), demands);
    let supplies = [
        ("entries", Supply::Entries { packed: Bytes::new() }),
        ("geometry", Supply::Geometry { number: 0, length: 0, offset: 0, part: Bytes::new() }),
        ("stand-in", Supply::StandIn { id: DrawableId(0), pieces: 1, drawables: list() }),
        ("ahead", Supply::Ahead { geometries: list() }),
    ];
    let supplies = supplies.map(|(name, supply)| (postcard(&supply)[0], name));
    assert_eq!(rows("| number | item | values | what it holds |"), supplies);
    let most = format!("{},{:03} numbers", NumberList::MOST / 1000, NumberList::MOST % 1000);
    assert!(WIRE.contains(&most), "the page does not say {most}");
}

#[test]
fn roles_and_drawables_have_their_names_in_links_and_messages() {
    assert_eq!([Role::Culler, Role::Display, Role::Relay].map(String::from), ["culler", "display", "relay"]);
    assert_eq!(DrawableId(7).to_string(), "drawable 7");
}
