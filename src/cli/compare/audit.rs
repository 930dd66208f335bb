//! The exact references of a comparison's frames.

use std::collections::BTreeMap;

use trimaran::{
    comparison::{ComparedPicture, schema::Popping},
    report::{Frame, schema::Stat},
    walkthrough::{Auditor, FrameRecord, LevelSwitch, Plan, Reference},
};
use trimaran_actors::Cameras;
use trimaran_proto::FrameNumber;

use super::walks::{Comparing, Mode, Path, plan};
use crate::cli::{Failure, progress};

/// Audited frames of all paths that are held against full detail, which takes longest to draw, and those that
/// are held against the same frame with the levels of the one before. Each path has at least one of both.
const ERRORS: usize = 40;
const SWITCHES: usize = 200;

/// The exact references of each audited frame at each error bound, and the device that draws them.
pub(super) struct References {
    pub(super) auditor: Auditor,
    found: Vec<OfBound>,
}

/// Those at one error bound.
struct OfBound {
    epsilon_px: f64,
    /// By path and frame.
    frames: BTreeMap<(u32, u32), Reference>,
    /// By path, of some audited frames that have one before them.
    switches: BTreeMap<u32, Vec<LevelSwitch>>,
}

impl References {
    /// Draws all of them. Each frame is drawn at all error bounds in turn, which share its full detail.
    pub(super) fn find(comparing: &Comparing<'_>, bounds: &[f64]) -> Result<Self, Failure> {
        let Comparing { args, file, drawn, paths, first_plan, .. } = comparing;
        let auditor = Auditor::new(&file.scene, drawn, first_plan.settings()).map_err(Failure::broken)?;
        let of =
            |&epsilon_px: &f64| OfBound { epsilon_px, frames: BTreeMap::new(), switches: BTreeMap::new() };
        let mut references = Self { auditor, found: bounds.iter().map(of).collect() };
        let count: usize = paths.iter().map(|path| audited(path, args.walk.audit_every).len()).sum();
        let bar = progress::bar("references", (count * bounds.len()) as u64);
        for (index, path) in (0..).zip(paths) {
            let frames = audited(path, args.walk.audit_every);
            let [errors, switches] =
                [ERRORS, SWITCHES].map(|most| (frames.len() * paths.len()).div_ceil(most).max(1));
            for (place, frame) in frames.enumerate() {
                for bound in 0..bounds.len() {
                    let of = (index, path, frame);
                    references.draw(comparing, bound, of, place % errors == 0)?;
                    if place % switches == 0 {
                        references.switch(bound, of)?;
                    }
                    bar.inc(1);
                }
            }
        }
        bar.finish_and_clear();
        references.see(first_plan);
        Ok(references)
    }

    fn draw(
        &mut self,
        comparing: &Comparing<'_>,
        bound: usize,
        (index, path, frame): (u32, &Path, u32),
        with_error: bool,
    ) -> Result<(), Failure> {
        if comparing.stop.requested() {
            return Err(Failure::stopped("interrupted"));
        }
        let Self { auditor, found } = self;
        let (Some(&system), Some(of)) = (comparing.args.systems.first(), found.get_mut(bound)) else {
            return Ok(());
        };
        auditor.see(plan(comparing.args, system, of.epsilon_px, Mode::Audited)?.settings());
        let camera = path.cameras.clone().camera(FrameNumber(frame));
        let reference = auditor.reference(camera, with_error).map_err(Failure::broken)?;
        of.frames.insert((index, frame), reference);
        Ok(())
    }

    /// Holds a frame, whose bound was the last one seen, against the levels of the frame before.
    fn switch(&mut self, bound: usize, (index, path, frame): (u32, &Path, u32)) -> Result<(), Failure> {
        let (Some(before), Some(of)) = (frame.checked_sub(1), self.found.get_mut(bound)) else {
            return Ok(());
        };
        let mut cameras = path.cameras.clone();
        let [before, camera] = [before, frame].map(|frame| cameras.camera(FrameNumber(frame)));
        let switch = self.auditor.level_switch(before, camera).map_err(Failure::broken)?;
        of.switches.entry(index).or_default().push(switch);
        Ok(())
    }

