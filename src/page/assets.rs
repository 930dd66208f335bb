//! The files of the page, which are part of the program.

/// A file of the page.
#[derive(Debug)]
pub(super) struct Asset {
    /// How a browser asks for it.
    pub(super) path: &'static str,
    /// Its media type.
    pub(super) kind: &'static str,
    pub(super) bytes: &'static [u8],
}

/// All files; none where the program was built without the page.
pub(super) const ASSETS: &[Asset] = include!(concat!(env!("OUT_DIR"), "/assets.rs"));
