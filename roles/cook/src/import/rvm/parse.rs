//! The binary form of an RVM file.
//!
//! Its chunks are HEAD and MODL first and END: last; between them CNTB opens a group and CNTE closes it, PRIM
//! is a primitive of the open group and COLR redefines a colour. A body opens with a version. After END:
//! there is padding, or another model.

use std::io::{Read, Seek};

use super::chunks::Chunks;
use super::file::{File, Order};
use super::reader::Reader;
use super::{FilePosition, RvmError};
use crate::import::report::WarningKind;

/// Reads chunks to the end of the source, and returns where that is.
pub(super) fn parse(source: impl Read + Seek, file: &mut File<'_>) -> Result<FilePosition, RvmError> {
    let mut chunks = Chunks::new(source)?;
    while let Some(chunk) = chunks.next()? {
        let at = FilePosition::Byte(chunk.at);
        match &chunk.id {
            b"HEAD" => {
                let encoding = encoding(&mut chunks.body(&chunk)?).unwrap_or_default();
                file.begin(&String::from_utf8_lossy(encoding))?;
            }
            b"MODL" => {}
            b"CNTB" => group(&mut chunks.body(&chunk)?, file, at)?,
            b"CNTE" => file.close()?,
            b"PRIM" => primitive(&mut chunks.body(&chunk)?, file, at),
            b"COLR" => match colour(&mut chunks.body(&chunk)?) {
                Some((number, colour)) => file.colour(number, colour),
                None => file.leave_out("COLR", "too short"),
            },
            b"END:" => {
                file.end()?;
                if chunks.skip_to_next_model()? {
                    file.report.warn(WarningKind::BehindEnd, 1);
                }
            }
            id => file.skip(&id.escape_ascii().to_string()),
        }
    }
    Ok(FilePosition::Byte(chunks.length()))
}

/// The last of a head's strings, if its version has it.
fn encoding<'a>(body: &mut Reader<'a>) -> Option<&'a [u8]> {
    let version = body.u32()?;
    // Program, note, date, user.
    for _ in 0..4 {
        body.string()?;
    }
    if version < 2 { None } else { body.string() }
}

fn group(body: &mut Reader<'_>, file: &mut File<'_>, at: FilePosition) -> Result<(), RvmError> {
    let version = body.u32().unwrap_or_default();
    let (name, material) = match body.string() {
        // It is followed by a reference point that no primitive depends on.
        Some(name) => (name, body.take(12).and_then(|_| body.u32())),
        // Its length is wrong; its letters may be right.
        None => (body.rest(), None),
    };
    let name = file.name(name);
    let transparency = if version < 3 || material.is_none() { None } else { body.take(1) };
    let transparency = transparency.and_then(|bytes| bytes.first().copied());
    file.open(&name, material, transparency.map(u32::from), at)
}

fn primitive(body: &mut Reader<'_>, file: &mut File<'_>, at: FilePosition) {
    // Without a version there is nothing left for the rest either.
    let _version = body.u32();
    file.primitive(body, Order::Columns, at);
}

fn colour(body: &mut Reader<'_>) -> Option<(u32, [u8; 3])> {
    body.u32()?;
    let number = body.u32()?;
    Some((number, *body.take(3)?.first_chunk()?))
}
