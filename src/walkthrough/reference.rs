//! What a frame would show without culling: shared by all ways to cull, which are held against it.

use trimaran_audit::metrics::{
    ImageDifference, ImageRef, exactly_visible, exactly_visible_triangles, mismatching_pixels,
};
use trimaran_cull::Image;
use trimaran_gpu::ItemImage;
use trimaran_proto::{Camera, DrawableId, ViewState};
use xxhash_rust::xxh3::xxh3_64;

use crate::report::Frame;

use super::{
    audit::{AuditError, Auditor, items_of},
    compose::FrameRecord,
    objects::count_objects,
};

/// A frame's LOD cut without culling.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// From where it is seen.
    pub camera: Camera,
    /// XXH3-64 of its picture's bytes.
    pub picture: u64,
    /// What is exactly visible of the cut, ascending.
    pub exact: Vec<DrawableId>,
    /// How many objects that are.
    pub objects: u64,
    /// How many triangles own a pixel.
    pub triangles: Option<u64>,
    /// How far the picture is from full detail.
    pub error: ImageDifference,
}

/// How a culled frame differs from its reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CullingDifference {
    /// Pixels unlike the picture without culling.
    pub pixels: u64,
    /// Exactly visible nodes that were not drawn.
    pub lost_nodes: u64,
}

impl Reference {
    /// Enters what is exactly visible into a frame's record, and how a culled frame differs from it. The
    /// error against full detail is that of the reference, which is the frame's own where no pixel differs.
    pub fn enter(&self, difference: CullingDifference, frame: &mut Frame) {
        frame.nodes_exact = Some(self.exact.len() as u64);
        frame.objects_exact = Some(self.objects);
        frame.triangles_exact = self.triangles;
        frame.cut_mismatch_pixels = Some(difference.pixels);
        frame.false_culled_nodes = Some(difference.lost_nodes);
        frame.full_detail = Some(self.error);
    }
}

impl Auditor {
    /// What a frame would be without culling, for all that is held against it.
    ///
    /// # Errors
    /// If the device fails.
    pub fn reference(&mut self, camera: Camera) -> Result<Reference, AuditError> {
        let (view, rule) = self.seen_from(&camera);
        let mut picture = Image::default();
        let cut = self.unculled(camera, &mut picture)?;
        let items = self.draw_items(&view, &rule, &cut)?;
        let owners = items_of(&items)?;
        let exact: Vec<_> = exactly_visible(&owners).into_iter().map(DrawableId).collect();
        let full = self.full(camera)?;
        let drawn = Drawn { ids: &cut, picture: &picture, items: &items };
        Ok(Reference {
            camera,
            picture: fingerprint(&picture),
            objects: count_objects(&self.scene, exact.iter().copied()),
            triangles: exactly_visible_triangles(&owners, &items.triangle),
            error: self.level_error(&view, &cut, drawn, &full)?,
            exact,
        })
    }

    /// A frame's picture without culling, and at full detail.
    ///
    /// # Errors
    /// If the device fails.
    pub fn pictures(&mut self, camera: Camera) -> Result<[Image; 2], AuditError> {
        let mut unculled = Image::default();
        self.unculled(camera, &mut unculled)?;
        Ok([unculled, self.full(camera)?.picture.clone()])
    }

    /// Holds a frame that was drawn against its reference. A picture whose fingerprint is known is drawn again
    /// only if it differs.
    ///
    /// # Errors
    /// If the device fails.
    pub fn culling_difference(
        &mut self,
        reference: &Reference,
        record: &FrameRecord,
    ) -> Result<CullingDifference, AuditError> {
        let mut drawn = record.ids.clone();
        drawn.sort_unstable_by_key(|id| id.0);
        let lost = |id: &&DrawableId| drawn.binary_search_by_key(&id.0, |id| id.0).is_err();
        let lost_nodes = reference.exact.iter().filter(lost).count() as u64;
        if record.picture == Some(reference.picture) {
            return Ok(CullingDifference { pixels: 0, lost_nodes });
        }
        let (mut shown, mut unculled) = (Image::default(), Image::default());
        self.picture(record, &mut shown)?;
        self.unculled(record.camera, &mut unculled)?;
        let pixels = mismatching_pixels(&ImageRef::of(&shown)?, &ImageRef::of(&unculled)?)?;
        Ok(CullingDifference { pixels, lost_nodes })
    }
}

/// A frame at full detail, without culling.
pub(super) struct FullDetail {
    pub(super) camera: Camera,
    pub(super) state: ViewState,
    pub(super) picture: Image,
    pub(super) items: ItemImage,
}

/// A picture, and what was drawn for it.
#[derive(Clone, Copy)]
pub(super) struct Drawn<'p> {
    pub(super) ids: &'p [DrawableId],
    pub(super) picture: &'p Image,
    pub(super) items: &'p ItemImage,
}

impl FullDetail {
    /// Whether it is what `camera` sees in `state`, whose level rule full detail does not know.
    pub(super) fn is_of(&self, camera: &Camera, state: &ViewState) -> bool {
        self.camera == *camera && self.state == ViewState { lod: self.state.lod, ..state.clone() }
    }
}

/// The fingerprint of a picture.
pub(super) fn fingerprint(picture: &Image) -> u64 {
    xxh3_64(&picture.rgba)
}
