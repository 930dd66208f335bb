//! Every message, and how it is written.

use bytes::{BufMut, Bytes, BytesMut};
use serde::Serialize;

use crate::decode::DecodeFault;
use crate::header::Kind;
use crate::{
    Accept, Camera, CodedIds, FrameEnd, FrameMessage, FrameNumber, FrameStart, Goodbye, Hello, IdBatch,
    NumberedCamera, ProtocolVersion, Refusal,
};

/// The bytes that every hello starts with, in every version: they tell a peer from a stranger.
pub(crate) const MAGIC: [u8; 4] = *b"TRIM";

/// Anything that travels.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// Who connects.
    Hello(Hello),
    /// The hello was taken.
    Accept(Accept),
    /// The hello was not taken.
    Refuse(Refusal),
    /// The peer leaves.
    Goodbye(Goodbye),
    /// The peer has nothing to say, and lives.
    Alive,
    /// A camera on the latest lane.
    Camera(Camera),
    /// A camera on a latest lane that has no order of its own.
    Numbered(NumberedCamera),
    /// A message of the frames lane.
    Frame(FrameMessage),
    /// Ids on the frames lane, as changes.
    Coded(CodedIds),
}

impl Message {
    /// What the message is.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Hello(_) => Kind::Hello,
            Self::Accept(_) => Kind::Accept,
            Self::Refuse(_) => Kind::Refuse,
            Self::Goodbye(_) => Kind::Goodbye,
            Self::Alive => Kind::Alive,
            Self::Camera(_) => Kind::Camera,
            Self::Numbered(_) => Kind::Numbered,
            Self::Frame(FrameMessage::Begin(_)) => Kind::Begin,
            Self::Frame(FrameMessage::Ids(_)) => Kind::Ids,
            Self::Frame(FrameMessage::End(_)) => Kind::End,
            Self::Frame(FrameMessage::Stats(_)) => Kind::Stats,
            Self::Coded(_) => Kind::Coded,
        }
    }

    /// Appends the message with its header to `out`.
    pub fn encode(&self, out: &mut BytesMut) {
        match self {
            Self::Hello(hello) => {
                let mut prefix = [0; 6];
                prefix[..4].copy_from_slice(&MAGIC);
                prefix[4..].copy_from_slice(&ProtocolVersion::CURRENT.0.to_le_bytes());
                put_control(out, Kind::Hello, &prefix, hello);
            }
            Self::Accept(accept) => put_control(out, Kind::Accept, &[], accept),
            Self::Refuse(refusal) => {
                put_control(out, Kind::Refuse, &ProtocolVersion::CURRENT.0.to_le_bytes(), refusal);
            }
            Self::Goodbye(goodbye) => put_control(out, Kind::Goodbye, &[], goodbye),
            Self::Alive => out.put_slice(&Kind::Alive.header(0)),
            Self::Camera(camera) => {
                out.put_slice(&Kind::Camera.header(Camera::SIZE));
                out.put_slice(&camera.to_bytes());
            }
            Self::Numbered(numbered) => {
                out.put_slice(&Kind::Numbered.header(NumberedCamera::SIZE));
                out.put_slice(&numbered.to_bytes());
            }
            Self::Frame(FrameMessage::Begin(start)) => {
                out.put_slice(&Kind::Begin.header(4 + Camera::SIZE));
                out.put_u32_le(start.frame.0);
                out.put_slice(&start.camera.to_bytes());
            }
            Self::Frame(FrameMessage::Ids(batch)) => {
                out.put_slice(&Kind::Ids.header(batch.as_bytes().len()));
                out.put_slice(batch.as_bytes());
            }
            Self::Coded(coded) => {
                out.put_slice(&Kind::Coded.header(coded.as_bytes().len()));
                out.put_slice(coded.as_bytes());
            }
            Self::Frame(FrameMessage::Stats(stats)) => put_control(out, Kind::Stats, &[], stats),
            Self::Frame(FrameMessage::End(end)) => {
                out.put_slice(&Kind::End.header(16));
                out.put_u32_le(end.frame.0);
                out.put_u32_le(end.ids);
                out.put_u64_le(end.hash);
            }
        }
    }

    /// Reads the payload of a message of this kind; its length is one that the kind allows.
    pub(crate) fn parse(kind: Kind, payload: Bytes) -> Result<Self, DecodeFault> {
        match kind {
            Kind::Hello => parse_hello(&payload),
            Kind::Accept => parse_control(kind, &payload).map(Self::Accept),
            Kind::Refuse => parse_refusal(&payload),
            Kind::Goodbye => parse_control(kind, &payload).map(Self::Goodbye),
            Kind::Alive => Ok(Self::Alive),
            Kind::Camera => parse_camera(kind, &payload).map(Self::Camera),
            Kind::Numbered => {
                let bytes = payload.first_chunk().ok_or(DecodeFault::Short { kind })?;
                NumberedCamera::from_bytes(bytes)
                    .map(Self::Numbered)
                    .map_err(|cause| DecodeFault::Camera { kind, cause })
            }
            Kind::Begin => {
                let (frame, camera) = payload.split_first_chunk().ok_or(DecodeFault::Short { kind })?;
                let frame = FrameNumber(u32::from_le_bytes(*frame));
                let camera = parse_camera(kind, camera)?;
                Ok(Self::Frame(FrameMessage::Begin(FrameStart { frame, camera })))
            }
            Kind::Ids => IdBatch::new(payload)
                .map(|batch| Self::Frame(FrameMessage::Ids(batch)))
                .map_err(|cause| DecodeFault::Ids { cause }),
            Kind::Coded => Ok(Self::Coded(CodedIds::new(payload))),
            Kind::Stats => parse_control(kind, &payload).map(|stats| Self::Frame(FrameMessage::Stats(stats))),
            Kind::End => {
                let words: &[u8; 16] = payload.first_chunk().ok_or(DecodeFault::Short { kind })?;
                let word = u128::from_le_bytes(*words);
                let end = FrameEnd {
                    frame: FrameNumber(word as u32),
                    ids: (word >> 32) as u32,
                    hash: (word >> 64) as u64,
                };
                Ok(Self::Frame(FrameMessage::End(end)))
            }
        }
    }
}

