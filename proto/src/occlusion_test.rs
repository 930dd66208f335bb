//! The kinds of occlusion tests.

use serde::{Deserialize, Serialize};

use crate::SettingsError;
use crate::named::named;

/// The occlusion test for a node's box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum OcclusionTestKind {
    /// Precise occlusion queries: the paper's method.
    Query,
    /// One instanced draw with the early depth test and counters in a storage buffer.
    Raster,
    /// A compute test against a farthest-depth pyramid.
    Hzb,
}

named!(
    OcclusionTestKind { Query = "query", Raster = "raster", Hzb = "hzb" } else SettingsError::OcclusionTest
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_occlusion_tests_read_back() {
        for kind in OcclusionTestKind::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
        }
        assert_eq!(
            "Query".parse::<OcclusionTestKind>().map_err(|e| e.to_string()),
            Err("no occlusion test is called \"Query\": take query, raster or hzb".to_owned())
        );
    }
}
