//! Identities of the devices of a machine: UUIDs and PCI addresses.

use std::fmt;
use std::str::FromStr;

/// A device's UUID, from its driver. For a card of NVIDIA it is the one that `nvidia-smi` and CUDA print
/// behind `GPU-`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct DeviceUuid(pub [u8; 16]);

impl fmt::Display for DeviceUuid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, byte) in self.0.iter().enumerate() {
            let hyphen = if [4, 6, 8, 10].contains(&at) { "-" } else { "" };
            write!(f, "{hyphen}{byte:02x}")?;
        }
        Ok(())
    }
}

/// A UUID in text, or its beginning.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UuidPrefix(String);

impl UuidPrefix {
    /// How many characters a whole UUID has.
    const WHOLE: usize = 36;

    /// Whether it begins this UUID.
    pub(crate) fn is_of(&self, uuid: DeviceUuid) -> bool {
        uuid.to_string().starts_with(&self.0)
    }
}

/// A text is no UUID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("give a whole UUID, or its beginning behind GPU-")]
pub struct NoUuid;

impl FromStr for UuidPrefix {
    type Err = NoUuid;

    /// A whole UUID. Behind `GPU-` or `MIG-`, as CUDA writes it, its beginning is enough.
    fn from_str(text: &str) -> Result<Self, NoUuid> {
        let cut = ["GPU-", "MIG-"].iter().find_map(|before| text.strip_prefix(before));
        let digits = cut.unwrap_or(text).to_ascii_lowercase();
        let hyphens = [8, 13, 18, 23];
        let fits = |(at, byte): (usize, u8)| match hyphens.contains(&at) {
            true => byte == b'-',
            false => byte.is_ascii_hexdigit(),
        };
        let is_long_enough = if cut.is_some() { !digits.is_empty() } else { digits.len() == Self::WHOLE };
        let is_one = is_long_enough && digits.len() <= Self::WHOLE && digits.bytes().enumerate().all(fits);
        is_one.then_some(Self(digits)).ok_or(NoUuid)
    }
}

impl fmt::Display for UuidPrefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Where a device is on the PCI bus. Addresses are in the order in which `nvidia-smi` numbers cards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct PciAddress {
    /// The domain, also called segment.
    pub domain: u32,
    /// The bus in the domain.
    pub bus: u32,
    /// The device, also called slot, on the bus.
    pub device: u32,
    /// The function of the device.
    pub function: u32,
}

impl fmt::Display for PciAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { domain, bus, device, function } = self;
        write!(f, "{domain:04x}:{bus:02x}:{device:02x}.{function:x}")
    }
}

/// A text is no PCI address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("give a PCI address such as 0000:3b:00.0")]
pub struct NoPciAddress;

impl FromStr for PciAddress {
    type Err = NoPciAddress;

    /// `domain:bus:device.function`, hexadecimal; without a domain it is 0.
    fn from_str(text: &str) -> Result<Self, NoPciAddress> {
        let number = |digits: &str, most: usize| {
            let is_one = (1..=most).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_hexdigit());
            is_one.then(|| u32::from_str_radix(digits, 16).ok()).flatten()
        };
        let parse = || {
            let (place, function) = text.split_once('.')?;
            let (place, device) = place.rsplit_once(':')?;
            let (domain, bus) = place.split_once(':').unwrap_or(("0", place));
            Some(Self {
                domain: number(domain, 8)?,
                bus: number(bus, 2)?,
                device: number(device, 2)?,
                function: number(function, 1)?,
            })
        };
        parse().ok_or(NoPciAddress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UUID: DeviceUuid = DeviceUuid([
        0x8f, 0x6a, 0x12, 0x34, 0x56, 0x78, 0x9a, 0xbc, 0xde, 0xf0, 0x01, 0x23, 0x45, 0x67, 0x89, 0xab,
    ]);

    #[test]
    fn a_uuid_is_found_by_its_text_or_behind_gpu_by_its_beginning() {
        assert_eq!(UUID.to_string(), "8f6a1234-5678-9abc-def0-0123456789ab");
        for text in [
            "8f6a1234-5678-9abc-def0-0123456789ab",
            "8F6A1234-5678-9ABC-DEF0-0123456789AB",
            "GPU-8f6a1234-5678-9abc-def0-0123456789ab",
            "MIG-8f6a1234-5678-9abc-def0-0123456789ab",
            "GPU-8f6a1234-56",
            "GPU-8",
        ] {
            assert!(text.parse::<UuidPrefix>().unwrap().is_of(UUID), "{text}");
        }
        assert!(!"GPU-8f6a1235".parse::<UuidPrefix>().unwrap().is_of(UUID));
        for text in ["", "8f6a1234", "GPU-", "GPU-x", "GPU-8f6a12345", "NVIDIA H200", "MIG-GPU-8f6a1234/1/2"]
        {
            assert_eq!(text.parse::<UuidPrefix>(), Err(NoUuid), "{text}");
        }
    }

    #[test]
    fn a_pci_address_is_read_as_tools_print_it() {
        let address = PciAddress { domain: 0, bus: 0x3b, device: 0, function: 1 };
        for text in ["0000:3b:00.1", "00000000:3B:00.1", "3b:00.1"] {
            assert_eq!(text.parse(), Ok(address), "{text}");
        }
        assert_eq!(address.to_string(), "0000:3b:00.1");
        for text in
            ["", "3b", "3b:00", "0000:3b:00", "0:0:0:0.0", "x:00.0", "3b:00.10", "+3:00.0", "300 SE 2.0"]
        {
            assert_eq!(text.parse::<PciAddress>(), Err(NoPciAddress), "{text}");
        }
        assert!(
            address < PciAddress { bus: 0x5e, ..address }
                && address < PciAddress { domain: 1, bus: 0, ..address }
        );
    }
}
