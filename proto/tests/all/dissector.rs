//! Runs this crate's Wireshark dissector over the examples of WIRE.md and over each refusal. Whole sessions
//! are in the program's tests.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};

use bytes::{Bytes, BytesMut};
use trimaran_proto::FrameNumber;
use trimaran_wire::{
    ChannelFormat, ChannelName, ChannelNumber, ChannelSizes, CloseReason, Explanation, FrameEnd,
    FrameMessage, Lane, Message, ProtocolName, Refusal, Rejection, SessionId, WireVersions,
};

fn examples() -> BTreeMap<&'static str, Vec<u8>> {
    crate::examples::examples_of(include_str!("../../WIRE.md"))
}

fn encoded(message: Message) -> Vec<u8> {
    let mut out = BytesMut::new();
    message.encode(&mut out);
    out.to_vec()
}

/// A capture of IPv4 packets without checksums: each with its sending end, of TCP (protocol 6) or UDP (17).
fn capture(packets: &[(usize, Vec<u8>)], protocol: u16) -> Vec<u8> {
    // The header of a file of IPv4 packets (link type 228), with times in microseconds.
    let mut file = [0xa1b2_c3d4_u32, 4 << 16 | 2, 0, 0, 65_535, 228].map(u32::to_le_bytes).concat();
    let mut sent = [1_u32; 2];
    for (index, (from, payload)) in packets.iter().enumerate() {
        let mut packet = if *from == 0 { [40_000_u16, 7400] } else { [7400, 40_000] }.to_vec();
        if protocol == 17 {
            packet.extend([8 + payload.len() as u16, 0]);
        } else {
            let numbers = [sent[*from], sent[1 - from]];
            packet.extend(numbers.into_iter().flat_map(|number| [(number >> 16) as u16, number as u16]));
            // Twenty bytes of header, push and acknowledge, the largest window.
            packet.extend([0x5018, 65_535, 0, 0]);
        }
        let size = 20 + 2 * packet.len() + payload.len();
        file.extend([index as u32, 0, size as u32, size as u32].map(u32::to_le_bytes).concat());
        let header = [0x4500, size as u16, 0, 0, 0x4000 | protocol, 0, 0x7f00, 1, 0x7f00, 1];
        file.extend(header.into_iter().chain(packet).flat_map(u16::to_be_bytes));
        file.extend(payload);
        sent[*from] += payload.len() as u32;
    }
    file
}

/// These fields of each packet as tshark shows them, separated by `|`. `None` skips the test: tshark is
/// missing and `TRIMARAN_REQUIRE_TSHARK` is not set.
fn read(packets: &[(usize, Vec<u8>)], fields: &[&str]) -> Option<Vec<String>> {
    read_over(6, packets, fields)
}

/// The same over TCP (protocol 6) or UDP (17).
fn read_over(protocol: u16, packets: &[(usize, Vec<u8>)], fields: &[&str]) -> Option<Vec<String>> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("examples.pcap");
    std::fs::write(&file, capture(packets, protocol)).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("wireshark/trimaran.lua");
    let mut tshark = Command::new("tshark");
    tshark.arg("-r").arg(file).arg("-X").arg(format!("lua_script:{}", script.display()));
    tshark.args(["-T", "fields", "-E", "separator=|", "-E", "aggregator=;", "-e", "trimaran.malformed"]);
    tshark.args(["-e", "trimaran_udp.malformed"]);
    tshark.args(fields.iter().flat_map(|field| ["-e", field]));
    let output = match tshark.stderr(Stdio::piped()).output() {
        Ok(output) => output,
        Err(error) if std::env::var_os("TRIMARAN_REQUIRE_TSHARK").is_none() => {
            println!("skipped: no tshark ({error}); ./x setup installs it");
            return None;
        }
        Err(error) => panic!("no tshark: {error}"),
    };
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !said.contains("Lua"), "{said}");
    let shown = String::from_utf8(output.stdout).unwrap();
    assert_eq!(shown.lines().count(), packets.len(), "{shown}");
    let sound = |line: &str| match line.strip_prefix("||") {
        Some(fields) => fields.to_owned(),
        None => panic!("malformed: {line}"),
    };
    Some(shown.lines().map(sound).collect())
}

