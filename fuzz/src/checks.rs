//! Properties of any bytes at all on a link of any application. The fuzz targets search for bytes that
//! break it; an ordinary test of `transport/wire` replays the corpus.

use bytes::BytesMut;
use trimaran_wire::{
    Batch, BatchSize, Decoder, Format, FrameAssembler, FrameMessage, FrameNumber, FrameOutcome, FrameStep,
    FrameWriter, Message,
};

/// Any bytes, whole or byte by byte, give the same messages and the same end; and each message that was read
/// is written again as it stood, unless it has varints, which may have been longer than needed. Gives the
/// messages.
pub fn decode(bytes: &[u8], format: &Format) -> Vec<Message> {
    let mut whole = Decoder::new(*format);
    whole.push(bytes);
    let mut slow = Decoder::new(*format);
    let (mut rest, mut messages) = (bytes.iter(), Vec::new());
    loop {
        let before = whole.position() as usize;
        let message = whole.next_message();
        let same = loop {
            match slow.next_message() {
                Ok(None) => match rest.next() {
                    Some(byte) => slow.push(&[*byte]),
                    None => break Ok(None),
                },
                other => break other,
            }
        };
        assert_eq!(message, same);
        match message {
            Ok(Some(message)) => {
                rewrite(&message, &bytes[before..whole.position() as usize], format);
                messages.push(message);
            }
            Ok(None) => return messages,
            Err(error) => {
                assert_eq!(error.offset as usize, before);
                assert_eq!(whole.next_message(), Err(error), "an error is for ever");
                return messages;
            }
        }
    }
}

fn rewrite(message: &Message, read: &[u8], format: &Format) {
    let mut written = BytesMut::new();
    message.encode(&mut written);
    match message {
        Message::Hello(_) | Message::Accept(_) | Message::Refuse(_) | Message::Close(_) => {
            let mut decoder = Decoder::new(*format);
            decoder.push(&written);
            assert_eq!(decoder.next_message().as_ref(), Ok(&Some(message.clone())));
        }
        _ => assert_eq!(written, read),
    }
}

/// Any bytes, taken as calls to a writer, give frames that an assembler takes; and whatever the writer
/// refuses changes nothing.
pub fn frames(bytes: &[u8]) {
    let Some((size, calls)) = bytes.split_first() else { return };
    let batch = BatchSize::new(u32::from(*size)).unwrap_or_default();
    let mut writer = FrameWriter::new(batch);
    let mut assembler = FrameAssembler::new(u32::MAX);
    let (mut pushed, mut got) = (Vec::new(), Vec::new());
    for (at, call) in calls.iter().enumerate() {
        let mut sent = Vec::new();
        match call % 4 {
            0 => {
                let frame = FrameNumber(u32::from(call / 4));
                if writer.begin(frame).is_ok() {
                    assert_eq!(assembler.take(FrameStep::Begin(frame)), Ok(None));
                }
            }
            1 => {
                let items: Vec<u32> = (0..u32::from(call / 4)).map(|i| i << 8 | at as u32).collect();
                if writer.push(&items, |message| sent.push(message)).is_ok() {
                    pushed.extend(items);
                }
            }
            2 => {
                let _order = writer.flush(|message| sent.push(message));
            }
            _ => {
                let _order = writer.finish(|message| sent.push(message));
            }
        }
        for message in sent {
            let outcome = match message {
                FrameMessage::Batch(bytes) => {
                    let Ok(items) = Batch::<u32>::new(bytes) else { unreachable!("no batch was written") };
                    assert!(items.count() <= batch.items());
                    got.extend(items.iter());
                    assembler.take(FrameStep::Batch { items: items.count(), bytes: items.as_bytes() })
                }
                FrameMessage::End(end) => assembler.take(FrameStep::End(end)),
                other => unreachable!("{other:?}"),
            };
            match outcome {
                Ok(None) => {}
                Ok(Some(FrameOutcome::Complete(_))) => assert_eq!(got, pushed),
                other => unreachable!("{other:?}"),
            }
        }
    }
}
