//! Small files with huge requests: each ends in an error that names the file, the requester, and the remedy;
//! and takes no more memory than [`ImportLimits`] promises.

use std::fmt::Write;
use std::path::Path;
use std::process::Command;

use trimaran_cook::import::{
    GltfError, ImportError, ImportLimits, ImportOptions, ObjError, OverBudget, PlyError, Resource, RvmError,
    StlError, import, import_bytes,
};

use Resource::{AttributeBytes, Depth, Objects, Triangles, Vertices};

use crate::import_files::{RvmWriter, floats, glb, import_beside, reals};

/// A file made to take much memory.
struct Hostile {
    name: &'static str,
    bytes: Vec<u8>,
    /// The exceeded limit; none for a file that is dense but takes nothing that is counted.
    asks_for: Option<Resource>,
    /// The requester that the error names.
    user: &'static str,
    /// The attribute file beside it.
    beside: Vec<u8>,
}

const LIMITS: ImportLimits = ImportLimits {
    triangles: 300_000,
    vertices: 300_000,
    objects: 30_000,
    depth: 100,
    attribute_bytes: 4 << 20,
};

/// A document with the given nodes and primitives. Its accessors: 0 are `vertices` positions, 1 as many
/// indices; 2 and 3 are as many positions and indices, all zero and without bytes; 4 and 5 are three
/// positions and three indices.
fn document(nodes: &str, primitives: &str, vertices: usize) -> Vec<u8> {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{nodes}],"meshes":[{{"name":"pump","primitives":[{primitives}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3"}},
        {{"bufferView":1,"componentType":5125,"count":{vertices},"type":"SCALAR"}},
        {{"componentType":5126,"count":{vertices},"type":"VEC3"}},{{"componentType":5125,"count":{vertices},"type":"SCALAR"}},
        {{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":1,"componentType":5125,"count":3,"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{}}},{{"buffer":0,"byteOffset":{},"byteLength":{}}}],
        "buffers":[{{"byteLength":{}}}]}}"#,
        12 * vertices,
        12 * vertices,
        4 * vertices,
        16 * vertices
    );
    let positions: Vec<f32> = (0..3 * vertices).map(|number| (number % 1009) as f32).collect();
    let mut bin = floats(&positions);
    bin.extend((0..vertices as u32).flat_map(u32::to_le_bytes));
    glb(&json, &bin)
}

/// A triangle, and a view of this many elements of 256 bytes, all of them zero and compressed.
fn compressed(count: usize) -> Vec<u8> {
    let packed = meshopt::encode_vertex_buffer(&vec![[0u32; 64]; count]).unwrap();
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "accessors":[{{"bufferView":2,"componentType":5126,"count":3,"type":"VEC3"}}],
        "bufferViews":[{{"buffer":0,"byteLength":1}},{{"buffer":0,"byteLength":1}},{{"buffer":0,"byteLength":{},
        "extensions":{{"EXT_meshopt_compression":{{"buffer":0,"byteLength":{},"byteStride":256,"count":{count},
        "mode":"ATTRIBUTES"}}}}}}],"buffers":[{{"byteLength":{}}}]}}"#,
        256 * count,
        packed.len(),
        packed.len()
    );
    glb(&json, &packed)
}

/// A triangle with a white texture of `side` x `side` texels.
fn textured(side: u32) -> Vec<u8> {
    let mut image = std::io::Cursor::new(Vec::new());
    image::GrayImage::new(side, side).write_to(&mut image, image::ImageFormat::Png).unwrap();
    let image = image.into_inner();
    let mut bin = floats(&[0.0; 9]);
    bin.extend(&image);
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":[{{"material":0,
        "attributes":{{"POSITION":0,"TEXCOORD_0":1}}}}]}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":
        {{"index":0}}}}}}],"textures":[{{"source":0}}],"images":[{{"bufferView":1}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
        {{"bufferView":0,"componentType":5126,"count":3,"type":"VEC2"}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":{}}}],
        "buffers":[{{"byteLength":{}}}]}}"#,
        image.len(),
        bin.len()
    );
    glb(&json, &bin)
}

fn list(count: usize, item: &str) -> String {
    let mut text = [item, ","].concat().repeat(count);
    text.pop();
    text
}

