//! Writes a report to disk: its records as they come, and the report itself whole or not at all.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use serde::{Serialize, de::DeserializeOwned};
use trimaran_cull::{Image, RgbImage};

use super::error::{ReportError, io_error};
use super::html::{self, Comparison};
use super::left::{self, Left};
use super::pictures::{PictureKind, file_name, files_of_report, is_whole};
use super::schema::{Frame, FramePictures, HowEnded, Report};
use super::unfinished::Unfinished;

/// The paths of a report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Paths {
    /// `report.json`.
    pub json: PathBuf,
    /// `report.html`.
    pub html: PathBuf,
    /// The folder of the PNG files.
    pub frames: PathBuf,
}

/// Writes a report, its page and its pictures into `dir`, which is created if need be. A report that was
/// there is replaced.
///
/// # Errors
/// The file that could not be written; then nothing of the new report is left.
pub fn write<'a>(
    dir: &Path,
    report: Report,
    pictures: impl IntoIterator<Item = (u32, PictureKind, &'a Image)>,
) -> Result<Paths, ReportError> {
    let mut writer = Writer::create(dir)?;
    for (frame, kind, picture) in pictures {
        writer.picture(frame, kind, picture)?;
    }
    writer.finish(report)
}

/// Takes a run's frames and pictures as they come, and writes the report beside them at the end.
///
/// All goes to a folder `unfinished` within the target first, and [`finish`](Self::finish) moves it into
/// place. A writer dropped before that leaves its records there: `frames/`, and `walk.jsonl`, whose first
/// line describes the run and whose other lines are frames and remarks. Without records it leaves nothing.
/// While it takes frames it reserves room for the report, in case the disk fills up.
#[derive(Debug)]
pub struct Writer {
    out: PathBuf,
    unfinished: Unfinished,
    journal: Option<File>,
    pictures: BTreeSet<(u32, PictureKind)>,
    is_unchecked: bool,
    is_resumable: bool,
}

/// The data needed to complete a report later.
pub const UNCHECKED: &str = "unchecked.json";

impl Writer {
    /// Prepares to write into `dir`, which is created if need be. A killed process's records are moved aside.
    ///
    /// # Errors
    /// If the folder cannot be created or written to, is full, or another process writes a report there.
    pub fn create(dir: &Path) -> Result<Self, ReportError> {
        let mut writer = Self::open(dir)?;
        writer.unfinished.clear()?;
        Ok(writer)
    }

