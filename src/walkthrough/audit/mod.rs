//! The errors of a picture: against its own LOD cut without culling, and against full detail.

mod attribution;
mod deviation;
mod due;
mod judgement;
mod popping;
mod reference;

use std::{collections::BTreeSet, sync::Arc};

use thiserror::Error;
use trimaran_actors::CullerDevice;
use trimaran_audit::{
    Missing,
    metrics::{
        self, ImageRef, MetricError, exactly_visible, exactly_visible_triangles, false_culls,
        mismatching_pixels,
    },
};
use trimaran_cull::{Choice, CutRule, Image, ImageDifference, LodCut, View, draw_order, lod_cut};
use trimaran_gpu::{GpuError, GpuScene, ItemImage, ItemPass};
use trimaran_proto::{Camera, DrawableId, FrameNumber};
use trimaran_scene::{Level, NodeId, Scene};

pub use attribution::AttributionError;
#[cfg(test)]
pub(super) use deviation::finest_below;
pub(super) use due::DueAudits;
pub use judgement::Judgement;
pub use popping::LevelSwitch;
pub use reference::{CullingDifference, Reference};
use reference::{Drawn, FullDetail};

use super::{
    compose::FrameRecord,
    objects::count_objects,
    redraw::{GivesUp, RedrawError, Redrawer},
    view_states::ViewStates,
};
use crate::report::schema::{Frame, VisibleObject};

