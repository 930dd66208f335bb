// A pyramid of farthest depths: up to six levels from the finer one. A workgroup makes those over its block
// of 64 x 64 finer texels, so no level waits for all of the one before it.

struct Finer {
    // Where its texels begin. Those of coarser levels follow.
    start: u32,
    width: u32,
    height: u32,
}

// Depths as bits, which no device rounds or flushes: as no depth is below 0, they compare as the depths do.
// Signed, so that -0 is the least.
@group(0) @binding(0) var<storage, read_write> texels: array<i32>;
var<immediate> finer: Finer;

// Invocations of a workgroup, across and down.
const SIDE = 16u;
// The block's texels of the level that was made last, in rows of SIDE.
var<workgroup> block: array<i32, 256>;

// A level.
struct Level {
    start: u32,
    width: u32,
    height: u32,
}

fn halved(level: Level) -> Level {
    // Rounded up: at odd sizes the last column and row stand for themselves.
    return Level(level.start + level.width * level.height, (level.width + 1u) / 2u, (level.height + 1u) / 2u);
}

fn is_in(level: Level, x: u32, y: u32) -> bool {
    return x < level.width && y < level.height;
}

fn farthest(a: i32, b: i32, c: i32, d: i32) -> i32 {
    return min(min(a, b), min(c, d));
}

// The farthest of four texels of the finer level, two to a side from here. It is within the level.
fn farthest_of_finer(left: u32, top: u32) -> i32 {
    let right = min(left + 1u, finer.width - 1u);
    let bottom = min(top + 1u, finer.height - 1u);
    let above = finer.start + top * finer.width;
    let below = finer.start + bottom * finer.width;
    return farthest(texels[above + left], texels[above + right], texels[below + left], texels[below + right]);
}

fn keep(level: Level, x: u32, y: u32, depth: i32) {
    texels[level.start + y * level.width + x] = depth;
}

@compute @workgroup_size(SIDE, SIDE)
fn cs_halve(
    @builtin(global_invocation_id) at: vec3<u32>,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) own: vec3<u32>,
) {
    // Two levels without the others' help: four texels, and one.
    let first = halved(Level(finer.start, finer.width, finer.height));
    var level = halved(first);
    if is_in(level, at.x, at.y) {
        let x = 2u * at.x;
        let y = 2u * at.y;
        var depth = farthest_of_finer(2u * x, 2u * y);
        keep(first, x, y, depth);
        for (var other = 1u; other < 4u; other += 1u) {
            let right = x + (other & 1u);
            let bottom = y + (other >> 1u);
            if is_in(first, right, bottom) {
                let other_depth = farthest_of_finer(2u * right, 2u * bottom);
                keep(first, right, bottom, other_depth);
                depth = min(depth, other_depth);
            }
        }
        block[own.y * SIDE + own.x] = depth;
        if first.width > 1u || first.height > 1u {
            keep(level, at.x, at.y, depth);
        }
    }
    // And the others together: 8, 4, 2 and 1 texels to a side.
    for (var side = SIDE / 2u; side > 0u; side /= 2u) {
        workgroupBarrier();
        let before = level;
        level = halved(before);
        let x = group.x * side + own.x;
        let y = group.y * side + own.y;
        let is_mine = own.x < side && own.y < side && is_in(level, x, y);
        var depth = 0;
        if is_mine {
            let left = 2u * own.x;
            let top = 2u * own.y * SIDE;
            let right = select(left, left + 1u, 2u * x + 1u < before.width);
            let bottom = select(top, top + SIDE, 2u * y + 1u < before.height);
            depth = farthest(
                block[top + left],
                block[top + right],
                block[bottom + left],
                block[bottom + right],
            );
            if before.width > 1u || before.height > 1u {
                keep(level, x, y, depth);
            }
        }
        workgroupBarrier();
        if is_mine {
            block[own.y * SIDE + own.x] = depth;
        }
    }
}
