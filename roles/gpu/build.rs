//! Compiles `shaders/*.wgsl` to SPIR-V, one module per entry point: a module then requires only the features
//! of its stage.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::{env, fs};

use naga::ShaderStage;
use naga::back::spv;
use naga::front::wgsl;
use naga::valid::{Capabilities, ValidationFlags, Validator};

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=shaders");
    let out = PathBuf::from(env::var("OUT_DIR")?);
    for files in MODULES {
        compile(files, &out)?;
    }
    Ok(())
}

/// The files of each module, one after the other: WGSL has no imports.
const MODULES: [&[&str]; 6] = [
    &["boxes"],
    &["pyramid"],
    &["scene"],
    &["hzb", "test_boxes"],
    &["traversal/rounding", "traversal/round"],
    &[
        "hzb",
        "traversal/rounding",
        "traversal/cut",
        "traversal/test_box",
        "traversal/traversal",
        "traversal/map",
    ],
];

/// Writes `<entry point>.spv` for each entry point of a module.
fn compile(files: &[&str], out: &Path) -> Result<(), Box<dyn Error>> {
    let mut source = String::new();
    for file in files {
        source += &fs::read_to_string(Path::new("shaders").join(file).with_extension("wgsl"))?;
    }
    let explain = |message: String| format!("shaders/{}: {message}", files.join(" + "));
    let module = wgsl::parse_str(&source).map_err(|e| explain(e.emit_to_string(&source)))?;
    let capabilities = Capabilities::PRIMITIVE_INDEX
        | Capabilities::IMMEDIATES
        | Capabilities::EARLY_DEPTH_TEST
        | Capabilities::FLOAT64;
    let mut validator = Validator::new(ValidationFlags::all(), capabilities);
    let info = validator.validate(&module).map_err(|e| explain(e.emit_to_string(&source)))?;
    let mut options = spv::Options { lang_version: (1, 3), ..spv::Options::default() };
    // Shaders write to shared memory before they read it.
    options.zero_initialize_workgroup_memory = spv::ZeroInitializeWorkgroupMemoryMode::None;
    // The projection already has Vulkan's y down; WebGPU's flip would turn the picture over.
    options.flags.remove(spv::WriterFlags::ADJUST_COORDINATE_SPACE);
    for point in &module.entry_points {
        let only = spv::PipelineOptions { shader_stage: point.stage, entry_point: point.name.clone() };
        let mut words =
            spv::write_vec(&module, &info, &options, Some(&only)).map_err(|e| explain(e.to_string()))?;
        if point.stage == ShaderStage::Compute || point.name.ends_with("_cut") {
            forbid_contraction(&mut words);
        }
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        fs::write(out.join(format!("{}.spv", point.name)), bytes)?;
    }
    Ok(())
}

/// Decorates all sums and products with NoContraction, which WGSL cannot express: without it a driver may
/// fuse two of them into one operation, which rounds differently from the host, or from another shader.
fn forbid_contraction(words: &mut Vec<u32>) {
    const HEADER: usize = 5;
    const OP_DECORATE: u32 = 71;
    const OP_MEMBER_DECORATE: u32 = 72;
    const NO_CONTRACTION: u32 = 42;
    /// `OpFAdd`, `OpFSub`, `OpFMul`.
    const ARITHMETIC: [u32; 3] = [129, 131, 133];
    let (mut at, mut end_of_decorations, mut decorations) = (HEADER, HEADER, Vec::new());
    while let Some(&[word, _, result]) = words.get(at..at + 3) {
        let (operation, length) = (word & 0xffff, (word >> 16) as usize);
        at += length.max(1);
        if operation == OP_DECORATE || operation == OP_MEMBER_DECORATE {
            end_of_decorations = at;
        } else if ARITHMETIC.contains(&operation) {
            decorations.extend([3 << 16 | OP_DECORATE, result, NO_CONTRACTION]);
        }
    }
    words.splice(end_of_decorations..end_of_decorations, decorations);
}
