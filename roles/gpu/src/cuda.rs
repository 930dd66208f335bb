//! The devices that CUDA's programs may use: job schedulers, such as Slurm, grant cards by these variables.

use std::env;

use thiserror::Error;

use crate::device_id::{PciAddress, UuidPrefix};
use crate::gpu_info::GpuInfo;

/// NVIDIA's number among the vendors of PCI devices.
const NVIDIA: u32 = 0x10de;

/// The value of `CUDA_VISIBLE_DEVICES`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CudaDevices {
    visible: String,
    /// Whether `CUDA_DEVICE_ORDER` is `PCI_BUS_ID`: its numbers then follow PCI addresses.
    by_pci: bool,
}

/// Why the variable names no device that Vulkan could open.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub(crate) enum NotFollowed {
    #[error("it names no device")]
    Empty,
    #[error("it names {0:?}, and Vulkan has no device with that UUID")]
    Unknown(String),
    #[error("it names device {index}, and Vulkan has {count} of NVIDIA's")]
    Past { index: usize, count: usize },
    #[error(
        "it names device {0} of different cards, and CUDA numbers these by speed: set \
         CUDA_DEVICE_ORDER=PCI_BUS_ID, or name a UUID"
    )]
    Order(usize),
    #[error("the device that it names cannot be used: it lacks {0}")]
    Unsuitable(String),
}

impl CudaDevices {
    /// The devices that `CUDA_VISIBLE_DEVICES` names, numbered as `CUDA_DEVICE_ORDER` says.
    #[must_use]
    pub fn new(visible: &str, order: Option<&str>) -> Self {
        Self { visible: visible.to_owned(), by_pci: order == Some("PCI_BUS_ID") }
    }

    /// The values in this process's environment; `None` if nothing restricts CUDA.
    #[must_use]
    pub fn from_environment() -> Option<Self> {
        let visible = env::var("CUDA_VISIBLE_DEVICES").ok()?;
        Some(Self::new(&visible, env::var("CUDA_DEVICE_ORDER").ok().as_deref()))
    }

    /// The place of the first one that it names in `found`; the first place if Vulkan has none that it names,
    /// with a warning.
    pub(crate) fn place_or_best(&self, found: &[GpuInfo]) -> usize {
        match self.place(found) {
            Ok(place) => place,
            Err(NotFollowed::Empty) => 0,
            Err(why) => {
                tracing::warn!("CUDA_VISIBLE_DEVICES={} is not followed: {why}", self.visible);
                0
            }
        }
    }

    fn place(&self, found: &[GpuInfo]) -> Result<usize, NotFollowed> {
        let first = self.visible.split(',').next().unwrap_or_default().trim();
        let place = match (first.parse::<usize>(), first.parse::<UuidPrefix>()) {
            (Ok(index), _) => self.numbered(index, found)?,
            (_, Ok(uuid)) => {
                let place = found.iter().position(|info| uuid.is_of(info.uuid));
                place.ok_or_else(|| NotFollowed::Unknown(first.to_owned()))?
            }
            // Without a card Slurm writes `NoDevFiles`, and others -1.
            _ if first.is_empty() || first == "-1" || first == "NoDevFiles" => {
                return Err(NotFollowed::Empty);
            }
            _ => return Err(NotFollowed::Unknown(first.to_owned())),
        };
        match found.get(place) {
            Some(info) if !info.missing.is_empty() => Err(NotFollowed::Unsuitable(info.missing.join(", "))),
            _ => Ok(place),
        }
    }

