//! The lanes of a link as the application uses them, whatever carries them.

pub(crate) mod frames;
pub(crate) mod latest;
pub(crate) mod messages;
pub(crate) mod shared;