/// Why a frame could not be checked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AuditError {
    /// The device failed.
    #[error("drawing for the audit failed")]
    Gpu(#[from] GpuError),
    /// The picture could not be drawn again, or the check was cancelled.
    #[error(transparent)]
    Redraw(#[from] RedrawError),
    /// The pictures differ in size.
    #[error("comparing pictures failed")]
    Metric(#[from] MetricError),
    /// Something visible was not drawn, and repeating the culler's work to find the cause failed.
    #[error("{frame} was culled falsely; culling it again, to see why, failed")]
    Attribution {
        /// The frame.
        frame: FrameNumber,
        /// The cause.
        #[source]
        cause: AttributionError,
    },
}

/// The pictures of one audited frame.
#[derive(Debug, Clone, Default)]
pub struct AuditPictures {
    /// As shown.
    pub shown: Image,
    /// The same LOD cut without culling.
    pub unculled: Image,
    /// Full detail without culling.
    pub full: Image,
}

/// Checks frames of a finished session, off its clock: draws each again from its record, as shown, without
/// culling and at full detail.
pub struct Auditor {
    redrawer: Redrawer,
    drawn: Arc<GpuScene>,
    /// Made when the first frame is checked.
    items: Option<ItemPass>,
    /// The last picture at full detail: frames of one camera at several error bounds share it.
    full: Option<Arc<FullDetail>>,
}

impl Auditor {
    /// An auditor for frames with these view states.
    ///
    /// # Errors
    /// If the device cannot draw that size.
    pub fn new(
        scene: &Arc<Scene>,
        drawn: &Arc<GpuScene>,
        views: impl Into<ViewStates>,
    ) -> Result<Self, GpuError> {
        let redrawer = Redrawer::new(scene, drawn, views)?;
        Ok(Self { redrawer, drawn: Arc::clone(drawn), items: None, full: None })
    }

    /// Abandons a check with an error as soon as `is_given_up` says so, also while the device draws. After
    /// that nothing more can be checked.
    pub fn give_up_when(&mut self, is_given_up: GivesUp) {
        self.redrawer.give_up_when(is_given_up);
    }

    /// Uses these view states for the frames from now on, with the same picture size.
    pub fn see(&mut self, views: impl Into<ViewStates>) {
        self.redrawer.see(views);
    }

    /// The picture of a frame, drawn again.
    ///
    /// # Errors
    /// If the device fails, or draws another picture than before.
    pub fn picture(&mut self, record: &FrameRecord, into: &mut Image) -> Result<(), RedrawError> {
        self.redrawer.picture(record, into)
    }

    /// Checks the last frame of `walk`, which holds all frames up to it. Enters the results into `frame`,
    /// with the names of the visible objects if `names`, and leaves the pictures in `pictures`. If something
    /// visible is missing, `machine` repeats the work of the frame's machine to find the cause; without it no
    /// cause is searched for. If a picture lacks drawables, only its pixels that are not exact yet are
    /// counted.
    ///
    /// # Errors
    /// If a device fails.
    pub fn audit<D: CullerDevice>(
        &mut self,
        machine: Option<&mut D>,
        walk: &[FrameRecord],
        names: bool,
        frame: &mut Frame,
        pictures: &mut AuditPictures,
    ) -> Result<(), AuditError> {
        let Some(record) = walk.last() else { return Ok(()) };
        let (view, rule) = self.redrawer.seen_from(&record.camera);
        self.redrawer.go_on()?;
        self.picture(record, &mut pictures.shown)?;
        self.redrawer.go_on()?;
        let cut = self.unculled(record.camera, &mut pictures.unculled)?;
        self.redrawer.go_on()?;
        let full = self.full(record.camera)?;
        self.redrawer.go_on()?;
        pictures.full.clone_from(&full.picture);
        frame.triangles_exact_full = exactly_visible_triangles(&items_of(&full.items)?, &full.items.triangle);
        let objects = self.objects(&exactly_visible(&items_of(&full.items)?));
        frame.objects_exact_full = Some(objects.len() as u64);
        if names {
            frame.visible = Some(objects.iter().map(|&object| self.named(object)).collect());
        }
        if record.lacking > 0 {
            frame.loading_pixels = Some(pixels_unlike_unculled(pictures)?);
            return Ok(());
        }

        self.redrawer.go_on()?;
        let shown_items = self.draw_items(&view, &rule, &record.ids)?;
        self.redrawer.go_on()?;
        let cut_items = self.draw_items(&view, &rule, &cut)?;
        let missing = enter_culling(frame, record, pictures, &shown_items, &cut_items)?;
        if !missing.is_empty()
            && let Some(machine) = machine
        {
            let number = record.camera.frame();
            frame.false_culls =
                attribution::false_culls(&self.redrawer.scene, &self.redrawer.views, machine, walk, &missing)
                    .map_err(|cause| AuditError::Attribution { frame: number, cause })?;
        }
        self.redrawer.go_on()?;
        let exact = exactly_visible(&items_of(&cut_items)?).into_iter().map(DrawableId);
        frame.objects_exact = Some(count_objects(&self.redrawer.scene, exact));
        let drawn = Drawn { ids: &record.ids, picture: &pictures.shown, items: &shown_items };
        frame.full_detail = Some(self.level_error(&view, &rule, drawn, &full)?);
        Ok(())
    }

    /// Draws the LOD cut of a frame without culling, and returns it in the order drawn.
    ///
    /// # Errors
    /// If the device fails.
    pub fn unculled(&mut self, camera: Camera, picture: &mut Image) -> Result<Vec<DrawableId>, GpuError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let mut cut = lod_cut(&self.redrawer.scene, &view, &rule);
        draw_order(&self.redrawer.scene, &view, &mut cut);
        self.redrawer.draw(&view, &rule, &cut, picture)?;
        Ok(cut)
    }

    /// The triangle at each pixel, at full detail and without culling: the ground truth of visibility.
    ///
    /// # Errors
    /// If the device fails.
    pub fn full_detail_items(&mut self, camera: Camera) -> Result<ItemImage, GpuError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let finest = self.full_detail(&view, &rule);
        self.draw_items(&view, &rule, &finest)
    }

    fn full(&mut self, camera: Camera) -> Result<Arc<FullDetail>, GpuError> {
        let (view, rule) = self.redrawer.seen_from(&camera);
        let state = self.redrawer.views.of(&camera).clone();
        if let Some(full) = self.full.as_ref().filter(|full| full.is_of(&camera, &state)) {
            return Ok(Arc::clone(full));
        }
        let finest = self.full_detail(&view, &rule);
        let mut picture = Image::default();
        self.redrawer.draw(&view, &rule, &finest, &mut picture)?;
        let items = self.draw_items(&view, &rule, &finest)?;
        Ok(Arc::clone(self.full.insert(Arc::new(FullDetail { camera, state, picture, items }))))
    }

    /// Draws the ID buffer of the solid drawables.
    fn draw_items(&mut self, view: &View, rule: &CutRule, ids: &[DrawableId]) -> Result<ItemImage, GpuError> {
        let mut image = ItemImage::default();
        let solid = rule.divide(&self.redrawer.scene, ids, &mut Vec::new());
        let items = match self.items.take() {
            Some(items) => items,
            None => {
                let mut items = ItemPass::new(&self.drawn, view.viewport())?;
                if let Some(is_given_up) = self.redrawer.is_given_up.clone() {
                    items.cancel_when(move || is_given_up());
                }
                items
            }
        };
        let items = self.items.insert(items);
        items.begin(view)?;
        items.draw(&solid)?;
        items.finish()?;
        items.read(&mut image)?;
        Ok(image)
    }

    /// The pieces of the finest level of every leaf that is shown and inside the frustum, in drawing order.
    fn full_detail(&self, view: &View, rule: &CutRule) -> Vec<DrawableId> {
        let cut = LodCut::new(&self.redrawer.scene, view, rule);
        let mut finest = Vec::new();
        let mut open = vec![NodeId(0)];
        while let Some(id) = open.pop() {
            let Some(node) = self.redrawer.scene.nodes().get(id.0 as usize) else { continue };
            if cut.outside(node) || cut.choose(id, node) == Choice::Nothing {
                continue;
            }
            if node.is_leaf() {
                finest.extend(self.redrawer.scene.levels(node).next().into_iter().flat_map(Level::pieces));
            }
            open.extend(node.children().map(NodeId));
        }
        draw_order(&self.redrawer.scene, view, &mut finest);
        finest
    }

    /// The error of the levels of detail: the picture against full detail.
    fn level_error(
        &self,
        view: &View,
        rule: &CutRule,
        drawn: Drawn<'_>,
        full: &FullDetail,
    ) -> Result<ImageDifference, MetricError> {
        let (shown, all) = (items_of(drawn.items)?, items_of(&full.items)?);
        let cut = LodCut::new(&self.redrawer.scene, view, rule);
        metrics::image_difference(
            &ImageRef::of(&full.picture)?,
            &ImageRef::of(drawn.picture)?,
            deviation::silhouette(&self.redrawer.scene, view, drawn.ids, &shown, &all)?,
            deviation::surfaces(&self.redrawer.scene, view, &cut.levels(), &shown, &all),
        )
    }

    /// The objects that these drawables belong to, ascending, each once.
    fn objects(&self, drawables: &[u32]) -> BTreeSet<u32> {
        drawables
            .iter()
            .filter_map(|&id| self.redrawer.scene.drawables().get(id as usize))
            .filter_map(|drawable| self.redrawer.scene.nodes().get(drawable.node as usize))
            .map(|node| node.object)
            .collect()
    }

    fn named(&self, object: u32) -> VisibleObject {
        let record = self.redrawer.scene.objects().get(object as usize);
        VisibleObject {
            name: self.redrawer.scene.object_name(object).unwrap_or_default().to_owned(),
            source: record
                .and_then(|r| self.redrawer.scene.source_name(r.source))
                .unwrap_or_default()
                .to_owned(),
            source_index: record.map_or(object, |r| r.source_index),
        }
    }
}

