//! The file format: a magic number, a version, a length, the frames, and a checksum at the end.

use std::fs::{self, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tempfile::NamedTempFile;
use thiserror::Error;
use trimaran_proto::{Camera, CameraError, DrawableId, FrameNumber, SceneHash};
use xxhash_rust::xxh3::xxh3_64;

use super::{Trace, TraceFrame};

/// The magic number of a trace. The last byte stops programs that print it as text.
const MARK: [u8; 16] = *b"trimaran trace\n\x1a";
/// Magic number, version, and the length of the rest.
const HEAD: usize = 28;
/// The checksum.
const TAIL: usize = 8;

/// Why a trace cannot be read or written.
#[derive(Debug, Error)]
#[error("{}: {fault}", .path.display())]
pub struct TraceError {
    /// The file.
    pub path: PathBuf,
    /// The error.
    #[source]
    pub fault: TraceFault,
}

/// A fault of a trace.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TraceFault {
    /// A disk error.
    #[error("cannot be read or written")]
    Disk(#[from] io::Error),
    /// It is another kind of file.
    #[error("is not a recorded walk: give a file that `trimaran run --record` wrote")]
    Foreign,
    /// It was written by another version.
    #[error("is a trace of version {found}, and this program reads version {version}: record the walk again", version = Trace::VERSION)]
    Version {
        /// Its version.
        found: u32,
    },
    /// Its end is missing.
    #[error("is cut short: it has {found} of {expected} bytes; copy it again, or record the walk again")]
    CutShort {
        /// The bytes that are there.
        found: u64,
        /// The bytes that its header announces.
        expected: u64,
    },
    /// It has bytes after its end, or a wrong checksum.
    #[error("is damaged: its checksum does not hold; copy it again, or record the walk again")]
    Damaged,
    /// Its content cannot be decoded.
    #[error("is no trace, though its checksum holds")]
    Content(#[source] postcard::Error),
    /// It has no frame.
    #[error("has no frame: record the walk again")]
    Empty,
    /// A frame of it is invalid.
    #[error("its frame {frame} cannot be: {what}")]
    Frame {
        /// Its index.
        frame: usize,
        /// The error.
        what: &'static str,
    },
    /// A camera of it is invalid.
    #[error("its frame {frame} has no camera")]
    Camera {
        /// Its index.
        frame: usize,
        /// The cause.
        #[source]
        cause: CameraError,
    },
}

/// Whether a file that begins with `head` was meant to be a trace.
#[must_use]
pub fn looks_like_a_trace(head: &[u8]) -> bool {
    // A file shorter than the magic number, but equal to its beginning, is a trace cut short.
    let marked = head.len().min(MARK.len());
    marked > 0 && head.get(..marked) == MARK.get(..marked)
}

/// The frames as they are stored, by postcard.
#[derive(Serialize, Deserialize)]
struct Stored {
    scene: u128,
    size: [u32; 2],
    epsilon_px: f64,
    few_pixels: bool,
    batch: u32,
    frames: Vec<StoredFrame>,
}

#[derive(Serialize, Deserialize)]
struct StoredFrame {
    number: u32,
    eye: [f64; 3],
    orientation: [f64; 4],
    /// The tangent of half the vertical field of view, width over height, and the near distance.
    lens: [f32; 2],
    /// OR, HC, RVG.
    times_ns: [u64; 3],
    /// The first id, and the differences between consecutive ids.
    gaps: Vec<u32>,
    /// Differences: how many more ids, and how many nanoseconds later.
    found: Vec<(u32, u64)>,
}

/// A file in the same folder to replace `path` once it is written. Creates the folder if need be.
fn new_file(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or_else(|| Path::new("."));
    fs::create_dir_all(folder)?;
    tempfile::Builder::new().permissions(Permissions::from_mode(0o666)).tempfile_in(folder)
}

impl Trace {
    /// The version of the format: every change of the format increases it.
    pub const VERSION: u32 = 2;

    /// Writes the trace; replaces an older one atomically.
    ///
    /// # Errors
    /// When the disk fails.
    pub fn write(&self, path: &Path) -> Result<(), TraceError> {
        let at = |fault| TraceError { path: path.to_owned(), fault };
        let bytes = self.to_bytes().map_err(at)?;
        new_file(path)
            .and_then(|file| {
                fs::write(file.path(), bytes)?;
                file.persist(path).map_err(|failure| failure.error)
            })
            .map(drop)
            .map_err(|cause| at(cause.into()))
    }

    /// Checks, as far as possible, that a trace can be written to this path; creates its folder.
    ///
    /// # Errors
    /// The obstacle.
    pub fn check_path(path: &Path) -> Result<(), TraceError> {
        let at = |cause: io::Error| TraceError { path: path.to_owned(), fault: cause.into() };
        if path.is_dir() {
            return Err(at(io::ErrorKind::IsADirectory.into()));
        }
        new_file(path).map(drop).map_err(at)
    }

    /// Reads and checks a whole trace.
    ///
    /// # Errors
    /// When the disk fails or the file is anything but a whole trace.
    pub fn read(path: &Path) -> Result<Self, TraceError> {
        let bytes = fs::read(path).map_err(TraceFault::from);
        bytes
            .and_then(|bytes| Self::from_bytes(&bytes))
            .map_err(|fault| TraceError { path: path.to_owned(), fault })
    }

    /// The trace in the file's format.
    ///
    /// # Errors
    /// Only when memory runs out.
    pub fn to_bytes(&self) -> Result<Vec<u8>, TraceFault> {
        let stored = Stored {
            scene: self.scene.0,
            size: self.size,
            epsilon_px: self.epsilon_px,
            few_pixels: self.few_pixels,
            batch: self.batch,
            frames: self.frames.iter().map(StoredFrame::of).collect(),
        };
        let body = postcard::to_stdvec(&stored).map_err(TraceFault::Content)?;
        let mut bytes = Vec::with_capacity(HEAD + body.len() + TAIL);
        bytes.extend(MARK);
        bytes.extend(Self::VERSION.to_le_bytes());
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
        let sum = xxh3_64(&bytes);
        bytes.extend(sum.to_le_bytes());
        Ok(bytes)
    }

    /// Reads and checks a trace in the file's format.
    ///
    /// # Errors
    /// When these bytes are anything but a whole trace.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, TraceFault> {
        let found = bytes.len() as u64;
        if !looks_like_a_trace(bytes) {
            return Err(TraceFault::Foreign);
        }
        let least = (HEAD + TAIL) as u64;
        let Some((head, rest)) = bytes.split_first_chunk::<HEAD>() else {
            return Err(TraceFault::CutShort { found, expected: least });
        };
        let [.., v0, v1, v2, v3, l0, l1, l2, l3, l4, l5, l6, l7] = *head;
        match u32::from_le_bytes([v0, v1, v2, v3]) {
            Self::VERSION => {}
            other => return Err(TraceFault::Version { found: other }),
        }
        let expected = u64::from_le_bytes([l0, l1, l2, l3, l4, l5, l6, l7]).saturating_add(least);
        if found < expected {
            return Err(TraceFault::CutShort { found, expected });
        }
        let Some((body, sum)) = rest.split_last_chunk::<TAIL>() else { return Err(TraceFault::Damaged) };
        let summed = bytes.get(..bytes.len() - TAIL).unwrap_or_default();
        if found > expected || xxh3_64(summed) != u64::from_le_bytes(*sum) {
            return Err(TraceFault::Damaged);
        }
        let stored: Stored = postcard::from_bytes(body).map_err(TraceFault::Content)?;
        if stored.frames.is_empty() {
            return Err(TraceFault::Empty);
        }
        let frames = stored.frames.into_iter().enumerate();
        Ok(Self {
            scene: SceneHash(stored.scene),
            size: stored.size,
            epsilon_px: stored.epsilon_px,
            few_pixels: stored.few_pixels,
            batch: stored.batch,
            frames: frames.map(|(place, frame)| frame.into_frame(place)).collect::<Result<_, _>>()?,
        })
    }
}

impl StoredFrame {
    fn of(frame: &TraceFrame) -> Self {
        let ns = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let camera = &frame.camera;
        let before = std::iter::once(0).chain(frame.ids.iter().map(|id| id.0));
        let batches_before = std::iter::once((0, Duration::ZERO)).chain(frame.found.iter().copied());
        Self {
            number: camera.frame().0,
            eye: camera.eye(),
            orientation: camera.orientation(),
            lens: [camera.tan_half_fov_y(), camera.near()],
            times_ns: [ns(frame.or), ns(frame.hc), ns(frame.rvg)],
            gaps: frame.ids.iter().zip(before).map(|(id, before)| id.0.saturating_sub(before)).collect(),
            found: (frame.found.iter().zip(batches_before))
                .map(|((ids, at), (i, t))| (ids.saturating_sub(i), ns(at.saturating_sub(t))))
                .collect(),
        }
    }

    fn into_frame(self, frame: usize) -> Result<TraceFrame, TraceFault> {
        let wrong = |what| TraceFault::Frame { frame, what };
        let [tan, near] = self.lens;
        let camera = Camera::new(self.eye, self.orientation, tan, near, FrameNumber(self.number))
            .map_err(|cause| TraceFault::Camera { frame, cause })?;
        let mut ids = Vec::with_capacity(self.gaps.len());
        let mut last: Option<u32> = None;
        for gap in self.gaps {
            let id = match last {
                None => Some(gap),
                Some(last) => last.checked_add(gap).filter(|_| gap > 0),
            };
            let id = id.ok_or_else(|| wrong("its ids do not ascend"))?;
            ids.push(DrawableId(id));
            last = Some(id);
        }
        let (mut count, mut at) = (0_u32, 0_u64);
        let mut found = Vec::with_capacity(self.found.len());
        for (more, later) in self.found {
            count = count.checked_add(more).ok_or_else(|| wrong("it found too many ids"))?;
            at = at.checked_add(later).ok_or_else(|| wrong("it took too long"))?;
            found.push((count, Duration::from_nanos(at)));
        }
        if count as usize != ids.len() {
            return Err(wrong("it found more or fewer ids than it has"));
        }
        let [or, hc, rvg] = self.times_ns.map(Duration::from_nanos);
        Ok(TraceFrame { camera, or, hc, rvg, ids, found })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn frame(number: u32, ids: &[u32]) -> TraceFrame {
        let count = ids.len() as u32;
        TraceFrame {
            camera: Camera::at_origin(FrameNumber(number)),
            or: Duration::from_nanos(1),
            hc: Duration::from_micros(u64::from(count)),
            rvg: Duration::from_millis(7),
            ids: ids.iter().copied().map(DrawableId).collect(),
            found: vec![(count / 2, Duration::from_micros(1)), (count, Duration::from_micros(5))],
        }
    }

    fn trace(frames: Vec<TraceFrame>) -> Trace {
        let scene = SceneHash(0x1234_5678_9abc_def0_0fed_cba9_8765_4321);
        Trace { scene, size: [640, 480], epsilon_px: 2.0, few_pixels: false, batch: 16, frames }
    }

    fn sample() -> Trace {
        trace(vec![frame(0, &[0, 1, 7, 1000, u32::MAX]), frame(1, &[]), frame(2, &[5])])
    }

    #[test]
    fn a_trace_written_is_the_trace_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deeper/walk.trace");
        sample().write(&path).unwrap();
        assert_eq!(Trace::read(&path).unwrap(), sample());
    }

    #[test]
    fn a_cut_at_every_place_is_told_from_a_foreign_file() {
        let bytes = sample().to_bytes().unwrap();
        for cut in 1..bytes.len() {
            let fault = Trace::from_bytes(&bytes[..cut]).unwrap_err();
            assert!(matches!(fault, TraceFault::CutShort { .. }), "{cut}: {fault}");
        }
        for foreign in [&b""[..], b"{}", b"trimaran scene\n\x1a0000000000000000000000000000"] {
            assert!(matches!(Trace::from_bytes(foreign), Err(TraceFault::Foreign)));
        }
    }

    #[test]
    fn every_flipped_bit_is_noticed() {
        let bytes = sample().to_bytes().unwrap();
        for at in 0..8 * bytes.len() {
            let mut bytes = bytes.clone();
            bytes[at / 8] ^= 1 << (at % 8);
            assert!(Trace::from_bytes(&bytes).is_err(), "bit {at}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert!(matches!(Trace::from_bytes(&longer), Err(TraceFault::Damaged)));
    }

    #[test]
    fn what_cannot_be_is_refused_though_its_checksum_holds() {
        assert!(matches!(Trace::from_bytes(&trace(Vec::new()).to_bytes().unwrap()), Err(TraceFault::Empty)));
        let mut twice = frame(0, &[3, 3]);
        let bytes = trace(vec![twice.clone()]).to_bytes().unwrap();
        assert!(matches!(Trace::from_bytes(&bytes), Err(TraceFault::Frame { frame: 0, .. })));
        twice.ids.truncate(1); // and two are found
        let bytes = trace(vec![frame(0, &[]), twice]).to_bytes().unwrap();
        assert!(matches!(Trace::from_bytes(&bytes), Err(TraceFault::Frame { frame: 1, .. })));
    }

    #[test]
    fn an_error_names_the_file_and_what_to_do() {
        let error = Trace::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml")).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("Cargo.toml: ") && text.contains("trimaran run --record"), "{text}");
    }

    proptest! {
        #[test]
        fn any_ids_come_back(ids in prop::collection::btree_set(any::<u32>(), 0..200)) {
            let ids: Vec<u32> = ids.into_iter().collect();
            let trace = trace(vec![frame(9, &ids)]);
            prop_assert_eq!(Trace::from_bytes(&trace.to_bytes().unwrap()).unwrap(), trace);
        }
    }
}
