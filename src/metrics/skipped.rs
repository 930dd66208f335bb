//! Frames that came and were not returned to their reader.

use std::fmt;

use prometheus_client::{
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter},
};
use serde::{Deserialize, Serialize};
use trimaran_transport::Skipped;

use super::links::LinkReading;

/// How many frames of a link were left out by this side's reader, by cause.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SkippedReading {
    /// A newer frame took their place.
    pub replaced: u64,
    /// They had waited longer than their lifespan.
    pub expired: u64,
    /// They lacked items that were given up (`mode=deadline`).
    pub incomplete: u64,
}

impl SkippedReading {
    pub(super) fn add(&mut self, other: Self) {
        self.replaced += other.replaced;
        self.expired += other.expired;
        self.incomplete += other.incomplete;
    }

    /// The counts by the name of the cause.
    #[must_use]
    pub const fn by_cause(&self) -> [(&'static str, u64); 3] {
        [("replaced", self.replaced), ("expired", self.expired), ("incomplete", self.incomplete)]
    }
}

impl From<Skipped> for SkippedReading {
    fn from(skipped: Skipped) -> Self {
        Self { replaced: skipped.replaced, expired: skipped.expired, incomplete: skipped.incomplete }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Cause {
    peer: String,
    cause: &'static str,
}

/// Writes the family.
pub(super) fn encode(
    readings: &[LinkReading],
    encoder: &mut DescriptorEncoder<'_>,
) -> Result<(), fmt::Error> {
    let help = "Frames that came and were not returned to their reader";
    let mut family = encoder.encode_descriptor("frames_skipped", help, None, MetricType::Counter)?;
    for LinkReading { peer, skipped, .. } in readings {
        for (cause, count) in skipped.by_cause() {
            let labels = Cause { peer: peer.clone(), cause };
            ConstCounter::new(count).encode(family.encode_family(&labels)?)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use trimaran_proto::{Camera, DrawableId, FrameNumber, Identity, Role, SceneHash, Walkthrough};
    use trimaran_transport::{FrameStart, KeepLast, LinkConfig, Net, TokioNet, inproc};

    use crate::metrics::LinkMetrics;

    #[tokio::test]
    async fn frames_that_a_slow_reader_leaves_out_are_counted_by_cause() {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let identity = |role| Identity { role, scene: Some(SceneHash(1).into()), session: None };
        let (culler, display) = (identity(Role::Culler), identity(Role::Display));
        let (mut culler, mut display) =
            inproc::pair::<Walkthrough>(&net, culler, display, &LinkConfig::default()).unwrap();
        let metrics = LinkMetrics::of([&display]);
        display.frames_rx = display.frames_rx.keep_last(KeepLast::default());
        for number in (0..3).map(FrameNumber) {
            let start = FrameStart { frame: number, header: Camera::at_origin(number) };
            culler.frames_tx.begin(start).await.unwrap();
            culler.frames_tx.push(&[DrawableId(7)]).await.unwrap();
            culler.frames_tx.finish().await.unwrap();
        }
        for _ in 0..10_000 {
            if metrics.read().iter().any(|link| link.skipped.replaced == 2) {
                break;
            }
            tokio::task::yield_now().await;
        }
        assert_eq!(display.frames_rx.frame().await.unwrap().start.frame, FrameNumber(2));
        let text = crate::metrics::Metrics::of("display", metrics).text().unwrap();
        for (cause, count) in [("replaced", 2), ("expired", 0), ("incomplete", 0)] {
            let line =
                format!("trimaran_link_frames_skipped_total{{peer=\"culler\",cause=\"{cause}\"}} {count}");
            assert!(text.lines().any(|found| found == line), "no {line} in {text}");
        }
    }
}
