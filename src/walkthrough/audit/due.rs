//! The audits of a walk's report.

use trimaran_cull::Image;

use super::{AuditPictures, Auditor};
use crate::{
    culling::CullingMethod,
    report::{Frame, PictureKind, Writer},
    vulkan::VulkanCuller,
    walkthrough::{FrameRecord, GivesUp, RedrawError, ReportingError, Walk},
};

/// Audits the frames of a walk that are due, and writes their pictures.
pub(in crate::walkthrough) struct DueAudits {
    auditor: Auditor,
    /// Repeats a culler's work, if the walk was culled by Trimaran's method.
    machine: Option<VulkanCuller>,
    pictures: AuditPictures,
    names: bool,
}

impl DueAudits {
    pub(in crate::walkthrough) fn new(walk: Walk<'_>) -> Result<Self, ReportingError> {
        let Walk { file, drawn, plan, path } = walk;
        let repeats = plan.culling == CullingMethod::Trimaran;
        let machine = repeats.then(|| VulkanCuller::new(drawn, plan.viewport, plan.occlusion_test));
        Ok(Self {
            auditor: Auditor::new(&file.scene, drawn, path.views().clone())?,
            machine: machine.transpose()?,
            pictures: AuditPictures::default(),
            names: plan.visible,
        })
    }

    pub(in crate::walkthrough) fn give_up_when(&mut self, is_given_up: GivesUp) {
        self.auditor.give_up_when(is_given_up);
    }

    pub(in crate::walkthrough) fn picture(
        &mut self,
        record: &FrameRecord,
        into: &mut Image,
    ) -> Result<(), RedrawError> {
        self.auditor.picture(record, into)
    }

    /// Audits the last frame of `walk`, enters the results into `frame`, and writes its pictures.
    pub(in crate::walkthrough) fn audit(
        &mut self,
        walk: &[FrameRecord],
        frame: &mut Frame,
        writer: &mut Writer,
    ) -> Result<(), ReportingError> {
        let pictures = &mut self.pictures;
        self.auditor.audit(self.machine.as_mut(), walk, self.names, frame, pictures)?;
        for (kind, picture) in [
            (PictureKind::Shown, &pictures.shown),
            (PictureKind::Unculled, &pictures.unculled),
            (PictureKind::Full, &pictures.full),
        ] {
            // If the shown picture was read back, it was written then.
            if !writer.has(frame.frame, kind) {
                writer.picture(frame.frame, kind, picture)?;
            }
        }
        Ok(())
    }
}
