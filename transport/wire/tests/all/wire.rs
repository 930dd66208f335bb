//! This crate writes and reads the worked examples of WIRE.md.

use std::collections::BTreeMap;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use trimaran_wire::{
    Accept, BatchSize, Channel, ChannelFormat, ChannelList, ChannelName, ChannelNumber, ChannelSizes,
    CloseReason, Decoder, Explanation, Fixed, Format, FrameEnd, FrameMessage, FrameNumber, FrameWriter,
    HEADER_BYTES, Hello, Item, Kind, Lane, MAX_BLOCK, MAX_CHANNELS, MAX_FIXED, MAX_HELLO, MAX_MESSAGE,
    Message, Numbered, Protocol, ProtocolName, Refusal, Rejection, Serial, SessionId, WireVersion,
    WireVersions, to_bytes,
};

use crate::examples::{check, hex};
use crate::refusals::refusals;
use crate::robot::{Command, NotFinite, Pose, Robot, Time};

const WIRE: &str = include_str!("../../WIRE.md");
/// The bytes of the release before.
const VERSION_4: &str = include_str!("../version-4.md");

fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    crate::examples::examples_of(WIRE)
}

fn hello(name: &str) -> Bytes {
    postcard::to_stdvec(name).unwrap().into()
}

const IDLE_TIMEOUT: Duration = Duration::from_secs(20);

/// The messages that the examples spell out, from peers of these versions.
fn messages(versions: WireVersions) -> Vec<(&'static str, Message)> {
    let pose = to_bytes(&Pose { x: 1.0, y: 2.0, heading: -3.0 });
    let items = [1u32, 258].map(u32::to_le_bytes).concat();
    let frame = FrameNumber(9);
    let hash = xxhash_rust::xxh3::xxh3_64(&items);
    let introduced = Hello {
        versions,
        protocol: ProtocolName::new(Robot::NAME),
        session: SessionId(5),
        lane: Lane::Latest,
        idle_timeout: IDLE_TIMEOUT.into(),
        channels: ChannelList::default(),
        application: hello("arm"),
    };
    const CHANNELS: &[Channel] =
        &[Channel::latest::<Time>("clock"), Channel::frames::<Pose, u32>("back lidar")];
    let with_channels = Hello {
        lane: Lane::Channel(ChannelNumber(1)),
        channels: ChannelList::of(CHANNELS),
        ..introduced.clone()
    };
    let frames = [
        ("begin", FrameMessage::Begin { frame, header: to_bytes(&Time(1000)) }),
        ("batch", FrameMessage::Batch(items.into())),
        ("end", FrameMessage::End(FrameEnd { frame, items: 2, hash })),
        (
            "coded-batch",
            FrameMessage::Coded([&100u32.to_le_bytes()[..], &50u16.to_le_bytes()].concat().into()),
        ),
    ];
    let (version, idle_timeout) = (versions.highest, IDLE_TIMEOUT.into());
    let mut messages = vec![
        ("hello", Message::Hello(introduced)),
        ("accept", Message::Accept(Accept { version, idle_timeout, application: hello("map") })),
        ("refuse", Message::Refuse(Refusal::Rejected(Rejection::new(1, "full")))),
        ("close", Message::Close(CloseReason::new(3, "no power"))),
        ("keep-alive", Message::KeepAlive),
        ("hello-channels", Message::Hello(with_channels)),
        ("latest-value", Message::Latest(pose.clone())),
        ("numbered-value", Message::Numbered(Numbered { number: Serial(5), value: pose })),
    ];
    messages.extend(frames.map(|(name, message)| (name, Message::Frame(message))));
    let command = postcard::to_stdvec(&Command::GoTo("dock".to_owned())).unwrap();
    messages.push(("message", Message::Message(command.into())));
    messages.push(("block", Message::Block(Bytes::from_static(b"map tile"))));
    messages
}

#[test]
fn every_kind_of_message_has_an_example_that_is_what_is_written_and_reads_back() {
    let mut messages = messages(WireVersions::SUPPORTED);
    messages.extend([("hello-4", of_version_4("hello")), ("accept-4", of_version_4("accept"))]);
    for kind in Kind::ALL {
        assert!(messages.iter().any(|(_, message)| message.kind() == kind), "no {kind}");
    }
    let others = 2; // the empty frame, and another version's hello
    check(&examples(), messages, Format::of::<Robot>(), others);
}

