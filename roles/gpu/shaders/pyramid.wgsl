// A pyramid of farthest depths: one level from the finer one.

struct Finer {
    // Where its texels begin, and where those of the level to make do.
    start: u32,
    next_start: u32,
    width: u32,
    height: u32,
}

// Depths as bits, which no device rounds or flushes: as no depth is below 0, they compare as the depths do.
// Signed, so that -0 is the least.
@group(0) @binding(0) var<storage, read_write> texels: array<i32>;
var<immediate> finer: Finer;

fn texel(x: u32, y: u32) -> i32 {
    return texels[finer.start + y * finer.width + x];
}

@compute @workgroup_size(8, 8)
fn cs_halve(@builtin(global_invocation_id) at: vec3<u32>) {
    // Rounded up: at odd sizes the last column and row stand for themselves.
    let width = (finer.width + 1u) / 2u;
    let height = (finer.height + 1u) / 2u;
    if at.x >= width || at.y >= height {
        return;
    }
    let left = 2u * at.x;
    let top = 2u * at.y;
    let right = min(left + 1u, finer.width - 1u);
    let bottom = min(top + 1u, finer.height - 1u);
    let above = min(texel(left, top), texel(right, top));
    let below = min(texel(left, bottom), texel(right, bottom));
    texels[finer.next_start + at.y * width + at.x] = min(above, below);
}
