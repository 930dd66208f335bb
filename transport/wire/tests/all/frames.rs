//! A frame's order and size, checked by its writer and its reader.

use trimaran_wire::{
    BatchSize, FrameAssembler, FrameEnd, FrameMessage, FrameNumber, FrameOrderError, FrameOutcome, FrameStep,
    FrameViolation, FrameWriter,
};

const THREE: FrameNumber = FrameNumber(3);
const FOUR: FrameNumber = FrameNumber(4);

fn writer(batch: u32) -> FrameWriter<u32> {
    FrameWriter::new(BatchSize::new(batch).unwrap())
}

fn items(count: u32) -> Vec<u32> {
    (0..count).collect()
}

/// Both ends count, for one batch or many.
#[test]
fn a_frame_of_more_items_than_it_may_have_is_refused_at_both_ends() {
    for batch in [1, 3, 16_384] {
        let mut writer = writer(batch).of_at_most(10);
        let mut sent = Vec::new();
        writer.begin(THREE).unwrap();
        writer.push(&items(8), |message| sent.push(message)).unwrap();
        let one_too_many = writer.push(&items(3), |_| panic!("nothing of it is sent"));
        assert_eq!(one_too_many, Err(FrameOrderError::TooMany { frame: THREE, most: 10 }));
        writer.push(&items(2), |message| sent.push(message)).unwrap();
        writer.finish(|message| sent.push(message)).unwrap();

        let taken = |most| {
            let mut assembler = FrameAssembler::new(most);
            assembler.take(FrameStep::Begin(THREE))?;
            sent.iter().try_fold(None, |_, message| {
                assembler.take(match message {
                    FrameMessage::Batch(bytes) => FrameStep::Batch { items: bytes.len() / 4, bytes },
                    FrameMessage::End(end) => FrameStep::End(*end),
                    other => panic!("{other:?}"),
                })
            })
        };
        assert!(matches!(taken(10), Ok(Some(FrameOutcome::Complete(_)))), "{batch}");
        assert_eq!(taken(9), Err(FrameViolation::Beyond { frame: THREE, most: 9 }), "{batch}");
    }
}

#[test]
fn a_full_batch_leaves_at_once_and_the_rest_at_a_flush_or_the_end() {
    let mut writer = writer(4);
    let sizes = |sent: &[FrameMessage]| sent.iter().map(FrameMessage::payload).collect::<Vec<_>>();
    let mut sent = Vec::new();
    writer.begin(THREE).unwrap();
    writer.push(&items(3), |message| sent.push(message)).unwrap();
    assert_eq!(sizes(&sent), []);
    writer.push(&items(6), |message| sent.push(message)).unwrap();
    assert_eq!(sizes(&sent), [16, 16]);
    writer.flush(|message| sent.push(message)).unwrap();
    writer.flush(|_| panic!("nothing is pending")).unwrap();
    assert_eq!(sizes(&sent), [16, 16, 4]);
    writer.push(&items(1), |message| sent.push(message)).unwrap();
    let end = writer.finish(|message| sent.push(message)).unwrap();
    assert_eq!(sizes(&sent), [16, 16, 4, 4, 16]);
    assert_eq!((end.frame, end.items), (THREE, 10));
    assert_eq!(sent.last(), Some(&FrameMessage::End(end)));
}

#[test]
fn a_writer_holds_its_caller_to_begin_push_and_finish() {
    let mut writer = writer(4);
    let none = |_| panic!("nothing is sent");
    assert_eq!(writer.push(&items(1), none), Err(FrameOrderError::NoneOpen));
    assert_eq!(writer.flush(none), Err(FrameOrderError::NoneOpen));
    assert_eq!(writer.finish(none), Err(FrameOrderError::NoneOpen));
    writer.begin(THREE).unwrap();
    assert_eq!(writer.begin(FOUR), Err(FrameOrderError::StillOpen { open: THREE, wanted: FOUR }));
    writer.finish(|_| ()).unwrap();
    assert_eq!(writer.begin(THREE), Err(FrameOrderError::NotRising { last: THREE, wanted: THREE }));
    writer.begin(FOUR).unwrap();
}

#[test]
fn an_assembler_names_what_a_peer_breaks() {
    let begin = FrameStep::Begin;
    let end = |frame, items| FrameStep::End(FrameEnd { frame, items, hash: 0 });
    let batch = FrameStep::Batch { items: 1, bytes: &[1, 2, 3, 4] };
    let received = xxhash_rust::xxh3::xxh3_64(&[1, 2, 3, 4]);
    for (steps, violation) in [
        (&[begin(THREE), begin(FOUR)][..], FrameViolation::BeginInsideFrame { open: THREE, begun: FOUR }),
        (&[begin(FOUR), begin(FOUR)], FrameViolation::BeginInsideFrame { open: FOUR, begun: FOUR }),
        (
            &[begin(THREE), batch, end(THREE, 2), begin(THREE)],
            FrameViolation::NotRising { last: THREE, begun: THREE },
        ),
        (&[batch], FrameViolation::ItemsOutsideFrame { count: 1 }),
        (&[end(THREE, 0)], FrameViolation::EndOutsideFrame { ended: THREE }),
        (&[begin(THREE), end(FOUR, 0)], FrameViolation::EndOfOtherFrame { open: THREE, ended: FOUR }),
        (
            &[begin(THREE), batch, batch, end(THREE, 1)],
            FrameViolation::TooMany { frame: THREE, announced: 1, received: 2 },
        ),
        (
            &[begin(THREE), batch, end(THREE, 1)],
            FrameViolation::Hash { frame: THREE, announced: 0, received },
        ),
    ] {
        let mut assembler = FrameAssembler::new(u32::MAX);
        let (last, before) = steps.split_last().unwrap();
        for step in before {
            assembler.take(*step).unwrap();
        }
        assert_eq!(assembler.take(*last), Err(violation), "{violation}");
    }
}

#[test]
fn a_frame_is_open_from_its_begin_to_its_end() {
    let mut assembler = FrameAssembler::new(0);
    let end = FrameEnd { frame: THREE, items: 0, hash: xxhash_rust::xxh3::xxh3_64(&[]) };
    assert_eq!(assembler.open_frame(), None);
    assembler.take(FrameStep::Begin(THREE)).unwrap();
    assert_eq!(assembler.open_frame(), Some(THREE));
    assert_eq!(assembler.take(FrameStep::End(end)), Ok(Some(FrameOutcome::Complete(end))));
    assert_eq!(assembler.open_frame(), None);
}

#[test]
fn frame_numbers_end() {
    assert_eq!(FrameNumber(7).next(), Some(FrameNumber(8)));
    assert_eq!(FrameNumber(u32::MAX).next(), None);
}
