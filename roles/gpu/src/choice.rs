//! Which of a machine's devices to open.

use std::fmt;

use crate::GpuError;
use crate::cuda::CudaDevices;
use crate::device_id::{PciAddress, UuidPrefix};
use crate::gpu_info::GpuInfo;

/// Which device to open. [`From`] reads it from what a user gives.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum DeviceChoice {
    /// The best suitable one: discrete before integrated before virtual before CPU.
    #[default]
    Best,
    /// The best suitable one whose name contains this text, in any case.
    Named(String),
    /// The one with this number in [`Gpu::list`](crate::Gpu::list), from 0; in text `#0`.
    Number(usize),
    /// The one with this UUID, or whose UUID begins like this.
    Uuid(UuidPrefix),
    /// The one at this address.
    Pci(PciAddress),
    /// The first one that CUDA's programs may use. If Vulkan does not find it, the best one, with a warning.
    Cuda(CudaDevices),
}

/// The text of a number, a UUID or a PCI address; any other is a part of a name.
impl From<&str> for DeviceChoice {
    fn from(text: &str) -> Self {
        let number = text.strip_prefix('#').and_then(|number| number.parse().ok());
        let number = number.map(Self::Number);
        let uuid = || text.parse().map(Self::Uuid).ok();
        let pci = || text.parse().map(Self::Pci).ok();
        number.or_else(uuid).or_else(pci).unwrap_or_else(|| Self::Named(text.to_owned()))
    }
}

impl DeviceChoice {
    /// The choice where the user makes none: the device that a job scheduler grants by
    /// `CUDA_VISIBLE_DEVICES`, or the best one.
    #[must_use]
    pub fn from_environment() -> Self {
        CudaDevices::from_environment().map_or(Self::Best, Self::Cuda)
    }

    /// The place in `found` of the device to open.
    pub(crate) fn place(&self, found: &[GpuInfo]) -> Result<usize, GpuError> {
        let place = match self {
            Self::Best => Some(0),
            Self::Cuda(devices) => Some(devices.place_or_best(found)),
            Self::Named(part) => {
                let part = part.to_lowercase();
                found.iter().position(|info| info.name.to_lowercase().contains(&part))
            }
            Self::Number(number) => Some(*number),
            Self::Uuid(uuid) => found.iter().position(|info| uuid.is_of(info.uuid)),
            Self::Pci(address) => found.iter().position(|info| info.pci == Some(*address)),
        };
        let chosen = place.and_then(|place| Some((place, found.get(place)?)));
        match chosen {
            Some((place, info)) if info.missing.is_empty() => Ok(place),
            Some((_, info)) => {
                let missing = info.missing.join(", ");
                Err(GpuError::Unsuitable { device: info.name.clone(), missing })
            }
            None if found.is_empty() => Err(GpuError::NoDevice),
            None => {
                let found = found.iter().enumerate().map(|(number, info)| format!("#{number} {}", info.name));
                let found = found.collect::<Vec<_>>().join(", ");
                Err(GpuError::NoSuchDevice { wanted: self.to_string(), found })
            }
        }
    }
}

impl fmt::Display for DeviceChoice {
    /// As a user gives it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Best | Self::Cuda(_) => f.write_str("the best one"),
            Self::Named(part) => f.write_str(part),
            Self::Number(number) => write!(f, "#{number}"),
            Self::Uuid(uuid) => uuid.fmt(f),
            Self::Pci(address) => address.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu_info::listed;

    #[test]
    fn two_equal_cards_are_two_devices_by_number_uuid_or_address() {
        let found =
            [listed("NVIDIA H200", Some(0x5e)), listed("NVIDIA H200", Some(0x3b)), listed("llvmpipe", None)];
        let uuid = |place: usize| found[place].uuid.to_string();
        let place = |text: &str| DeviceChoice::from(text).place(&found).unwrap();
        for (first, second) in [
            ("#0", "#1"),
            ("0000:5e:00.0", "0000:3b:00.0"),
            ("5E:00.0", "3b:00.0"),
            (&*uuid(0), &*uuid(1)),
            (&*format!("GPU-{}", uuid(0)), "GPU-3b"),
        ] {
            assert_eq!([place(first), place(second)], [0, 1], "{first} and {second}");
        }
        assert_eq!([place("h200"), place("LLVM"), place("#2")], [0, 2, 2]);
        assert_eq!(DeviceChoice::Best.place(&found).unwrap(), 0);
    }

    #[test]
    fn a_device_that_is_not_there_is_named_beside_those_that_are() {
        let found = [listed("NVIDIA H200", Some(0x5e)), listed("llvmpipe", None)];
        for wanted in ["#2", "0000:3b:00.0", "8f6a1234-5678-9abc-def0-0123456789ab", "Voodoo 2", "#one"] {
            let error = DeviceChoice::from(wanted).place(&found).unwrap_err().to_string();
            let expected =
                format!("no Vulkan device matches {wanted:?}; this machine has: #0 NVIDIA H200, #1 llvmpipe");
            assert_eq!(error, expected);
        }
        assert!(matches!(DeviceChoice::Best.place(&[]), Err(GpuError::NoDevice)));
        assert!(matches!(DeviceChoice::from("#0").place(&[]), Err(GpuError::NoDevice)));
    }

    #[test]
    fn a_device_that_was_asked_for_and_cannot_be_used_is_an_error() {
        let mut found = [listed("NVIDIA H200", Some(0x5e)), listed("old", Some(0x3b))];
        found[1].missing = vec!["Vulkan 1.3"];
        for wanted in ["#1", "old", "0000:3b:00.0"] {
            let error = DeviceChoice::from(wanted).place(&found).unwrap_err();
            assert!(matches!(error, GpuError::Unsuitable { .. }), "{error}");
        }
    }
}
