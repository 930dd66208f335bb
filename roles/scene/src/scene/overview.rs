//! Where to begin in a scene, as its file has it: bytes of postcard.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A box with its sides along the axes, metres in the world.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Bounds {
    /// Lower corner.
    pub min: [f64; 3],
    /// Upper corner.
    pub max: [f64; 3],
}

/// A place to begin, and the extent of most of a scene, for viewers. Lengths are metres, in world space with
/// y up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Overview {
    /// The box around the scene without the few objects that lie far from all others.
    pub core: Bounds,
    /// Where to begin: the eye's position.
    pub eye: [f64; 3],
    /// Its viewing direction, a unit vector.
    pub forward: [f64; 3],
    /// Whether there are floors to walk on.
    pub has_floors: bool,
    /// Height of the eye above floors: see [`AutoPath`](crate::path::AutoPath).
    pub eye_height: f64,
    /// The least distance between an eye and any surface.
    pub clearance: f64,
    /// Vertical field of view, degrees.
    pub vfov_deg: f64,
}

impl Overview {
    /// As bytes.
    pub(super) fn encode(&self) -> Vec<u8> {
        // Numbers alone always fit.
        postcard::to_stdvec(self).unwrap_or_default()
    }

    /// The reverse; `None` if the bytes are invalid.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        let (this, rest) = postcard::take_from_bytes::<Self>(bytes).ok()?;
        rest.is_empty().then_some(this)?.sound()
    }

    /// Itself, if its numbers make sense.
    pub(crate) fn sound(self) -> Option<Self> {
        let Self { core, eye, forward, eye_height, clearance, vfov_deg, .. } = self;
        let [min, max, eye, forward] = [core.min, core.max, eye, forward].map(DVec3::from_array);
        let is_sound = min.is_finite()
            && max.is_finite()
            && min.cmple(max).all()
            && eye.is_finite()
            && forward.try_normalize().is_some()
            && [eye_height, clearance].iter().all(|length| length.is_finite() && *length > 0.0)
            && vfov_deg > 0.0
            && vfov_deg < 180.0;
        is_sound.then_some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_overview_that_makes_no_sense_is_refused() {
        let sound = Overview {
            core: Bounds { min: [-1.0; 3], max: [2.0; 3] },
            eye: [0.0, 1.7, 5.0],
            forward: [0.0, 0.0, -1.0],
            has_floors: true,
            eye_height: 1.7,
            clearance: 0.2,
            vfov_deg: 60.0,
        };
        assert_eq!(Overview::decode(&sound.encode()), Some(sound));
        let bytes = sound.encode();
        assert_eq!(Overview::decode(&bytes[..bytes.len() - 1]), None);
        assert_eq!(Overview::decode(&[&*bytes, &[0]].concat()), None);
        let Bounds { min, max } = sound.core;
        for wrong in [
            Overview { eye: [f64::NAN, 0.0, 0.0], ..sound },
            Overview { forward: [0.0; 3], ..sound },
            Overview { clearance: 0.0, ..sound },
            Overview { eye_height: f64::INFINITY, ..sound },
            Overview { vfov_deg: 180.0, ..sound },
            Overview { core: Bounds { min: max, max: min }, ..sound },
        ] {
            assert_eq!(Overview::decode(&wrong.encode()), None, "{wrong:?}");
        }
    }
}
