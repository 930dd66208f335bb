//! The display's settings for a session.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{BatchSize, IdCoding, LodRule, OcclusionTestKind, Viewport};

/// The display's settings for itself and its cullers, sent in the handshake. Each field is valid by its type.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The size of the picture and of the culling depth buffer.
    pub viewport: Viewport,
    /// The LOD selection rule.
    pub lod: LodRule,
    /// The largest number of ids in a batch.
    pub batch: BatchSize,
    /// The coding of ids on links between processes.
    pub coding: IdCoding,
    /// The occlusion test. A LOD rule that stops at few pixels needs a test that counts pixels.
    pub occlusion_test: OcclusionTestKind,
}

impl Settings {
    /// Batches of the default size, ids as changes, and boxes tested against a depth pyramid.
    #[must_use]
    pub fn new(viewport: Viewport, lod: LodRule) -> Self {
        Self {
            viewport,
            lod,
            batch: BatchSize::default(),
            coding: IdCoding::Changes,
            occlusion_test: OcclusionTestKind::Hzb,
        }
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { viewport, lod, batch, coding, occlusion_test } = self;
        write!(
            f,
            "{viewport} at {} px, {} ids a batch, coding {coding}, occlusion test {occlusion_test}",
            lod.epsilon_px(),
            batch.items()
        )?;
        if lod.stops_at_few_pixels() {
            f.write_str(", stopping at few pixels")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_settings_do_not_decode() {
        let sizes: Vec<u8> = postcard::to_stdvec(&(0u32, 5u32)).unwrap();
        assert!(postcard::from_bytes::<Viewport>(&sizes).is_err());
        let rule = postcard::to_stdvec(&(f64::NAN, false)).unwrap();
        assert!(postcard::from_bytes::<LodRule>(&rule).is_err());
        let batch = postcard::to_stdvec(&16_385u32).unwrap();
        assert!(postcard::from_bytes::<BatchSize>(&batch).is_err());
    }

    #[test]
    fn settings_are_said_in_one_line() {
        let plain = Settings::new(Viewport::new(640, 480).unwrap(), LodRule::new(2.0).unwrap());
        let said = "640x480 at 2 px, 256 ids a batch, coding changes, occlusion test hzb";
        assert_eq!(plain.to_string(), said);
        let few = Settings { lod: plain.lod.stopping_at_few_pixels(true), ..plain };
        assert_eq!(few.to_string(), format!("{said}, stopping at few pixels"));
    }
}
