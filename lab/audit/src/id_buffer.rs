//! Rasterizes drawables into an ID buffer with depth (the paper: item buffer).

use glam::DVec3;
use trimaran_cull::{View, Viewport};
use trimaran_proto::DrawableId;
use trimaran_scene::{Drawable, Scene};

use crate::raster::{Coverage, rasterize_triangle};

/// The visible triangle at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TriangleId {
    /// The drawable.
    pub drawable: DrawableId,
    /// The triangle in it, counted from 0.
    pub triangle: u32,
}

/// How vertices are transformed from their node's frame to view space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Placement {
    /// In f64 all the way.
    #[default]
    Exact,
    /// Like a GPU: matrix and translation about the eye composed in f64, rounded to f32, and applied in f32.
    Single,
}

/// Depth and triangle at every pixel, row by row from the top left.
#[derive(Debug, Clone, PartialEq)]
pub struct IdBuffer {
    viewport: Viewport,
    depth: Vec<f64>,
    ids: Vec<Option<TriangleId>>,
}

impl IdBuffer {
    /// An empty buffer: the background everywhere.
    #[must_use]
    pub fn new(viewport: Viewport) -> Self {
        let pixels = viewport.width() as usize * viewport.height() as usize;
        Self { viewport, depth: vec![0.0; pixels], ids: vec![None; pixels] }
    }

    /// The size.
    #[must_use]
    pub const fn viewport(&self) -> Viewport {
        self.viewport
    }

    /// Reversed depth (near / distance); 0 for the background.
    #[must_use]
    pub fn depth(&self) -> &[f64] {
        &self.depth
    }

    /// Reversed depth as a D32 buffer holds it.
    #[must_use]
    pub fn depth32(&self) -> Vec<f32> {
        self.depth.iter().map(|&depth| depth as f32).collect()
    }

    /// The triangle at each pixel; `None` for the background.
    #[must_use]
    pub fn ids(&self) -> &[Option<TriangleId>] {
        &self.ids
    }

    /// The visible drawables, each once, in ascending order.
    #[must_use]
    pub fn seen(&self) -> Vec<DrawableId> {
        let mut seen: Vec<DrawableId> = self.ids.iter().flatten().map(|id| id.drawable).collect();
        seen.sort_unstable();
        seen.dedup();
        seen
    }

    /// The number of pixels at which the other buffer has another triangle.
    #[must_use]
    pub fn differing_pixels(&self, other: &Self) -> usize {
        let unpaired = self.ids.len().abs_diff(other.ids.len());
        unpaired + self.ids.iter().zip(&other.ids).filter(|(a, b)| a != b).count()
    }

    /// Depth-tests one pixel of a triangle that belongs to no drawable: an occluder by hand.
    pub fn cover(&mut self, hit: Coverage) {
        if let Some(depth) = self.depth.get_mut(hit.pixel) {
            *depth = depth.max(hit.depth);
        }
    }

    /// The depth change of the surface at a pixel to the next pixel, in `view`.
    pub(crate) fn slope(&self, scene: &Scene, view: &View, pixel: usize) -> f64 {
        let corners = self.ids.get(pixel).copied().flatten().and_then(|shown| {
            let drawable = scene.drawables().get(shown.drawable.index())?;
            triangles(scene, view, drawable, Placement::Exact).nth(shown.triangle as usize)
        });
        let Some([a, b, c]) = corners else { return 0.0 };
        // Depth is near / distance: on the screen it is linear along a plane.
        let normal = (b - a).cross(c - a);
        let scale = f64::from(view.camera().near()) / normal.dot(a);
        let slope = (normal.x / view.focal_x()).abs().max((normal.y / view.focal_y()).abs()) * scale.abs();
        // Edge-on, its depth is undefined.
        if slope.is_finite() { slope } else { 0.0 }
    }

    /// Moves everything drawn nearer to the eye by a fraction of its distance: a fault for tests.
    pub(crate) fn bring_nearer(&mut self, fraction: f64) {
        for depth in &mut self.depth {
            *depth *= 1.0 + fraction;
        }
    }

    /// Draws one drawable, without the parts that sections cut away. Of equal depths the first drawn stays.
    pub fn draw(&mut self, scene: &Scene, view: &View, id: DrawableId, placement: Placement) {
        let Some(drawable) = scene.drawables().get(id.index()) else { return };
        let planes: Vec<_> = view.section_planes().collect();
        let kept = |hit: &Coverage| {
            planes.is_empty() || {
                let place = unproject(view, hit.pixel, hit.depth).extend(1.0);
                planes.iter().all(|plane| plane.dot(place) >= 0.0)
            }
        };
        for (triangle, corners) in (0..).zip(triangles(scene, view, drawable, placement)) {
            rasterize_triangle(view, corners, |hit| {
                let (Some(depth), Some(shown)) = (self.depth.get_mut(hit.pixel), self.ids.get_mut(hit.pixel))
                else {
                    return;
                };
                let nearness = match placement {
                    Placement::Exact => hit.depth,
                    Placement::Single => f64::from(hit.depth as f32),
                };
                if nearness > *depth && kept(&hit) {
                    *depth = nearness;
                    *shown = Some(TriangleId { drawable: id, triangle });
                }
            });
        }
    }
}

/// The point at a pixel's centre with this reversed depth, in view space.
pub(crate) fn unproject(view: &View, pixel: usize, depth: f64) -> DVec3 {
    let (width, height) = (view.viewport().width() as usize, f64::from(view.viewport().height()));
    let distance = f64::from(view.camera().near()) / depth;
    let (x, y) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
    DVec3::new(
        (x - width as f64 * 0.5) / view.focal_x() * distance,
        (height * 0.5 - y) / view.focal_y() * distance,
        -distance,
    )
}

/// Draws `ids` in the order given.
#[must_use]
pub fn rasterize(
    scene: &Scene,
    view: &View,
    ids: impl IntoIterator<Item = DrawableId>,
    placement: Placement,
) -> IdBuffer {
    let mut buffer = IdBuffer::new(view.viewport());
    for id in ids {
        buffer.draw(scene, view, id, placement);
    }
    buffer
}

/// The drawable's triangles in view space.
pub(crate) fn triangles<'s>(
    scene: &'s Scene,
    view: &View,
    drawable: &Drawable,
    placement: Placement,
) -> impl Iterator<Item = [DVec3; 3]> + use<'s> {
    let node = scene.nodes().get(drawable.node as usize);
    let place = node.map(|node| {
        (view.to_view() * node.linear().as_dmat3(), view.to_view() * (node.origin() - view.eye()))
    });
    scene.triangles(drawable).filter_map(move |corners| {
        let (linear, origin) = place?;
        Some(corners.map(|corner| match placement {
            Placement::Exact => origin + linear * corner.as_dvec3(),
            Placement::Single => (origin.as_vec3() + linear.as_mat3() * corner).as_dvec3(),
        }))
    })
}
