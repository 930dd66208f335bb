//! The LOD selection that the display asks for.

use trimaran_cull::{LodRule, LodRuleError};
use trimaran_proto::Settings;

pub(super) fn lod_rule(settings: &Settings) -> Result<LodRule, LodRuleError> {
    Ok(LodRule::new(settings.epsilon.pixels())?.stopping_at_few_pixels(settings.few_pixels))
}

#[cfg(test)]
mod tests {
    use trimaran_proto::{BatchSize, EpsilonPx, FrameNumber, IdCoding, PictureSize, TesterKind};

    use super::*;

    #[test]
    fn the_display_decides_bound_and_rule() {
        for few_pixels in [false, true] {
            let settings = Settings {
                size: PictureSize::new(8, 8).unwrap(),
                epsilon: EpsilonPx::new(3.0).unwrap(),
                batch: BatchSize::default(),
                coding: IdCoding::Plain,
                tester: TesterKind::Raster,
                lockstep: true,
                few_pixels,
                first: FrameNumber(0),
                frames: None,
            };
            let rule = lod_rule(&settings).unwrap();
            assert_eq!((rule.epsilon_px(), rule.stops_at_few_pixels()), (3.0, few_pixels));
        }
    }
}
