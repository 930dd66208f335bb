//! LOD selection: the same rule in every role.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The LOD selection rule: when a level of detail is good enough.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "(f64, bool)", into = "(f64, bool)")]
pub struct LodRule {
    epsilon_px: f64,
    few_pixels: bool,
}

/// An invalid error bound.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("an error bound of {0} pixels: it must be a finite number above 0")]
pub struct LodRuleError(pub f64);

impl LodRule {
    /// A level is good enough if nothing on the screen moves by more than `epsilon_px` pixels.
    ///
    /// # Errors
    /// If the bound is not a finite number above 0.
    pub fn new(epsilon_px: f64) -> Result<Self, LodRuleError> {
        if epsilon_px.is_finite() && epsilon_px > 0.0 {
            Ok(Self { epsilon_px, few_pixels: false })
        } else {
            Err(LodRuleError(epsilon_px))
        }
    }

    /// The same rule with the paper's section 4.5.2 on or off (default: off). When on, a node whose box
    /// covers fewer pixels than the error bound is not refined. This compares a count with a length. The
    /// drawn levels then depend on visibility, so culling is no longer exact.
    #[must_use]
    pub const fn stopping_at_few_pixels(self, on: bool) -> Self {
        Self { few_pixels: on, ..self }
    }

    /// The error bound in pixels.
    #[must_use]
    pub const fn epsilon_px(self) -> f64 {
        self.epsilon_px
    }

    /// Whether section 4.5.2 of the paper is on.
    #[must_use]
    pub const fn stops_at_few_pixels(self) -> bool {
        self.few_pixels
    }
}

impl TryFrom<(f64, bool)> for LodRule {
    type Error = LodRuleError;

    fn try_from((epsilon_px, few_pixels): (f64, bool)) -> Result<Self, LodRuleError> {
        Ok(Self::new(epsilon_px)?.stopping_at_few_pixels(few_pixels))
    }
}

impl From<LodRule> for (f64, bool) {
    fn from(rule: LodRule) -> Self {
        (rule.epsilon_px, rule.few_pixels)
    }
}
