//! The codings of ids.

use serde::{Deserialize, Serialize};

use crate::SettingsError;
use crate::named::named;

/// How the ids of a frame travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub enum IdCoding {
    /// 4 bytes an id, as the paper's bandwidth formula counts them.
    #[default]
    Plain,
    /// As changes against an earlier frame, in order and as soon as they are known. Batches that would not
    /// shrink travel plain.
    Changes,
}

named!(IdCoding { Plain = "plain", Changes = "changes" } else SettingsError::Coding);
