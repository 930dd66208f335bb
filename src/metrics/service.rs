//! The open parts of a process: its scene, its device, its place for guests.

use std::{
    fmt,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicBool, Ordering},
    },
};

use parking_lot::RwLock;
use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeLabelSet, EncodeMetric},
    metrics::{MetricType, gauge::ConstGauge, info::Info},
};

use super::SceneReading;

/// The state of a process. Clones share it.
#[derive(Debug, Clone, Default)]
pub(super) struct Service {
    opened: Arc<OnceLock<Opened>>,
    places: Arc<RwLock<Option<usize>>>,
    ready: Arc<AtomicBool>,
}

/// The open scene and device of a process.
pub struct Opened {
    /// Its scene.
    pub scene: SceneReading,
    /// The name of its device.
    pub device: String,
    /// Reads the memory of the device that it uses.
    pub memory: Box<dyn Fn() -> DeviceMemory + Send + Sync>,
    /// Reads how many pages are open in browsers, if it serves pages.
    pub pages: Option<Box<dyn Fn() -> usize + Send + Sync>>,
}

/// Bytes of a device's memory that a process has taken.
#[derive(Debug, Clone, Copy, Default)]
pub struct DeviceMemory {
    /// For geometry.
    pub geometry: u64,
    /// For the depth of its sessions.
    pub depth: u64,
}

impl fmt::Debug for Opened {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Opened").field("scene", &self.scene).finish_non_exhaustive()
    }
}

impl Service {
    /// Only the first call counts: a process opens one scene.
    pub(super) fn opened(&self, opened: Opened) {
        let _there_already = self.opened.set(opened);
    }

    pub(super) fn has_places(&self, places: usize) {
        *self.places.write() = Some(places);
    }

    pub(super) fn places(&self) -> Option<usize> {
        *self.places.read()
    }

    pub(super) fn get(&self) -> Option<&Opened> {
        self.opened.get()
    }

    pub(super) fn ready(&self) {
        self.ready.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_ready(&self) -> bool {
        self.ready.load(Ordering::Relaxed)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Kind {
    kind: &'static str,
}

impl Collector for Service {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let help = "1 once scene, device and sockets are open";
        let ready = encoder.encode_descriptor("ready", help, None, MetricType::Gauge)?;
        ConstGauge::new(i64::from(self.is_ready())).encode(ready)?;
        if let Some(places) = self.places() {
            let help = "How many sessions or links it has places for";
            let gauge = encoder.encode_descriptor("places", help, None, MetricType::Gauge)?;
            ConstGauge::new(places as f64).encode(gauge)?;
        }
        let Some(Opened { scene, device, memory, pages }) = self.get() else { return Ok(()) };
        let info = encoder.encode_descriptor("scene", "The scene and the device", None, MetricType::Info)?;
        let labels = [
            ("name", scene.name.clone()),
            ("fingerprint", scene.fingerprint.clone()),
            ("triangles", scene.triangles.to_string()),
            ("objects", scene.objects.to_string()),
            ("device", device.clone()),
        ];
        Info::new(labels).encode(info)?;
        let DeviceMemory { geometry, depth } = memory();
        let help = "Memory of the device that is taken, by use";
        let mut family = encoder.encode_descriptor("gpu_memory_bytes", help, None, MetricType::Gauge)?;
        for (kind, bytes) in [("geometry", geometry), ("depth", depth)] {
            ConstGauge::new(bytes as f64).encode(family.encode_family(&Kind { kind })?)?;
        }
        if let Some(pages) = pages {
            let gauge = encoder.encode_descriptor("pages", "Pages in browsers", None, MetricType::Gauge)?;
            ConstGauge::new(pages() as f64).encode(gauge)?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::metrics::Metrics;

    /// An open scene with pages.
    pub(in crate::metrics) fn plant() -> Opened {
        Opened {
            scene: SceneReading {
                name: "plant \"A\".scene".to_owned(),
                fingerprint: "00ff".to_owned(),
                triangles: 12,
                objects: 1,
            },
            device: "llvmpipe".to_owned(),
            memory: Box::new(|| DeviceMemory { geometry: 1024, depth: 56 }),
            pages: Some(Box::new(|| 3)),
        }
    }

    #[test]
    fn a_scene_and_the_memory_are_there_once_they_are_open() {
        let metrics = Metrics::new("culler");
        assert!(!metrics.text().unwrap().contains("trimaran_scene_info"));
        metrics.opened(plant());
        let text = metrics.text().unwrap();
        for line in [
            "trimaran_ready 0",
            "trimaran_scene_info{name=\"plant \\\"A\\\".scene\",fingerprint=\"00ff\",triangles=\"12\",\
             objects=\"1\",device=\"llvmpipe\"} 1",
            "trimaran_gpu_memory_bytes{kind=\"geometry\"} 1024.0",
            "trimaran_gpu_memory_bytes{kind=\"depth\"} 56.0",
            "trimaran_pages 3.0",
        ] {
            assert!(text.lines().any(|found| found == line), "no {line} in {text}");
        }
        metrics.ready();
        assert!(metrics.text().unwrap().contains("trimaran_ready 1"));
    }
}