    /// CUDA numbers cards from the fastest on, and equal ones by PCI address. Vulkan does not know their
    /// speed, so different cards have numbers only by PCI address.
    fn numbered(&self, index: usize, found: &[GpuInfo]) -> Result<usize, NotFollowed> {
        let nvidia = found.iter().enumerate().filter(|(_, info)| info.vendor == NVIDIA);
        let mut cards: Vec<(Option<PciAddress>, usize)> =
            nvidia.map(|(place, info)| (info.pci, place)).collect();
        cards.sort_unstable();
        // A card with two drivers is listed twice.
        cards.dedup_by_key(|(pci, place)| pci.ok_or(*place));
        let mut names = cards.iter().filter_map(|(_, place)| Some(&found.get(*place)?.name));
        let first = names.next();
        let has_order = cards.len() < 2
            || cards.iter().all(|(pci, _)| pci.is_some())
                && (self.by_pci || names.all(|name| Some(name) == first));
        if !has_order {
            return Err(NotFollowed::Order(index));
        }
        let past = NotFollowed::Past { index, count: cards.len() };
        cards.get(index).map(|(_, place)| *place).ok_or(past)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu_info::listed;

    fn place(visible: &str, order: Option<&str>, found: &[GpuInfo]) -> Result<usize, NotFollowed> {
        CudaDevices::new(visible, order).place(found)
    }

    /// As Vulkan may list them: not by address, and the CPU's driver last.
    fn two_equal_cards() -> Vec<GpuInfo> {
        vec![listed("NVIDIA H200", Some(0x5e)), listed("NVIDIA H200", Some(0x3b)), listed("llvmpipe", None)]
    }

    #[test]
    fn two_tasks_that_were_granted_a_card_each_open_two_devices() {
        let found = two_equal_cards();
        assert_eq!([place("0", None, &found), place("1", None, &found)], [Ok(1), Ok(0)]);
        let uuids = found[..2].iter().map(|info| place(&format!("GPU-{}", info.uuid), None, &found));
        assert_eq!(uuids.collect::<Vec<_>>(), [Ok(0), Ok(1)]);
        let begun: String = found[1].uuid.to_string().chars().take(10).collect();
        assert_eq!(place(&format!(" GPU-{begun},GPU-0"), None, &found), Ok(1));
        assert_eq!(place("1,0", None, &found), Ok(0), "the first one is used");
    }

    #[test]
    fn numbers_of_different_cards_are_followed_by_address_alone() {
        let found = [listed("NVIDIA L4", Some(0x5e)), listed("NVIDIA H200", Some(0x3b))];
        assert_eq!(place("0", None, &found), Err(NotFollowed::Order(0)));
        assert_eq!(place("0", Some("FASTEST_FIRST"), &found), Err(NotFollowed::Order(0)));
        assert_eq!(place("0", Some("PCI_BUS_ID"), &found), Ok(1));
        let unaddressed = [listed("NVIDIA L4", None), listed("NVIDIA L4", None)];
        assert_eq!(place("0", Some("PCI_BUS_ID"), &unaddressed), Err(NotFollowed::Order(0)));
        assert_eq!(place("0", None, &unaddressed[..1]), Ok(0));
    }

    #[test]
    fn a_card_with_two_drivers_is_one_card() {
        let found = [
            listed("NVIDIA L4", Some(0x3b)),
            listed("NVIDIA L4 (NVK AD104)", Some(0x3b)),
            listed("NVIDIA L4", Some(0x5e)),
        ];
        assert_eq!([place("0", None, &found), place("1", None, &found)], [Ok(0), Ok(2)]);
    }

    #[test]
    fn what_vulkan_does_not_have_leaves_the_best_device() {
        let found = two_equal_cards();
        let mut unusable = found.clone();
        unusable[1].missing = vec!["Vulkan 1.3"];
        for (visible, found, why) in [
            ("2", &found, NotFollowed::Past { index: 2, count: 2 }),
            ("0", &found[2..].to_vec(), NotFollowed::Past { index: 0, count: 0 }),
            ("GPU-ffff", &found, NotFollowed::Unknown("GPU-ffff".to_owned())),
            ("MIG-GPU-1/2/3", &found, NotFollowed::Unknown("MIG-GPU-1/2/3".to_owned())),
            ("0", &unusable, NotFollowed::Unsuitable("Vulkan 1.3".to_owned())),
            ("", &found, NotFollowed::Empty),
            ("-1", &found, NotFollowed::Empty),
            ("NoDevFiles", &found, NotFollowed::Empty),
        ] {
            assert_eq!(place(visible, None, found), Err(why));
            assert_eq!(CudaDevices::new(visible, None).place_or_best(found), 0);
        }
    }
}
