//! Notes on a scene: comments with a view, kept in a folder beside it, and exchanged as BCF.

pub mod bcf;
mod date;
mod folder;
mod frame;
mod guid;
mod note;
mod parts;

pub use date::{Date, DateError};
pub use folder::{Held, NotesError, NotesFolder, Snapshot, SnapshotKind};
pub use frame::Frame;
pub use guid::{Guid, GuidError};
pub use note::{
    Camera, HeaderFile, Lens, Note, NoteFault, Owner, PartRef, Reply, Section, Status, Topic, View,
    Visibility,
};
pub use parts::{SceneParts, TooManyParts};
