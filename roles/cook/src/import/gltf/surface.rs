//! A primitive's triangles during colouring.

use glam::Vec3;

use super::gradient::Coloured;
use super::material::{Alpha, Material};
use super::texture::Placed;
use crate::lists::at;

/// A primitive's vertices and triangles. Colours are linear; without any, all vertices have the material's.
pub(super) struct Surface {
    pub positions: Vec<Vec3>,
    pub colours: Option<Vec<[f32; 4]>>,
    pub coordinates: Option<Vec<[f32; 2]>>,
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Some of its triangles, with the vertices that they use.
    pub(super) fn part(&self, triangles: &[[u32; 3]]) -> Self {
        let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        let number = |corner: u32| used.partition_point(|&pick| pick < corner) as u32;
        Self {
            positions: pick(&self.positions, &used),
            colours: self.colours.as_ref().map(|colours| pick(colours, &used)),
            coordinates: self.coordinates.as_ref().map(|coordinates| pick(coordinates, &used)),
            triangles: triangles.iter().map(|triangle| triangle.map(number)).collect(),
        }
    }

    /// Colours each triangle by a texture, and leaves out those that are all hole. Returns whether the
    /// texture has several colours within one.
    pub(super) fn paint(
        &mut self,
        texture: &Placed<'_>,
        coordinates: &[[f32; 2]],
        material: &Material,
    ) -> bool {
        let alpha = material.alpha();
        let (mut positions, mut colours, mut varies) = (Vec::new(), Vec::new(), false);
        for &triangle in &self.triangles {
            let mean = texture.mean(triangle.map(|corner| at(coordinates, corner)));
            let own = self.mean_colour(triangle, material);
            let mut colour = [0, 1, 2, 3].map(|channel: usize| mean.colour[channel] * own[channel]);
            match alpha {
                Alpha::Opaque => colour[3] = 1.0,
                Alpha::Mask(_) if mean.colour[3] == 0.0 => continue,
                // The share without holes.
                Alpha::Mask(_) => colour[3] = mean.colour[3],
                Alpha::Blend => {}
            }
            varies |= mean.varies;
            let corners = triangle.map(|corner| at(&self.positions, corner));
            positions.extend(corners);
            colours.extend([colour; 3]);
        }
        self.triangles = (0..positions.len() as u32 / 3).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        self.positions = positions;
        self.colours = Some(colours);
        varies
    }

    /// Applies alpha, leaves out triangles that are holes, and cuts those whose colour changes.
    pub(super) fn shade(&mut self, material: &Material) {
        if let Alpha::Mask(cutoff) = material.alpha() {
            let cutoff = f32::from(cutoff) / 255.0;
            let mut triangles = std::mem::take(&mut self.triangles);
            triangles.retain(|&triangle| self.mean_colour(triangle, material)[3] >= cutoff);
            self.triangles = triangles;
        }
        let Self { positions, colours: Some(colours), triangles, .. } = self else { return };
        if material.alpha() != Alpha::Blend {
            colours.iter_mut().for_each(|[.., alpha]| *alpha = 1.0);
        }
        Coloured { positions, colours, triangles }.cut();
    }

    /// The mean of a triangle's corners.
    fn mean_colour(&self, triangle: [u32; 3], material: &Material) -> [f32; 4] {
        let Some(colours) = &self.colours else { return material.factor() };
        let corners = triangle.map(|corner| at(colours, corner));
        [0, 1, 2, 3].map(|channel: usize| corners.iter().map(|corner| corner[channel]).sum::<f32>() / 3.0)
    }
}

fn pick<T: Copy>(all: &[T], picks: &[u32]) -> Vec<T> {
    picks.iter().filter_map(|&pick| all.get(pick as usize).copied()).collect()
}