#[test]
fn the_examples_are_read_field_by_field() {
    let examples = examples();
    for (name, fields, expected) in [
        (
            "hello",
            &[
                "trimaran.protocol",
                "trimaran.session",
                "trimaran.lane",
                "trimaran.role",
                "trimaran.settings.batch",
            ][..],
            "trimaran/4|0x0000000000000005|0|1|256",
        ),
        (
            "hello",
            &["trimaran.scene", "trimaran.session_key"],
            "00000000000000000000000000001234|0x0000000000005eed",
        ),
        ("hello", &["trimaran.version", "trimaran.version.lowest"], "5|4"),
        ("accept", &["trimaran.version", "trimaran.role", "trimaran.settings.width"], "5|0|"),
        (
            "accept",
            &[
                "trimaran.scene.nodes",
                "trimaran.scene.drawables",
                "trimaran.scene.geometries",
                "trimaran.scene.objects",
            ],
            "400|600|250|100",
        ),
        (
            "hello-without-a-scene",
            &[
                "trimaran.lane",
                "trimaran.idle_timeout",
                "trimaran.scene",
                "trimaran.session_key",
                "trimaran.settings.batch",
            ],
            "3|20000||0x0000000000005eed|256",
        ),
        ("accept", &["trimaran.idle_timeout"], "20000"),
        (
            "refuse",
            &["trimaran.version", "trimaran.reason", "trimaran.rejection", "trimaran.text"],
            "4|2|3|the listener is a culler as well: connect displays with cullers",
        ),
        ("close", &["trimaran.close", "trimaran.text"], "2|it failed: no GPU"),
        (
            "camera",
            &["trimaran.camera.eye", "trimaran.camera.near", "trimaran.camera.frame"],
            "1;2;-3|0.25|7",
        ),
        ("begin", &["trimaran.begin", "trimaran.camera.view"], "9|3"),
        ("ids", &["trimaran.ids", "trimaran.id"], "2|1;258"),
        ("stats", &["trimaran.message", "trimaran.stats", "trimaran.stats.occluders_of"], "0|9|7"),
        (
            "stats",
            &["trimaran.stats.value"],
            "1;300;0;0;0;200;20;60;0;0;5;0;0;0;0;0;0;0;2;0;0;0;0;0;0;0;0;0;0;0;0;0;0;0",
        ),
        (
            "meet",
            &["trimaran.message", "trimaran.meeting", "trimaran.meet.at"],
            "1|0x0000000000005eed|tcp://two:7400",
        ),
        ("switch", &["trimaran.message", "trimaran.switch.first"], "4|8"),
        ("view", &["trimaran.message", "trimaran.view", "trimaran.view.last"], "7|3|1"),
        ("coded-ids", &["trimaran.coded.back", "trimaran.coded.kept"], "2|10;9;27"),
    ] {
        let Some(shown) = read(&[(0, examples[name].clone())], fields) else { return };
        assert_eq!(shown, [expected], "{name}");
    }
}

