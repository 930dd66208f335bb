//! Puts a report on disk: what is recorded as it comes, and the report itself whole or not at all.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::html::{self, Exhibit};
use super::metrics::Picture;
use super::png::Rgb;
use super::schema::{Frame, FramePictures, Report};
use super::unfinished::Unfinished;

/// Which picture of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PictureKind {
    /// What RVG showed.
    Shown,
    /// The same level cut without culling.
    Unculled,
    /// Full detail without culling.
    Full,
}

/// Where a report lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Paths {
    /// `report.json`.
    pub json: PathBuf,
    /// `report.html`.
    pub html: PathBuf,
    /// The folder of the PNG files.
    pub frames: PathBuf,
}

/// Why a report could not be written. An older one is still there, whole, unless the error is about `moving`.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file or folder could not be read or written.
    #[error("{doing} {} failed{}", path.display(), advice(source))]
    Io {
        /// What was being done.
        doing: &'static str,
        /// To which file or folder.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Another walk writes into the same folder.
    #[error(
        "another process writes a report into {}; wait for its end, or give another folder with --out",
        path.display()
    )]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// A picture could not be encoded.
    #[error("encoding the picture {} failed", path.display())]
    Encode {
        /// The file it was meant for.
        path: PathBuf,
        /// What the encoder says.
        source: png::EncodingError,
    },
    /// A picture just written could not be read back for the page.
    #[error("reading the picture {} back failed; is something else writing there?", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        source: png::DecodingError,
    },
    /// The report could not be made JSON.
    #[error("the report could not be written as JSON")]
    Json(#[from] serde_json::Error),
}

impl ReportError {
    /// Whether it may work another time though nothing is changed in what was asked for: a full disk, or a
    /// folder that is in use.
    #[must_use]
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Busy { .. } => true,
            Self::Io { source, .. } => {
                matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
            }
            _ => false,
        }
    }
}

/// What to do about it.
fn advice(source: &io::Error) -> &'static str {
    match source.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => {
            ": no space left; free some, or give another folder with --out"
        }
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            ": not permitted; give a folder that you may write to with --out"
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists => {
            ": a file is in the way; give another folder with --out"
        }
        _ => "",
    }
}

/// Writes a report, its page and its pictures into `dir`, which is created if need be. A report that was
/// there is replaced.
///
/// # Errors
/// Says which file could not be written; then nothing of the new report is left.
pub fn write<'a>(
    dir: &Path,
    report: Report,
    pictures: impl IntoIterator<Item = (u32, PictureKind, Picture<'a>)>,
) -> Result<Paths, ReportError> {
    let mut writer = Writer::create(dir)?;
    for (frame, kind, picture) in pictures {
        writer.picture(frame, kind, &picture)?;
    }
    writer.finish(report)
}

/// Takes a run's frames and pictures as they come, and puts the report beside them at the end.
///
/// All goes to a folder `unfinished` within the target first, and is moved into place by
/// [`finish`](Self::finish). A writer that is dropped before leaves what was recorded there: `walk.jsonl`,
/// whose first line says what was run and whose other lines are frames, and `frames/`. Where nothing was
/// recorded it leaves nothing. While it takes frames it keeps room for the report, so that a full disk has
/// room for that.
#[derive(Debug)]
pub struct Writer {
    out: PathBuf,
    unfinished: Unfinished,
    journal: Option<File>,
    pictures: BTreeMap<u32, FramePictures>,
}

impl Writer {
    /// Prepares to write into `dir`, which is created if need be.
    ///
    /// # Errors
    /// If the folder cannot be created or written to, is full, or another process writes a report there.
    pub fn create(dir: &Path) -> Result<Self, ReportError> {
        let unfinished = Unfinished::create(dir)?;
        Ok(Self { out: dir.to_owned(), unfinished, journal: None, pictures: BTreeMap::new() })
    }

