//! Making scenes, and looking at them.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use trimaran::config::positive;
use trimaran_cook::{
    CookOptions,
    import::{ImportLimits, PlantFrame},
};

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// The files: glTF (.glb, .gltf), AVEVA review (.rvm, .rev), OBJ, STL, PLY, STEP, IGES, IFC. Several make
    /// one scene.
    #[arg(required = true, value_name = "FILES")]
    pub(crate) files: Vec<PathBuf>,
    /// Where to write the scene.
    #[arg(short, long, value_name = "X.scene")]
    pub(crate) output: PathBuf,
    #[command(flatten)]
    pub(crate) reading: ReadingArgs,
    /// Print what was read and made as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// How files are read.
#[derive(Debug, Args)]
pub(crate) struct ReadingArgs {
    /// How far a tessellated curve may lie from the true one, millimetres (RVM, STEP, IGES, IFC). No curve is
    /// cut finer than a ten-thousandth of its radius.
    #[arg(
        long,
        value_name = "MM",
        default_value_t = 1.0,
        value_parser = positive,
        allow_negative_numbers = true
    )]
    pub(crate) chord_tolerance: f64,
    /// Which way is up in the files [default: y for glTF and OBJ, z for all others].
    #[arg(long, value_enum)]
    pub(crate) up: Option<Up>,
    /// Metres a unit of the files' coordinates [default: 1 for OBJ and PLY, 0.001 for RVM and STL; glTF,
    /// STEP, IGES and IFC have their own].
    #[arg(long, value_name = "METRES", value_parser = positive, allow_negative_numbers = true)]
    pub(crate) unit: Option<f64>,
    /// East, north and up of the model's own origin in the plant's coordinates, metres: for models that were
    /// exported about an origin of their own [default: as an IFC file says, or else 0,0,0].
    #[arg(long, value_name = "E,N,U", value_parser = origin, allow_hyphen_values = true)]
    pub(crate) origin: Option<Origin>,
    /// Where north is in the files: degrees clockwise from y, seen from above, or from -z where y is up
    /// [default: as an IFC file says, or else 0].
    #[arg(long, value_name = "DEGREES", value_parser = angle, allow_negative_numbers = true)]
    pub(crate) north: Option<f64>,
    /// How long the converter of STEP, IGES or IFC may make no progress, seconds.
    #[arg(long, value_name = "S", default_value_t = 1800.0, value_parser = positive, allow_negative_numbers = true)]
    pub(crate) converter_timeout: f64,
    /// Take nothing that would have to be left out or repaired: each warning is an error.
    #[arg(long)]
    pub(crate) strict: bool,
    #[command(flatten)]
    pub(crate) limits: LimitArgs,
}

/// How much files may ask for. A small file that is damaged or hostile can ask for more than any memory
/// holds.
#[derive(Debug, Args)]
#[command(next_help_heading = "Limits (raise them for a model that says so)")]
pub(crate) struct LimitArgs {
    /// The most triangles of all meshes together; instances share theirs.
    #[arg(long, value_name = "N", default_value_t = ImportLimits::default().triangles)]
    pub(crate) max_triangles: u64,
    /// The most vertices of all meshes together.
    #[arg(long, value_name = "N", default_value_t = ImportLimits::default().vertices)]
    pub(crate) max_vertices: u64,
    /// The most objects; each instance is one.
    #[arg(long, value_name = "N", default_value_t = ImportLimits::default().objects)]
    pub(crate) max_objects: u64,
    /// How deep nodes or groups may be nested.
    #[arg(long, value_name = "N", default_value_t = ImportLimits::default().depth)]
    pub(crate) max_depth: u32,
    /// The most bytes of attribute files; attributes that several parts share count for each.
    #[arg(long, value_name = "N", default_value_t = ImportLimits::default().attribute_bytes)]
    pub(crate) max_attribute_bytes: u64,
    /// The most nodes of the scene's tree: a small object is one, a large one some for each hundred
    /// triangles.
    #[arg(long, value_name = "N", default_value_t = CookOptions::default().max_nodes)]
    pub(crate) max_nodes: usize,
}

/// East, north and up, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Origin(pub(crate) [f64; 3]);

fn origin(text: &str) -> Result<Origin, String> {
    let numbers: Vec<f64> = text.split(',').map(|part| finite(part.trim())).collect::<Result<_, _>>()?;
    let count = numbers.len();
    let origin: [f64; 3] =
        numbers.try_into().map_err(|_| format!("three numbers with commas between, not {count}"))?;
    match (PlantFrame { origin, north_deg: 0.0 }).is_sound() {
        true => Ok(Origin(origin)),
        false => Err("at most 10^12 m".to_owned()),
    }
}

fn angle(text: &str) -> Result<f64, String> {
    let north_deg = finite(text)?;
    match (PlantFrame { origin: [0.0; 3], north_deg }).is_sound() {
        true => Ok(north_deg),
        false => Err("from -360 to 360 degrees".to_owned()),
    }
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("{text:?} is not a number"))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Up {
    Y,
    Z,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Kind {
    /// Decks, rooms, pipe racks and vessels of a process plant.
    Plant,
    /// A ship: hull, bulkheads, tanks, superstructure.
    Tanker,
}

#[derive(Debug, Args)]
pub(crate) struct GenerateArgs {
    /// The kind of scene to generate.
    #[arg(value_enum)]
    pub(crate) kind: Kind,
    /// Where to write the scene.
    #[arg(short, long, value_name = "X.scene")]
    pub(crate) output: PathBuf,
    /// About how many triangles; instances count each time [default: 0.4 million].
    #[arg(long, value_name = "N")]
    pub(crate) triangles: Option<u64>,
    /// About how many objects [default: as suits the triangles].
    #[arg(long, value_name = "N")]
    pub(crate) objects: Option<u32>,
    /// The same seed gives the same model, byte for byte.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// The size the paper measured: a plant of 13 million triangles in 1,200 objects, a tanker of 82 million
    /// in 127 thousand.
    #[arg(long, conflicts_with_all = ["triangles", "objects"])]
    pub(crate) paper: bool,
    /// Print what was made as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Args)]
pub(crate) struct InfoArgs {
    /// The scene.
    pub(crate) scene: PathBuf,
    /// Print as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}