/// A chain of `count` nodes, the last of which has the mesh.
fn chain(count: usize) -> String {
    let mut text = String::new();
    for node in 1..count {
        write!(text, r#"{{"children":[{node}]}},"#).unwrap();
    }
    text + r#"{"mesh":0}"#
}

fn rvm(groups: impl Fn(RvmWriter) -> RvmWriter) -> Vec<u8> {
    groups(RvmWriter::new().open("/PLANT", 1)).close().finish()
}

fn spheres(count: usize, diameter: f32) -> Vec<u8> {
    let sphere = reals(&[diameter]);
    rvm(|file| (0..count).fold(file, |file, _| file.primitive(9, [0.0; 3], [-1.0; 3], [1.0; 3], &sphere)))
}

/// All known ways to make much of little.
fn hostile() -> Vec<Hostile> {
    let one_node = r#"{"mesh":0}"#;
    let plain = r#"{"attributes":{"POSITION":0}}"#;
    let indexed = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    let degenerate = r#"{"attributes":{"POSITION":4},"indices":3}"#;
    let strip = r#"{"attributes":{"POSITION":4},"indices":3,"mode":5}"#;
    let instances = r#"{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":2}}}}"#;
    let squashed = r#"{"mesh":0,"scale":[1,0,1]}"#;
    let long_name = format!(r#"{{"mesh":0,"name":"{}"}}"#, "n".repeat(100_000));
    let named = long_name
        .replace("}", r#","extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":2}}}}"#);
    let glb = |bytes, asks_for, user| Hostile { name: "a.glb", bytes, asks_for, user, beside: vec![] };
    let rvm_file = |bytes, asks_for, user| Hostile { name: "a.rvm", bytes, asks_for, user, beside: vec![] };
    let text = |name, text: String, asks_for, user| {
        let (bytes, beside) = (text.into_bytes(), vec![]);
        Hostile { name, bytes, asks_for, user, beside }
    };
    let obj = |content: String, asks_for, user| text("a.obj", content, asks_for, user);
    let rev = |groups: String| text("a.rev", format!("HEAD\n1 1\n{groups}END:\n"), None, "");
    let said = |of: Vec<u8>, text: String, asks_for, user| {
        let beside = format!("CADC_Attributes_File v1.0\n{text}").into_bytes();
        Hostile { name: "a.rvm", bytes: of, asks_for, user, beside }
    };
    let copies = |count: usize| {
        rvm(|file| (0..count).fold(file, |file, _| file.open("/A", 1).cuboid([0.0; 3], [1.0; 3]).close()))
    };
    let shared =
        |lines: String| said(copies(1_000), format!("NEW /A\n{lines}END\n"), Some(AttributeBytes), "several");
    let talkative = format!(r#"{plain}],"extras":{{"a":"{}"}},"more":["#, "n".repeat(100_000));
    let fan = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf{}\n", " 1 2 3".repeat(400_000 / 3));
    let triangles = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{}", "f 1 2 3\n".repeat(400_000));
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let many = |word: &str, then: &str| -> String {
        (0..200_000).map(|number| format!("{word} {number:x}\n{then}")).collect()
    };
    let names = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\n{}", "o a\nf 1 2 3\no b\nf 3 2 1\n".repeat(40_000));
    let stl = |bytes, asks_for, user| Hostile { name: "a.stl", bytes, asks_for, user, beside: vec![] };
    let facet = "vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop\n";
    let binary_stl = [vec![0; 80], 110_000_u32.to_le_bytes().to_vec(), vec![0; 110_000 * 50]].concat();
    let ply = |element: &str, rows: usize, values: &str, asks_for| {
        let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let faces = format!("element {element} {rows}\nproperty list uchar int vertex_indices\n");
        let rows = format!("end_header\n0 0 0\n1 0 0\n0 1 0\n{values}");
        text("a.ply", format!("ply\nformat ascii 1.0\n{vertices}{faces}{rows}"), asks_for, "object \"a\"")
    };
    let long_list = format!("400000{}", " 0 1 2 1".repeat(100_000));
    vec![
        glb(document(one_node, &list(2_000, plain), 100_000), Some(Vertices), "primitive 3 of mesh 0"),
        glb(document(one_node, &list(2_000, indexed), 100_000), Some(Vertices), "mesh 0 (\"pump\")"),
        glb(document(one_node, &list(2_000, degenerate), 100_000), Some(Triangles), "primitive 9 of mesh 0"),
        glb(document(one_node, &list(2_000, strip), 100_000), Some(Triangles), "primitive 3 of mesh 0"),
        glb(document(&list(2_000, instances), plain, 20_000), Some(Objects), "node 1"),
        glb(document(&list(2_000, squashed), plain, 30_000), Some(Triangles), "flattens"),
        glb(document(&named, plain, 1_000), Some(Objects), "node 0"),
        glb(document(&list(2_000, one_node), &talkative, 3), Some(AttributeBytes), "node 4"),
        glb(compressed(200_000), Some(Vertices), "buffer view 2, decompressed,"),
        glb(textured(4_096), None, ""),
        glb(textured(1_000), None, ""),
        glb(document(&chain(5_000), plain, 3), Some(Depth), "node 100"),
        glb(document(&list(1_000_000, "{}"), plain, 3), None, ""),
        glb(document(&format!(r#"{{"children":[{}]}}"#, list(1_000_000, "0")), plain, 3), None, ""),
        rvm_file(spheres(2_000, 1e30), Some(Triangles), "/PLANT"),
        rvm_file(copies(40_000), Some(Objects), "group \"/A\""),
        rvm_file(rvm(|file| (0..40_000).fold(file, |file, _| file.open("/A", 1))), Some(Depth), "/A"),
        rev("CNTB\n1 1\n\n0 0 0 1\nCNTE\n1 1\n".repeat(100_000)),
        rev(format!("CNTB\n1 1\nA\n0 0 0 1\nPRIM\n1 1\n11\n{}CNTE\n1 1\n", "1\n".repeat(1_000_000))),
        rev("ATTR\n1 1\n".repeat(200_000)),
        shared("K:=v\n".repeat(100_000)),
        shared(format!("K:={}\n", "x".repeat(1_000)).repeat(1_000)),
        said(copies(1), "NEW /A\nEND\n".repeat(500_000), Some(AttributeBytes), "a.att"),
        said(copies(1), "NEW A\n".repeat(600_000), None, ""),
        said(copies(1), format!("NEW /A\n{}", "a:=\n".repeat(1_000_000)), None, ""),
        obj(fan, Some(Triangles), "object"),
        obj(triangles, Some(Triangles), "object"),
        obj(names, Some(Objects), "object \"a\""),
        obj(format!("v 0 0 0\n{}", "f 1\n".repeat(2_000_000)), None, ""),
        obj(format!("v 0 0 0\n{}", "f 1 1\n".repeat(2_000_000)), None, ""),
        obj("v 0 0 0\n".repeat(1_000_000), None, ""),
        obj("o a\n".repeat(1_000_000), None, ""),
        obj(format!("{triangle}{}", many("usemtl", "")), None, ""),
        obj(format!("{triangle}{}", many("usemtl", "f 1 2 3\n")), None, ""),
        obj(format!("{triangle}{}", many("", "")), None, ""),
        obj(format!("{triangle}o a\n{}", many("g", "f 1 2 3\n")), Some(Objects), "object \""),
        obj(format!("{triangle}{}", "v 0 0 0 1 1 1 1\n".repeat(300_000)), None, ""),
        stl(binary_stl, Some(Vertices), "solid \"a\""),
        stl(format!("solid b\n{}", facet.repeat(110_000)).into(), Some(Vertices), "solid \"b\""),
        stl(format!("solid c\n{facet}").repeat(40_000).into(), Some(Objects), "solid \"c\""),
        stl("solid\nendsolid\n".repeat(500_000).into(), None, ""),
        stl("what\n".repeat(500_000).into_bytes(), None, ""),
        ply("face", 400_000, &"3 0 1 2\n".repeat(400_000), Some(Triangles)),
        ply("face", 1, &long_list, Some(Triangles)),
        ply("tristrips", 1, &long_list, Some(Triangles)),
        ply("face", 1_000_000, &"0\n".repeat(1_000_000), None),
        ply(&"a 0\nproperty int x\nelement ".repeat(100_000), 0, "", None),
    ]
}

fn over_budget(error: &ImportError) -> Option<&OverBudget> {
    match error {
        ImportError::Gltf { source, .. } => match &**source {
            GltfError::Budget(over) => Some(over),
            _ => None,
        },
        ImportError::Rvm { source: RvmError::Budget(over), .. } => Some(over),
        ImportError::Obj { source: ObjError::Budget(over), .. } => Some(over),
        ImportError::Stl { source: StlError::Budget(over), .. } => Some(over),
        ImportError::Ply { source: PlyError::Budget(over), .. } => Some(over),
        _ => None,
    }
}

fn import_hostile(file: &Hostile) -> Result<u64, ImportError> {
    let options = ImportOptions { limits: LIMITS, ..Default::default() };
    if !file.beside.is_empty() {
        let folder = tempfile::TempDir::new().unwrap();
        let path = folder.path().join(file.name);
        std::fs::write(&path, &file.bytes).unwrap();
        std::fs::write(folder.path().join("a.att"), &file.beside).unwrap();
        return import(&[path], &options, &mut |_| {}).map(|imported| imported.report.triangles);
    }
    import_bytes(Path::new(file.name), &file.bytes, &options).map(|imported| imported.report.triangles)
}

#[test]
fn files_that_ask_for_too_much_are_refused_with_who_asked_and_the_remedy() {
    for (number, file) in hostile().iter().enumerate() {
        let imported = import_hostile(file);
        let Some(resource) = file.asks_for else { continue };
        let error = imported.expect_err(&format!("number {number}, a {}", file.name));
        let said = error.to_string();
        let over = over_budget(&error).unwrap_or_else(|| panic!("number {number}: {said}"));
        assert_eq!(over.resource, resource, "number {number}: {said}");
        assert!(over.user.contains(file.user), "number {number}: {said}");
        assert!(said.contains(file.name) && said.contains(resource.flag()), "number {number}: {said}");
    }
}

/// A file may keep one array of positions for all of its parts.
#[test]
fn primitives_take_what_they_use_of_a_shared_array() {
    let few = list(2_000, r#"{"attributes":{"POSITION":0},"indices":5}"#);
    let bytes = document(r#"{"mesh":0}"#, &few, 100_000);
    let file = Hostile { name: "a.glb", bytes, asks_for: None, user: "", beside: vec![] };
    assert_eq!(import_hostile(&file).unwrap(), 2_000);
}

/// Each file in a process of its own, whose peak memory the system records.
#[cfg(target_os = "linux")]
#[test]
fn no_file_takes_more_memory_than_is_promised() {
    const NUMBER: &str = "TRIMARAN_TEST_HOSTILE_FILE";
    let peak = || {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
    };
    if let Ok(number) = std::env::var(NUMBER) {
        let file = hostile().swap_remove(number.parse().unwrap());
        // The memory for making the files does not count for the importer.
        std::fs::write("/proc/self/clear_refs", "5").unwrap();
        let before = peak();
        let _refused = import_hostile(&file);
        println!("peak {} of {}", peak().saturating_sub(before), file.bytes.len() + file.beside.len());
        return;
    }
    for (number, file) in hostile().iter().enumerate() {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "import_limits::no_file_takes_more_memory_than_is_promised", "--nocapture"])
            .env(NUMBER, number.to_string())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&child.stdout);
        let peak = said.lines().find_map(|line| line.split("peak ").nth(1)?.split(' ').next()?.parse().ok());
        let peak: u64 = peak.unwrap_or_else(|| panic!("number {number}: {said}"));
        let most = LIMITS.memory((file.bytes.len() + file.beside.len()) as u64);
        println!(
            "{number} {}: {} bytes, {} MB of {} MB",
            file.name,
            file.bytes.len(),
            peak >> 20,
            most >> 20
        );
        assert!(peak <= most, "number {number}, a {}: {peak} bytes, {most} are promised", file.name);
    }
}

/// A library that is named many times, by any of its names, is read once.
#[test]
fn a_material_library_is_read_once() {
    let mut library = String::new();
    for number in 0..2_000 {
        write!(library, "newmtl m{number}\nKd 1 0 0\n").unwrap();
    }
    let mut text = String::new();
    for number in 0..4_000 {
        text += if number % 2 == 0 { "mtllib a.mtl\n" } else { "mtllib ./a.mtl\n" };
    }
    text += "v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m1999\nf 1 2 3\n";
    let others = [("a.mtl", library.as_bytes())];
    let imported = import_beside("a.obj", text.as_bytes(), &others).unwrap();
    assert_eq!(imported.model.meshes[0].colours[0].0, [255, 0, 0, 255]);
    assert_eq!(imported.report.warnings, []);
}