    /// Begins to record frames: notes what is run, as `report` says, which has no frames yet.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn begin(&mut self, report: &Report) -> Result<(), ReportError> {
        let path = self.unfinished.path().join("walk.jsonl");
        self.journal = Some(File::create(&path).map_err(io_error("creating", &path))?);
        let mut head = serde_json::to_value(report)?;
        if let Some(head) = head.as_object_mut() {
            head.retain(|key, _| !matches!(key.as_str(), "summary" | "sweep" | "frames"));
        }
        self.line(&head)
    }

    /// Records a frame.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn frame(&mut self, frame: &Frame) -> Result<(), ReportError> {
        self.line(frame)?;
        self.unfinished.recorded();
        Ok(())
    }

    /// A line of the journal, and room for what becomes of it: it stands indented in the report and once more
    /// in the page.
    fn line(&mut self, value: &impl Serialize) -> Result<(), ReportError> {
        let Some(journal) = &mut self.journal else { return Ok(()) };
        let mut line = serde_json::to_vec(value)?;
        line.push(b'\n');
        let path = || self.out.join("unfinished/walk.jsonl");
        self.unfinished.reserve(4 * line.len()).map_err(|cause| io_error("writing", &path())(cause))?;
        journal.write_all(&line).map_err(|cause| io_error("writing", &path())(cause))
    }

    /// Writes a picture of a frame as PNG.
    ///
    /// # Errors
    /// If it cannot be encoded or written.
    pub fn picture(
        &mut self,
        frame: u32,
        kind: PictureKind,
        picture: &Picture<'_>,
    ) -> Result<(), ReportError> {
        let name = picture_name(frame, kind);
        let path = self.unfinished.path().join(&name);
        let file = Rgb::of(picture)
            .encode(png::Compression::Fast)
            .map_err(|source| ReportError::Encode { path: self.out.join(&name), source })?;
        if let Err(cause) = fs::write(&path, file) {
            // Half a picture is none, and its room may be needed.
            let _left = fs::remove_file(&path);
            return Err(io_error("writing", &self.out.join(&name))(cause));
        }
        *slot(self.pictures.entry(frame).or_default(), kind) = Some(name);
        Ok(())
    }

    /// Whether this picture has been written.
    #[must_use]
    pub fn has(&self, frame: u32, kind: PictureKind) -> bool {
        self.pictures.get(&frame).is_some_and(|pictures| match kind {
            PictureKind::Shown => pictures.shown.is_some(),
            PictureKind::Unculled => pictures.unculled.is_some(),
            PictureKind::Full => pictures.full.is_some(),
        })
    }

    /// Writes `report.json` and `report.html`, and moves everything into place. The pictures written are
    /// entered into the report's frames. On a full disk the page goes without pictures.
    ///
    /// # Errors
    /// Says which file could not be written; then the older report is still there, and what was recorded is
    /// in `unfinished`.
    pub fn finish(mut self, mut report: Report) -> Result<Paths, ReportError> {
        self.unfinished.release();
        for frame in &mut report.frames {
            if let Some(pictures) = self.pictures.get(&frame.frame) {
                frame.pictures = pictures.clone();
            }
        }
        self.stage("report.json", &serde_json::to_vec_pretty(&report)?)?;
        let exhibits = self.exhibits(&report)?;
        match self.stage("report.html", html::page(&report, &exhibits)?.as_bytes()) {
            Err(full) if full.may_pass() => {
                self.stage("report.html", html::page(&report, &[])?.as_bytes())?;
            }
            staged => staged?,
        }
        self.publish()
    }

    /// Writes a file of the report proper, to the disk and not only to the cache: a full disk may show no
    /// earlier.
    fn stage(&self, name: &str, content: &[u8]) -> Result<(), ReportError> {
        File::create(self.unfinished.path().join(name))
            .and_then(|mut file| file.write_all(content).and_then(|()| file.sync_all()))
            .map_err(io_error("writing", &self.out.join(name)))
    }

    /// The pictures that the page shows, read back.
    fn exhibits(&self, report: &Report) -> Result<Vec<Exhibit>, ReportError> {
        let read = |name: &Option<String>| -> Result<Option<Rgb>, ReportError> {
            let Some(name) = name else { return Ok(None) };
            let path = self.unfinished.path().join(name);
            let file = fs::read(&path).map_err(io_error("reading", &path))?;
            Rgb::decode(&file).map(Some).map_err(|source| ReportError::Decode { path, source })
        };
        let mut exhibits = Vec::new();
        for (frame, why) in html::choose(report) {
            let Some(pictures) = self.pictures.get(&frame) else { continue };
            if let Some(shown) = read(&pictures.shown)? {
                let (unculled, full) = (read(&pictures.unculled)?, read(&pictures.full)?);
                exhibits.push(Exhibit { frame, why, shown, unculled, full });
            }
        }
        Ok(exhibits)
    }

    /// Moves everything into place, `report.json` last, and removes the pictures of the report that was there
    /// before and has no successor.
    fn publish(self) -> Result<Paths, ReportError> {
        let staged = |name: &str| self.unfinished.path().join(name);
        let paths = Paths {
            json: self.out.join("report.json"),
            html: self.out.join("report.html"),
            frames: self.out.join("frames"),
        };
        let before = pictures_of_report(&paths.json);
        let names: Vec<&String> = self.pictures.values().flat_map(names).collect();
        fs::create_dir_all(&paths.frames).map_err(io_error("creating the folder", &paths.frames))?;
        for name in names.iter().map(|n| n.as_str()).chain(["report.html", "report.json"]) {
            let target = self.out.join(name);
            fs::rename(staged(name), &target).map_err(io_error("moving", &target))?;
        }
        for stale in before.iter().filter(|name| !names.contains(name)) {
            let path = self.out.join(stale);
            match fs::remove_file(&path) {
                Err(source) if source.kind() != ErrorKind::NotFound => {
                    return Err(ReportError::Io { doing: "removing the older picture", path, source });
                }
                _ => {}
            }
        }
        self.unfinished.discard();
        Ok(paths)
    }
}

