//! From bytes to messages, for any split of the bytes and any contents.

use bytes::BytesMut;
use thiserror::Error;

use crate::kind::{HEADER_BYTES, Kind, parse_header};
use crate::{DecodeFault, Format, Message};

/// Bytes that are not this protocol.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("at byte {offset} of the stream: {fault}")]
pub struct DecodeError {
    /// Where the offending message starts, in bytes from the start of the stream.
    pub offset: u64,
    /// The fault of the message.
    #[source]
    pub fault: DecodeFault,
}

/// Finds the messages in a stream of bytes.
///
/// Feed it through [`Decoder::buffer`] or [`Decoder::push`], then call [`Decoder::next_message`] until it
/// returns `None`. Items are not copied: a batch shares the buffer's memory.
///
/// Memory: it holds the bytes fed and not yet taken. A header is checked as soon as its four bytes are there,
/// so nothing waits for an impossible length. A caller that takes all messages before reading on never holds
/// more than one largest batch and one read.
///
/// After an error the stream is lost, and each further call returns the same error.
#[derive(Debug)]
pub struct Decoder {
    format: Format,
    buffer: BytesMut,
    offset: u64,
    failed: Option<DecodeError>,
}

impl Decoder {
    /// A decoder at the start of a stream of values of these sizes.
    #[must_use]
    pub fn new(format: Format) -> Self {
        Self { format, buffer: BytesMut::new(), offset: 0, failed: None }
    }

    /// The messages that follow have values of these sizes.
    pub const fn set_format(&mut self, format: Format) {
        self.format = format;
    }

    /// The buffer to read into, with room for at least `room` more bytes. Only append to it.
    pub fn buffer(&mut self, room: usize) -> &mut BytesMut {
        self.buffer.reserve(room);
        &mut self.buffer
    }

    /// Appends bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// The bytes of an incomplete message: 0 where the stream may end.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.buffer.len()
    }

    /// The bytes of the messages taken so far, headers included.
    #[must_use]
    pub const fn position(&self) -> u64 {
        self.offset
    }

    /// Takes the next whole message; `None` if more bytes are needed.
    ///
    /// # Errors
    /// If the bytes are not this protocol.
    pub fn next_message(&mut self) -> Result<Option<Message>, DecodeError> {
        if let Some(error) = &self.failed {
            return Err(error.clone());
        }
        self.step().map_err(|fault| {
            let error = DecodeError { offset: self.offset, fault };
            self.failed = Some(error.clone());
            error
        })
    }

    fn step(&mut self) -> Result<Option<Message>, DecodeFault> {
        let Some(header) = self.buffer.first_chunk::<HEADER_BYTES>() else { return Ok(None) };
        let (code, length) = parse_header(*header);
        let kind = Kind::from_code(code).ok_or(DecodeFault::UnknownKind { code })?;
        let lengths = kind.lengths(&self.format);
        if !lengths.contains(&length) {
            let (least, most) = lengths.into_inner();
            return Err(DecodeFault::Length { kind, length, least, most });
        }
        if self.buffer.len() < HEADER_BYTES + length {
            return Ok(None);
        }
        let mut whole = self.buffer.split_to(HEADER_BYTES + length);
        let message = Message::parse(kind, whole.split_off(HEADER_BYTES).freeze(), &self.format)?;
        self.offset += (HEADER_BYTES + length) as u64;
        Ok(Some(message))
    }
}
