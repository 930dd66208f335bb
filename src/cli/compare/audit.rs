//! The exact references of a comparison's frames.

use trimaran::{
    comparison::ComparedPicture,
    report::Frame,
    walkthrough::{Auditor, FrameRecord, Plan, Reference},
};
use trimaran_actors::Cameras;
use trimaran_proto::FrameNumber;

use super::walks::{Comparing, Mode, plan};
use crate::cli::{Failure, progress};

/// The exact references of each audited frame at each error bound, and the device that draws them.
pub(super) struct References {
    pub(super) auditor: Auditor,
    /// By error bound, each with the references by frame.
    found: Vec<(f64, Vec<(u32, Reference)>)>,
}

impl References {
    /// Draws all of them. Each frame is drawn at all error bounds in turn, which share its full detail.
    pub(super) fn find(comparing: &Comparing<'_>, bounds: &[f64]) -> Result<Self, Failure> {
        let Comparing { args, file, drawn, path, first_plan, .. } = comparing;
        let auditor = Auditor::new(&file.scene, drawn, path.views().clone()).map_err(Failure::broken)?;
        let mut references = Self { auditor, found: bounds.iter().map(|px| (*px, Vec::new())).collect() };
        let every = args.walk.audit_every;
        if every == 0 {
            return Ok(references);
        }
        // The first frame has no history, so it says little about the others.
        let first = if path.frames() > every { every } else { 0 };
        let frames = (first..path.frames()).step_by(every as usize);
        let bar = progress::bar("references", frames.len() as u64 * bounds.len() as u64);
        let mut cameras = path.clone();
        let Some(&system) = args.systems.first() else { return Ok(references) };
        for frame in frames {
            let camera = cameras.camera(FrameNumber(frame));
            for (epsilon, found) in &mut references.found {
                if comparing.stop.requested() {
                    return Err(Failure::stopped("interrupted"));
                }
                references.auditor.see(plan(args, system, *epsilon, Mode::Audited)?.settings());
                let reference = references.auditor.reference(camera).map_err(Failure::broken)?;
                found.push((frame, reference));
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        references.see(first_plan);
        Ok(references)
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
        let flip = |reference: &Reference| reference.error.flip_mean.unwrap_or(0.0);
        let mut by_error: Vec<_> =
            self.at(epsilon_px).map(|(frame, of)| (frame, of.camera, flip(of))).collect();
        by_error.sort_by(|a, b| a.2.total_cmp(&b.2));
        let typical = by_error.get(by_error.len().saturating_sub(1) / 2).copied();
        let worst = by_error.pop().filter(|worst| Some(worst.0) != typical.map(|typical| typical.0));
        let mut pictures = Vec::new();
        for (which, chosen) in [("typical", typical), ("worst", worst)] {
            let Some((frame, camera, flip_mean)) = chosen else { continue };
            let [shown, full] = self.auditor.pictures(camera).map_err(Failure::broken)?;
            pictures.push(ComparedPicture { epsilon_px, frame, which, flip_mean, shown, full });
        }
        Ok(pictures)
    }

    /// The references at an error bound, by frame.
    pub(super) fn at(&self, epsilon: f64) -> impl Iterator<Item = (u32, &Reference)> {
        let of = self.found.iter().filter(move |(px, _)| *px == epsilon);
        of.flat_map(|(_, found)| found).map(|(frame, reference)| (*frame, reference))
    }

    /// Compares a frame with its reference, if it has one, and enters the result.
    pub(super) fn enter(
        &mut self,
        epsilon: f64,
        record: &FrameRecord,
        frame: &mut Frame,
    ) -> Result<(), Failure> {
        let Self { auditor, found } = self;
        let of = found.iter().find(|(px, _)| *px == epsilon);
        let reference = of.and_then(|(_, found)| found.iter().find(|(number, _)| *number == frame.frame));
        if let Some((_, reference)) = reference {
            let difference = auditor.culling_difference(reference, record).map_err(Failure::broken)?;
            reference.enter(difference, frame);
        }
        Ok(())
    }
}
