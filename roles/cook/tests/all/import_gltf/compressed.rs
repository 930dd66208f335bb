//! Compressed files: meshoptimizer's and Draco's.

use draco_core::{
    DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, Mesh, MeshEncoder, PointAttribute,
};
use glam::Vec3;
use meshopt::{
    EncodeExpMode, encode_filter_exp, encode_index_buffer, encode_index_sequence, encode_vertex_buffer,
};
use trimaran_cook::Model;
use trimaran_cook::import::{GltfError, ImportError, ImportLimits, ImportOptions, Resource};
use trimaran_scene::Rgba8;

use super::document::Document;
use super::{error, model};

use crate::import_files::floats;

/// A sheet of `side` x `side` squares, one unit each, in the plane z = 0.
fn sheet(side: usize) -> (Vec<[f32; 3]>, Vec<u32>) {
    let row = side + 1;
    let positions = (0..row * row).map(|at| [(at % row) as f32, (at / row) as f32, 0.0]).collect();
    let square = |at: usize| {
        let first = (at / side * row + at % side) as u32;
        let above = first + row as u32;
        [first, first + 1, above + 1, first, above + 1, above]
    };
    (positions, (0..side * side).flat_map(square).collect())
}

/// Asserts that a model is the sheet, and nothing else.
fn is_sheet(model: &Model, side: usize, tolerance: f32) {
    let mesh = &model.meshes[0];
    assert_eq!((mesh.triangle_count(), mesh.positions.len()), (2 * side * side, (side + 1) * (side + 1)));
    let corner = |corner: u32| mesh.positions[corner as usize];
    for triangle in mesh.indices.chunks(3) {
        let [a, b, c] = [corner(triangle[0]), corner(triangle[1]), corner(triangle[2])];
        let normal = (b - a).cross(c - a);
        assert!((normal - Vec3::Z).length() < 4.0 * tolerance + 1e-6, "{a} {b} {c}");
        assert!((a - a.round()).length() <= tolerance, "{a}");
    }
}

/// A document's description of compressed bytes in its buffer 0.
struct Packed<'a> {
    bytes: &'a [u8],
    count: usize,
    stride: usize,
    mode: &'a str,
    filter: &'a str,
}

/// A compressed view: its plain bytes would be in buffer 1, which is missing.
fn packed_view(
    document: &mut Document,
    name: &str,
    Packed { bytes, count, stride, mode, filter }: Packed<'_>,
) -> usize {
    let offset = document.bytes(bytes);
    let of_vertices = if mode == "ATTRIBUTES" { format!(r#","byteStride":{stride}"#) } else { String::new() };
    document.raw_view(&format!(
        r#"{{"buffer":1,"byteLength":{}{of_vertices},"extensions":{{"{name}":{{"buffer":0,"byteOffset":{offset},
        "byteLength":{},"byteStride":{stride},"count":{count},"mode":"{mode}"{filter}}}}}}}"#,
        count * stride,
        bytes.len()
    ))
}