    /// As [`create`](Self::create), but a killed process's records stay until [`begin`](Self::begin) moves
    /// them aside, or [`go_on`](Self::go_on) resumes them.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn open(dir: &Path) -> Result<Self, ReportError> {
        let unfinished = Unfinished::open(dir)?;
        Ok(Self {
            out: dir.to_owned(),
            unfinished,
            journal: None,
            pictures: BTreeSet::new(),
            is_unchecked: false,
            is_resumable: false,
        })
    }

    /// The same writer, which keeps the records beside the report of a walk that was asked to stop, or whose
    /// disk was full. So the next process can [resume](Self::go_on) it.
    #[must_use]
    pub fn resumable(self) -> Self {
        Self { is_resumable: true, ..self }
    }

    /// The records of a killed process; `None` if there are none, or they are invalid.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn left<H: DeserializeOwned, L: DeserializeOwned>(&self) -> Result<Option<Left<H, L>>, ReportError> {
        let path = self.unfinished.journal();
        left::read(&path).map_err(io_error("reading", &path))
    }

    /// Resumes the records of a killed process, which has the shown pictures of these `frames`.
    ///
    /// # Errors
    /// If it cannot be written to.
    pub fn go_on<H, L>(
        &mut self,
        left: &Left<H, L>,
        frames: impl IntoIterator<Item = u32>,
    ) -> Result<(), ReportError> {
        let path = self.unfinished.journal();
        let open = || {
            let journal = File::options().append(true).open(&path)?;
            if journal.metadata()?.len() > left.len {
                journal.set_len(left.len)?;
            }
            Ok(journal)
        };
        self.journal = Some(open().map_err(io_error("writing", &path))?);
        let shown = frames.into_iter().map(|frame| (frame, PictureKind::Shown));
        let whole = |(frame, kind)| is_whole(&self.unfinished.path().join(file_name(frame, kind)));
        self.pictures = shown.filter(|picture| whole(*picture)).collect();
        Ok(())
    }

    /// Begins to record frames. Notes the run as described by `report`, which has no frames yet, and the
    /// `state` needed to [resume](Self::go_on) if this process is killed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn begin(&mut self, report: &Report, state: Option<&impl Serialize>) -> Result<(), ReportError> {
        self.unfinished.clear()?;
        let path = self.unfinished.journal();
        self.journal = Some(File::create(&path).map_err(io_error("creating", &path))?);
        let mut head = serde_json::to_value(report)?;
        if let Some(head) = head.as_object_mut() {
            head.retain(|key, _| !matches!(key.as_str(), "summary" | "sweep" | "frames"));
        }
        self.line(&head, state)
    }

    /// Records a frame, and in `state` its data that the report lacks.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn frame(&mut self, frame: &Frame, state: Option<&impl Serialize>) -> Result<(), ReportError> {
        self.line(frame, state)?;
        self.unfinished.recorded();
        Ok(())
    }

    /// Records a remark.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn note(&mut self, note: &str) -> Result<(), ReportError> {
        self.line(&serde_json::json!({ "note": note }), None::<&()>)
    }

    /// Writes a line of the journal, and reserves room for `value`, which occurs indented in the report and
    /// once more in the page.
    fn line(&mut self, value: &impl Serialize, state: Option<&impl Serialize>) -> Result<(), ReportError> {
        let Some(journal) = &mut self.journal else { return Ok(()) };
        let mut line = serde_json::to_vec(value)?;
        let reserved = self.unfinished.reserve(4 * line.len());
        if let Some(state) = state {
            // Appends one more key.
            line.pop();
            line.extend(b",\"state\":");
            serde_json::to_writer(&mut line, state)?;
            line.push(b'}');
        }
        line.push(b'\n');
        reserved
            .and_then(|()| journal.write_all(&line))
            .map_err(io_error("writing", &self.out.join("unfinished/walk.jsonl")))
    }

    /// Writes a picture of a frame as PNG.
    ///
    /// # Errors
    /// If it cannot be encoded or written.
    pub fn picture(&mut self, frame: u32, kind: PictureKind, picture: &Image) -> Result<(), ReportError> {
        let name = file_name(frame, kind);
        let path = self.unfinished.path().join(&name);
        let picture =
            RgbImage::of(picture).ok_or_else(|| ReportError::Picture { path: self.out.join(&name) })?;
        let file = picture
            .encode(png::Compression::Fast)
            .map_err(|source| ReportError::Encode { path: self.out.join(&name), source })?;
        if let Err(cause) = fs::write(&path, file) {
            // Half a picture is useless, and its room may be needed.
            let _left = fs::remove_file(&path);
            return Err(io_error("writing", &self.out.join(&name))(cause));
        }
        self.pictures.insert((frame, kind));
        Ok(())
    }

    /// Writes the data needed to complete the report later. It stays beside the report until a complete one
    /// replaces it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn keep(&mut self, unchecked: &impl Serialize) -> Result<(), ReportError> {
        let kept = self.save(UNCHECKED, &serde_json::to_vec(unchecked)?);
        if kept.is_err() {
            let _left = fs::remove_file(self.unfinished.path().join(UNCHECKED));
        }
        self.is_unchecked = kept.is_ok();
        kept
    }

    /// Whether this picture has been written.
    #[must_use]
    pub fn has(&self, frame: u32, kind: PictureKind) -> bool {
        self.pictures.contains(&(frame, kind))
    }

    /// Writes `report.json` and `report.html`, and moves everything into place. The pictures written are
    /// entered into the report's frames. On a full disk the page has no pictures.
    ///
    /// # Errors
    /// The file that could not be written; then the older report is still there, and the records are in
    /// `unfinished`.
    pub fn finish(mut self, mut report: Report) -> Result<Paths, ReportError> {
        self.unfinished.release();
        for frame in &mut report.frames {
            let name = |kind| self.has(frame.frame, kind).then(|| file_name(frame.frame, kind));
            frame.pictures = FramePictures {
                shown: name(PictureKind::Shown),
                unculled: name(PictureKind::Unculled),
                full: name(PictureKind::Full),
            };
        }
        self.save("report.json", &serde_json::to_vec_pretty(&report)?)?;
        let comparisons = self.comparisons(&report)?;
        match self.save("report.html", html::page(&report, &comparisons)?.as_bytes()) {
            Err(full) if full.may_pass() => {
                self.save("report.html", html::page(&report, &[])?.as_bytes())?;
            }
            saved => saved?,
        }
        // A walk of which only checks are missing goes on with these. So does one once its disk has room.
        let stopped = matches!(report.summary.ended.how, HowEnded::Interrupted | HowEnded::NotRecorded)
            || self.is_unchecked;
        let goes_on = self.is_resumable && stopped;
        self.publish(goes_on)
    }

    /// Writes a file of the report proper and syncs it to the disk: a full disk may show no earlier.
    fn save(&self, name: &str, content: &[u8]) -> Result<(), ReportError> {
        File::create(self.unfinished.path().join(name))
            .and_then(|mut file| file.write_all(content).and_then(|()| file.sync_all()))
            .map_err(io_error("writing", &self.out.join(name)))
    }

    /// The pictures that the page shows.
    fn comparisons(&self, report: &Report) -> Result<Vec<Comparison>, ReportError> {
        let mut comparisons = Vec::new();
        for (frame, why) in html::choose(report) {
            if let Some(shown) = self.read_back(frame, PictureKind::Shown)? {
                let unculled = self.read_back(frame, PictureKind::Unculled)?;
                let full = self.read_back(frame, PictureKind::Full)?;
                comparisons.push(Comparison { frame, why, shown, unculled, full });
            }
        }
        Ok(comparisons)
    }

    /// A written picture; `None` if it was not written.
    fn read_back(&self, frame: u32, kind: PictureKind) -> Result<Option<RgbImage>, ReportError> {
        if !self.has(frame, kind) {
            return Ok(None);
        }
        let path = self.unfinished.path().join(file_name(frame, kind));
        let file = fs::read(&path).map_err(io_error("reading", &path))?;
        RgbImage::decode(&file).map(Some).map_err(|source| ReportError::Decode { path, source })
    }

    /// Moves everything into place, `report.json` last, and removes pictures of the old report that have no
    /// successor. The journal stays for a walk that `goes_on`: its pictures are drawn again.
    fn publish(self, goes_on: bool) -> Result<Paths, ReportError> {
        let paths = Paths {
            json: self.out.join("report.json"),
            html: self.out.join("report.html"),
            frames: self.out.join("frames"),
        };
        let before = files_of_report(&paths.json);
        let pictures: Vec<String> =
            self.pictures.iter().map(|(frame, kind)| file_name(*frame, *kind)).collect();
        fs::create_dir_all(&paths.frames).map_err(io_error("creating the folder", &paths.frames))?;
        let unchecked = self.is_unchecked.then_some(UNCHECKED);
        let report = unchecked.into_iter().chain(["report.html", "report.json"]);
        for name in pictures.iter().map(String::as_str).chain(report) {
            let target = self.out.join(name);
            fs::rename(self.unfinished.path().join(name), &target).map_err(io_error("moving", &target))?;
        }
        let stale = before.iter().filter(|name| !pictures.contains(name)).map(String::as_str);
        for stale in stale.chain((!self.is_unchecked).then_some(UNCHECKED)) {
            let path = self.out.join(stale);
            match fs::remove_file(&path) {
                Err(cause) if cause.kind() != ErrorKind::NotFound => {
                    return Err(io_error("removing the older picture", &path)(cause));
                }
                _ => {}
            }
        }
        if !goes_on {
            self.unfinished.discard();
        }
        Ok(paths)
    }
}

#[cfg(test)]
mod tests;
