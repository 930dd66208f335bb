//! A decoder's errors for bytes that are not this protocol.

use trimaran_wire::{
    BatchError, DecodeFault, Decoder, Format, Kind, Message, Refusal, WireVersion, WireVersions,
};

const FORMAT: Format = Format { latest: 12, header: 8, item: 4, count_coded: |_| None, channels: &[] };

/// A message of this kind with any payload.
fn message(kind: Kind, payload: &[u8]) -> Vec<u8> {
    let header = u32::from(kind.code()) | (payload.len() as u32) << 8;
    [&header.to_le_bytes()[..], payload].concat()
}

fn decode(bytes: &[u8]) -> Result<Option<Message>, DecodeFault> {
    let mut decoder = Decoder::new(FORMAT);
    decoder.push(bytes);
    decoder.next_message().map_err(|error| error.fault)
}

fn length(kind: Kind, length: usize) -> DecodeFault {
    let (least, most) = kind.lengths(&FORMAT).into_inner();
    DecodeFault::Length { kind, length, least, most }
}

#[test]
fn a_header_is_judged_before_its_payload_is_there() {
    assert_eq!(decode(&[0x10, 12, 0]), Ok(None), "no header yet");
    assert_eq!(decode(&[0x10, 12, 0, 0]), Ok(None));
    assert_eq!(decode(&[0x10, 13, 0, 0]), Err(length(Kind::Latest, 13)));
    assert_eq!(decode(&[0x21, 0xff, 0xff, 0xff]), Err(length(Kind::Batch, 0x00ff_ffff)));
    assert_eq!(decode(&[0x21, 1, 0, 1]), Err(length(Kind::Batch, 65_537)));
    assert_eq!(decode(&[0x21, 0, 0, 1]), Ok(None), "the longest batch");
    assert_eq!(decode(&[0x30, 0x01, 0x40, 0]), Err(length(Kind::Message, 16_385)));
    assert_eq!(decode(&[0x40, 0x01, 0x40, 0]), Err(length(Kind::Block, 16_385)));
    assert_eq!(decode(&[0x47, b'E', b'T', b' ']), Err(DecodeFault::UnknownKind { code: 0x47 }));
}

#[test]
fn each_kind_has_its_lengths() {
    for kind in Kind::ALL {
        let (least, most) = kind.lengths(&FORMAT).into_inner();
        let wrong = [least.checked_sub(1), Some(most + 1)];
        for wrong in wrong.into_iter().flatten() {
            assert_eq!(decode(&message(kind, &vec![0; wrong])), Err(length(kind, wrong)));
        }
    }
}

#[test]
fn a_hello_is_known_by_its_magic_number_and_version() {
    let hello = |payload: &[u8]| decode(&message(Kind::Hello, payload));
    assert_eq!(hello(b"TRIN\x01\x00"), Err(DecodeFault::NotTrimaran));
    assert_eq!(hello(b"TRI"), Err(DecodeFault::NotTrimaran));
    assert_eq!(hello(b"TRIM\x01"), Err(DecodeFault::Short { kind: Kind::Hello }));
    assert_eq!(hello(b"TRIM\x05\x00\x04"), Err(DecodeFault::Short { kind: Kind::Hello }));
    let range = |lowest, highest| WireVersions { lowest: WireVersion(lowest), highest: WireVersion(highest) };
    let others = |theirs| DecodeFault::Version { ours: WireVersions::SUPPORTED, theirs };
    assert_eq!(hello(b"TRIM\x02\x01\x01\x01whatever"), Err(others(range(0x0101, 0x0102))));
    assert_eq!(hello(b"TRIM\x05\x00\x09\x00upside down"), Err(others(range(9, 5))));
    assert_eq!(hello(b"TRIM\x03\x00whatever"), Err(others(range(3, 3))));
    let cut = hello(b"TRIM\x04\x00\x07robo");
    assert!(matches!(cut, Err(DecodeFault::Control { kind: Kind::Hello, .. })), "{cut:?}");
    let long = [b"TRIM\x04\x00\x21".as_slice(), &[b'x'; 33], &[5, 0]].concat();
    let long = hello(&long);
    assert!(
        matches!(long, Err(DecodeFault::Control { kind: Kind::Hello, .. })),
        "a name of 33 bytes: {long:?}"
    );
}