/// A block's contents depend on its sender, which the hellos name.
#[test]
fn blocks_are_read_item_by_item() {
    let examples = examples();
    let say = |name: &str| examples[name].clone();
    let entries = encoded(Message::Block(Bytes::from_static(&[0, 3, 2, 0, 0xaa])));
    let packets = [
        (0, say("hello-without-a-scene")),
        (1, say("accept")),
        (0, say("holds-and-begin")),
        (0, say("lacks")),
        (0, say("taken-and-shown")),
        (1, say("geometry-part")),
        (1, entries.clone()),
        (1, say("stand-in")),
        (1, say("ahead")),
    ];
    let fields = [
        "trimaran.demand",
        "trimaran.demand.coarser_first",
        "trimaran.demand.ahead",
        "trimaran.demand.frame",
        "trimaran.demand.taken",
        "trimaran.demand.drawable",
        "trimaran.demand.geometry",
    ];
    let Some(shown) = read(&packets, &fields) else { return };
    assert_eq!(shown[2..5], ["2;0|1|8388608|||4;5;134|7", "3|||9|300|2;258|", "5;6|||9|17000||"]);
    let fields = [
        "trimaran.supply",
        "trimaran.supply.geometry",
        "trimaran.supply.length",
        "trimaran.supply.offset",
        "trimaran.supply.part",
        "trimaran.supply.records",
        "trimaran.supply.entries",
    ];
    let Some(shown) = read(&packets, &fields) else { return };
    assert_eq!(shown[4..7], ["||||||", "1|8|300|296|deadbeef||", "0|||||2|aa"]);
    let fields =
        ["trimaran.supply", "trimaran.supply.stand_in", "trimaran.supply.drawable", "trimaran.supply.ahead"];
    let Some(shown) = read(&packets, &fields) else { return };
    assert_eq!(shown[6..], ["0|||", "2|300|2;258|", "3|||8;9"]);
    let Some(shown) = read(&packets, &["_ws.col.Info"]) else { return };
    assert!(shown[0].contains("hello from display without a scene, bulk"), "{shown:?}");
    for (packet, said) in [
        (2, "begin with coarser drawables first and 8388608 bytes ahead"),
        (3, "block of 8 bytes: frame 9 lacks 2 drawables"),
        (7, "block of 8 bytes: 2 drawables from 300 stand in for 2 drawables"),
        (8, "block of 4 bytes: 2 pieces ahead"),
    ] {
        assert!(shown[packet].contains(said), "{shown:?}");
    }

    // From a capture without hellos only the bytes are known.
    let Some(shown) = read(&[(0, entries)], &["trimaran.supply", "trimaran.block"]) else { return };
    assert_eq!(shown, ["|00030200aa"]);
}

#[test]
fn changes_are_decoded_against_the_frame_before() {
    let examples = examples();
    let mut begin = examples["begin"].clone();
    begin[4] = 7;
    let batch: Bytes = (100..150_u32).flat_map(u32::to_le_bytes).collect();
    let end = FrameEnd { frame: FrameNumber(7), items: 50, hash: 0 };
    let first = [
        begin,
        encoded(Message::Frame(FrameMessage::Batch(batch))),
        encoded(Message::Frame(FrameMessage::End(end))),
    ];
    let second = [examples["begin"].clone(), examples["coded-ids"].clone()];
    let packets = [(0, first.concat()), (0, second.concat())];
    let Some(shown) = read(&packets, &["trimaran.end", "trimaran.id"]) else { return };
    let list = |ids: Vec<u32>| ids.iter().map(u32::to_string).collect::<Vec<_>>().join(";");
    let now = (100..110).chain(111..120).chain(123..150).chain([200, 1000]).collect();
    assert_eq!(shown, [format!("7|{}", list((100..150).collect())), format!("|{}", list(now))]);
}

#[test]
fn each_refusal_is_read_with_its_values() {
    let versions = WireVersions::SUPPORTED;
    let (session, lane) = (SessionId(5), Lane::Frames);
    let text = Explanation::new;
    let refusals = [
        (Refusal::Version { listener: versions, connector: versions }, "0||||"),
        (
            Refusal::Protocol {
                listener: ProtocolName::new("trimaran/4"),
                connector: ProtocolName::new("robot/1"),
            },
            "1|trimaran/4;robot/1|||",
        ),
        (Refusal::Rejected(Rejection::new(1, "other scene")), "2||other scene||"),
        (Refusal::Session { session, lane }, "3|||0x0000000000000005|1"),
        (Refusal::Unpaired { session }, "4|||0x0000000000000005|"),
        (Refusal::Busy, "5||||"),
        (Refusal::Key { claimed: text("culler"), known: text("display") }, "6||culler;display||"),
        (Refusal::Session { session, lane: Lane::Channel(ChannelNumber(2)) }, "3|||0x0000000000000005|4"),
    ];
    let packets = refusals.iter().map(|(refusal, _)| (1, encoded(Message::Refuse(refusal.clone()))));
    let fields =
        ["trimaran.reason", "trimaran.protocol", "trimaran.text", "trimaran.session", "trimaran.lane"];
    let Some(shown) = read(&packets.collect::<Vec<_>>(), &fields) else { return };
    assert_eq!(shown, refusals.map(|(_, expected)| expected));

    let sizes = ChannelSizes::Latest { value: 300 };
    let connector = Some(ChannelFormat { name: ChannelName::new("clock"), sizes });
    let channels = Refusal::Channel { number: ChannelNumber(3), listener: None, connector };
    let fields = ["trimaran.channel.number", "trimaran.channel", "trimaran.channel.value_size"];
    let Some(shown) = read(&[(1, encoded(Message::Refuse(channels)))], &fields) else { return };
    assert_eq!(shown, ["3|clock|300"]);

    // In version 4 each side has one.
    let versions = Refusal::Version { listener: versions, connector: versions };
    let refusals = [encoded(Message::Refuse(versions)), vec![0x03, 5, 0, 0, 4, 0, 0, 4, 5]];
    let packets = refusals.map(|refusal| (1, refusal));
    let Some(shown) = read(&packets, &["trimaran.version", "trimaran.reason"]) else { return };
    assert_eq!(shown, ["4;5;4;5;4|0", "4;4;5|0"]);

    let close = |code| (0, encoded(Message::Close(CloseReason::new(code, ""))));
    let fields = ["trimaran.close", "trimaran.text", "_ws.col.Info"];
    let Some(shown) = read(&[close(CloseReason::REFUSED)], &fields) else { return };
    assert_eq!(shown, ["65535||Trimaran: close: the listener is not taken"]);
}

