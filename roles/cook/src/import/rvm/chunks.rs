//! The chunks of a binary RVM file, read in sequence: a file is never in memory as a whole.
//!
//! A chunk is four letters (each in four bytes), the offset of the next chunk, a word of unknown use, and a
//! body. The offset has 32 bits and wraps in files of more than 4 GiB. A model may follow another one in the
//! same file; its offsets then count from its own beginning.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

use super::reader::Reader;
use super::{FilePosition, RvmError};

/// The first bytes of a file: the header of a chunk HEAD.
pub(super) const MAGIC: [u8; 16] = letters(*b"HEAD");

/// Bytes of a chunk's header.
const HEADER: u64 = 24;

/// Reads a file from one chunk to the next.
#[derive(Debug)]
pub(super) struct Chunks<S> {
    source: BufReader<S>,
    /// The source's position.
    position: u64,
    /// Where the next chunk begins.
    next: u64,
    length: u64,
    /// The beginning of the model: offsets count from there.
    base: u64,
    body: Vec<u8>,
}

/// A chunk's header.
#[derive(Debug, Clone, Copy)]
pub(super) struct Chunk {
    pub id: [u8; 4],
    /// Its first byte.
    pub at: u64,
    /// Bytes behind the header.
    body: u64,
}

impl<S: Read + Seek> Chunks<S> {
    pub(super) fn new(mut source: S) -> io::Result<Self> {
        let length = source.seek(SeekFrom::End(0))?;
        source.rewind()?;
        let source = BufReader::new(source);
        Ok(Self { source, position: 0, next: 0, length, base: 0, body: Vec::new() })
    }

    /// Bytes of the file.
    pub(super) const fn length(&self) -> u64 {
        self.length
    }

    /// The next chunk; none at the end of the file, or if only zeros follow.
    pub(super) fn next(&mut self) -> Result<Option<Chunk>, RvmError> {
        let at = self.next;
        self.go_to(at)?;
        let mut header = Vec::new();
        self.position += self.source.by_ref().take(HEADER).read_to_end(&mut header)? as u64;
        let words = header.as_chunks::<4>().0;
        let letters = |word: &[u8; 4]| if let [0, 0, 0, letter] = *word { Some(letter) } else { None };
        let id: Option<Vec<u8>> = words.iter().take(4).map(letters).collect();
        // The last chunk may be cut short, and its next offset may be anything.
        if id.as_ref().is_some_and(|id| id.starts_with(b"END")) {
            self.next = at + header.len() as u64;
            return Ok(Some(Chunk { id: *b"END:", at, body: 0 }));
        }
        let place = FilePosition::Byte(at);
        match (id.as_deref().and_then(|id| id.first_chunk()), words) {
            _ if header.iter().all(|&byte| byte == 0) && self.only_zeros_follow()? => Ok(None),
            (Some(&id), &[_, _, _, _, next, _]) if id != [0; 4] => {
                self.chunk(id, at, u32::from_be_bytes(next)).map(Some)
            }
            (_, words) if words.len() < 6 && id.is_some() => {
                Err(RvmError::Truncated { at: FilePosition::Byte(self.length), what: "a chunk's header" })
            }
            _ => Err(RvmError::Malformed { at: place, what: "a chunk does not begin with letters" }),
        }
    }

    /// The chunk at `at`, behind which the next one begins at byte `next`.
    fn chunk(&mut self, id: [u8; 4], at: u64, next: u32) -> Result<Chunk, RvmError> {
        let length = |base: u64| u64::from(next.wrapping_sub((at - base) as u32));
        if id == *b"HEAD" && (HEADER..length(0)).contains(&length(at)) {
            self.base = at;
        } else if id == *b"HEAD" {
            self.base = 0;
        }
        let length = length(self.base);
        if length < HEADER || at + length > self.length {
            let backwards = "a chunk says that the next one begins before its own end";
            return Err(if length < HEADER || u64::from(next) + self.base < at + HEADER {
                RvmError::Malformed { at: FilePosition::Byte(at), what: backwards }
            } else {
                RvmError::Truncated { at: FilePosition::Byte(self.length), what: "a chunk" }
            });
        }
        self.next = at + length;
        Ok(Chunk { id, at, body: length - HEADER })
    }

    /// The body of the chunk just returned.
    pub(super) fn body(&mut self, chunk: &Chunk) -> Result<Reader<'_>, RvmError> {
        self.go_to(chunk.at + HEADER)?;
        self.body.clear();
        self.position += self.source.by_ref().take(chunk.body).read_to_end(&mut self.body)? as u64;
        Ok(Reader::new(&self.body))
    }

    /// Continues at the next model after one's last chunk. Returns whether non-zero bytes were skipped.
    pub(super) fn skip_to_next_model(&mut self) -> Result<bool, RvmError> {
        // The version of the last chunk.
        self.next = (self.next + 4).min(self.length);
        self.go_to(self.next)?;
        let starts = [MAGIC, letters(*b"MODL")].map(u128::from_be_bytes);
        let (mut window, mut passed) = (u128::MAX, 0_u64);
        loop {
            let bytes = self.source.fill_buf()?;
            if bytes.is_empty() {
                self.next = self.position;
                return Ok(passed > 0);
            }
            for (number, &byte) in (1..).zip(bytes) {
                window = window << 8 | u128::from(byte);
                passed += u64::from(byte != 0);
                if starts.contains(&window) {
                    // All but the four letters.
                    self.next = self.position + number - 16;
                    return Ok(passed > 4);
                }
            }
            let read = bytes.len();
            self.source.consume(read);
            self.position += read as u64;
        }
    }

    fn only_zeros_follow(&mut self) -> io::Result<bool> {
        loop {
            let bytes = self.source.fill_buf()?;
            if bytes.iter().any(|&byte| byte != 0) {
                return Ok(false);
            }
            let read = bytes.len();
            if read == 0 {
                return Ok(true);
            }
            self.source.consume(read);
            self.position += read as u64;
        }
    }

    fn go_to(&mut self, target: u64) -> io::Result<()> {
        self.source.seek_relative(target as i64 - self.position as i64)?;
        self.position = target;
        Ok(())
    }
}

/// Letters in the encoding of a header.
const fn letters([a, b, c, d]: [u8; 4]) -> [u8; 16] {
    [0, 0, 0, a, 0, 0, 0, b, 0, 0, 0, c, 0, 0, 0, d]
}
