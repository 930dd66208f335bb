// Boxes tested against a pyramid of farthest depths, as `HzbTest` does on the host and with the same answers:
// f64 sums and products in the same order. The build script forbids to fuse them: fma rounds once, the host
// twice.

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
    boxes: u32,
    // Where each level's texels begin.
    starts: array<u32, 18>,
}

@group(0) @binding(0) var<storage, read_write> texels: array<f32>;
@group(0) @binding(1) var<storage, read_write> boxes: array<Box>;
@group(0) @binding(2) var<storage, read_write> visible: array<u32>;
var<immediate> test: Test;

struct Texel {
    level: u32,
    x: u32,
    y: u32,
}

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

fn depth_at(texel: Texel) -> f64 {
    let width = ((test.width - 1u) >> texel.level) + 1u;
    return f64(texels[test.starts[texel.level] + texel.y * width + texel.x]);
}

fn part_of(shape: u32, texel: Texel) -> Part {
    let left = texel.x << texel.level;
    let top = texel.y << texel.level;
    let last = (1u << texel.level) - 1u;
    return Part(
        max(boxes[shape].x0, left),
        min(boxes[shape].x1, left + last),
        max(boxes[shape].y0, top),
        min(boxes[shape].y1, top + last),
    );
}

fn block_of(shape: u32, part: Part, margin: f64) -> Block {
    return Block(
        0.5lf * f64(part.x0 + part.x1 + 1u) - 0.5lf * f64(boxes[shape].x0 + boxes[shape].x1 + 1u),
        0.5lf * f64(part.y0 + part.y1 + 1u) - 0.5lf * f64(boxes[shape].y0 + boxes[shape].y1 + 1u),
        0.5lf * f64(part.x1 - part.x0) + margin,
        0.5lf * f64(part.y1 - part.y0) + margin,
    );
}

fn greatest(plane: Plane, block: Block) -> f64 {
    return plane.middle + plane.dx * block.x + plane.dy * block.y + abs(plane.dx) * block.half_x
        + abs(plane.dy) * block.half_y;
}

// How near the box's front can be at the centres of these pixels.
fn nearest_over(shape: u32, part: Part) -> f64 {
    let block = block_of(shape, part, test.margin);
    var front = boxes[shape].nearest;
    for (var i = 0u; i < boxes[shape].fronts; i += 1u) {
        front = min(front, greatest(boxes[shape].planes[i], block) * test.nearer);
    }
    return max(front, boxes[shape].farthest);
}

// Whether the grown outline misses the centres of all these pixels.
fn misses(shape: u32, part: Part) -> bool {
    let block = block_of(shape, part, test.grown);
    let fronts = boxes[shape].fronts;
    for (var i = 0u; i < fronts; i += 1u) {
        let front = boxes[shape].planes[i];
        for (var j = fronts; j < fronts + boxes[shape].backs; j += 1u) {
            let back = boxes[shape].planes[j];
            let edge = Plane(front.middle - back.middle, front.dx - back.dx, front.dy - back.dy);
            if greatest(edge, block) < 0.0lf {
                return true;
            }
        }
    }
    return false;
}

// The host visits texels in another order. That changes no answer: a box is hidden only if all that are to be
// looked at were, and the budget sufficed.
fn shows(shape: u32) -> bool {
    let level = boxes[shape].level;
    var looked_at = 0u;
    for (var y = boxes[shape].y0 >> level; y <= boxes[shape].y1 >> level; y += 1u) {
        for (var x = boxes[shape].x0 >> level; x <= boxes[shape].x1 >> level; x += 1u) {
            var at = Texel(level, x, y);
            if boxes[shape].nearest < depth_at(at) {
                continue;
            }
            // Down to pixels, and on to the next of four texels where one is done.
            loop {
                let part = part_of(shape, at);
                if part.x0 <= part.x1 && part.y0 <= part.y1 {
                    looked_at += 1u;
                    if looked_at > boxes[shape].budget {
                        return true;
                    }
                    if !(nearest_over(shape, part) < depth_at(at) || misses(shape, part)) {
                        if at.level == 0u {
                            return true;
                        }
                        at = Texel(at.level - 1u, 2u * at.x, 2u * at.y);
                        continue;
                    }
                }
                while at.level < level && (at.x & at.y & 1u) == 1u {
                    at = Texel(at.level + 1u, at.x >> 1u, at.y >> 1u);
                }
                if at.level == level {
                    break;
                }
                at = Texel(at.level, at.x ^ 1u, at.y + (at.x & 1u));
            }
        }
    }
    return false;
}

@compute @workgroup_size(64)
fn cs_test_boxes(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < test.boxes {
        visible[id.x] = select(0u, 1u, shows(id.x));
    }
}
