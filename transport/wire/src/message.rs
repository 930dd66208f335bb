//! Messages, and how they are written.

use bytes::{Buf, BufMut, Bytes, BytesMut};
use serde::Serialize;

use crate::{
    Accept, ChannelList, CloseReason, DecodeFault, FixedBytes, Format, FrameEnd, FrameMessage, FrameNumber,
    Hello, Kind, Numbered, Refusal, WireVersion, WireVersions, batch,
};

/// The first bytes of every hello, in every version: they distinguish a peer from a stranger.
pub(crate) const MAGIC: [u8; 4] = *b"TRIM";

/// Any message on the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Message {
    /// A connecting peer's hello.
    Hello(Hello),
    /// The hello was accepted.
    Accept(Accept),
    /// The hello was refused.
    Refuse(Refusal),
    /// The peer closes.
    Close(CloseReason),
    /// The peer is idle, but alive.
    KeepAlive,
    /// A value of the latest lane.
    Latest(FixedBytes),
    /// A value of a latest lane that has no order of its own.
    Numbered(Numbered),
    /// A message of the frames lane.
    Frame(FrameMessage),
    /// A message of the messages lane, encoded by postcard.
    Message(Bytes),
    /// A block of the bulk lane, which only the application understands.
    Block(Bytes),
}

impl From<FrameMessage> for Message {
    fn from(message: FrameMessage) -> Self {
        Self::Frame(message)
    }
}

impl From<CloseReason> for Message {
    fn from(reason: CloseReason) -> Self {
        Self::Close(reason)
    }
}

impl Message {
    /// The kind of the message.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Hello(hello) if !hello.channels.is_empty() => Kind::ChannelsHello,
            Self::Hello(_) => Kind::Hello,
            Self::Accept(accept) if accept.version.has_range() => Kind::VersionedAccept,
            Self::Accept(_) => Kind::Accept,
            Self::Refuse(_) => Kind::Refuse,
            Self::Close(_) => Kind::Close,
            Self::KeepAlive => Kind::KeepAlive,
            Self::Latest(_) => Kind::Latest,
            Self::Numbered(_) => Kind::Numbered,
            Self::Frame(message) => message.kind(),
            Self::Message(_) => Kind::Message,
            Self::Block(_) => Kind::Block,
        }
    }

    /// Appends the message with its header to `out`.
    pub fn encode(&self, out: &mut BytesMut) {
        with_header(out, self.kind(), |out| self.put_payload(out));
    }

    fn put_payload(&self, out: &mut BytesMut) {
        match self {
            Self::Hello(hello) => {
                let Hello { versions, protocol, session, lane, idle_timeout, channels, application } = hello;
                out.put_slice(&MAGIC);
                out.put_u16_le(versions.highest.0);
                if versions.highest.has_range() {
                    out.put_u16_le(versions.lowest.0);
                }
                put_control(out, &(protocol, session, lane, idle_timeout));
                if !channels.is_empty() {
                    put_control(out, channels);
                }
                out.put_slice(application);
            }
            Self::Accept(Accept { version, idle_timeout, application }) => {
                if self.kind() == Kind::VersionedAccept {
                    out.put_u16_le(version.0);
                }
                put_control(out, idle_timeout);
                out.put_slice(application);
            }
            Self::Refuse(refusal) => {
                // It may be written before the hello has come.
                out.put_u16_le(WireVersion::LOWEST.0);
                put_control(out, refusal);
            }
            Self::Close(reason) => put_control(out, reason),
            Self::KeepAlive => {}
            Self::Latest(value) => out.put_slice(value),
            Self::Numbered(numbered) => numbered.write(out),
            Self::Frame(message) => message.put_payload(out),
            Self::Message(bytes) | Self::Block(bytes) => out.put_slice(bytes),
        }
    }

    /// Reads the payload of a message of this kind; its length is one that the kind allows.
    pub(crate) fn parse(kind: Kind, payload: Bytes, format: &Format) -> Result<Self, DecodeFault> {
        let short = DecodeFault::Short { kind };
        match kind {
            Kind::Hello | Kind::ChannelsHello => parse_hello(kind, payload),
            Kind::Accept => parse_accept(kind, WireVersion::WITHOUT_RANGE, payload),
            Kind::VersionedAccept => {
                let (version, body) = take_version(kind, payload)?;
                if !WireVersions::SUPPORTED.contains(version) || !version.has_range() {
                    return Err(unsupported(WireVersions::only(version)));
                }
                parse_accept(kind, version, body)
            }
            Kind::Refuse => parse_refusal(payload),
            Kind::Close => parse_control(kind, &payload).map(Self::Close),
            Kind::KeepAlive => Ok(Self::KeepAlive),
            Kind::Latest => Ok(Self::Latest(payload.as_ref().into())),
            Kind::Numbered => Numbered::read(&payload, format.latest).map(Self::Numbered).ok_or(short),
            Kind::Begin => {
                let (frame, header) = payload.split_first_chunk().ok_or(short)?;
                let frame = FrameNumber(u32::from_le_bytes(*frame));
                Ok(Self::Frame(FrameMessage::Begin { frame, header: header.into() }))
            }
            Kind::Batch => {
                batch::check(payload.len(), format.item).map_err(|cause| DecodeFault::Batch { cause })?;
                Ok(Self::Frame(FrameMessage::Batch(payload)))
            }
            Kind::Coded => Ok(Self::Frame(FrameMessage::Coded(payload))),
            Kind::Message => Ok(Self::Message(payload)),
            Kind::Block => Ok(Self::Block(payload)),
            Kind::End => {
                let words: &[u8; 16] = payload.first_chunk().ok_or(short)?;
                let word = u128::from_le_bytes(*words);
                let end = FrameEnd {
                    frame: FrameNumber(word as u32),
                    items: (word >> 32) as u32,
                    hash: (word >> 64) as u64,
                };
                Ok(Self::Frame(FrameMessage::End(end)))
            }
        }
    }
}