fn of_version_4(name: &str) -> Message {
    let messages = messages(WireVersions::only(WireVersion(4)));
    messages.into_iter().find(|(known, _)| *known == name).unwrap().1
}

/// The messages of the release before are read, and written to its peers, byte for byte.
#[test]
fn the_bytes_of_version_4_are_read_and_written() {
    let kept = crate::examples::examples_of(VERSION_4);
    let others = 1; // the empty frame
    check(&kept, messages(WireVersions::only(WireVersion(4))), Format::of::<Robot>(), others);
    let page = examples();
    assert_eq!((&page["hello-4"], &page["accept-4"]), (&kept["hello"], &kept["accept"]));
}

/// A listener of version 4 answers so when its peer has another version.
#[test]
fn a_refusal_by_version_4_names_it_alone() {
    let mut decoder = Decoder::new(Format::of::<Robot>());
    decoder.push(&[0x03, 5, 0, 0, 4, 0, 0, 4, 5]);
    let (listener, connector) = (WireVersions::only(WireVersion(4)), WireVersions::SUPPORTED);
    let refused = decoder.next_message();
    assert_eq!(refused, Ok(Some(Message::Refuse(Refusal::Version { listener, connector }))));
}

/// A listener of version 4 reads no longer hellos than it knows, and then it can say its version.
#[test]
fn the_longest_hello_is_one_that_version_4_reads() {
    let most = MAX_FIXED as u16;
    let channel = |_| ChannelFormat {
        name: ChannelName::new(&"x".repeat(ChannelName::MAX_BYTES)),
        sizes: ChannelSizes::Frames { header: most, item: most },
    };
    let hello = |lane, channels| Hello {
        versions: WireVersions::SUPPORTED,
        protocol: ProtocolName::new(&"x".repeat(ProtocolName::MAX_BYTES)),
        session: SessionId(u64::MAX),
        lane,
        idle_timeout: Duration::MAX.into(),
        channels,
        application: Bytes::from(vec![7; MAX_HELLO]),
    };
    let length = |hello| {
        let mut out = BytesMut::new();
        Message::Hello(hello).encode(&mut out);
        out.len() - HEADER_BYTES
    };
    assert_eq!(length(hello(Lane::Bulk, ChannelList::default())), 256);
    let channels = (0..MAX_CHANNELS).map(channel).collect();
    let last = Lane::Channel(ChannelNumber(MAX_CHANNELS as u8 - 1));
    assert!(length(hello(last, channels)) <= 897);
}

#[test]
fn the_empty_frame_is_begin_and_end() {
    let mut writer = FrameWriter::<u32>::new(BatchSize::default());
    let mut out = BytesMut::new();
    writer.begin(FrameNumber(9)).unwrap();
    writer.push(&[], |_| panic!("no batch")).unwrap();
    writer.finish(|message| Message::Frame(message).encode(&mut out)).unwrap();
    assert_eq!(hex(&out), hex(&examples()["empty-end"]));
}

#[test]
fn another_versions_hello_says_which() {
    let mut decoder = Decoder::new(Format::of::<Robot>());
    decoder.push(&examples()["hello-7"]);
    let error = decoder.next_message().unwrap_err().to_string();
    let expected = "the peer speaks versions 6 to 7 of the protocol, this one versions 4 to 5";
    assert!(error.contains(expected), "{error}");
}

/// The value of a length in the page: a sum of numbers, each of which may be multiplied by a letter that
/// follows it.
fn length(written: &str, format: &Format) -> usize {
    let factor = |word: &str| match word {
        "L" => format.latest,
        "H" => format.header,
        "I" => format.item,
        number => number.parse().unwrap(),
    };
    written.split(" + ").map(|term| term.split(' ').map(factor).product::<usize>()).sum()
}

