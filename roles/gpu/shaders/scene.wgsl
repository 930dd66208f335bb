// The scene passes: one vertex position for all of them, so that a triangle covers the same samples at the
// same depth whichever pass draws it.

enable primitive_index;

// The data of one draw of a batch, as attributes that advance by instance: each draw is one instance, and its
// first instance is its place in the batch. No descriptor sets, and no limit on the number of draws from the
// size of a storage buffer.
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

fn view_position(local: vec3<f32>, draw: Draw) -> vec3<f32> {
    let p = vec4<f32>(local, 1.0);
    return vec3<f32>(dot(draw.row_x, p), dot(draw.row_y, p), dot(draw.row_z, p));
}

fn clip_position(local: vec3<f32>, draw: Draw) -> vec4<f32> {
    let view = view_position(local, draw);
    return vec4<f32>(view.xy * camera.scale, camera.near, -view.z);
}

// The bounds of the part of the scene that sections leave.
struct Sections {
    count: u32,
    // In view space, the normals times the near distance: what lies along the ray (x, y, -1) at a depth is
    // kept where plane . (x, y, -1, depth) >= 0.
    planes: array<vec4<f32>, 36>,
}

@group(0) @binding(0) var<storage, read> sections: Sections;

// OR cuts away this much more than the passes that draw what shows, as a share of the magnitudes summed: all
// that it draws has to be drawn there as well. A sum goes through 6 roundings, each of at most 2^-23 of the
// magnitudes. Two devices that round each of them another way are 12 of these apart; 32 leave room for depths
// and rays that are a few roundings apart as well.
const OCCLUDER_MARGIN = 32.0 / 8388608.0;

// Whether sections cut a fragment away. Its place follows from the pixel's centre and the depth alone, which
// are the same in all passes. The build script forbids to fuse sums and products, so that the passes agree on
// the last bit too.
fn is_cut_away(at: vec4<f32>, margin: f32) -> bool {
    let scaled = at.xy * camera.ray_scale;
    // The distance is near / depth. As only the sign is asked for, all is multiplied by the depth, and
    // nothing divided.
    let point = vec4<f32>(scaled + camera.ray_offset, -1.0, at.z);
    let magnitude = vec4<f32>(abs(scaled) + abs(camera.ray_offset), 1.0, at.z);
    for (var i = 0u; i < sections.count; i += 1u) {
        let terms = sections.planes[i] * point;
        let bounds = abs(sections.planes[i]) * magnitude;
        let side = terms.x + terms.y + terms.z + terms.w;
        if !(side >= margin * (bounds.x + bounds.y + bounds.z + bounds.w)) {
            return true;
        }
    }
    return false;
}

// Depth alone: no fragment shader at all where nothing is cut away.
@vertex
fn vs_depth(
    @location(0) local: vec3<f32>,
    draw: Draw,
) -> @invariant @builtin(position) vec4<f32> {
    return clip_position(local, draw);
}

@fragment
fn fs_depth_cut(@builtin(position) at: vec4<f32>) {
    if is_cut_away(at, OCCLUDER_MARGIN) {
        discard;
    }
}

struct PictureVertex {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) colour: vec4<f32>,
    // The part of the light at the eye is linear in the pixel: weights of x, y and 1.
    @location(1) @interpolate(flat) eye_light: vec3<f32>,
    @location(2) @interpolate(flat) other_light: f32,
}

// Shares of the lights. All shading is flat: a triangle has the normal of its first corner.
const AMBIENT = 0.10;
const SKY = 0.22;
const EYE = 0.26;
const KEY = 0.42;

// The largest share of a see-through surface in what shows at a pixel: `SEE_THROUGH_ALPHA` in pipeline.rs.
const SEE_THROUGH_ALPHA = 0.3;

@vertex
fn vs_picture(
    @location(0) local: vec3<f32>,
    @location(1) colour: vec4<f32>,
    @location(6) folded: vec2<f32>,
    draw: Draw,
) -> PictureVertex {
    let normal = view_normal(folded, view_position(local, draw), draw);
    let sky = 0.5 + 0.5 * dot(normal, camera.up.xyz);
    let other_light = AMBIENT + SKY * sky + KEY * max(dot(normal, camera.key.xyz), 0.0);
    // The normal by the ray from the pixel to the eye, (-x, -y, 1).
    let eye_light = vec3<f32>(-normal.xy * camera.ray_scale, normal.z - dot(normal.xy, camera.ray_offset));
    return PictureVertex(clip_position(local, draw), colour, EYE * eye_light, other_light);
}

// The unit normal in view space from one in the local frame, folded as the scene's `Normal` says. It is
// turned to the eye, so that both sides of a triangle are lit alike, whatever the winding and even in a
// mirror.
fn view_normal(folded: vec2<f32>, position: vec3<f32>, draw: Draw) -> vec3<f32> {
    let z = 1.0 - abs(folded.x) - abs(folded.y);
    let under = max(-z, 0.0);
    let local = vec3<f32>(folded - select(vec2<f32>(-under), vec2<f32>(under), folded >= vec2<f32>(0.0)), z);
    // Cofactors keep a normal at right angles to its plane under any scale.
    let normal = vec3<f32>(
        dot(cross(draw.row_y.xyz, draw.row_z.xyz), local),
        dot(cross(draw.row_z.xyz, draw.row_x.xyz), local),
        dot(cross(draw.row_x.xyz, draw.row_y.xyz), local),
    );
    let shrink = inverseSqrt(max(dot(normal, normal), 1e-36));
    return normal * select(shrink, -shrink, dot(normal, position) > 0.0);
}

