//! Frames from one end to the other, and what must come of them.

use std::time::Duration;

use trimaran_net::Instant;
use trimaran_proto::{
    BatchSize, Camera, Delivery, DrawableId, FrameAssembler, FrameEvent, FrameNumber, FrameOutcome,
    FrameStart, FrameWriter, Goodbye, IdCoding, IdDecoder, IdEncoder, Message,
};
use trimaran_udp::{Config, Congestion, Connection, Received, Repair};

use crate::network::{Network, Pair};

pub(crate) fn camera(frame: u32) -> Camera {
    Camera::new([f64::from(frame), 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], 0.5, 1.5, 0.1, FrameNumber(frame))
        .unwrap()
}

pub(crate) fn ids(count: u32) -> Vec<DrawableId> {
    (0..count).map(|i| DrawableId(i.wrapping_mul(2_654_435_761))).collect()
}

/// A sender of frames.
pub(crate) struct Sender {
    writer: FrameWriter,
    encoder: Option<IdEncoder>,
}

impl Sender {
    pub(crate) fn new(config: Config) -> Self {
        let delivery = if config.patience.is_none() { Delivery::Ordered } else { Delivery::Lossy };
        let encoder = (config.coding == IdCoding::Changes).then(|| IdEncoder::new(delivery));
        Self { writer: FrameWriter::new(config.batch), encoder }
    }

    pub(crate) fn send(&mut self, end: &mut Connection, frame: u32, ids: &[DrawableId]) {
        if let (Some(encoder), Some(confirmed)) = (&mut self.encoder, end.confirmed_frame()) {
            encoder.confirm(confirmed);
        }
        let Self { writer, encoder } = self;
        let mut send = |message| {
            let message = match encoder {
                Some(encoder) => encoder.encode(message),
                None => Message::Frame(message),
            };
            match message {
                Message::Coded(batch) => end.send_coded(batch),
                Message::Frame(message) => end.send(message),
                other => panic!("{other:?}"),
            }
        };
        let start = FrameStart { frame: FrameNumber(frame), camera: camera(frame) };
        send(writer.begin(start).unwrap());
        writer.push(ids, &mut send).unwrap();
        writer.finish(&mut send).unwrap();
    }
}

/// Reads what is there; gives the complete frames' ids.
pub(crate) struct Reader {
    assembler: FrameAssembler,
    decoder: IdDecoder,
    /// How many batches came as changes.
    pub(crate) coded: usize,
    ids: Vec<DrawableId>,
    pub(crate) frames: Vec<Vec<DrawableId>>,
    /// Which frames had gaps, and how many ids they should have had.
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
            decoder: IdDecoder::new(u32::MAX),
            coded: 0,
            ids: Vec::new(),
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
    /// How long frames took from their beginning to their end's arrival, rising.
    pub(crate) fn latencies(&self) -> Vec<Duration> {
        let mut latencies: Vec<_> =
            self.begun.iter().zip(&self.over).map(|(begun, over)| over.since(*begun)).collect();
        latencies.sort_unstable();
        latencies
    }

    pub(crate) fn read(&mut self, end: &mut Connection) {
        while let Some(item) = end.recv() {
            assert_eq!(self.ended, None, "nothing comes after the end");
            let message = match item {
                Received::Frame(message) => self.decoder.plain(message),
                Received::Coded(batch) => {
                    self.coded += 1;
                    self.decoder.coded(&batch).unwrap()
                }
                end => {
                    self.ended = Some(end);
                    continue;
                }
            };
            match self.assembler.take(message).unwrap() {
                FrameEvent::Ids(batch) => self.ids.extend(batch.iter()),
                FrameEvent::End(FrameOutcome::Complete(_)) => {
                    self.over.push(self.now);
                    self.frames.push(std::mem::take(&mut self.ids));
                }
                FrameEvent::End(FrameOutcome::Incomplete { expected, received, .. }) => {
                    assert_eq!(received as usize, self.ids.len());
                    self.over.push(self.now);
                    self.gaps.push((self.frames.len(), expected));
                    self.frames.push(std::mem::take(&mut self.ids));
                }
                FrameEvent::Begin(_) | FrameEvent::Stats(_) => {}
            }
        }
    }
}

/// Sends frames of these sizes and a goodbye over `network`; all must arrive whole.
pub(crate) fn deliver(network: Network, config: Config, sizes: &[u32]) -> Pair {
    let (pair, reader) = converse(network, config, &of_sizes(sizes), Duration::ZERO);
    assert_eq!(reader.gaps, []);
    pair
}

/// Frames of these sizes.
pub(crate) fn of_sizes(sizes: &[u32]) -> Vec<Vec<DrawableId>> {
    sizes.iter().map(|size| ids(*size)).collect()
}

/// Sends frames, one after each `pause`, and a goodbye. The end must arrive, and of each frame its ids in
/// order, with gaps where the configuration allows them.
pub(crate) fn converse(
    network: Network,
    config: Config,
    frames: &[Vec<DrawableId>],
    pause: Duration,
) -> (Pair, Reader) {
    let mut pair = Pair::new(network, config);
    let (mut sender, mut reader) = (Sender::new(config), Reader::default());
    let mut waiting = (0..).zip(frames);
    let end = Instant::from_nanos(0).after(Duration::from_secs(600));
    let mut newest = None;
    let mut next = Instant::from_nanos(0);
    loop {
        if pair.ends[0].is_writable() && pair.now >= next {
            next = pair.now.after(pause);
            match waiting.next() {
                Some((frame, ids)) => {
                    pair.ends[0].publish(camera(frame));
                    reader.begun.push(pair.now);
                    sender.send(&mut pair.ends[0], frame, ids);
                    if frame as usize + 1 == frames.len() {
                        pair.ends[0].goodbye(Goodbye::Finished);
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
        newest = pair.ends[1].latest().map(|camera| camera.frame()).or(newest);
    }
    assert_eq!(reader.ended, Some(Received::Goodbye(Goodbye::Finished)));
    assert_eq!(reader.frames.len(), frames.len());
    for (got, sent) in reader.frames.iter().zip(frames) {
        let mut all = sent.iter();
        assert!(got.iter().all(|id| all.any(|sent| sent == id)), "ids that were not sent, or out of order");
    }
    let whole = reader.frames.iter().zip(frames).filter(|(got, sent)| got == sent).count();
    assert_eq!(whole + reader.gaps.len(), frames.len(), "a frame is whole or known to have gaps");
    for (frame, expected) in &reader.gaps {
        assert!(config.patience.is_some() && *expected as usize == frames[*frame].len(), "{frame}");
        assert!(reader.frames[*frame].len() < *expected as usize);
    }
    assert_eq!(newest, frames.len().checked_sub(1).map(|last| FrameNumber(last as u32)));
    (pair, reader)
}

/// Frames of 4,000 ids, sixty a second, for `seconds`.
pub(crate) fn stream(network: Network, config: Config, seconds: usize) -> (Pair, Reader) {
    converse(network, config, &of_sizes(&vec![4000; 60 * seconds]), Duration::from_micros(16_667))
}

pub(crate) const DEADLINE: Config = Config { patience: Some(Duration::from_millis(40)), ..RELIABLE };
pub(crate) const RELIABLE: Config = Config {
    window: 4 << 20,
    send_buffer: 4 << 20,
    ack_delay: Duration::from_millis(1),
    lease: Duration::from_secs(20),
    patience: None,
    repair: Repair::Auto,
    repair_percent: 15,
    congestion: Congestion::Cubic,
    initial_window: 20,
    max_datagram: 1452,
    batch: BatchSize::MAX,
    coding: IdCoding::Plain,
};
