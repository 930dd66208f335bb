//! Frames from one end to the other, and checks of their arrival.

use std::time::Duration;

use bytes::Bytes;
use trimaran_net::Instant;
use trimaran_udp::{Config, Connection, Received, Repair, UnitLane};
use trimaran_wire::{
    Batch, BatchSize, CloseReason, FixedBytes, Format, FrameAssembler, FrameMessage, FrameNumber,
    FrameOutcome, FrameStep, FrameWriter,
};

use super::changes::{Changes, count};
use super::network::{Network, Pair};

/// A value of the latest lane, or the header of a frame.
pub(crate) fn value(frame: u32) -> FixedBytes {
    frame.to_le_bytes().into_iter().cycle().take(72).collect()
}

pub(crate) fn items(count: u32) -> Vec<u32> {
    (0..count).map(|i| i.wrapping_mul(2_654_435_761)).collect()
}

/// A sender of frames.
pub(crate) struct Sender {
    writer: FrameWriter<u32>,
    /// The reference frames of batches, if they are coded.
    changes: Option<Changes>,
    /// Whether every frame arrives.
    reliable: bool,
}

impl Sender {
    pub(crate) fn new(config: Config) -> Self {
        let changes = config.coded.then(Changes::default);
        Self { writer: FrameWriter::new(config.batch), changes, reliable: config.frame_deadline.is_none() }
    }

    pub(crate) fn send(&mut self, end: &mut Connection, frame: u32, items: &[u32]) {
        let Self { writer, changes, reliable } = self;
        let newest = changes.as_ref().and_then(Changes::newest);
        let reference = if *reliable { newest } else { end.confirmed_frame(UnitLane::Frames) };
        let mut send = |message| {
            let coded = match (&changes, &message) {
                (Some(changes), FrameMessage::Batch(bytes)) => changes.encode(reference, bytes),
                _ => None,
            };
            end.send(&coded.map_or(message, FrameMessage::Coded));
        };
        writer.begin(FrameNumber(frame)).unwrap();
        send(FrameMessage::Begin { frame: FrameNumber(frame), header: value(frame) });
        writer.push(items, &mut send).unwrap();
        writer.finish(&mut send).unwrap();
        if let Some(changes) = changes {
            changes.remember(FrameNumber(frame), items);
        }
    }
}

/// Reads all available data; returns the complete frames' items.
pub(crate) struct Reader {
    assembler: FrameAssembler,
    /// The reference frames of batches.
    changes: Changes,
    /// How many batches came as changes.
    pub(crate) coded: usize,
    items: Vec<u32>,
    pub(crate) frames: Vec<Vec<u32>>,
    /// The frames with gaps, and how many items they should have had.
    pub(crate) gaps: Vec<(usize, u32)>,
    pub(crate) ended: Option<Received>,
    pub(crate) now: Instant,
    pub(crate) begun: Vec<Instant>,
    pub(crate) over: Vec<Instant>,
}

impl Default for Reader {
    fn default() -> Self {
        Self {
            assembler: FrameAssembler::new(u32::MAX),
            changes: Changes::default(),
            coded: 0,
            items: Vec::new(),
            frames: Vec::new(),
            gaps: Vec::new(),
            ended: None,
            now: Instant::from_nanos(0),
            begun: Vec::new(),
            over: Vec::new(),
        }
    }
}

impl Reader {
    /// The latencies of frames from their beginning to their end's arrival, rising.
    pub(crate) fn latencies(&self) -> Vec<Duration> {
        let mut latencies: Vec<_> =
            self.begun.iter().zip(&self.over).map(|(begun, over)| over.since(*begun)).collect();
        latencies.sort_unstable();
        latencies
    }

    pub(crate) fn read(&mut self, end: &mut Connection) {
        while let Some(item) = end.recv(UnitLane::Frames) {
            assert_eq!(self.ended, None, "nothing comes after the end");
            match item {
                Received::Frame(FrameMessage::Begin { frame, header }) => {
                    assert_eq!(header, value(frame.0));
                    self.assembler.take(FrameStep::Begin(frame)).unwrap();
                }
                Received::Frame(FrameMessage::Batch(bytes)) => self.take(bytes),
                Received::Frame(FrameMessage::Coded(bytes)) => {
                    self.coded += 1;
                    let plain = self.changes.decode(&bytes);
                    assert_eq!(count(&bytes), Some(plain.len() / 4));
                    self.take(plain);
                }
                Received::Frame(FrameMessage::End(end)) => {
                    let outcome = self.assembler.take(FrameStep::End(end)).unwrap();
                    match outcome.unwrap() {
                        FrameOutcome::Complete(_) => self.changes.remember(end.frame, &self.items),
                        FrameOutcome::Incomplete { expected, received, .. } => {
                            assert_eq!(received as usize, self.items.len());
                            self.gaps.push((self.frames.len(), expected));
                        }
                    }
                    self.over.push(self.now);
                    self.frames.push(std::mem::take(&mut self.items));
                }
                end => self.ended = Some(end),
            }
        }
    }

