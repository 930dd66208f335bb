//! Records a session, frame by frame.

use std::time::Duration;

use trimaran_actors::{BoxedError, Observer, ShownFrame};
use trimaran_proto::{FrameNumber, FrameStats};

use super::{
    compose::FrameRecord,
    journal::{Entry, Journal, JournalStopped},
    redraw::fingerprint,
    resume::Progress,
};

/// The culler's figures of a frame arrive at most this many frames later. After that a frame is written
/// without them.
const STATS_LAG: usize = 4;

/// Notes every frame of a session, and writes them into a report's folder if given one.
pub struct Recorder<'p> {
    frames: Vec<FrameRecord>,
    notes: Vec<String>,
    picture_every: u32,
    progress: &'p mut dyn FnMut(FrameNumber),
    /// How long the walk had gone on before this session.
    walked: Duration,
    /// How many frames it had then.
    before: usize,
    journal: Option<Journal>,
    /// How many frames and notes the journal has.
    written: usize,
    noted: usize,
}

impl<'p> Recorder<'p> {
    /// Reads back every `picture_every`-th picture, none if 0, and calls `progress` after each frame.
    pub fn new(picture_every: u32, progress: &'p mut dyn FnMut(FrameNumber)) -> Self {
        Self {
            frames: Vec::new(),
            notes: Vec::new(),
            picture_every,
            progress,
            walked: Duration::ZERO,
            before: 0,
            journal: None,
            written: 0,
            noted: 0,
        }
    }

    /// Resumes from earlier records, and notes it. The frames' clock continues as well.
    pub fn go_on(&mut self, before: Progress) {
        self.walked = before.walked();
        let went_on = before.went_on();
        let Progress { records, notes, .. } = before;
        (self.written, self.noted) = (records.len(), notes.len());
        (self.frames, self.notes) = (records, notes);
        self.before = self.frames.len();
        self.notes.extend(went_on);
    }

    /// Whether a frame was shown in this session.
    #[must_use]
    pub const fn has_shown(&self) -> bool {
        self.frames.len() > self.before
    }

    /// Writes later records into `journal` as well.
    pub fn write_into(&mut self, journal: Journal) {
        self.journal = Some(journal);
    }

    /// Whether records are written into a journal.
    #[must_use]
    pub const fn writes(&self) -> bool {
        self.journal.is_some()
    }

    /// A remark on the walk. It is written with the next frame, so that a process killed repeatedly before
    /// that does not fill the disk.
    pub fn note(&mut self, note: String) {
        self.notes.push(note);
    }

    /// The frame after the last one shown.
    #[must_use]
    pub fn next_frame(&self) -> FrameNumber {
        self.frames.last().and_then(|record| record.camera.frame().next()).unwrap_or(FrameNumber(0))
    }

    /// The frames, in the order shown.
    #[must_use]
    pub fn into_frames(self) -> Vec<FrameRecord> {
        self.frames
    }

    /// The frames, in the order shown, the remarks, and the journal with all of them, if there was one.
    #[must_use]
    pub fn into_parts(mut self) -> (Vec<FrameRecord>, Vec<String>, Option<Journal>) {
        // A stopped journal returns its error when it is finished.
        let _stopped = self.write(self.frames.len());
        (self.frames, self.notes, self.journal)
    }

    /// Writes the frames before `end`, and first the remarks.
    fn write(&mut self, end: usize) -> Result<(), JournalStopped> {
        let Some(journal) = &self.journal else { return Ok(()) };
        for record in self.frames.get(self.written..end).unwrap_or_default() {
            for note in self.notes.get(self.noted..).unwrap_or_default() {
                journal.note(Entry::Note(note.clone()))?;
                self.noted += 1;
            }
            journal.note(Entry::Frame(Box::new(record.clone())))?;
            self.written += 1;
        }
        Ok(())
    }

    /// How many frames, from the first on, have all their cullers' figures.
    fn complete(&self) -> usize {
        let known = |record: &&FrameRecord| record.stats.is_some() || record.again;
        let known = self.frames.iter().skip(self.written).take_while(known).count();
        (self.written + known).max(self.frames.len().saturating_sub(STATS_LAG))
    }
}

impl Observer for Recorder<'_> {
    fn wants_picture(&self, frame: FrameNumber) -> bool {
        self.picture_every > 0 && frame.0.is_multiple_of(self.picture_every)
    }

    fn shown(&mut self, frame: &ShownFrame<'_>) -> Result<(), BoxedError> {
        self.frames.push(FrameRecord {
            camera: frame.camera,
            culler: frame.culler,
            ids: frame.ids.to_vec(),
            for_loss: frame.for_loss,
            lacking: frame.lacking,
            again: frame.again,
            picture: frame.picture.map(fingerprint),
            published: self.walked + frame.published,
            begun: self.walked + frame.begun,
            drawing: self.walked + frame.drawing,
            shown: self.walked + frame.shown,
            on_device: frame.on_device,
            traffic: frame.traffic,
            arrivals: frame.arrivals.to_vec(),
            stats: None,
        });
        (self.progress)(frame.camera.frame());
        if let (Some(journal), Some(picture)) = (&self.journal, frame.picture) {
            let number = frame.camera.frame().0;
            journal.note(Entry::Picture { frame: number, picture: picture.clone() })?;
        }
        Ok(self.write(self.complete())?)
    }

    fn culled(&mut self, stats: &FrameStats) {
        let first = self.frames.first().map_or(0, |record| record.camera.frame().0);
        let place = stats.frame.0.checked_sub(first).map(|place| place as usize);
        if let Some(record) = place.and_then(|place| self.frames.get_mut(place)) {
            record.stats = Some(*stats);
        }
    }
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{Camera, SentBytes};

    use super::*;

    #[test]
    fn what_a_picture_lacks_and_whether_it_was_shown_before_is_noted() {
        let mut quiet = |_| {};
        let mut recorder = Recorder::new(0, &mut quiet);
        let said = [(0, false), (7, false), (2, true), (0, true)];
        for (number, (lacking, again)) in (0..).zip(said) {
            let shown = ShownFrame {
                camera: Camera::at_origin(FrameNumber(number)),
                culler: None,
                ids: &[],
                for_loss: 0,
                lacking,
                queued: 0,
                again,
                picture: None,
                published: Duration::ZERO,
                begun: Duration::ZERO,
                drawing: Duration::ZERO,
                shown: Duration::ZERO,
                on_device: Duration::ZERO,
                traffic: SentBytes::default(),
                arrivals: &[],
            };
            recorder.shown(&shown).unwrap();
        }
        let noted: Vec<_> =
            recorder.into_frames().iter().map(|record| (record.lacking, record.again)).collect();
        assert_eq!(noted, said);
    }
}
