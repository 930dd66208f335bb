//! Versions of the wire, and the one that two peers have in common.

use std::fmt;

use serde::{Deserialize, Serialize};

/// A version of the wire format of links.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WireVersion(pub u16);

impl WireVersion {
    /// The highest version that this crate speaks.
    pub const CURRENT: Self = Self(5);

    /// The lowest version that this crate speaks: that of the release before.
    pub const LOWEST: Self = Self(4);

    /// The last version without ranges: its hello names this version alone, and its accept names none.
    pub(crate) const WITHOUT_RANGE: Self = Self(4);

    /// Whether a hello of this version names a range, and an accept a version.
    pub(crate) const fn has_range(self) -> bool {
        self.0 > Self::WITHOUT_RANGE.0
    }
}

impl fmt::Display for WireVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// The versions of the wire that a peer speaks: all from the lowest to the highest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct WireVersions {
    /// The highest one.
    pub highest: WireVersion,
    /// The lowest one.
    pub lowest: WireVersion,
}

impl WireVersions {
    /// Those that this crate speaks.
    pub const SUPPORTED: Self = Self { highest: WireVersion::CURRENT, lowest: WireVersion::LOWEST };

    /// This version alone.
    #[must_use]
    pub const fn only(version: WireVersion) -> Self {
        Self { highest: version, lowest: version }
    }

    /// Whether this version is among them.
    #[must_use]
    pub fn contains(self, version: WireVersion) -> bool {
        (self.lowest..=self.highest).contains(&version)
    }

    /// The highest version that both peers speak. `None` if there is none, or a range is upside down.
    #[must_use]
    pub fn in_common(self, other: Self) -> Option<WireVersion> {
        let highest = self.highest.min(other.highest);
        (self.contains(highest) && other.contains(highest)).then_some(highest)
    }

    /// The version in which a listener of these versions accepts a peer: the highest in common. A listener of
    /// version 4 knows no ranges, so it accepts hellos of its own version alone.
    #[must_use]
    pub fn accepts(self, hello: Self) -> Option<WireVersion> {
        let understood = self.highest.has_range() || self.highest >= hello.highest;
        self.in_common(hello).filter(|_| understood)
    }
}

/// `version 4`, or `versions 4 to 5`.
impl fmt::Display for WireVersions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { highest, lowest } = self;
        if lowest == highest {
            write!(f, "version {highest}")
        } else {
            write!(f, "versions {lowest} to {highest}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(lowest: u16, highest: u16) -> WireVersions {
        WireVersions { highest: WireVersion(highest), lowest: WireVersion(lowest) }
    }

    #[test]
    fn both_take_the_highest_version_in_common() {
        for (one, other, common) in [
            (range(4, 5), range(4, 5), Some(5)),
            (range(4, 5), range(5, 6), Some(5)),
            (range(4, 5), range(4, 4), Some(4)),
            (range(4, 5), range(3, 4), Some(4)),
            (range(4, 5), range(6, 7), None),
            (range(4, 5), range(2, 3), None),
            (range(4, 5), range(9, 5), None),
            (range(4, 5), range(9, 4), None),
        ] {
            let common = common.map(WireVersion);
            assert_eq!((one.in_common(other), other.in_common(one)), (common, common), "{one}, {other}");
        }
    }

    #[test]
    fn a_listener_of_version_4_reads_no_range() {
        let accepted = |listener: WireVersions, hello| listener.accepts(hello).map(|version| version.0);
        assert_eq!(accepted(range(4, 4), range(4, 5)), None);
        assert_eq!(accepted(range(4, 4), range(4, 4)), Some(4));
        assert_eq!(accepted(range(4, 5), range(4, 4)), Some(4));
        assert_eq!(accepted(range(4, 5), range(5, 6)), Some(5));
        assert_eq!(accepted(range(4, 5), range(6, 7)), None);
    }

    #[test]
    fn one_version_and_several_read_as_such() {
        assert_eq!(range(4, 4).to_string(), "version 4");
        assert_eq!(WireVersions::SUPPORTED.to_string(), "versions 4 to 5");
    }
}