/// Appends a header, the fixed bytes `prefix`, and `body` as postcard.
fn put_control(out: &mut BytesMut, kind: Kind, prefix: &[u8], body: &impl Serialize) {
    let start = out.len();
    out.put_slice(&[0; crate::HEADER_BYTES]);
    out.put_slice(prefix);
    // Control types hold integers, options and short strings only: writing them to memory cannot fail.
    if let Ok(body) = postcard::to_stdvec(body) {
        out.put_slice(&body);
    }
    let length = out.len() - start - crate::HEADER_BYTES;
    out[start..start + crate::HEADER_BYTES].copy_from_slice(&kind.header(length));
}

/// Reads a whole payload as postcard.
fn parse_control<T: serde::de::DeserializeOwned>(kind: Kind, payload: &[u8]) -> Result<T, DecodeFault> {
    let (value, rest) =
        postcard::take_from_bytes(payload).map_err(|cause| DecodeFault::Control { kind, cause })?;
    if rest.is_empty() { Ok(value) } else { Err(DecodeFault::Trailing { kind, bytes: rest.len() }) }
}

fn parse_hello(payload: &[u8]) -> Result<Message, DecodeFault> {
    let rest = payload.strip_prefix(&MAGIC).ok_or(DecodeFault::NotTrimaran)?;
    let (version, body) = rest.split_first_chunk().ok_or(DecodeFault::Short { kind: Kind::Hello })?;
    let theirs = ProtocolVersion(u16::from_le_bytes(*version));
    if theirs != ProtocolVersion::CURRENT {
        return Err(DecodeFault::Version { ours: ProtocolVersion::CURRENT, theirs });
    }
    parse_control(Kind::Hello, body).map(Message::Hello)
}

/// A refusal is for the connecting peer, so the version in it is the listener's.
fn parse_refusal(payload: &[u8]) -> Result<Message, DecodeFault> {
    let (version, body) = payload.split_first_chunk().ok_or(DecodeFault::Short { kind: Kind::Refuse })?;
    let listener = ProtocolVersion(u16::from_le_bytes(*version));
    let connector = ProtocolVersion::CURRENT;
    if listener != connector {
        return Ok(Message::Refuse(Refusal::Version { listener, connector }));
    }
    parse_control(Kind::Refuse, body).map(Message::Refuse)
}

fn parse_camera(kind: Kind, payload: &[u8]) -> Result<Camera, DecodeFault> {
    let bytes = payload.first_chunk().ok_or(DecodeFault::Short { kind })?;
    Camera::from_bytes(bytes).map_err(|cause| DecodeFault::Camera { kind, cause })
}
