// Boxes tested against a pyramid of farthest depths, as `HzbTest` does on the host and with the same answers:
// f64 sums and products in the same order. The build script forbids to fuse them: fma rounds once, the host
// twice. A workgroup tests a box: its invocations share the texels of a level, and then those of the next
// finer one.

struct Plane {
    middle: f64,
    dx: f64,
    dy: f64,
}

// `ScreenRecord`.
struct Box {
    planes: array<Plane, 6>,
    nearest: f64,
    farthest: f64,
    x0: u32,
    x1: u32,
    y0: u32,
    y1: u32,
    fronts: u32,
    backs: u32,
    level: u32,
    budget: u32,
}

struct Test {
    grown: f64,
    margin: f64,
    nearer: f64,
    width: u32,
    // Where each level's texels begin.
    starts: array<u32, 17>,
    // The step of a traversal, and how long its lists are.
    step: u32,
    capacity: u32,
}

@group(0) @binding(0) var<storage, read_write> texels: array<f32>;
@group(0) @binding(1) var<storage, read_write> boxes: array<Box>;
var<immediate> test: Test;

const LANES = 32u;
// No less than a box's budget of texels.
const MOST = 256u;

// The workgroup's box.
var<workgroup> shape: Box;
// Texels to look at, all of one level, and those of the next finer: a column, and a row times 65,536.
var<workgroup> listed: array<array<u32, MOST>, 2>;
var<workgroup> added: atomic<u32>;
var<workgroup> count: u32;

// The pixels of a box in a texel.
struct Part {
    x0: u32,
    x1: u32,
    y0: u32,
    y1: u32,
}

// A rectangle about the middle of a box's own.
struct Block {
    x: f64,
    y: f64,
    half_x: f64,
    half_y: f64,
}

fn depth_at(level: u32, x: u32, y: u32) -> f64 {
    let width = ((test.width - 1u) >> level) + 1u;
    return f64(texels[test.starts[level] + y * width + x]);
}

fn part_of(level: u32, x: u32, y: u32) -> Part {
    let left = x << level;
    let top = y << level;
    let last = (1u << level) - 1u;
    return Part(
        max(shape.x0, left),
        min(shape.x1, left + last),
        max(shape.y0, top),
        min(shape.y1, top + last),
    );
}

fn block_of(part: Part, margin: f64) -> Block {
    return Block(
        0.5lf * f64(part.x0 + part.x1 + 1u) - 0.5lf * f64(shape.x0 + shape.x1 + 1u),
        0.5lf * f64(part.y0 + part.y1 + 1u) - 0.5lf * f64(shape.y0 + shape.y1 + 1u),
        0.5lf * f64(part.x1 - part.x0) + margin,
        0.5lf * f64(part.y1 - part.y0) + margin,
    );
}

fn greatest(plane: Plane, block: Block) -> f64 {
    return plane.middle + plane.dx * block.x + plane.dy * block.y + abs(plane.dx) * block.half_x
        + abs(plane.dy) * block.half_y;
}

// How near the box's front can be at the centres of these pixels.
fn nearest_over(part: Part) -> f64 {
    let block = block_of(part, test.margin);
    var front = shape.nearest;
    for (var i = 0u; i < shape.fronts; i += 1u) {
        front = min(front, greatest(shape.planes[i], block) * test.nearer);
    }
    return max(front, shape.farthest);
}

// Whether the grown outline misses the centres of all these pixels.
fn misses(part: Part) -> bool {
    let block = block_of(part, test.grown);
    let fronts = shape.fronts;
    for (var i = 0u; i < fronts; i += 1u) {
        let front = shape.planes[i];
        for (var j = fronts; j < fronts + shape.backs; j += 1u) {
            let back = shape.planes[j];
            let edge = Plane(front.middle - back.middle, front.dx - back.dx, front.dy - back.dy);
            if greatest(edge, block) < 0.0lf {
                return true;
            }
        }
    }
    return false;
}

fn add(list: u32, x: u32, y: u32) {
    let place = atomicAdd(&added, 1u);
    if place < MOST {
        listed[list][place] = x | (y << 16u);
    }
}

// Adds the texels of the coarsest level whose depth does not hide the box's nearest point.
fn add_coarsest(lane: u32) {
    let level = shape.level;
    let left = shape.x0 >> level;
    let top = shape.y0 >> level;
    let width = (shape.x1 >> level) - left + 1u;
    let height = (shape.y1 >> level) - top + 1u;
    for (var i = lane; i < width * height; i += LANES) {
        let x = left + i % width;
        let y = top + i / width;
        if !(shape.nearest < depth_at(level, x, y)) {
            add(0u, x, y);
        }
    }
}

// Adds the finer texels of one in which the box may show.
fn look_at(level: u32, x: u32, y: u32, list: u32) {
    let part = part_of(level, x, y);
    if nearest_over(part) < depth_at(level, x, y) || misses(part) {
        return;
    }
    if level == 0u {
        // It shows at a pixel: more texels than any budget.
        atomicAdd(&added, MOST + 1u);
        return;
    }
    for (var row = part.y0 >> (level - 1u); row <= part.y1 >> (level - 1u); row += 1u) {
        for (var column = part.x0 >> (level - 1u); column <= part.x1 >> (level - 1u); column += 1u) {
            add(list, column, row);
        }
    }
}

// Whether the box of this number shows anywhere. All invocations of the workgroup ask, and the first one is
// told: the others get 0.
//
// The host visits texels in another order. That changes no answer: a box is hidden only if all that are to be
// looked at were, and the budget sufficed.
fn shows(number: u32, lane: u32) -> u32 {
    if lane == 0u {
        shape = boxes[number];
        atomicStore(&added, 0u);
    }
    workgroupBarrier();
    let budget = min(shape.budget, MOST);
    var level = shape.level;
    var list = 0u;
    var looked_at = 0u;
    add_coarsest(lane);
    loop {
        workgroupBarrier();
        if lane == 0u {
            count = atomicExchange(&added, 0u);
        }
        let here = workgroupUniformLoad(&count);
        looked_at += here;
        if here == 0u || looked_at > budget {
            break;
        }
        for (var i = lane; i < here; i += LANES) {
            let texel = listed[list][i];
            look_at(level, texel & 0xffffu, texel >> 16u, 1u - list);
        }
        list = 1u - list;
        level -= min(level, 1u);
    }
    return select(0u, 1u, lane == 0u && looked_at > budget);
}
