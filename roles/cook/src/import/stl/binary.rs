//! Binary STL: a header of 80 bytes, a count, and records of 50 bytes.

use glam::DVec3;

use super::colour::Colours;
use super::{Solid, Solids, StlError};
use crate::import::report::WarningKind;

/// The bytes before the count.
const HEADER: usize = 80;
/// The bytes of a triangle: a normal, three corners, and two bytes that may be its colour.
const RECORD: usize = 50;

/// Whether a file with these bytes is an STL file of either form.
pub(in crate::import) fn is_stl(bytes: &[u8]) -> bool {
    // In text the four bytes of the count are letters; as a count they are a thousand million at least.
    let is_letter = |byte: &u8| matches!(byte, b'\t' | b'\n' | b'\r' | b' '..=b'~');
    let count = bytes.get(HEADER..HEADER + 4);
    is_text(bytes) || count.is_some_and(|count| !count.iter().all(is_letter))
}

/// Whether the text form may begin with these bytes; some binary files do as well.
fn is_text(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes).trim_ascii_start();
    bytes.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
}

/// A binary file.
pub(super) struct Binary<'b> {
    header: &'b [u8; HEADER],
    announced: u32,
    records: &'b [[u8; RECORD]],
    behind: &'b [u8],
}

impl<'b> Binary<'b> {
    /// The file as a binary one. A file that begins like text is one if its length fits its count, or if it
    /// has zeros where text has none.
    pub(super) fn of(bytes: &'b [u8]) -> Option<Self> {
        let (header, rest) = bytes.split_first_chunk::<HEADER>()?;
        let (count, rest) = rest.split_first_chunk::<4>()?;
        let (records, behind) = rest.as_chunks::<RECORD>();
        let binary = Self { header, announced: u32::from_le_bytes(*count), records, behind };
        let fits = binary.announced as usize == binary.records.len() && binary.behind.is_empty();
        (fits || !is_text(bytes) || header.contains(&0) || count.contains(&0)).then_some(binary)
    }

    /// Adds the triangles as one solid.
    pub(super) fn read(self, solids: &mut Solids<'_>) -> Result<(), StlError> {
        let Self { header, announced, records, behind } = self;
        let present = records.len();
        let is_placeholder = [0, u32::MAX].contains(&announced) && present > 0 && behind.is_empty();
        if announced as usize > present && !is_placeholder {
            return Err(StlError::Cut { announced, present });
        }
        let report = &mut solids.part.report;
        let records = if is_placeholder {
            report.warn_about(WarningKind::CountReplaced, &format!("{announced} for {present}"), 1);
            records
        } else {
            let taken = records.get(..announced as usize).unwrap_or(records);
            let behind = (present - taken.len()) * RECORD + behind.len();
            let detail = format!("{behind} bytes");
            report.warn_about(WarningKind::BehindLast, &detail, u64::from(behind > 0));
            taken
        };
        solids.count(solids.stem, records.len(), 3 * records.len())?;
        let colours = Colours::of(header, records.iter().map(attribute));
        let mut solid = Solid::default();
        for (number, record) in (1..).zip(records) {
            let colour = colours.of_facet(attribute(record));
            if let Err(what) = solids.facet(&mut solid, &corners(record), colour) {
                let number: u64 = number;
                solids.faces.note(|| format!("triangle {number}: {what}"));
            }
        }
        solids.add("", solid)?;
        Ok(())
    }
}

/// The corners of a record, behind its normal.
fn corners(record: &[u8; RECORD]) -> [DVec3; 3] {
    let mut values = record.as_chunks::<4>().0.iter().skip(3).map(|bytes| f32::from_le_bytes(*bytes));
    let mut value = || f64::from(values.next().unwrap_or(f32::NAN));
    [(); 3].map(|()| DVec3::new(value(), value(), value()))
}

/// The two bytes at the end of a record.
fn attribute(record: &[u8; RECORD]) -> u16 {
    record.last_chunk().map_or(0, |bytes| u16::from_le_bytes(*bytes))
}
