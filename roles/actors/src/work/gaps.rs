//! The display's handling of lost ids (a link with deadlines): lost counts as visible.

use std::sync::Arc;

use trimaran_cull::{CutRule, OccluderError, OccluderMapper, View};
use trimaran_proto::DrawableId;
use trimaran_scene::Scene;

/// The last frame's set, with which a frame with gaps is filled.
#[derive(Debug)]
pub struct Gaps {
    scene: Arc<Scene>,
    last: Vec<DrawableId>,
    /// Made for the first gap: most sessions have none.
    mapper: Option<OccluderMapper>,
}

impl Gaps {
    /// For a display that shows `scene`, and has shown nothing yet.
    #[must_use]
    pub fn new(scene: &Arc<Scene>) -> Self {
        Self { scene: Arc::clone(scene), last: Vec::new(), mapper: None }
    }

    /// Adds to the received `ids` the last frame's set, mapped to the frame's LOD cut by `rule`. Returns how
    /// many were added.
    ///
    /// Lost ids were mostly visible a moment ago. Newly visible ones may be missing until the next frame,
    /// which is known: the frame counts as one with gaps.
    ///
    /// # Errors
    /// When the scene has no such id.
    pub fn fill(
        &mut self,
        view: View,
        rule: &CutRule,
        ids: &mut Vec<DrawableId>,
    ) -> Result<usize, OccluderError> {
        let mapper = match &mut self.mapper {
            Some(mapper) => {
                mapper.begin(view, rule);
                mapper
            }
            None => self.mapper.insert(OccluderMapper::new(Arc::clone(&self.scene), view, rule)),
        };
        let mut due = Vec::new();
        mapper.push(&self.last, &mut due)?;
        ids.sort_unstable_by_key(|id| id.0);
        let came = ids.len();
        due.retain(|id| ids.binary_search_by_key(&id.0, |id| id.0).is_err());
        ids.append(&mut due);
        Ok(ids.len() - came)
    }

    /// Notes the drawn set.
    pub fn drawn(&mut self, ids: &[DrawableId]) {
        self.last.clear();
        self.last.extend_from_slice(ids);
    }
}

#[cfg(test)]
mod tests {
    use trimaran_cook::generate::{PlantOptions, plant};
    use trimaran_cook::{CookOptions, cook};
    use trimaran_cull::{LodRule, Viewport, lod_cut};
    use trimaran_proto::{Camera, FrameNumber};

    use super::*;

    fn view(eye: [f64; 3], orientation: [f64; 4]) -> View {
        let camera = Camera::new(eye, orientation, 0.5, 0.1, FrameNumber(0)).unwrap();
        View::new(camera, Viewport::new(320, 240).unwrap())
    }

    /// The view into the scene, out of a few, that shows most; and the same one a little to the side.
    fn views(scene: &Scene, rule: LodRule) -> [View; 2] {
        let h = 0.5_f64.sqrt();
        let ways = [[0.0, 0.0, 0.0, 1.0], [0.0, h, 0.0, h], [h, 0.0, 0.0, h], [0.5, 0.5, 0.5, 0.5]];
        let eyes = (0..27).map(|at| [at % 3, at / 3 % 3, at / 9].map(|step| 12.0 * f64::from(step) - 12.0));
        let all = eyes.flat_map(|eye| ways.map(|way| (eye, way)));
        let best = all.max_by_key(|(eye, way)| lod_cut(scene, &view(*eye, *way), rule).len());
        let ([x, y, z], way) = best.unwrap();
        [view([x, y, z], way), view([x + 0.1, y + 0.1, z], way)]
    }

    fn cut(scene: &Scene, view: &View, rule: LodRule) -> Vec<u32> {
        let mut ids: Vec<u32> = lod_cut(scene, view, rule).into_iter().map(|id| id.0).collect();
        ids.sort_unstable();
        ids
    }

    #[test]
    fn a_lost_half_is_made_up_from_the_last_frame_at_the_levels_due_now() {
        let scene = Arc::new(cook(&plant(&PlantOptions::small(3)), &CookOptions::default(), &()).unwrap());
        let rule = LodRule::new(2.0).unwrap();
        let [before, now] = views(&scene, rule);
        let last = lod_cut(&scene, &before, rule);
        let whole = cut(&scene, &now, rule);
        assert!(whole.len() > 20, "{} ids", whole.len());
        let mut gaps = Gaps::new(&scene);
        gaps.drawn(&last);
        // Ids come in the order in which they were found visible.
        let mut ids: Vec<_> = whole.iter().rev().step_by(2).map(|id| DrawableId(*id)).collect();
        let came = ids.len();
        let added = gaps.fill(now, &rule.into(), &mut ids).unwrap();
        assert_eq!(ids.len(), came + added);
        let mut drawn: Vec<u32> = ids.iter().map(|id| id.0).collect();
        drawn.sort_unstable();
        assert!(drawn.windows(2).all(|pair| pair[0] < pair[1]), "nothing is drawn twice");
        assert!(drawn.iter().all(|id| whole.binary_search(id).is_ok()), "nothing but the cut");
        assert!(drawn.len() * 10 >= whole.len() * 9, "{} of {} ids", drawn.len(), whole.len());

        gaps.drawn(&ids);
        let mut ids = Vec::new();
        assert!(gaps.fill(before, &rule.into(), &mut ids).unwrap() > 20, "{} ids", ids.len());
        let cut_before = cut(&scene, &before, rule);
        assert_ne!(cut_before, whole);
        assert!(ids.iter().all(|id| cut_before.binary_search(&id.0).is_ok()), "the cut of this frame's view");

        gaps.drawn(&[]);
        let mut ids = vec![DrawableId(whole[0])];
        assert_eq!(gaps.fill(now, &rule.into(), &mut ids).unwrap(), 0, "no last frame, nothing to add");
    }
}
