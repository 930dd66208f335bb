//! The place of a draw's triangles, on the device or not.

/// The place of a draw's triangles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) first_index: u32,
    pub(crate) first_vertex: u32,
}

/// How to handle a draw whose triangles are not on the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Absent {
    /// They are read, however long that takes. Without room the draws end before this one.
    Read,
    /// They are read while this many bytes of them are left; beyond that the draw is skipped.
    ReadOrSkip { most: u64 },
}
