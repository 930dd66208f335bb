//! The codec as a whole: written data reads back, for any split; garbage does no harm.

#[allow(unreachable_pub, reason = "the fuzz targets share the file, and see it as public")]
#[path = "../../../../fuzz/src/checks.rs"]
mod checks;

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use proptest::prelude::*;
use trimaran_wire::{
    Accept, BatchSize, ChannelFormat, ChannelList, ChannelName, ChannelNumber, ChannelSizes, CloseReason,
    Decoder, Explanation, FixedBytes, Format, FrameAssembler, FrameEnd, FrameMessage, FrameNumber,
    FrameOutcome, FrameStep, FrameViolation, FrameWriter, Hello, IdleTimeout, Lane, MAX_BLOCK, MAX_CHANNELS,
    MAX_HELLO, MAX_MESSAGE, Message, Numbered, ProtocolName, Refusal, Rejection, Serial, SessionId,
    WireVersion, WireVersions,
};

use crate::refusals::{longest_channel, refusals};

/// The sizes of an application whose values and headers need more than a [`FixedBytes`] has on the stack, and
/// less.
const FORMAT: Format = Format { latest: 120, header: 8, item: 4, count_coded: |_| None, channels: &[] };

fn bytes(length: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), length)
}

fn fixed(length: usize) -> impl Strategy<Value = FixedBytes> {
    bytes(length).prop_map(FixedBytes::from_vec)
}

fn text() -> impl Strategy<Value = Explanation> {
    any::<String>().prop_map(|text| Explanation::new(&text))
}

fn lane() -> impl Strategy<Value = Lane> {
    let channel = any::<u8>().prop_map(|number| Lane::Channel(ChannelNumber(number)));
    prop_oneof![Just(Lane::Latest), Just(Lane::Frames), Just(Lane::Messages), Just(Lane::Bulk), channel]
}

fn channel() -> impl Strategy<Value = ChannelFormat> {
    let sizes = prop_oneof![
        any::<u16>().prop_map(|value| ChannelSizes::Latest { value }),
        any::<(u16, u16)>().prop_map(|(header, item)| ChannelSizes::Frames { header, item }),
    ];
    (any::<String>(), sizes).prop_map(|(name, sizes)| ChannelFormat { name: ChannelName::new(&name), sizes })
}

fn channels() -> impl Strategy<Value = ChannelList> {
    prop::collection::vec(channel(), 0..=MAX_CHANNELS).prop_map(|channels| channels.into_iter().collect())
}

fn idle_timeout() -> impl Strategy<Value = IdleTimeout> {
    any::<u32>().prop_map(|millis| Duration::from_millis(millis.into()).into())
}

/// Those of this release, of the one before, and of the next one.
fn versions() -> impl Strategy<Value = WireVersions> {
    prop::sample::select(vec![(5, 4), (4, 4), (6, 5)]).prop_map(|(highest, lowest)| WireVersions {
        highest: WireVersion(highest),
        lowest: WireVersion(lowest),
    })
}

fn hello() -> impl Strategy<Value = Message> {
    let application = bytes(0..=MAX_HELLO);
    (versions(), any::<String>(), any::<u64>(), lane(), idle_timeout(), channels(), application).prop_map(
        |(versions, protocol, session, lane, idle_timeout, channels, application)| {
            Message::Hello(Hello {
                versions,
                protocol: ProtocolName::new(&protocol),
                session: SessionId(session),
                lane,
                idle_timeout,
                channels,
                application: application.into(),
            })
        },
    )
}

fn refusal() -> impl Strategy<Value = Refusal> {
    let session = any::<u64>().prop_map(SessionId);
    let name = any::<String>().prop_map(|name| ProtocolName::new(&name));
    prop_oneof![
        (versions(), versions()).prop_map(|(listener, connector)| Refusal::Version { listener, connector }),
        (name.clone(), name).prop_map(|(listener, connector)| Refusal::Protocol { listener, connector }),
        (any::<u16>(), any::<String>()).prop_map(|(code, why)| Refusal::Rejected(Rejection::new(code, &why))),
        (session.clone(), lane()).prop_map(|(session, lane)| Refusal::Session { session, lane }),
        session.prop_map(|session| Refusal::Unpaired { session }),
        Just(Refusal::Busy),
        (text(), text()).prop_map(|(claimed, known)| Refusal::Key { claimed, known }),
        (any::<u8>(), prop::option::of(channel()), prop::option::of(channel())).prop_map(
            |(number, listener, connector)| Refusal::Channel {
                number: ChannelNumber(number),
                listener,
                connector
            }
        ),
    ]
}