/// The next release names both versions that it speaks, and writes the rest as this one does.
#[test]
fn a_hello_of_the_next_release_is_read() {
    let read = decode(&message(Kind::Hello, b"TRIM\x06\x00\x05\x00\x01r\x05\x00\x64arm"));
    let Ok(Some(Message::Hello(hello))) = read else { panic!("{read:?}") };
    let theirs = WireVersions { highest: WireVersion(6), lowest: WireVersion(5) };
    assert_eq!((hello.versions, hello.application.as_ref()), (theirs, b"arm".as_slice()));
}

#[test]
fn an_accept_names_a_version_that_this_side_speaks() {
    for (version, known) in [(3, false), (4, false), (5, true), (6, false)] {
        let read = decode(&message(Kind::VersionedAccept, &[version, 0, 0x64]));
        let theirs = WireVersions::only(WireVersion(version.into()));
        let fault = DecodeFault::Version { ours: WireVersions::SUPPORTED, theirs };
        match read {
            Ok(Some(Message::Accept(accept))) => assert!(known && accept.version.0 == u16::from(version)),
            other => assert_eq!((other, known), (Err(fault), false)),
        }
    }
}

#[test]
fn a_refusal_of_another_version_is_read_no_further() {
    let refusal = |listener, connector| Ok(Some(Message::Refuse(Refusal::Version { listener, connector })));
    let ours = WireVersions::SUPPORTED;
    let refused = decode(&message(Kind::Refuse, &[6, 0, 0xff, 0xff]));
    assert_eq!(refused, refusal(WireVersions::only(WireVersion(6)), ours));
    let theirs = WireVersions { highest: WireVersion(7), lowest: WireVersion(6) };
    assert_eq!(decode(&message(Kind::Refuse, &[6, 0, 0, 7, 6, 5, 4])), refusal(theirs, ours));
    let unknown = decode(&message(Kind::Refuse, &[4, 0, 7]));
    assert!(matches!(unknown, Err(DecodeFault::Control { kind: Kind::Refuse, .. })), "{unknown:?}");
}

#[test]
fn control_messages_end_where_their_payload_does() {
    let tail = DecodeFault::Trailing { kind: Kind::Close, bytes: 2 };
    assert_eq!(decode(&message(Kind::Close, &[0, 0, 7, 7])), Err(tail));
    assert_eq!(
        decode(&message(Kind::Refuse, &[4, 0, 5, 7])),
        Err(DecodeFault::Trailing { kind: Kind::Refuse, bytes: 1 })
    );
    let long = [&[2, 0xc9, 1][..], &[b'x'; 201]].concat();
    let long = decode(&message(Kind::Close, &long));
    assert!(matches!(long, Err(DecodeFault::Control { kind: Kind::Close, .. })), "{long:?}");
}

#[test]
fn a_batch_is_whole_items() {
    let cause = BatchError { bytes: 5, item: 4 };
    assert_eq!(decode(&message(Kind::Batch, &[0; 5])), Err(DecodeFault::Batch { cause }));
}

#[test]
fn an_error_says_where_its_message_starts_and_stays() {
    let mut decoder = Decoder::new(FORMAT);
    let alive = message(Kind::KeepAlive, &[]);
    decoder.push(&[&alive[..], &alive, &[0xff; 9]].concat());
    assert_eq!(decoder.next_message(), Ok(Some(Message::KeepAlive)));
    assert_eq!((decoder.position(), decoder.pending()), (4, 13));
    assert_eq!(decoder.next_message(), Ok(Some(Message::KeepAlive)));
    let error = decoder.next_message().unwrap_err();
    assert_eq!((error.offset, &error.fault), (8, &DecodeFault::UnknownKind { code: 0xff }));
    decoder.push(&alive);
    assert_eq!(decoder.next_message(), Err(error));
    assert_eq!(decoder.position(), 8);
}

#[test]
fn a_batch_shares_the_memory_that_was_read_into() {
    let mut decoder = Decoder::new(FORMAT);
    let buffer = decoder.buffer(64);
    buffer.extend_from_slice(&message(Kind::Batch, &[1, 0, 0, 0]));
    let read = buffer.as_ptr() as usize + 4;
    let Ok(Some(Message::Frame(trimaran_wire::FrameMessage::Batch(bytes)))) = decoder.next_message() else {
        panic!("no batch");
    };
    assert_eq!(bytes.as_ptr() as usize, read);
}
