//! The page: a display in a browser, and its server. Its links are WebSockets at the same port, so one
//! address is enough.

mod access;
mod answering;
mod assets;
mod clash;
mod clearance;
mod description;
mod drive;
mod embedding;
pub mod finding;
mod network;
mod notes;
mod parts;
mod people;
mod preparation;
mod proxies;
mod questions;
mod server;
mod sides;
mod snap;
mod surface;
mod tiles;
mod tls;
mod token;
mod tokens;
mod warnings;

pub use clash::{
    CLASH_COLUMNS, CLASH_GROUP_COLUMNS, ClashCamera, ClashGroup, ClashNames, ClashPart, ClashRow, ignored_csv,
};
pub use description::{SceneDescription, model_name};
pub use drive::{Drive, DriveReport, LongTasks, Moment, WrongPixels};
pub use embedding::{FrameAncestor, FrameAncestorError};
pub use preparation::Preparation;
pub use proxies::{Proxies, ProxyNetwork, ProxyNetworkError};
pub use server::{PageError, PageOptions, Pages};
pub use tls::{Tls, TlsError, TlsFiles};
pub use token::{Token, TokenError, TokenFileError};
pub use tokens::{
    May, PersonName, PersonNameError, TokenEntry, TokenHash, TokenHashError, TokenList, TokenListError,
    Tokens, Until, UntilError,
};
