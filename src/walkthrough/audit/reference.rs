//! The references of frames without culling, with which all culling methods are compared.

use trimaran_audit::metrics::{
    ImageRef, exactly_visible, exactly_visible_triangles, false_culls, mismatching_pixels,
};
use trimaran_cull::{Image, ImageDifference, draw_order, lod_cut};
use trimaran_gpu::{GpuError, ItemImage};
use trimaran_proto::{Camera, DrawableId, ViewState};

use crate::report::schema::{FalseCull, FalseCullCause, Frame};

use super::{AuditError, Auditor, Judgement, items_of};
use crate::walkthrough::{FrameRecord, count_objects, redraw::fingerprint};

/// A frame's LOD cut without culling.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// Its camera.
    pub camera: Camera,
    /// XXH3-64 of its picture's bytes.
    pub picture: u64,
    /// The exactly visible nodes of the cut, ascending.
    pub exact: Vec<DrawableId>,
    /// How many objects these show.
    pub objects: u64,
    /// How many triangles own a pixel.
    pub triangles: Option<u64>,
    /// The error of the picture against full detail, if it was asked for.
    pub error: Option<ImageDifference>,
}

/// How a culled frame differs from its reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CullingDifference {
    /// Pixels that differ from the picture without culling.
    pub pixels: u64,
    /// Those of them that a rasterizer in f64 shows as they are with culling; 0 where it was not asked.
    pub right_pixels: u64,
    /// Exactly visible nodes that were not drawn.
    pub lost_nodes: u64,
}

impl Reference {
    /// Enters the exactly visible set and a culled frame's difference into its record. The error against full
    /// detail is that of the reference, which equals the frame's own if no pixel differs.
    pub fn enter(&self, difference: CullingDifference, frame: &mut Frame) {
        frame.nodes_exact = Some(self.exact.len() as u64);
        frame.objects_exact = Some(self.objects);
        frame.triangles_exact = self.triangles;
        frame.cut_mismatch_pixels = Some(difference.pixels);
        frame.false_culled_nodes = Some(difference.lost_nodes);
        if difference.right_pixels > 0 {
            let (nodes, pixels) = (difference.lost_nodes, difference.right_pixels);
            frame.false_culls = vec![FalseCull { cause: FalseCullCause::HiddenInF64, nodes, pixels }];
        }
        frame.full_detail = self.error;
    }
}

impl Auditor {
    /// A frame without culling, for comparisons with culled ones; `with_error` also compares it with full
    /// detail, which takes longest.
    ///
    /// # Errors
    /// If the device fails.
    pub fn reference(&mut self, camera: Camera, with_error: bool) -> Result<Reference, AuditError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let mut picture = Image::default();
        let cut = self.unculled(camera, &mut picture)?;
        let items = self.draw_items(&view, &rule, &cut)?;
        let owners = items_of(&items)?;
        let exact: Vec<_> = exactly_visible(&owners).into_iter().map(DrawableId).collect();
        let drawn = Drawn { ids: &cut, picture: &picture, items: &items };
        let error = if with_error {
            let full = self.full(camera)?;
            Some(self.level_error(&view, &rule, drawn, &full)?)
        } else {
            None
        };
        Ok(Reference {
            camera,
            picture: fingerprint(&picture),
            objects: count_objects(&self.redrawer.scene, exact.iter().copied()),
            triangles: exactly_visible_triangles(&owners, &items.triangle),
            error,
            exact,
        })
    }

    /// A frame's pictures without culling: of its LOD cut, and at full detail.
    ///
    /// # Errors
    /// If the device fails.
    pub fn pictures(&mut self, camera: Camera) -> Result<[Image; 2], AuditError> {
        let mut unculled = Image::default();
        self.unculled(camera, &mut unculled)?;
        Ok([unculled, self.full(camera)?.picture.clone()])
    }

    /// Compares a drawn frame with its reference. A picture with a known fingerprint is redrawn only if that
    /// differs.
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
            return Ok(CullingDifference { pixels: 0, right_pixels: 0, lost_nodes });
        }
        let (mut shown, mut unculled) = (Image::default(), Image::default());
        self.picture(record, &mut shown)?;
        self.unculled(record.camera, &mut unculled)?;
        let pixels = mismatching_pixels(&ImageRef::of(&shown)?, &ImageRef::of(&unculled)?)?;
        let right_pixels = if pixels > 0 { self.judged(record)?.driver } else { 0 };
        Ok(CullingDifference { pixels, right_pixels, lost_nodes })
    }

    /// Judges the pixels at which a drawn frame differs from the same frame without culling.
    fn judged(&mut self, record: &FrameRecord) -> Result<Judgement, GpuError> {
        let (cut, whole) = self.unculled_items(record.camera)?;
        let shown = self.items(record)?;
        let (view, rule) = self.redrawer.seen_from(&record.camera);
        let mut judgement = Judgement::default();
        judgement.add(&self.redrawer.scene, &view, &rule, &cut, [&whole, &shown]);
        Ok(judgement)
    }

    /// The LOD cut of a frame without culling, and the triangle at each pixel of it.
    ///
    /// # Errors
    /// If the device fails.
    pub fn unculled_items(&mut self, camera: Camera) -> Result<(Vec<DrawableId>, ItemImage), GpuError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let mut cut = lod_cut(&self.redrawer.scene, &view, &rule);
        draw_order(&self.redrawer.scene, &view, &mut cut);
        let items = self.draw_items(&view, &rule, &cut)?;
        Ok((cut, items))
    }

    /// The triangle at each pixel of a drawn frame.
    ///
    /// # Errors
    /// If the device fails.
    pub fn items(&mut self, record: &FrameRecord) -> Result<ItemImage, GpuError> {
        let (view, rule) = self.redrawer.seen_from(&record.camera);
        self.draw_items(&view, &rule, &record.ids)
    }

    /// Compares the triangle at each pixel of a drawn frame with that of the same frame without culling.
    ///
    /// # Errors
    /// If the device fails.
    pub fn triangle_difference(
        &mut self,
        unculled: &ItemImage,
        record: &FrameRecord,
    ) -> Result<CullingDifference, AuditError> {
        let shown = self.items(record)?;
        let drawn: Vec<u32> = record.ids.iter().map(|id| id.0).collect();
        let lost = false_culls(&items_of(unculled)?, &items_of(&shown)?, &drawn)?;
        let pixels = (unculled.drawable.iter().zip(&unculled.triangle))
            .zip(shown.drawable.iter().zip(&shown.triangle))
            .filter(|(unculled, shown)| unculled != shown)
            .count();
        Ok(CullingDifference { pixels: pixels as u64, right_pixels: 0, lost_nodes: lost.nodes.len() as u64 })
    }
}

/// A frame at full detail, without culling.
pub(super) struct FullDetail {
    pub(super) camera: Camera,
    pub(super) state: ViewState,
    pub(super) picture: Image,
    pub(super) items: ItemImage,
}

/// A picture, and its drawables.
#[derive(Clone, Copy)]
pub(super) struct Drawn<'p> {
    pub(super) ids: &'p [DrawableId],
    pub(super) picture: &'p Image,
    pub(super) items: &'p ItemImage,
}

impl FullDetail {
    /// Whether it shows `camera` in `state`. The level rule does not matter at full detail.
    pub(super) fn is_of(&self, camera: &Camera, state: &ViewState) -> bool {
        self.camera == *camera && self.state == ViewState { lod: self.state.lod, ..state.clone() }
    }
}
