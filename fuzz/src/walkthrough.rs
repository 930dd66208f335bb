//! Properties of any bytes that come from a role of Trimaran. The fuzz targets search for bytes that
//! break it; an ordinary test of `proto` replays the corpus.

use bytes::Bytes;
use trimaran_proto::{
    BatchSize, Camera, DrawableId, FrameNumber, IdBatch, IdDecoder, IdEncoder, Identity, RoleMessage,
    ViewReader, Walkthrough,
};
use trimaran_wire::{
    Accept, BatchDecoder, BatchEncoder, Delivery, Fixed, Format, FrameEnd, FrameMessage, Hello, Item,
    Message, Protocol,
};

use crate::checks;

/// Bytes of messages are read or refused. A message that was read is written as the same bytes, or, where it
/// has varints, so that it reads the same.
pub fn decode(bytes: &[u8]) {
    for message in checks::decode(bytes, &Format::of::<Walkthrough>()) {
        match message {
            Message::Hello(Hello { application, .. }) | Message::Accept(Accept { application, .. }) => {
                reads_again::<Identity>(&application);
            }
            Message::Latest(camera) | Message::Frame(FrameMessage::Begin { header: camera, .. }) => {
                if let Ok(read) = Camera::read(&camera) {
                    assert_eq!(read.to_bytes()[..], camera[..]);
                }
            }
            Message::Message(said) => {
                reads_again::<RoleMessage>(&said);
                view(&said);
            }
            Message::Frame(FrameMessage::Coded(coded)) => {
                let most = BatchSize::MAX.items();
                assert!(Walkthrough::count_coded(&coded).is_none_or(|ids| (1..=most).contains(&ids)));
            }
            _ => {}
        }
    }
}

/// Where a message has a whole view state, that travels in parts and is read again as it was.
fn view(said: &[u8]) {
    let Ok(RoleMessage::View { version, part, .. }) = postcard::from_bytes(said) else { return };
    let Ok(Some(state)) = ViewReader::default().take(version, &part, true) else { return };
    let (mut reader, mut read) = (ViewReader::default(), None);
    for message in state.to_messages(version).unwrap_or_default() {
        if let RoleMessage::View { version, part, last } = message {
            assert_eq!(read, None);
            read = reader.take(version, &part, last).unwrap_or_default();
        }
    }
    assert_eq!(read, Some(state));
}

fn reads_again<T>(bytes: &[u8])
where
    T: serde::Serialize + serde::de::DeserializeOwned + PartialEq + std::fmt::Debug,
{
    if let Ok(value) = postcard::from_bytes::<T>(bytes) {
        let written = postcard::to_stdvec(&value);
        assert_eq!(written.and_then(|written| postcard::from_bytes(&written)), Ok(value));
    }
}

/// Any bytes, taken as what is sent over a lane: first a frame of the ids that the front names, then changes
/// against it. The ids that are read rise, fit a batch, are as many as stated, and are written and read again
/// as the same ones.
pub fn changes(bytes: &[u8]) {
    let Some((count, coded)) = bytes.split_first() else { return };
    let (gaps, coded) = coded.split_at(usize::from(*count).min(coded.len()));
    let mut next = 0_u32;
    let mut held = Vec::new();
    for gap in gaps {
        next += u32::from(*gap) + 1;
        held.extend(next.to_le_bytes());
    }
    let (mut decoder, mut encoder) = (IdDecoder::new(u32::MAX), IdEncoder::new(Delivery::Ordered));
    encoder.begin(FrameNumber(0));
    decoder.begin(FrameNumber(0));
    let items = (held.len() / DrawableId::SIZE) as u32;
    if let Ok(held) = IdBatch::new(Bytes::from(held)) {
        let _coded = encoder.encode(&held);
        decoder.plain(&held);
    }
    let end = FrameEnd { frame: FrameNumber(0), items, hash: 0 };
    encoder.end(&end);
    decoder.end(&end);
    encoder.begin(FrameNumber(1));
    decoder.begin(FrameNumber(1));

    let Ok(batch) = decoder.read(coded) else { return };
    let ids: Vec<DrawableId> = batch.iter().collect();
    assert!(ids.is_sorted_by(|a, b| a < b) && ids.len() <= BatchSize::MAX.items());
    assert_eq!(Walkthrough::count_coded(coded), Some(ids.len()));
    if let Some(again) = encoder.encode(&batch) {
        assert!(again.len() < batch.as_bytes().len());
        assert_eq!(Walkthrough::count_coded(&again), Some(ids.len()));
        assert_eq!(decoder.read(&again), Ok(batch));
    }
}