/// As the release before wrote it.
#[test]
fn the_handshake_of_version_4_is_read() {
    let kept = crate::examples::examples_of(include_str!("../../../transport/wire/tests/version-4.md"));
    let packets = [(0, kept["hello"].clone()), (1, kept["accept"].clone()), (1, kept["refuse"].clone())];
    let fields = [
        "trimaran.kind",
        "trimaran.version",
        "trimaran.version.lowest",
        "trimaran.protocol",
        "trimaran.idle_timeout",
        "trimaran.application",
    ];
    let Some(shown) = read(&packets, &fields) else { return };
    assert_eq!(shown[..2], ["0x01|4||robot/1|20000|0361726d", "0x02||||20000|036d6170"]);
}

/// Its values have other sizes, so they are shown as raw bytes.
#[test]
fn of_another_application_only_kinds_are_read() {
    let robot = robot_examples();
    let say = |name: &str| robot[name].clone();
    let packets = [
        (0, say("hello")),
        (1, say("accept")),
        (0, say("latest-value")),
        (0, [say("begin"), say("batch"), say("end"), say("message"), say("block")].concat()),
        (0, say("close")),
    ];
    let fields =
        ["trimaran.kind", "trimaran.protocol", "trimaran.camera.eye", "trimaran.id", "trimaran.application"];
    let Some(shown) = read(&packets, &fields) else { return };
    assert_eq!(shown[0], "0x01|robot/1|||0361726d");
    assert_eq!(shown[1], "0x07||||036d6170");
    assert_eq!(shown[2], "0x10||||0000803f00000040000040c0");
    assert_eq!(
        shown[3],
        "0x20;0x21;0x22;0x30;0x40||||09000000e803000000000000;0100000002010000;09000000020000000df1431b580e4f7a;0104646f636b;6d61702074696c65"
    );
    assert!(shown[4].starts_with("0x04||||03"), "{}", shown[4]);
}

fn robot_examples() -> BTreeMap<&'static str, Vec<u8>> {
    crate::examples::examples_of(include_str!("../../../transport/wire/WIRE.md"))
}

/// A frame of two items of four bytes, with a header of twelve, as channel 1 of the examples has it.
fn scan() -> [FrameMessage; 3] {
    let frame = FrameNumber(9);
    let header = [7; 12].into_iter().collect();
    let batch = Bytes::from_static(&[1, 0, 0, 0, 2, 1, 0, 0]);
    let end = FrameEnd { frame, items: 2, hash: 0x1234 };
    [FrameMessage::Begin { frame, header }, FrameMessage::Batch(batch), FrameMessage::End(end)]
}