impl FrameMessage {
    /// The kind of the message.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Begin { .. } => Kind::Begin,
            Self::Batch(_) => Kind::Batch,
            Self::Coded(_) => Kind::Coded,
            Self::End(_) => Kind::End,
        }
    }

    /// The bytes of its payload.
    #[must_use]
    pub fn payload(&self) -> usize {
        match self {
            Self::Begin { header, .. } => 4 + header.len(),
            Self::Batch(bytes) | Self::Coded(bytes) => bytes.len(),
            Self::End(_) => 16,
        }
    }

    /// Appends the message with its header to `out`.
    pub fn encode(&self, out: &mut BytesMut) {
        with_header(out, self.kind(), |out| self.put_payload(out));
    }

    fn put_payload(&self, out: &mut BytesMut) {
        match self {
            Self::Begin { frame, header } => {
                out.put_u32_le(frame.0);
                out.put_slice(header);
            }
            Self::Batch(bytes) | Self::Coded(bytes) => out.put_slice(bytes),
            Self::End(end) => {
                out.put_u32_le(end.frame.0);
                out.put_u32_le(end.items);
                out.put_u64_le(end.hash);
            }
        }
    }
}

/// Appends the output of `write`, with the header before it.
fn with_header(out: &mut BytesMut, kind: Kind, write: impl FnOnce(&mut BytesMut)) {
    let start = out.len();
    out.put_slice(&[0; crate::HEADER_BYTES]);
    write(out);
    let length = out.len() - start - crate::HEADER_BYTES;
    out[start..start + crate::HEADER_BYTES].copy_from_slice(&kind.header(length));
}

/// Appends `body` as postcard.
fn put_control(out: &mut BytesMut, body: &impl Serialize) {
    // Control types hold only integers, options and short strings, so writing them to memory cannot fail.
    if let Ok(body) = postcard::to_stdvec(body) {
        out.put_slice(&body);
    }
}

/// Reads the beginning of a payload as postcard. Returns the rest as well.
fn take_control<T: serde::de::DeserializeOwned>(
    kind: Kind,
    mut payload: Bytes,
) -> Result<(T, Bytes), DecodeFault> {
    let (value, rest) =
        postcard::take_from_bytes(&payload).map_err(|cause| DecodeFault::Control { kind, cause })?;
    let taken = payload.len() - rest.len();
    payload.advance(taken);
    Ok((value, payload))
}

/// Reads a whole payload as postcard.
fn parse_control<T: serde::de::DeserializeOwned>(kind: Kind, payload: &[u8]) -> Result<T, DecodeFault> {
    let (value, rest) =
        postcard::take_from_bytes(payload).map_err(|cause| DecodeFault::Control { kind, cause })?;
    if rest.is_empty() { Ok(value) } else { Err(DecodeFault::Trailing { kind, bytes: rest.len() }) }
}

/// Reads the beginning of a payload as a version. Returns the rest as well.
fn take_version(kind: Kind, mut payload: Bytes) -> Result<(WireVersion, Bytes), DecodeFault> {
    let version = payload.try_get_u16_le().map_err(|_| DecodeFault::Short { kind })?;
    Ok((WireVersion(version), payload))
}

const fn unsupported(theirs: WireVersions) -> DecodeFault {
    DecodeFault::Version { ours: WireVersions::SUPPORTED, theirs }
}

fn parse_hello(kind: Kind, mut payload: Bytes) -> Result<Message, DecodeFault> {
    if !payload.starts_with(&MAGIC) {
        return Err(DecodeFault::NotTrimaran);
    }
    payload.advance(MAGIC.len());
    let (highest, mut body) = take_version(kind, payload)?;
    let mut versions = WireVersions::only(highest);
    if highest.has_range() {
        (versions.lowest, body) = take_version(kind, body)?;
    }
    // The rest has the layout of the lowest version, or of 5 if that is higher: one that this side knows.
    if WireVersions::SUPPORTED.in_common(versions).is_none() {
        return Err(unsupported(versions));
    }
    let ((protocol, session, lane, idle_timeout), rest) = take_control(kind, body)?;
    let (channels, application) =
        if kind == Kind::ChannelsHello { take_control(kind, rest)? } else { (ChannelList::default(), rest) };
    Ok(Message::Hello(Hello { versions, protocol, session, lane, idle_timeout, channels, application }))
}

/// Reads an accept behind its version.
fn parse_accept(kind: Kind, version: WireVersion, body: Bytes) -> Result<Message, DecodeFault> {
    let (idle_timeout, application) = take_control(kind, body)?;
    Ok(Message::Accept(Accept { version, idle_timeout, application }))
}

/// A refusal has the layout of the listener's lowest version.
fn parse_refusal(payload: Bytes) -> Result<Message, DecodeFault> {
    let (layout, body) = take_version(Kind::Refuse, payload)?;
    let refusal = match parse_control(Kind::Refuse, &body) {
        // The same in every version from 5 on.
        Ok(refusal @ Refusal::Version { .. }) => refusal,
        // Version 4 names one version of each side, and later ones may be laid out otherwise.
        _ if body.first() == Some(&0) || !WireVersions::SUPPORTED.contains(layout) => {
            let (listener, connector) = (WireVersions::only(layout), WireVersions::SUPPORTED);
            Refusal::Version { listener, connector }
        }
        other => other?,
    };
    Ok(Message::Refuse(refusal))
}
