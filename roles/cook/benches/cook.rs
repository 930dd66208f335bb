//! The time of cooking, stage by stage, beside a bare chain of meshoptimizer halvings: the lower bound of any
//! cooking with levels. The chain makes no tree and no merged levels, and certifies nothing; the ratio shows
//! the cost of these.
//!
//! `cargo bench -p trimaran-cook --bench cook` cooks a generated plant. With `TRIMARAN_DATA` naming a folder,
//! each `.glb`, `.obj` and `.rvm` file in it is cooked too; those of a subfolder are cooked as one model.

#![expect(
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock; nothing here runs in virtual time"
)]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use meshopt::{SimplifyOptions, VertexDataAdapter};
use rayon::prelude::*;
use trimaran_cook::generate::{PlantOptions, plant};
use trimaran_cook::import::{ImportOptions, import};
use trimaran_cook::{CookOptions, Phase, Progress, cook};
use trimaran_cook::{Mesh, Model};

/// The chain ends at this many triangles.
const CHAIN_END: usize = 64;

fn main() -> Result<(), Box<dyn Error>> {
    measure("generated plant", Duration::ZERO, &plant(&PlantOptions::small(1)))?;
    let Some(folder) = std::env::var_os("TRIMARAN_DATA") else {
        println!("TRIMARAN_DATA is not set: no files");
        return Ok(());
    };
    let mut entries: Vec<PathBuf> = list(Path::new(&folder))?;
    entries.sort();
    for entry in entries {
        let mut files = if entry.is_dir() { list(&entry)? } else { vec![entry.clone()] };
        files.retain(|file| is_model(file));
        files.sort();
        if files.is_empty() {
            continue;
        }
        let start = Instant::now();
        let model = import(&files, &ImportOptions::default(), &mut |_| ())?.model;
        measure(&entry.display().to_string(), start.elapsed(), &model)?;
    }
    Ok(())
}

/// Whether a file's name is that of a model. Packed files are skipped: unpack them first.
fn is_model(file: &Path) -> bool {
    let extension = file.extension().unwrap_or_default();
    ["glb", "obj", "rvm"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}

fn list(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.path())).collect()
}

/// When each stage began.
#[derive(Default)]
struct Stages(Mutex<Vec<(Phase, Instant)>>);

impl Progress for Stages {
    fn begin(&self, phase: Phase, _: usize) {
        if let Ok(mut stages) = self.0.lock() {
            stages.push((phase, Instant::now()));
        }
    }

    fn advance(&self, _: usize) {}
}

fn measure(name: &str, imported: Duration, model: &Model) -> Result<(), Box<dyn Error>> {
    let unique: usize = model.meshes.iter().map(Mesh::triangle_count).sum();
    println!("{name}: {} objects, {unique} unique triangles", model.objects.len());
    let start = Instant::now();
    model.meshes.par_iter().try_for_each(halve)?;
    let floor = start.elapsed();
    let stages = Stages::default();
    let start = Instant::now();
    let scene = cook(model, &CookOptions::default(), &stages)?;
    let end = Instant::now();
    let stages = stages.0.into_inner().unwrap_or_default();
    let ends = stages.iter().skip(1).map(|&(_, begin)| begin).chain([end]);
    println!("  {:<12} {:>9.3} s", "Import", imported.as_secs_f64());
    for (&(phase, begin), stage_end) in stages.iter().zip(ends) {
        println!("  {:<12} {:>9.3} s", format!("{phase:?}"), (stage_end - begin).as_secs_f64());
    }
    let (whole, floor) = ((end - start).as_secs_f64(), floor.as_secs_f64());
    println!(
        "  {:<12} {whole:>9.3} s, {} nodes, {} levels",
        "Cook",
        scene.nodes().len(),
        scene.drawables().len()
    );
    println!("  {:<12} {floor:>9.3} s, the cook takes {:.1} times as long", "Bare chain", whole / floor);
    Ok(())
}

/// Welds a mesh and halves it until little is left or the simplifier is stuck.
fn halve(mesh: &Mesh) -> Result<(), meshopt::Error> {
    let (count, remap) = meshopt::generate_vertex_remap(&mesh.positions, Some(&mesh.indices));
    let positions = meshopt::remap_vertex_buffer(&mesh.positions, count, &remap);
    let mut indices = meshopt::remap_index_buffer(Some(&mesh.indices), mesh.indices.len(), &remap);
    let adapter = VertexDataAdapter::new(bytemuck::cast_slice(&positions), size_of::<glam::Vec3>(), 0)?;
    while indices.len() / 3 > CHAIN_END {
        let target = indices.len() / 6 * 3;
        let next = meshopt::simplify(&indices, &adapter, target, f32::MAX, SimplifyOptions::None, None);
        if next.is_empty() || next.len() == indices.len() {
            break;
        }
        indices = next;
    }
    Ok(())
}