// Flat shading by a key light, a light at the eye and a sky.
fn shade(in: PictureVertex) -> vec4<f32> {
    let light = in.other_light + min(dot(in.eye_light, vec3<f32>(in.position.xy, 1.0)), EYE);
    // The colours are sRGB-encoded and light multiplies what they encode. sRGB is near a power law, under
    // which encoding the product is the product of the encoded: so encode the light (a square root) and leave
    // the colours as they are.
    return vec4<f32>(in.colour.rgb * sqrt(light), 1.0);
}

@fragment
fn fs_picture(in: PictureVertex) -> @location(0) vec4<f32> {
    return shade(in);
}

@fragment
fn fs_picture_cut(in: PictureVertex) -> @location(0) vec4<f32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return shade(in);
}

// See-through surfaces: alpha is a surface's share in the picture, and is not written.
@fragment
fn fs_see_through(in: PictureVertex) -> @location(0) vec4<f32> {
    return vec4<f32>(shade(in).rgb, min(in.colour.a, SEE_THROUGH_ALPHA));
}

@fragment
fn fs_see_through_cut(in: PictureVertex) -> @location(0) vec4<f32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return vec4<f32>(shade(in).rgb, min(in.colour.a, SEE_THROUGH_ALPHA));
}

// The same for people, as the page draws it: the light comes over the shoulder of who looks, and colours are
// calm. Nothing is measured by these pictures.
struct WindowVertex {
    @invariant @builtin(position) position: vec4<f32>,
    // Its alpha is the share of what is see-through.
    @location(0) @interpolate(flat) tone: vec4<f32>,
}

// Towards the light, in view space.
const SHOULDER = vec3<f32>(0.36, 0.48, 0.80);

@vertex
fn vs_window(
    @location(0) local: vec3<f32>,
    @location(1) colour: vec4<f32>,
    @location(6) folded: vec2<f32>,
    draw: Draw,
) -> WindowVertex {
    let normal = view_normal(folded, view_position(local, draw), draw);
    let sky = 0.5 + 0.5 * dot(normal, camera.up.xyz);
    let light = 0.17 + 0.27 * sky + 0.56 * max(dot(normal, SHOULDER), 0.0);
    // Plants come in pure red and green: they shout less with a little grey in them.
    let grey = dot(colour.rgb, vec3<f32>(0.299, 0.587, 0.114));
    let calm = mix(vec3<f32>(grey), colour.rgb, 0.82) * 0.93 + 0.03;
    return WindowVertex(clip_position(local, draw), vec4<f32>(calm * sqrt(light), colour.a));
}

@fragment
fn fs_window(in: WindowVertex) -> @location(0) vec4<f32> {
    return vec4<f32>(in.tone.rgb, 1.0);
}

@fragment
fn fs_window_cut(in: WindowVertex) -> @location(0) vec4<f32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return vec4<f32>(in.tone.rgb, 1.0);
}

@fragment
fn fs_window_see_through(in: WindowVertex) -> @location(0) vec4<f32> {
    return vec4<f32>(in.tone.rgb, min(in.tone.a, SEE_THROUGH_ALPHA));
}

@fragment
fn fs_window_see_through_cut(in: WindowVertex) -> @location(0) vec4<f32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return vec4<f32>(in.tone.rgb, min(in.tone.a, SEE_THROUGH_ALPHA));
}

// A triangle over the whole picture, infinitely far away.
@vertex
fn vs_sky(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(select(-1.0, 3.0, corner == 1u), select(-1.0, 3.0, corner == 2u), 0.0, 1.0);
}

// Sky above the horizon, ground below.
@fragment
fn fs_sky(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let ray = vec3<f32>(at.xy * camera.ray_scale + camera.ray_offset, -1.0);
    let height = dot(normalize(ray), camera.up.xyz);
    let above = sqrt(clamp(height, 0.0, 1.0));
    let below = sqrt(clamp(-height, 0.0, 1.0));
    let sky = mix(vec3<f32>(0.90, 0.93, 0.95), vec3<f32>(0.62, 0.74, 0.86), above);
    let ground = mix(vec3<f32>(0.80, 0.81, 0.80), vec3<f32>(0.60, 0.61, 0.60), below);
    return vec4<f32>(mix(ground, sky, smoothstep(-0.012, 0.012, height)), 1.0);
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

@fragment
fn fs_item_cut(in: ItemVertex, @builtin(primitive_index) triangle: u32) -> @location(0) vec2<u32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return vec2<u32>(in.id, triangle);
}

// The same without primitive ids, which not every device has in fragment shaders: indices and vertices are
// fetched from storage buffers, three a triangle. The number of a vertex is its place in the scene's index
// buffer.
@group(0) @binding(1) var<storage, read> geometry: array<u32>;

// `Vertex` of the scene in words; its position comes first.
const VERTEX_WORDS = 5u;

struct PulledVertex {
    @invariant @builtin(position) position: vec4<f32>,
    @location(0) @interpolate(flat) item: vec2<u32>,
}

@vertex
fn vs_item_pulled(
    @builtin(vertex_index) place: u32,
    draw: Draw,
    @location(5) id: u32,
    // The drawable's first index and its first vertex.
    @location(7) first: vec2<u32>,
) -> PulledVertex {
    let word = VERTEX_WORDS * (first.y + geometry[place]);
    let local = vec3<f32>(
        bitcast<f32>(geometry[word]),
        bitcast<f32>(geometry[word + 1u]),
        bitcast<f32>(geometry[word + 2u]),
    );
    return PulledVertex(clip_position(local, draw), vec2<u32>(id, (place - first.x) / 3u));
}

@fragment
fn fs_item_pulled(in: PulledVertex) -> @location(0) vec2<u32> {
    return in.item;
}

@fragment
fn fs_item_pulled_cut(in: PulledVertex) -> @location(0) vec2<u32> {
    if is_cut_away(in.position, 0.0) {
        discard;
    }
    return in.item;
}
