//! Boxes in groups, as glTF.

use base64::{Engine as _, engine::general_purpose::STANDARD};
use serde_json::{Value, json};

/// Nodes under these roots as glTF. Mesh 0 is a box of a metre, whose lower corner is at the origin.
pub(crate) fn cubes(nodes: &[Value], roots: &[u32]) -> String {
    let mut bytes = Vec::new();
    for corner in 0..8_u8 {
        for axis in 0..3 {
            bytes.extend(f32::from(corner >> axis & 1).to_le_bytes());
        }
    }
    for [a, b, c, d] in
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5_u16]]
    {
        for corner in [a, b, c, a, c, d] {
            bytes.extend(corner.to_le_bytes());
        }
    }
    json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": roots }],
        "nodes": nodes,
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
              "min": [0, 0, 0], "max": [1, 1, 1] },
            { "bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR" },
        ],
        "bufferViews": [
            { "buffer": 0, "byteLength": 96 },
            { "buffer": 0, "byteOffset": 96, "byteLength": 72 },
        ],
        "buffers": [{
            "byteLength": bytes.len(),
            "uri": format!("data:application/octet-stream;base64,{}", STANDARD.encode(&bytes)),
        }],
    })
    .to_string()
}

/// Four boxes in a row, each of which touches the next one: `S / A / P / box0, box1`, `A / Q / box2` and
/// `S / B / R / box3`.
pub(crate) fn grouped_row() -> String {
    let group = |name: &str, children: &[u32]| json!({ "name": name, "children": children });
    let cube = |at: u32| json!({ "name": format!("box{at}"), "mesh": 0, "translation": [at, 0, 0] });
    let mut nodes: Vec<Value> = (0..4).map(cube).collect();
    let parts = [group("P", &[0, 1]), group("Q", &[2]), group("R", &[3])];
    nodes.extend(parts.into_iter().chain([group("A", &[4, 5]), group("B", &[6]), group("S", &[7, 8])]));
    cubes(&nodes, &[9])
}