/// A sheet whose positions and indices are compressed.
fn packed_sheet(name: &str, vertices: Packed<'_>, indices: Packed<'_>, component: &str) -> Vec<u8> {
    let mut document = Document::default();
    let (count, corners, short) = (vertices.count, indices.count, indices.stride == 2);
    let view = packed_view(&mut document, name, vertices);
    document.raw_accessor(&format!(r#"{{"bufferView":{view},{component},"count":{count},"type":"VEC3"}}"#));
    let view = packed_view(&mut document, name, indices);
    let kind = if short { 5123 } else { 5125 };
    document.raw_accessor(&format!(
        r#"{{"bufferView":{view},"componentType":{kind},"count":{corners},"type":"SCALAR"}}"#
    ));
    document.raw_buffer(&format!(r#"{{"byteLength":99999,"extensions":{{"{name}":{{"fallback":true}}}}}}"#));
    document.glb(&format!(
        r#""extensionsRequired":["{name}","KHR_mesh_quantization"],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}]"#
    ))
}

#[test]
fn meshopt_is_decompressed_in_every_mode_under_both_names() {
    let (positions, corners) = sheet(20);
    let plain = encode_vertex_buffer(&positions).unwrap();
    let exponents =
        encode_vertex_buffer(&encode_filter_exp(&positions, 16, EncodeExpMode::Separate)).unwrap();
    let shorts: Vec<[u16; 4]> = positions.iter().map(|at| [at[0] as u16, at[1] as u16, 0, 0]).collect();
    let shorts = encode_vertex_buffer(&shorts).unwrap();
    let triangles = encode_index_buffer(&corners, positions.len()).unwrap();
    let sequence = encode_index_sequence(&corners, positions.len()).unwrap();
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for (bytes, stride, filter, component) in [
            (&plain, 12, "", r#""componentType":5126"#),
            (&plain, 12, r#","filter":"NONE""#, r#""componentType":5126"#),
            (&exponents, 12, r#","filter":"EXPONENTIAL""#, r#""componentType":5126"#),
            (&shorts, 8, "", r#""componentType":5123"#),
        ] {
            for (index_bytes, mode, index_stride) in
                [(&triangles, "TRIANGLES", 4), (&triangles, "TRIANGLES", 2), (&sequence, "INDICES", 4)]
            {
                let vertices = Packed { bytes, count: positions.len(), stride, mode: "ATTRIBUTES", filter };
                let indices = Packed {
                    bytes: index_bytes,
                    count: corners.len(),
                    stride: index_stride,
                    mode,
                    filter: "",
                };
                is_sheet(&model(&packed_sheet(name, vertices, indices, component)), 20, 0.0);
            }
        }
    }
}

#[test]
fn meshopt_that_is_damaged_or_asks_for_too_much_is_refused_by_name() {
    let (positions, corners) = sheet(3);
    let plain = encode_vertex_buffer(&positions).unwrap();
    let triangles = encode_index_buffer(&corners, positions.len()).unwrap();
    let file = |bytes: &[u8], count, mode: &str| {
        let vertices = Packed { bytes, count, stride: 12, mode, filter: "" };
        let indices =
            Packed { bytes: &triangles, count: corners.len(), stride: 4, mode: "TRIANGLES", filter: "" };
        packed_sheet("EXT_meshopt_compression", vertices, indices, r#""componentType":5126"#)
    };
    for file in
        [file(&plain[..20], 16, "ATTRIBUTES"), file(&plain, 1 << 40, "ATTRIBUTES"), file(&plain, 16, "FANS")]
    {
        let said = error(&file);
        assert!(matches!(said, GltfError::Packed { view: 0, .. }), "{said}");
        assert!(said.to_string().contains("gltf-transform"), "{said}");
    }
    let limits = ImportLimits { vertices: 10, ..ImportLimits::default() };
    let options = ImportOptions { limits, ..ImportOptions::default() };
    let over =
        trimaran_cook::import::import_bytes("a.glb".as_ref(), &file(&plain, 40, "ATTRIBUTES"), &options);
    let Err(ImportError::Gltf { source, .. }) = over else { unreachable!("{over:?}") };
    assert!(matches!(*source, GltfError::Budget(over) if over.resource == Resource::Vertices));
}

/// The bytes of a mesh with an attribute of floats for each number of components.
fn draco(attributes: &[(GeometryAttributeType, Vec<Vec<f32>>)], corners: &[u32], level: i32) -> Vec<u8> {
    let mut mesh = Mesh::new();
    mesh.set_num_points(attributes[0].1.len());
    for (kind, values) in attributes {
        let mut attribute = PointAttribute::new();
        attribute.init(*kind, values[0].len() as u8, DataType::Float32, false, values.len());
        attribute.buffer_mut().write(0, &floats(&values.concat()));
        mesh.add_attribute(attribute);
    }
    mesh.set_num_faces(corners.len() / 3);
    mesh.set_faces_from_flat_indices(corners);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(mesh);
    let mut options = EncoderOptions::new();
    options.set_global_int("quantization_bits", 16);
    options.set_compression_level(level);
    let mut bytes = EncoderBuffer::new();
    encoder.encode(&options, &mut bytes).unwrap();
    bytes.data().to_vec()
}

/// A document whose sheet is compressed; `plain` are members of its accessors of positions and indices.
fn draco_sheet(bytes: &[u8], vertices: usize, corners: usize, attributes: &str, required: bool) -> Vec<u8> {
    let mut document = Document::default();
    for kind in ["VEC3", "VEC4"] {
        document.raw_accessor(&format!(r#"{{"componentType":5126,"count":{vertices},"type":"{kind}"}}"#));
    }
    document.raw_accessor(&format!(r#"{{"componentType":5125,"count":{corners},"type":"SCALAR"}}"#));
    let view = document.view(bytes, "");
    let list = if required { "extensionsRequired" } else { "extensionsUsed" };
    document.glb(&format!(
        r#""{list}":["KHR_draco_mesh_compression"],"nodes":[{{"mesh":0}}],"meshes":[{{"name":"vessel","primitives":
        [{{"attributes":{{{attributes}}},"indices":2,"extensions":{{"KHR_draco_mesh_compression":
        {{"bufferView":{view},"attributes":{{{attributes}}}}}}}}}]}}]"#
    ))
}

#[test]
fn draco_is_decompressed_required_or_only_used_with_its_colours() {
    let (positions, corners) = sheet(10);
    let of_positions: Vec<Vec<f32>> = positions.iter().map(|at| at.to_vec()).collect();
    let green = vec![vec![0.0, 1.0, 0.0, 1.0]; positions.len()];
    for (required, level) in [(true, 10), (true, 5), (false, 0)] {
        let alone = [(GeometryAttributeType::Position, of_positions.clone())];
        let bytes = draco(&alone, &corners, level);
        let file = draco_sheet(&bytes, positions.len(), corners.len(), r#""POSITION":0"#, required);
        let plain = model(&file);
        is_sheet(&plain, 10, 1e-3);
        let both = [alone[0].clone(), (GeometryAttributeType::Color, green.clone())];
        let bytes = draco(&both, &corners, level);
        let attributes = r#""POSITION":0,"COLOR_0":1"#;
        let coloured = model(&draco_sheet(&bytes, positions.len(), corners.len(), attributes, required));
        assert_eq!(coloured.triangle_count(), 200);
        assert!(coloured.meshes[0].colours.iter().all(|&colour| colour == Rgba8([0, 255, 0, 255])));
    }
}

#[test]
fn draco_that_cannot_be_read_is_refused_by_name_with_a_remedy() {
    let (positions, corners) = sheet(10);
    let of_positions = positions.iter().map(|at| at.to_vec()).collect();
    let bytes = draco(&[(GeometryAttributeType::Position, of_positions)], &corners, 5);
    let position = r#""POSITION":0"#;
    for file in [
        draco_sheet(&[0; 96], positions.len(), corners.len(), position, false),
        draco_sheet(&bytes[..bytes.len() / 2], positions.len(), corners.len(), position, true),
        // More than the document says.
        draco_sheet(&bytes, positions.len(), 30, position, true),
        draco_sheet(&bytes, 5, corners.len(), position, true),
    ] {
        let said = error(&file).to_string();
        for part in ["vessel", "KHR_draco_mesh_compression", "gltf-transform"] {
            assert!(said.contains(part), "{said}");
        }
    }
}

#[test]
fn draco_that_claims_more_than_is_allowed_is_refused_before_it_is_read() {
    for (vertices, corners) in [(1 << 40, 3), (4, 3 << 40)] {
        let said = error(&draco_sheet(&[0; 96], vertices, corners, r#""POSITION":0"#, true));
        assert!(matches!(said, GltfError::Budget(_)), "{said}");
    }
}

#[test]
fn plain_arrays_outrank_compressed_ones() {
    let mut document = Document::triangle();
    let view = document.view(&[0; 16], "");
    let file = document.glb(&format!(
        r#""extensionsUsed":["KHR_draco_mesh_compression"],"nodes":[{{"mesh":0}}],"meshes":[{{"primitives":
        [{{"attributes":{{"POSITION":0}},"extensions":{{"KHR_draco_mesh_compression":
        {{"bufferView":{view},"attributes":{{"POSITION":0}}}}}}}}]}}]"#
    ));
    assert_eq!(model(&file).triangle_count(), 1);
}