pub(super) fn io_error(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> ReportError + use<> {
    let path = path.to_owned();
    move |source| ReportError::Io { doing, path, source }
}

fn picture_name(frame: u32, kind: PictureKind) -> String {
    match kind {
        PictureKind::Shown => format!("frames/{frame:05}.png"),
        PictureKind::Unculled => format!("frames/{frame:05}.unculled.png"),
        PictureKind::Full => format!("frames/{frame:05}.full.png"),
    }
}

fn slot(pictures: &mut FramePictures, kind: PictureKind) -> &mut Option<String> {
    match kind {
        PictureKind::Shown => &mut pictures.shown,
        PictureKind::Unculled => &mut pictures.unculled,
        PictureKind::Full => &mut pictures.full,
    }
}

fn names(pictures: &FramePictures) -> impl Iterator<Item = &String> {
    [&pictures.shown, &pictures.unculled, &pictures.full].into_iter().flatten()
}

/// The pictures of the report that lies at `json`, if one does. Only names that a writer gives are believed:
/// they are removed.
fn pictures_of_report(json: &Path) -> Vec<String> {
    #[derive(Deserialize)]
    struct Before {
        frames: Vec<BeforeFrame>,
    }
    #[derive(Deserialize)]
    struct BeforeFrame {
        frame: u32,
        pictures: FramePictures,
    }
    let before = fs::read(json).ok().and_then(|text| serde_json::from_slice::<Before>(&text).ok());
    let kinds = [PictureKind::Shown, PictureKind::Unculled, PictureKind::Full];
    let ours = |frame: &BeforeFrame| {
        let expected = kinds.map(|kind| picture_name(frame.frame, kind));
        names(&frame.pictures).filter(|name| expected.contains(name)).cloned().collect::<Vec<_>>()
    };
    before.map_or_else(Vec::new, |b| b.frames.iter().flat_map(ours).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sample::{self, AUDIT_EVERY, SIZE};

    /// The sample's pictures: all that RVG showed, and the others of audited frames.
    fn pictures(report: &Report) -> Vec<(u32, PictureKind, Vec<u8>)> {
        let frames = report.frames.iter().map(|f| f.frame);
        frames
            .flat_map(|frame| {
                let mut all = vec![(frame, PictureKind::Shown, sample::picture(frame, 1))];
                if frame.is_multiple_of(AUDIT_EVERY) {
                    let mut unculled = sample::picture(frame, 1);
                    if frame == 27 {
                        unculled[20_000..20_164].fill(60);
                    }
                    all.push((frame, PictureKind::Unculled, unculled));
                    all.push((frame, PictureKind::Full, sample::picture(frame, 0)));
                }
                all
            })
            .collect()
    }

    fn write_sample(dir: &Path, report: Report) -> Result<Paths, ReportError> {
        let pictures = pictures(&report);
        let borrowed =
            pictures.iter().map(|(f, kind, rgba)| (*f, *kind, Picture::new(SIZE, SIZE, rgba).unwrap()));
        write(dir, report, borrowed)
    }

    fn listing(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(dir)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn everything_is_there_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("new/folder");
        let paths = write_sample(&out, sample::report()).unwrap();
        assert_eq!(listing(&out), ["frames", "report.html", "report.json"]);
        assert_eq!(listing(&paths.frames).len(), 60 + 2 * 20);

        let report: Report = serde_json::from_slice(&fs::read(&paths.json).unwrap()).unwrap();
        assert_eq!(report.frames[1].pictures.shown.as_deref(), Some("frames/00001.png"));
        assert_eq!(report.frames[1].pictures.full, None);
        assert_eq!(report.frames[3].pictures.unculled.as_deref(), Some("frames/00003.unculled.png"));
        let file = fs::read(out.join("frames/00003.png")).unwrap();
        let expected = sample::picture(3, 1);
        assert_eq!(Rgb::decode(&file).unwrap(), Rgb::of(&Picture::new(SIZE, SIZE, &expected).unwrap()));

        let html = fs::read_to_string(&paths.html).unwrap();
        assert_eq!(
            html.matches("src=\"data:image/png;base64,").count(),
            3 * 5,
            "three frames, five pictures each"
        );
        assert!(!html.contains("http"));
    }

    #[test]
    fn a_shorter_report_replaces_a_longer_one_and_spares_other_files() {
        let dir = tempfile::tempdir().unwrap();
        write_sample(dir.path(), sample::report()).unwrap();
        fs::write(dir.path().join("frames/00099.png"), "mine").unwrap();
        let mut shorter = sample::report();
        shorter.frames.truncate(2);
        write_sample(dir.path(), shorter).unwrap();
        assert_eq!(
            listing(&dir.path().join("frames")),
            ["00000.full.png", "00000.png", "00000.unculled.png", "00001.png", "00099.png"]
        );
    }

    #[test]
    fn a_report_that_names_strange_files_removes_none() {
        let dir = tempfile::tempdir().unwrap();
        let victim = dir.path().join("precious.txt");
        fs::write(&victim, "x").unwrap();
        let out = dir.path().join("out");
        fs::create_dir(&out).unwrap();
        fs::write(
            out.join("report.json"),
            r#"{"frames": [{"frame": 0, "pictures": {"shown": "../precious.txt", "unculled": null, "full": null}}]}"#,
        )
        .unwrap();
        write(&out, sample::bare(), []).unwrap();
        assert!(victim.exists());
    }

    #[test]
    fn an_abandoned_writer_leaves_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let mut writer = Writer::create(dir.path()).unwrap();
        let rgba = sample::picture(0, 0);
        writer.picture(0, PictureKind::Shown, &Picture::new(SIZE, SIZE, &rgba).unwrap()).unwrap();
        assert_eq!(listing(dir.path()), ["unfinished"]);
        drop(writer);
        assert!(listing(dir.path()).is_empty(), "no frame was recorded");
    }

    #[test]
    fn what_was_recorded_stays_where_no_report_comes_of_it() {
        let dir = tempfile::tempdir().unwrap();
        let lines = |folder: &str| -> Vec<serde_json::Value> {
            let text = fs::read_to_string(dir.path().join(folder).join("walk.jsonl")).unwrap();
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
        };
        let report = sample::report();
        for (killed, frames) in [3, 5].into_iter().enumerate() {
            let mut writer = Writer::create(dir.path()).unwrap();
            writer.begin(&report).unwrap();
            for frame in &report.frames[..frames] {
                writer.frame(frame).unwrap();
            }
            drop(writer);
            let left = lines("unfinished");
            assert_eq!(left.len(), 1 + frames);
            assert_eq!(left[0]["run"]["seed"], 7);
            assert_eq!(
                serde_json::from_value::<Frame>(left[frames].clone()).unwrap(),
                report.frames[frames - 1]
            );
            assert_eq!(listing(&dir.path().join("unfinished")), ["frames", "walk.jsonl"], "no reserve");
            if killed > 0 {
                assert_eq!(lines("unfinished.before").len(), 4, "that of the walk before");
            }
        }
        write_sample(dir.path(), sample::report()).unwrap();
        assert_eq!(listing(dir.path()), ["frames", "report.html", "report.json", "unfinished.before"]);
        assert_eq!(lines("unfinished.before").len(), 6, "the last one, and none older");
    }

    #[test]
    fn one_walk_at_a_time_writes_into_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        let writer = Writer::create(dir.path()).unwrap();
        let error = Writer::create(dir.path()).unwrap_err();
        assert!(matches!(error, ReportError::Busy { .. }) && error.may_pass(), "{error}");
        drop(writer);
        assert!(Writer::create(dir.path()).is_ok());
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("taken");
        fs::write(&file, "x").unwrap();
        let error = write(&file, sample::bare(), []).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("taken") && text.contains("--out"), "{text}");
        assert!(std::error::Error::source(&error).is_some());
    }

    #[test]
    fn a_failed_write_leaves_the_older_report_whole() {
        let dir = tempfile::tempdir().unwrap();
        let paths = write(dir.path(), sample::bare(), []).unwrap();
        let before = fs::read(&paths.json).unwrap();
        let writer = Writer::create(dir.path()).unwrap();
        // What a full disk would do: the page's file cannot be created.
        fs::create_dir(writer.unfinished.path().join("report.html")).unwrap();
        let error = writer.finish(sample::report()).unwrap_err();
        assert!(error.to_string().contains("report.html"), "{error}");
        assert_eq!(fs::read(&paths.json).unwrap(), before);
        assert_eq!(listing(dir.path()), ["frames", "report.html", "report.json"]);
    }

    #[test]
    fn a_full_disk_says_what_to_do() {
        let full = ReportError::Io {
            doing: "writing",
            path: "out/report.json".into(),
            source: ErrorKind::StorageFull.into(),
        };
        assert_eq!(
            full.to_string(),
            "writing out/report.json failed: no space left; free some, or give another folder with --out"
        );
    }

    /// With `TRIMARAN_REPORT_SAMPLE` set to a folder, leaves the sample there to be looked at.
    #[test]
    fn the_sample_can_be_looked_at() {
        if let Some(dir) = std::env::var_os("TRIMARAN_REPORT_SAMPLE") {
            write_sample(Path::new(&dir), sample::report()).unwrap();
        }
    }
}