/// Any message at all.
fn message() -> impl Strategy<Value = Message> {
    let whole_items = bytes(1..=50_usize).prop_map(|bytes| Bytes::from(bytes.repeat(FORMAT.item)));
    let frame = prop_oneof![
        (any::<u32>(), fixed(FORMAT.header))
            .prop_map(|(frame, header)| FrameMessage::Begin { frame: FrameNumber(frame), header }),
        whole_items.prop_map(FrameMessage::Batch),
        bytes(1..100_usize).prop_map(|bytes| FrameMessage::Coded(bytes.into())),
        any::<(u32, u32, u64)>().prop_map(|(frame, items, hash)| {
            FrameMessage::End(FrameEnd { frame: FrameNumber(frame), items, hash })
        }),
    ];
    prop_oneof![
        hello(),
        (4..=5_u16, idle_timeout(), bytes(0..=MAX_HELLO)).prop_map(|(version, idle_timeout, bytes)| {
            let (version, application) = (WireVersion(version), bytes.into());
            Message::Accept(Accept { version, idle_timeout, application })
        }),
        refusal().prop_map(Message::Refuse),
        (any::<u16>(), text()).prop_map(|(code, why)| Message::Close(CloseReason { code, why })),
        Just(Message::KeepAlive),
        fixed(FORMAT.latest).prop_map(Message::Latest),
        (any::<u32>(), fixed(FORMAT.latest))
            .prop_map(|(number, value)| Message::Numbered(Numbered { number: Serial(number), value })),
        frame.prop_map(Message::Frame),
        bytes(0..1000_usize).prop_map(|bytes| Message::Message(bytes.into())),
        bytes(0..1000_usize).prop_map(|bytes| Message::Block(bytes.into())),
    ]
}

fn encoded(messages: &[Message]) -> BytesMut {
    let mut out = BytesMut::new();
    messages.iter().for_each(|message| message.encode(&mut out));
    out
}

/// The messages of one frame whose items are pushed in these pieces.
fn frame(frame: FrameNumber, batch: BatchSize, pieces: &[Vec<u32>]) -> Vec<FrameMessage> {
    let mut writer = FrameWriter::new(batch);
    writer.begin(frame).unwrap();
    let mut messages = vec![FrameMessage::Begin { frame, header: [5; FORMAT.header].as_slice().into() }];
    for piece in pieces {
        writer.push(piece, |message| messages.push(message)).unwrap();
    }
    writer.finish(|message| messages.push(message)).unwrap();
    messages
}

fn take(
    assembler: &mut FrameAssembler,
    message: &FrameMessage,
) -> Result<Option<FrameOutcome>, FrameViolation> {
    assembler.take(match message {
        FrameMessage::Begin { frame, .. } => FrameStep::Begin(*frame),
        FrameMessage::Batch(bytes) => FrameStep::Batch { items: bytes.len() / FORMAT.item, bytes },
        FrameMessage::End(end) => FrameStep::End(*end),
        FrameMessage::Coded(_) => panic!("nothing was coded"),
    })
}

/// Feeds `bytes` in pieces that end at `cuts`, and takes every message as soon as it is whole.
fn decode(bytes: &[u8], cuts: &[prop::sample::Index]) -> Vec<Message> {
    let mut ends: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
    ends.push(bytes.len());
    ends.sort_unstable();
    let (mut decoder, mut from, mut messages) = (Decoder::new(FORMAT), 0, Vec::new());
    for end in ends {
        decoder.push(&bytes[from..end]);
        from = end;
        messages.extend(std::iter::from_fn(|| decoder.next_message().unwrap()));
    }
    assert_eq!(decoder.pending(), 0);
    assert_eq!(decoder.position(), bytes.len() as u64);
    messages
}

fn pieces() -> impl Strategy<Value = Vec<Vec<u32>>> {
    prop::collection::vec(prop::collection::vec(any::<u32>(), 0..50), 0..8)
}

fn batch() -> impl Strategy<Value = BatchSize> {
    prop_oneof![1u32..20, Just(256), Just(16_384)].prop_map(|items| BatchSize::new(items).unwrap())
}

