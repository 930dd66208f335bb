//! Models that are read, cooked and written.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

#[path = "../import_files/mod.rs"]
mod import_files;
#[allow(unreachable_pub, reason = "the fuzz targets' library shares the file")]
#[path = "../../../../fuzz/src/models.rs"]
mod models;
#[allow(unreachable_pub, reason = "tests of other packages share the file")]
#[path = "../../../../fuzz/replay.rs"]
mod replay;

mod cook_giant;
mod cook_hausdorff;
mod cook_scene;
mod import_cad;
mod import_data;
mod import_gltf;
mod import_hostile;
mod import_ifc;
mod import_limits;
mod import_obj;
mod import_ply;
mod import_rvm;
mod import_rvm_attributes;
mod import_rvm_text;
mod import_stl;
mod scene_corpus;
