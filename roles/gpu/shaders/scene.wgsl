// The scene passes: one vertex position for all of them, so that a triangle covers the same samples at the same depth
// whichever pass draws it.

enable primitive_index;

// What one draw of a batch needs, as attributes that advance by instance: each draw is one instance, and its first instance is its
// place in the batch. No descriptor sets, and no limit on the number of draws from the size of a storage buffer.
struct Draw {
    // Local frame to view space: the rows of a 3x4 matrix.
    @location(2) row_x: vec4<f32>,
    @location(3) row_y: vec4<f32>,
    @location(4) row_z: vec4<f32>,
}

struct Camera {
    // x and y scale of the projection; y is negative, for Vulkan's y points down.
    scale: vec2<f32>,
    // The near distance: depth is near / distance.
    near: f32,
    // View-space rays (x, y, -1) through a pixel: pixel centre * ray_scale + ray_offset.
    ray_scale: vec2<f32>,
    ray_offset: vec2<f32>,
    // Directions in view space, unit length: towards the key light, and up.
    key: vec4<f32>,
    up: vec4<f32>,
}

var<immediate> camera: Camera;

fn clip_position(local: vec3<f32>, draw: Draw) -> vec4<f32> {
    let p = vec4<f32>(local, 1.0);
    let view = vec3<f32>(dot(draw.row_x, p), dot(draw.row_y, p), dot(draw.row_z, p));
    return vec4<f32>(view.xy * camera.scale, camera.near, -view.z);
}

// Depth alone: no fragment shader at all.
@vertex
fn vs_depth(
    @location(0) local: vec3<f32>,
    draw: Draw,
) -> @invariant @builtin(position) vec4<f32> {
    return clip_position(local, draw);
}

struct PictureVertex {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec3<f32>,
}

@vertex
fn vs_picture(
    @location(0) local: vec3<f32>,
    @location(1) colour: vec4<f32>,
    draw: Draw,
) -> PictureVertex {
    return PictureVertex(clip_position(local, draw), colour.rgb);
}

// Flat shading by a key light, a light at the eye and a sky.
//
// The normal comes from depth alone, so nothing but a colour has to be interpolated: on a plane, 1/distance is linear in the
// ray (x, y), and its gradient is the plane's x and y; the plane's equation gives z. The normal so found faces away from the eye
// whatever the winding, so both sides of a triangle are lit alike.
@fragment
fn fs_picture(in: PictureVertex) -> @location(0) vec4<f32> {
    let depth = in.position.z;
    let ray = in.position.xy * camera.ray_scale + camera.ray_offset;
    let slope = vec2<f32>(dpdx(depth), dpdy(depth)) / camera.ray_scale;
    let away = vec3<f32>(slope, dot(slope, ray) - depth);
    let shrink = inverseSqrt(max(dot(away, away), 1e-36));
    let normal = away * -shrink;
    let sky = 0.5 + 0.5 * dot(normal, camera.up.xyz);
    let facing = min(depth * shrink, 1.0);
    let light = 0.10 + 0.22 * sky + 0.26 * facing + 0.42 * max(dot(normal, camera.key.xyz), 0.0);
    // The colours are sRGB-encoded and light multiplies what they encode. sRGB is near a power law, under which encoding the product is
    // the product of the encoded: so encode the light (a square root) and leave the colours as they are.
    return vec4<f32>(in.colour * sqrt(light), 1.0);
}

struct ItemVertex {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) id: u32,
}

@vertex
fn vs_item(@location(0) local: vec3<f32>, draw: Draw, @location(5) id: u32) -> ItemVertex {
    return ItemVertex(clip_position(local, draw), id);
}

@fragment
fn fs_item(in: ItemVertex, @builtin(primitive_index) triangle: u32) -> @location(0) vec2<u32> {
    return vec2<u32>(in.id, triangle);
}