/// The error of culling: the picture against the same LOD cut without it. Returns the missing drawables.
fn enter_culling(
    frame: &mut Frame,
    record: &FrameRecord,
    pictures: &AuditPictures,
    shown: &ItemImage,
    cut: &ItemImage,
) -> Result<Vec<Missing>, MetricError> {
    let (shown_items, cut_items) = (items_of(shown)?, items_of(cut)?);
    frame.nodes_exact = Some(exactly_visible(&cut_items).len() as u64);
    frame.triangles_exact = exactly_visible_triangles(&cut_items, &cut.triangle);
    let drawn: Vec<u32> = record.ids.iter().map(|id| id.0).collect();
    let lost = false_culls(&cut_items, &shown_items, &drawn)?;
    frame.false_culled_nodes = Some(lost.nodes.len() as u64);
    frame.false_culled_pixels = Some(lost.pixels);
    frame.false_culled_blob_px = Some(lost.largest_blob);
    frame.cut_mismatch_pixels = Some(pixels_unlike_unculled(pictures)?);
    let mut pixels = deviation::pixels_by_owner(&cut_items);
    let missing = lost.nodes.iter().filter_map(|(id, _)| {
        let id = DrawableId(*id);
        Some(Missing { id, pixels: pixels.remove(&id)? })
    });
    Ok(missing.collect())
}

fn pixels_unlike_unculled(pictures: &AuditPictures) -> Result<u64, MetricError> {
    mismatching_pixels(&ImageRef::of(&pictures.shown)?, &ImageRef::of(&pictures.unculled)?)
}

fn items_of(image: &ItemImage) -> Result<metrics::IdBufferRef<'_>, MetricError> {
    metrics::IdBufferRef::new(image.width, image.height, &image.drawable, ItemImage::BACKGROUND)
}