    fn take(&mut self, bytes: Bytes) {
        let batch = Batch::<u32>::new(bytes).unwrap();
        let step = FrameStep::Batch { items: batch.count(), bytes: batch.as_bytes() };
        self.assembler.take(step).unwrap();
        self.items.extend(batch.iter());
    }
}

/// Sends frames of these sizes and a close over `network`; all must arrive complete.
pub(crate) fn deliver(network: Network, config: Config, sizes: &[u32]) -> Pair {
    let (pair, reader) = converse(network, config, &of_sizes(sizes), Duration::ZERO);
    assert_eq!(reader.gaps, []);
    pair
}

/// Frames of these sizes.
pub(crate) fn of_sizes(sizes: &[u32]) -> Vec<Vec<u32>> {
    sizes.iter().map(|size| items(*size)).collect()
}

/// Sends frames, one after each `pause`, and a close. The end must arrive, and the items of each frame in
/// order, with gaps where the configuration allows them.
pub(crate) fn converse(
    network: Network,
    config: Config,
    frames: &[Vec<u32>],
    pause: Duration,
) -> (Pair, Reader) {
    let mut pair = Pair::new(network, config);
    let (mut sender, mut reader) = (Sender::new(config), Reader::default());
    let mut waiting = (0..).zip(frames);
    let end = Instant::from_nanos(0).after(Duration::from_secs(600));
    let mut newest = None;
    let mut next = Instant::from_nanos(0);
    loop {
        if pair.ends[0].is_writable(UnitLane::Frames) && pair.now >= next {
            next = pair.now.after(pause);
            match waiting.next() {
                Some((frame, items)) => {
                    pair.ends[0].publish(None, value(frame));
                    reader.begun.push(pair.now);
                    sender.send(&mut pair.ends[0], frame, items);
                    if frame as usize + 1 == frames.len() {
                        pair.ends[0].end_lane(UnitLane::Frames, CloseReason::new(0, "over"));
                    }
                }
                None if reader.ended.is_some() && pair.ends[0].is_drained() => break,
                None => {}
            }
        }
        assert!(
            pair.step_until(if next > pair.now { next } else { end }, end),
            "stuck at {:?}: {:?}, {} frames, {:?}",
            pair.now,
            pair.ends,
            reader.frames.len(),
            reader.ended
        );
        assert_eq!((pair.ends[0].closed(), pair.ends[1].closed()), (None, None));
        reader.now = pair.now;
        reader.read(&mut pair.ends[1]);
        newest = pair.ends[1].latest(None).or(newest);
    }
    assert_eq!(reader.ended, Some(Received::Closed(CloseReason::new(0, "over"))));
    assert_eq!(reader.frames.len(), frames.len());
    for (got, sent) in reader.frames.iter().zip(frames) {
        let mut all = sent.iter();
        assert!(
            got.iter().all(|item| all.any(|sent| sent == item)),
            "items that were not sent, or out of order"
        );
    }
    let whole = reader.frames.iter().zip(frames).filter(|(got, sent)| got == sent).count();
    assert_eq!(whole + reader.gaps.len(), frames.len(), "a frame is whole or known to have gaps");
    for (frame, expected) in &reader.gaps {
        assert!(config.frame_deadline.is_some() && *expected as usize == frames[*frame].len(), "{frame}");
        assert!(reader.frames[*frame].len() < *expected as usize);
    }
    assert_eq!(newest, frames.len().checked_sub(1).map(|last| value(last as u32)));
    (pair, reader)
}

/// Frames of 4,000 items, sixty a second, for `seconds`.
pub(crate) fn stream(network: Network, config: Config, seconds: usize) -> (Pair, Reader) {
    converse(network, config, &of_sizes(&vec![4000; 60 * seconds]), Duration::from_micros(16_667))
}

/// The defaults.
pub(crate) fn config() -> Config {
    Config::new(RELIABLE.format)
}

pub(crate) const DEADLINE: Config = Config { frame_deadline: Some(Duration::from_millis(40)), ..RELIABLE };
pub(crate) const RELIABLE: Config = Config {
    window: 4 << 20,
    send_buffer: 4 << 20,
    ack_delay: Duration::from_millis(1),
    idle_timeout: Duration::from_secs(20),
    frame_deadline: None,
    repair: Repair::Auto,
    repair_percent: 15,
    initial_window: 20,
    max_datagram: 1452,
    batch: BatchSize::MAX,
    coded: false,
    format: Format { latest: 72, header: 72, item: 4, count_coded: count, channels: &[] },
};
