//! What must hold for any bytes at all. The fuzz targets search for bytes that break it; an ordinary test of
//! `proto` replays the corpus.

use bytes::BytesMut;
use trimaran_proto::{
    BatchSize, Camera, Decoder, Delivery, DrawableId, FrameAssembler, FrameEvent, FrameMessage, FrameNumber,
    FrameOutcome, FrameStart, FrameWriter, IdDecoder, IdEncoder, Message,
};

/// Any bytes, whole or byte by byte, give the same messages and the same end; and each message that was read
/// is written again as it stood, unless it is a control message, whose varints may have been longer than
/// needed.
pub fn decode(bytes: &[u8]) {
    let mut whole = Decoder::new();
    whole.push(bytes);
    let mut slow = Decoder::new();
    let mut rest = bytes.iter();
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
            Ok(Some(message)) => rewrite(&message, &bytes[before..whole.position() as usize]),
            Ok(None) => return,
            Err(error) => {
                assert_eq!(whole.next_message(), Err(error), "an error is for ever");
                return;
            }
        }
    }
}

fn rewrite(message: &Message, read: &[u8]) {
    let mut written = BytesMut::new();
    message.encode(&mut written);
    match message {
        Message::Camera(_) => assert_eq!(written, read),
        Message::Frame(FrameMessage::Begin(_) | FrameMessage::Ids(_) | FrameMessage::End(_))
        | Message::Coded(_) => {
            assert_eq!(written, read);
        }
        _ => {
            let mut decoder = Decoder::new();
            decoder.push(&written);
            assert_eq!(decoder.next_message().as_ref(), Ok(&Some(message.clone())));
        }
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
                if let Some(camera) = camera(frame)
                    && let Ok(message) = writer.begin(FrameStart { frame, camera })
                {
                    sent.push(message);
                }
            }
            1 => {
                let ids: Vec<DrawableId> =
                    (0..u32::from(call / 4)).map(|i| DrawableId(i << 8 | at as u32)).collect();
                if writer.push(&ids, |message| sent.push(message)).is_ok() {
                    pushed.extend(ids);
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
            match assembler.take(message) {
                Ok(FrameEvent::Ids(ids)) => got.extend(ids.iter()),
                Ok(FrameEvent::End(outcome)) => {
                    assert!(matches!(outcome, FrameOutcome::Complete(_)), "{outcome:?}");
                    assert_eq!(got, pushed);
                }
                Ok(FrameEvent::Begin(_) | FrameEvent::Stats(_)) => {}
                Err(violation) => unreachable!("{violation}"),
            }
        }
    }
}

/// Any bytes, taken as what is sent over a lane: first a frame of the ids that the front names, then changes
/// against it. Whatever is read rises, fits a batch, and is written and read again as the same ids.
pub fn changes(bytes: &[u8]) {
    let Some((count, rest)) = bytes.split_first() else { return };
    let (gaps, payload) = rest.split_at(usize::from(*count).min(rest.len()));
    let mut next = 0_u32;
    let held: Vec<DrawableId> = gaps
        .iter()
        .map(|gap| {
            next += u32::from(*gap) + 1;
            DrawableId(next)
        })
        .collect();
    let (mut decoder, mut encoder) = (IdDecoder::new(u32::MAX), IdEncoder::new(Delivery::Ordered));
    let mut writer = FrameWriter::new(BatchSize::MAX);
    let mut first = Vec::new();
    first.extend(begin(&mut writer, 0));
    let _ = writer.push(&held, |message| first.push(message));
    let _ = writer.finish(|message| first.push(message));
    first.extend(begin(&mut writer, 1));
    for message in first {
        encoder.encode(decoder.plain(message));
    }
    let mut wire = Decoder::new();
    wire.push(&(0x24 | (payload.len() as u32) << 8).to_le_bytes());
    wire.push(payload);
    let Ok(Some(Message::Coded(coded))) = wire.next_message() else { return };
    let Ok(FrameMessage::Ids(batch)) = decoder.coded(&coded) else { return };
    let ids: Vec<DrawableId> = batch.iter().collect();
    assert!(ids.is_sorted_by(|a, b| a < b) && ids.len() <= BatchSize::MAX.ids());
    if let Message::Coded(again) = encoder.encode(FrameMessage::Ids(batch.clone())) {
        assert!(again.as_bytes().len() < batch.as_bytes().len());
        assert_eq!(decoder.coded(&again), Ok(FrameMessage::Ids(batch)));
    }
}

fn begin(writer: &mut FrameWriter, frame: u32) -> Option<FrameMessage> {
    let frame = FrameNumber(frame);
    writer.begin(FrameStart { frame, camera: camera(frame)? }).ok()
}

fn camera(frame: FrameNumber) -> Option<Camera> {
    Camera::new([0.0; 3], [0.0, 0.0, 0.0, 1.0], 1.0, 1.0, 0.1, frame).ok()
}
