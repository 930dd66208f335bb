//! The PNG files of a report: a frame's pictures by kind, and the name of each file.

use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use serde::Deserialize;

use super::schema::FramePictures;

/// A kind of picture of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PictureKind {
    /// The picture that RVG showed.
    Shown,
    /// The same LOD cut without culling.
    Unculled,
    /// Full detail without culling.
    Full,
}

/// The file of a frame's picture, relative to the report.
pub(super) fn file_name(frame: u32, kind: PictureKind) -> String {
    match kind {
        PictureKind::Shown => format!("frames/{frame:05}.png"),
        PictureKind::Unculled => format!("frames/{frame:05}.unculled.png"),
        PictureKind::Full => format!("frames/{frame:05}.full.png"),
    }
}

/// Whether a picture's file exists and is complete: an interrupted write may lack its end.
pub(super) fn is_whole(path: &Path) -> bool {
    const END: [u8; 8] = *b"IEND\xaeB`\x82";
    let end = || {
        let mut end = [0; END.len()];
        let mut file = File::open(path)?;
        file.seek(SeekFrom::End(-(END.len() as i64)))?;
        file.read_exact(&mut end)?;
        io::Result::Ok(end)
    };
    end().is_ok_and(|end| end == END)
}

/// The pictures of the report at `json`, if it exists. They are to be removed, so only names that
/// [`file_name`] makes are accepted.
pub(super) fn files_of_report(json: &Path) -> Vec<String> {
    #[derive(Deserialize)]
    struct Report {
        frames: Vec<Frame>,
    }
    #[derive(Deserialize)]
    struct Frame {
        frame: u32,
        pictures: FramePictures,
    }
    let Ok(text) = fs::read(json) else { return Vec::new() };
    let Ok(report) = serde_json::from_slice::<Report>(&text) else { return Vec::new() };
    let files = |Frame { frame, pictures: FramePictures { shown, unculled, full } }| {
        [(PictureKind::Shown, shown), (PictureKind::Unculled, unculled), (PictureKind::Full, full)]
            .into_iter()
            .filter_map(move |(kind, named)| named.filter(|named| *named == file_name(frame, kind)))
    };
    report.frames.into_iter().flat_map(files).collect()
}