#[test]
fn the_table_of_codes_and_lengths_is_the_crates() {
    for kind in Kind::ALL {
        let row = format!("| `{:#04x}` | {kind} | ", kind.code());
        let (_, rest) = WIRE.split_once(&row).unwrap_or_else(|| panic!("no row {row:?}"));
        let (lengths, _) = rest.split_once(" |").unwrap();
        let (least, most) = lengths.split_once(" to ").unwrap_or((lengths, lengths));
        for format in
            [Format::of::<Robot>(), Format { latest: 72, header: 0, item: 256, ..Format::default() }]
        {
            assert_eq!(length(least, &format)..=length(most, &format), kind.lengths(&format), "{kind}");
        }
    }
    assert!(WIRE.contains(&format!("{HEADER_BYTES}-byte header")));
}

#[test]
fn the_limits_are_the_crates() {
    let format = Format::of::<Robot>();
    let page = WIRE.split_whitespace().collect::<Vec<_>>().join(" ");
    for said in [
        format!("L is {}", format.latest),
        format!("H is {}", format.header),
        format!("I is {}", <u32 as Item>::SIZE),
        format!("| {MAX_FIXED} |"),
        format!("at most {} bytes, the application's hello {MAX_HELLO}", ProtocolName::MAX_BYTES),
        format!(
            "a message {MAX_MESSAGE}, a block {MAX_BLOCK}, each text for people {} bytes",
            Explanation::MAX_BYTES
        ),
        format!("refuses a peer {}.", Rejection::new(0, &"x".repeat(1000)).why.as_str().len()),
        format!("1 to {} items of I bytes", BatchSize::MAX.items()),
        format!("close with code {}", CloseReason::REFUSED),
        format!("# The wire of links, version {} ", WireVersion::CURRENT),
    ] {
        assert!(page.contains(&said), "the page does not say {said:?}");
    }
}

#[test]
fn the_reasons_have_the_numbers_of_the_page_and_some_pass() {
    let (_, table) = WIRE.split_once("| number | reason | values |\n|---|---|---|\n").unwrap();
    let rows: Vec<&str> = table.lines().take_while(|line| line.starts_with('|')).collect();
    let reasons = [
        ("versions differ", false),
        ("the applications differ", false),
        ("the application of the listener", false),
        ("the lane came twice", false),
        ("another lane", true),
        ("too many peers or handshakes", true),
        ("the key of who connects", false),
        ("the channels differ", false),
    ];
    assert_eq!(rows.len(), reasons.len());
    for (number, ((row, (reason, passing)), refusal)) in
        rows.iter().zip(reasons).zip(refusals("arm")).enumerate()
    {
        assert_eq!(refusal.is_passing(), passing, "{refusal}");
        let mut out = BytesMut::new();
        Message::Refuse(refusal).encode(&mut out);
        assert_eq!(usize::from(out[HEADER_BYTES + 2]), number, "{reason}");
        assert!(row.starts_with(&format!("| {number} | {reason}")), "{row}");
    }
}

#[test]
fn a_fixed_value_reads_back_or_says_why_not() {
    let pose = Pose { x: 1.0, y: -2.0, heading: 0.5 };
    let bytes = to_bytes(&pose);
    assert_eq!(bytes.len(), Pose::SIZE);
    assert_eq!(Pose::read(&bytes), Ok(pose));
    let lost = to_bytes(&Pose { x: f32::NAN, y: 0.0, heading: 0.0 });
    assert_eq!(Pose::read(&lost), Err(NotFinite));
    assert_eq!(Time::read(&to_bytes(&Time(1 << 40))), Ok(Time(1 << 40)));
    assert_eq!((to_bytes(&()).len(), <()>::read(&[])), (0, Ok(())));
}

/// The largest values are on the heap, and behave the same.
#[test]
fn a_value_may_have_a_kilobyte() {
    #[derive(Debug, PartialEq)]
    struct Large([u8; MAX_FIXED]);

    impl Fixed for Large {
        const SIZE: usize = MAX_FIXED;
        type Error = NotFinite;

        fn write(&self, out: &mut [u8]) {
            out.copy_from_slice(&self.0);
        }

        fn read(bytes: &[u8]) -> Result<Self, NotFinite> {
            bytes.first_chunk().copied().map(Self).ok_or(NotFinite)
        }
    }

    let large = Large(std::array::from_fn(|at| at as u8));
    assert_eq!(Large::read(&to_bytes(&large)), Ok(large));
}