#[test]
fn channels_are_read_by_the_sizes_in_their_hello() {
    let robot = robot_examples();
    let mut clock = robot["hello-channels"].clone();
    let which = clock.windows(3).position(|bytes| bytes == [5, 4, 1]).unwrap() + 2;
    let hellos = [clock.clone(), {
        clock[which] = 0;
        clock
    }];
    let fields = ["trimaran.lane", "trimaran.channel.number", "trimaran.channel", "_ws.col.Info"];
    let packets = [(0, hellos[0].clone()), (1, robot["accept"].clone())];
    let Some(shown) = read(&packets, &fields) else { return };
    let said = "Trimaran: hello of robot/1, channel back lidar";
    assert_eq!(shown[0], format!("4|1|clock;back lidar|{said}"));
    assert_eq!(shown[1], "|||Trimaran: accept with version of channel back lidar");
    let fields =
        ["trimaran.channel.value_size", "trimaran.channel.header_size", "trimaran.channel.item_size"];
    assert_eq!(read(&packets[..1], &fields).unwrap(), ["8|12|4"]);

    let frame = scan().map(|message| encoded(Message::Frame(message))).concat();
    let packets = [(0, hellos[0].clone()), (0, frame), (0, robot["close"].clone())];
    let fields = [
        "trimaran.begin",
        "trimaran.channel.header",
        "trimaran.channel.items",
        "trimaran.channel.item_bytes",
        "trimaran.end",
        "trimaran.end.hash",
        "_ws.col.Info",
    ];
    let shown = read(&packets, &fields).unwrap();
    let said = "Trimaran: begin 9 of back lidar; 2 items of back lidar; end 9 of back lidar";
    let header = "07".repeat(12);
    assert_eq!(shown[1], format!("9|{header}|2;2|0100000002010000|9|0x0000000000001234|{said}"));
    assert!(shown[2].ends_with("Trimaran: close of channel back lidar"), "{}", shown[2]);

    let value = encoded(Message::Latest([1, 2, 3, 4, 5, 6, 7, 8].into_iter().collect()));
    let packets = [(0, hellos[1].clone()), (1, value)];
    let shown = read(&packets, &["trimaran.channel.value", "_ws.col.Info"]).unwrap();
    assert_eq!(shown[1], "0102030405060708|Trimaran: value of clock");
}

/// A data packet in the clear, with these chunks.
fn datagram(number: u64, chunks: &[&[u8]]) -> Vec<u8> {
    [&(number << 2).to_le_bytes()[..], &[9, 0, 0, 0], &chunks.concat(), &[0; 16]].concat()
}

#[test]
fn channels_are_read_in_datagrams() {
    let (hello, udp) =
        (robot_examples()["hello-channels"].clone(), include_str!("../../../transport/udp/WIRE.md"));
    let channel = crate::examples::examples_of(udp)["channel"].clone();
    let length = (hello.len() as u16).to_le_bytes();
    let mut initial = [&17_u64.to_le_bytes()[..], &[9, 0, 0, 0, 0], &length, &hello].concat();
    initial.resize(1200, 0);
    let [begin, ..] = scan();
    let begin = encoded(Message::Frame(begin));
    let part = [&[0x0c, 1, 0x20, 5, 0, begin.len() as u8, 0][..], &begin].concat();
    let rest = [0x0c, 1, 0x22, 5, 20, 4, 0, 1, 2, 3, 4];
    let value = [0x0c, 0, 0x10, 3, 1, 2, 3, 4, 5, 6, 7, 8];
    let packets = [
        (0, initial),
        (0, datagram(1, &[&value, &channel, &part])),
        (0, datagram(2, &[&rest, &[0x20, 1, 0, 2, 0, 0, 0], &[0x10, 4, 0xaa, 0x01]])),
    ];
    let fields = [
        "trimaran_udp.channel",
        "trimaran_udp.value",
        "trimaran.channel.value",
        "trimaran_udp.max_data",
        "trimaran.begin",
        "trimaran.application",
        "_ws.col.Info",
    ];
    let Some(shown) = read_over(17, &packets, &fields) else { return };
    let said = "clock: value 3; back lidar: max data; back lidar: unit 5: begin 9";
    let expected = format!("0;1;1|3|0102030405060708|4194304|9||Trimaran/UDP: chunks of robot/1: {said}");
    assert_eq!(shown[1], expected);
    let said = "back lidar: unit 5: part of a frame; unit 1: part of a frame; value 4, and what follows it";
    assert_eq!(shown[2], format!("1|4||||aa01|Trimaran/UDP: chunks of robot/1: {said}"));
}
