// The occlusion tests: the faces of a box that face the eye.

// A box in view space, its axes turned so that a face that shows lies on an axis's positive end; as
// attributes that advance by instance.
struct Box {
    @location(0) centre: vec3<f32>,
    // Bit i: the face at the end of axis i faces the eye.
    @location(1) faces: u32,
    @location(2) axis_0: vec3<f32>,
    @location(3) axis_1: vec3<f32>,
    @location(4) axis_2: vec3<f32>,
}

struct Camera {
    // As in scene.wgsl.
    scale: vec2<f32>,
    near: f32,
}

@group(0) @binding(0) var<storage, read_write> counts: array<atomic<u32>>;
var<immediate> camera: Camera;

// Vertex 0..18: three faces of two triangles. A face that does not show collapses to a point.
fn corner_position(vertex: u32, shape: Box) -> vec4<f32> {
    let face = vertex / 6u;
    let corner = vertex % 6u;
    // Two triangles of a square: (0,0) (1,0) (0,1) and (0,1) (1,0) (1,1).
    let right = corner == 1u || corner >= 4u;
    let top = corner == 2u || corner == 3u || corner == 5u;
    let shows = (shape.faces & (1u << face)) != 0u;
    let u = select(-1.0, 1.0, right && shows);
    let v = select(-1.0, 1.0, top && shows);
    // Each corner is summed in the axes' own order whichever face asks, so that faces meet without a crack.
    let weights = select(
        select(vec3<f32>(u, v, 1.0), vec3<f32>(v, 1.0, u), face == 1u),
        vec3<f32>(1.0, u, v),
        face == 0u,
    );
    let p = shape.centre + shape.axis_0 * weights.x + shape.axis_1 * weights.y + shape.axis_2 * weights.z;
    return vec4<f32>(p.x * camera.scale.x, p.y * camera.scale.y, camera.near, -p.z);
}

// For occlusion queries: no fragment shader, the query counts.
@vertex
fn vs_box(@builtin(vertex_index) vertex: u32, shape: Box) -> @builtin(position) vec4<f32> {
    return corner_position(vertex, shape);
}

struct CountedVertex {
    @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) index: u32,
}

@vertex
fn vs_counted_box(
    @builtin(vertex_index) vertex: u32,
    @builtin(instance_index) index: u32,
    shape: Box,
) -> CountedVertex {
    return CountedVertex(corner_position(vertex, shape), index);
}

// Runs only where the depth test passed.
@fragment
@early_depth_test(force)
fn fs_count(in: CountedVertex) {
    atomicAdd(&counts[in.index], 1u);
}