proptest! {
    #[test]
    fn messages_survive_any_split(
        messages in prop::collection::vec(message(), 0..8),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..30),
    ) {
        prop_assert_eq!(decode(&encoded(&messages), &cuts), messages);
    }

    #[test]
    fn a_payload_is_as_long_as_its_message_says(message in message()) {
        let out = encoded(std::slice::from_ref(&message));
        prop_assert_eq!(out[0], message.kind().code());
        prop_assert!(message.kind().lengths(&FORMAT).contains(&(out.len() - trimaran_wire::HEADER_BYTES)));
        if let Message::Frame(frame) = message {
            prop_assert_eq!(frame.payload(), out.len() - trimaran_wire::HEADER_BYTES);
        }
    }

    #[test]
    fn a_frame_survives_any_split_and_any_pushes(
        batch in batch(),
        pieces in pieces(),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..30),
    ) {
        let sent: Vec<Message> =
            frame(FrameNumber(3), batch, &pieces).into_iter().map(Message::Frame).collect();
        let read = decode(&encoded(&sent), &cuts);
        prop_assert_eq!(&read, &sent);
        let mut assembler = FrameAssembler::new(u32::MAX);
        let (mut items, mut outcome) = (Vec::new(), None);
        for message in read {
            let Message::Frame(message) = message else { panic!("{message:?}") };
            if let FrameMessage::Batch(bytes) = &message {
                prop_assert!(bytes.len() <= FORMAT.batch(batch));
                items.extend(bytes.as_chunks().0.iter().map(|item| u32::from_le_bytes(*item)));
            }
            outcome = take(&mut assembler, &message).unwrap();
        }
        prop_assert_eq!(&items, &pieces.concat());
        let Some(FrameOutcome::Complete(end)) = outcome else { panic!("{outcome:?}") };
        prop_assert_eq!(end.items as usize, items.len());
    }

    #[test]
    fn a_lost_batch_is_known_to_be_lost(batch in batch(), pieces in pieces(), which: prop::sample::Index) {
        let number = FrameNumber(0);
        let mut messages = frame(number, batch, &pieces);
        prop_assume!(messages.len() > 2);
        let lost = messages.remove(1 + which.index(messages.len() - 2));
        let expected = pieces.concat().len() as u32;
        let mut assembler = FrameAssembler::new(u32::MAX);
        let last = messages.iter().map(|message| take(&mut assembler, message).unwrap()).last();
        let received = expected - (lost.payload() / FORMAT.item) as u32;
        prop_assert_eq!(last, Some(Some(FrameOutcome::Incomplete { frame: number, expected, received })));
    }

    #[test]
    fn swapped_batches_are_found_out(mut items in prop::collection::hash_set(any::<u32>(), 2..40)) {
        let items: Vec<u32> = items.drain().collect();
        let mut messages = frame(FrameNumber(0), BatchSize::new(1).unwrap(), &[items]);
        messages.swap(1, 2);
        let mut assembler = FrameAssembler::new(u32::MAX);
        let last = messages.iter().map(|message| take(&mut assembler, message)).last();
        let found_out = matches!(last, Some(Err(FrameViolation::Hash { .. })));
        prop_assert!(found_out, "{:?}", last);
    }

    #[test]
    fn garbage_does_no_harm(bytes in bytes(0..600)) {
        checks::decode(&bytes, &FORMAT);
        checks::frames(&bytes);
    }

    #[test]
    fn a_broken_stream_does_no_harm(
        messages in prop::collection::vec(message(), 1..6),
        broken in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut out = encoded(&messages);
        for (at, byte) in broken {
            let at = at.index(out.len());
            out[at] = byte;
        }
        checks::decode(&out, &FORMAT);
    }
}

#[test]
fn the_fuzz_corpus_does_no_harm() {
    let corpus = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/corpus");
    let inputs = |target: &str| -> Vec<Vec<u8>> {
        let files = std::fs::read_dir(format!("{corpus}/{target}")).unwrap();
        files.map(|file| std::fs::read(file.unwrap().path()).unwrap()).collect()
    };
    // The sizes of the application that the corpus was recorded from.
    let format = Format { latest: 72, header: 72, ..FORMAT };
    let messages =
        inputs("decode").iter().flat_map(|bytes| checks::decode(bytes, &format)).collect::<Vec<_>>();
    for kind in trimaran_wire::Kind::ALL {
        assert!(messages.iter().any(|message| message.kind() == kind), "no {kind} in the corpus");
    }
    let frames = inputs("frames");
    assert!(frames.len() >= 5, "only {} inputs: is the corpus there?", frames.len());
    frames.iter().for_each(|bytes| checks::frames(bytes));
}

/// The longest value of each type is within the limits of its kind, so that no peer refuses it for its
/// length.
#[test]
fn the_longest_control_messages_are_taken() {
    let text = Explanation::new(&"x".repeat(1000));
    let name = ProtocolName::new(&"x".repeat(1000));
    assert_eq!((text.as_str().len(), name.as_str().len()), (200, 32));
    let (session, lane) = (SessionId(u64::MAX), Lane::Channel(ChannelNumber(u8::MAX)));
    let channels: ChannelList = vec![longest_channel(); MAX_CHANNELS].into_iter().collect();
    let idle_timeout = Duration::MAX.into();
    let application = Bytes::from(vec![7; MAX_HELLO]);
    let mut messages = vec![
        Message::Hello(Hello {
            versions: WireVersions::SUPPORTED,
            protocol: name,
            session,
            lane,
            idle_timeout,
            channels,
            application: application.clone(),
        }),
        Message::Accept(Accept { version: WireVersion::CURRENT, idle_timeout, application }),
        Message::Close(CloseReason { code: u16::MAX, why: text }),
        Message::Message(vec![0; MAX_MESSAGE].into()),
        Message::Block(vec![0; MAX_BLOCK].into()),
    ];
    messages.extend(refusals(&"x".repeat(1000)).map(Message::Refuse));
    for message in messages {
        assert_eq!(decode(&encoded(std::slice::from_ref(&message)), &[]), [message]);
    }
}
