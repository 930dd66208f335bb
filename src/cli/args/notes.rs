//! The notes on a scene.

use std::path::PathBuf;

use clap::{ArgGroup, Args};
use trimaran::notes::bcf::BcfVersion;

#[derive(Debug, Args)]
#[command(group = ArgGroup::new("what").required(true))]
pub(crate) struct NotesArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// List the notes.
    #[arg(long, group = "what")]
    pub(crate) list: bool,
    /// Write all notes to a BCF file, for other programs.
    #[arg(long, group = "what", value_name = "F.bcf")]
    pub(crate) export: Option<PathBuf>,
    /// Add the topics of a BCF file of version 2.1 or 3.0. Those that are there already are updated, and keep
    /// their replies.
    #[arg(long, group = "what", value_name = "F.bcf")]
    pub(crate) import: Option<PathBuf>,
    /// The version of BCF: 2.1 or 3.0.
    #[arg(long, conflicts_with_all = ["list", "import"], default_value = "2.1")]
    pub(crate) version: BcfVersion,
    /// Print as JSON.
    #[arg(long, conflicts_with = "export")]
    pub(crate) json: bool,
    /// The folder of the notes [default: that beside the scene, such as plant.notes].
    #[arg(long, value_name = "DIR", env = "TRIMARAN_NOTES")]
    pub(crate) notes: Option<PathBuf>,
}
