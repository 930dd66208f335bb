//! The page: a display in a browser, and its server. Its links are WebSockets at the same port, so one
//! address is enough.

mod answering;
mod assets;
mod description;
mod drive;
mod network;
mod parts;
mod people;
mod questions;
mod server;
mod sides;
mod snap;
mod tiles;
mod token;
mod warnings;

pub use description::{SceneDescription, model_name};
pub use drive::{Drive, DriveReport, Moment, WrongPixels};
pub use server::{PageError, Pages};
pub use token::{Token, TokenError};