    /// Sets the plan by which frames are drawn from now on.
    pub(super) fn see(&mut self, plan: &Plan) {
        self.auditor.see(plan.settings());
    }

    /// Pictures of two frames at an error bound: a typical one by its error against full detail, and the
    /// worst.
    pub(super) fn pictures(&mut self, plan: &Plan) -> Result<Vec<ComparedPicture>, Failure> {
        let epsilon_px = plan.lod.epsilon_px();
        self.see(plan);
        let flip = |reference: &Reference| reference.error.and_then(|error| error.flip_mean);
        let frames = self.at(epsilon_px).filter_map(|(at, of)| Some((at, of.camera, flip(of)?)));
        let mut by_error: Vec<_> = frames.collect();
        by_error.sort_by(|a, b| a.2.total_cmp(&b.2));
        let typical = by_error.get(by_error.len().saturating_sub(1) / 2).copied();
        let worst = by_error.pop().filter(|worst| Some(worst.0) != typical.map(|typical| typical.0));
        let mut pictures = Vec::new();
        for (which, chosen) in [("typical", typical), ("worst", worst)] {
            let Some(((path, frame), camera, flip_mean)) = chosen else { continue };
            let [shown, full] = self.auditor.pictures(camera).map_err(Failure::broken)?;
            pictures.push(ComparedPicture { epsilon_px, path, frame, which, flip_mean, shown, full });
        }
        Ok(pictures)
    }

    /// The references at an error bound, by path and frame.
    pub(super) fn at(&self, epsilon: f64) -> impl Iterator<Item = ((u32, u32), &Reference)> {
        let of = self.found.iter().filter(move |of| of.epsilon_px == epsilon);
        of.flat_map(|of| &of.frames).map(|(at, reference)| (*at, reference))
    }

    /// How much pictures change because levels do, by error bound and path.
    pub(super) fn popping(&self) -> Vec<Popping> {
        let of = |of: &OfBound| {
            let epsilon_px = of.epsilon_px;
            let popping = |(path, switches): (&u32, &Vec<LevelSwitch>)| {
                let stat = |of: fn(&LevelSwitch) -> f64| Stat::of(switches.iter().map(of));
                let (changed, flip) = (stat(|switch| switch.changed)?, stat(|switch| switch.flip_mean)?);
                let over = switches.iter().filter(|switch| switch.largest_px > 1.0).count();
                Some(Popping {
                    epsilon_px,
                    path: *path,
                    frames: changed.frames,
                    changed: changed.median,
                    changed_p95: changed.p95,
                    flip_mean: flip.median,
                    frames_over_1_px: over as f64 / switches.len().max(1) as f64,
                })
            };
            of.switches.iter().filter_map(popping).collect::<Vec<_>>()
        };
        self.found.iter().flat_map(of).collect()
    }

    /// Compares a frame of a path with its reference, if it has one, and enters the result.
    pub(super) fn enter(
        &mut self,
        epsilon: f64,
        path: u32,
        record: &FrameRecord,
        frame: &mut Frame,
    ) -> Result<(), Failure> {
        let Self { auditor, found } = self;
        let of = found.iter().find(|of| of.epsilon_px == epsilon);
        if let Some(reference) = of.and_then(|of| of.frames.get(&(path, frame.frame))) {
            let difference = auditor.culling_difference(reference, record).map_err(Failure::broken)?;
            reference.enter(difference, frame);
        }
        Ok(())
    }
}

/// The audited frames of a path. The first one has no history, so it says little about the others.
fn audited(path: &Path, every: u32) -> impl ExactSizeIterator<Item = u32> + use<> {
    let frames = if every == 0 { 0 } else { path.cameras.frames() };
    let first = if frames > every { every } else { 0 };
    (first..frames).step_by(every.max(1) as usize)
}
