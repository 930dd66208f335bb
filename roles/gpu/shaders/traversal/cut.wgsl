// The LOD cut and the frustum: `LodCut` and `Frustum` of the host, bit by bit.

// `Node`.
struct Node {
    world_min: array<f64, 3>,
    world_max: array<f64, 3>,
    origin: array<f64, 3>,
    linear: array<f32, 9>,
    local_min: array<f32, 3>,
    local_max: array<f32, 3>,
    parent: u32,
    first_child: u32,
    child_count: u32,
    first_drawable: u32,
    drawable_count: u32,
    object: u32,
    reach: f32,
    objects: u32,
    depth: u32,
}

// `DrawableRecord`: a drawable, with its own box if it is a piece.
struct Drawable {
    local_min: array<f32, 3>,
    local_max: array<f32, 3>,
    error: f32,
    node: u32,
    pieces: u32,
}

// `SectionRecord`: a plane's location and direction, or a box's corners.
struct Section {
    is_box: u32,
    unused: u32,
    low: array<f64, 3>,
    high: array<f64, 3>,
}

// `CutRecord`: a view and a rule.
struct Cut {
    eye: array<f64, 3>,
    to_view: array<f64, 9>,
    focal: f64,
    spread: f64,
    near: f64,
    tan_x: f64,
    tan_y: f64,
    epsilon: f64,
    frustum_slack: f64,
    position_slack: f64,
    depth_slack: f64,
    nearest_tested: f64,
    screen_focal: array<f64, 2>,
    screen_middle: array<f64, 2>,
    screen_last: array<f64, 2>,
    grown: f64,
    nearer: f64,
    sections: array<Section, 6>,
    section_count: u32,
    last_level: u32,
    budget: u32,
    // Where the pages of drawables begin in the table of pages.
    drawable_pages: u32,
    // How many drawables are mapped; none where the frame is culled.
    mapped: u32,
    stamp: u32,
    nodes: u32,
    unused: u32,
}

@group(0) @binding(2) var<storage, read_write> cut: Cut;

// A node or a piece of one.
struct Body {
    world_min: Vector,
    world_max: Vector,
    local_min: Vector,
    local_max: Vector,
    origin: Vector,
    linear: Matrix,
    reach: f64,
}

fn vector(v: array<f64, 3>) -> Vector {
    return Vector(v[0], v[1], v[2]);
}

fn widened(v: array<f32, 3>) -> Vector {
    return Vector(f64(v[0]), f64(v[1]), f64(v[2]));
}

fn eye() -> Vector {
    return vector(cut.eye);
}

fn to_view() -> Matrix {
    return Matrix(
        Vector(cut.to_view[0], cut.to_view[1], cut.to_view[2]),
        Vector(cut.to_view[3], cut.to_view[4], cut.to_view[5]),
        Vector(cut.to_view[6], cut.to_view[7], cut.to_view[8]),
    );
}

fn body_of(node: Node) -> Body {
    let m = node.linear;
    let linear = Matrix(
        Vector(f64(m[0]), f64(m[1]), f64(m[2])),
        Vector(f64(m[3]), f64(m[4]), f64(m[5])),
        Vector(f64(m[6]), f64(m[7]), f64(m[8])),
    );
    return Body(
        vector(node.world_min),
        vector(node.world_max),
        widened(node.local_min),
        widened(node.local_max),
        vector(node.origin),
        linear,
        f64(node.reach),
    );
}

// `Node::part`.
fn piece_of(node: Body, local_min: Vector, local_max: Vector) -> Body {
    var low = Vector(MOST_F64, MOST_F64, MOST_F64);
    var high = -low;
    for (var corner = 0u; corner < 8u; corner += 1u) {
        let at = Vector(
            select(local_min.x, local_max.x, (corner & 1u) != 0u),
            select(local_min.y, local_max.y, (corner & 2u) != 0u),
            select(local_min.z, local_max.z, (corner & 4u) != 0u),
        );
        let placed = product(node.linear, at) + node.origin;
        low = min(low, placed);
        high = max(high, placed);
    }
    // Four times the distance from 1 to the next number.
    let margin = times(max(abs(low), abs(high)), 8.881784197001252e-16lf);
    var part = node;
    part.world_min = min(max(low - margin, node.world_min), node.world_max);
    part.world_max = min(max(high + margin, node.world_min), node.world_max);
    part.local_min = local_min;
    part.local_max = local_max;
    return part;
}

// `Frustum::excludes`.
fn excludes(centre: Vector, a: Vector, b: Vector, c: Vector, slack: f64) -> bool {
    let depth = -centre.z;
    let depths = Vector(-a.z, -b.z, -c.z);
    return depth + sum_of(abs(depths)) + slack < cut.near
        || beyond_side(cut.tan_x, centre.x, depth, Vector(a.x, b.x, c.x), depths, slack)
        || beyond_side(cut.tan_y, centre.y, depth, Vector(a.y, b.y, c.y), depths, slack);
}

fn beyond_side(tan: f64, across: f64, along: f64, reach: Vector, depths: Vector, slack: f64) -> bool {
    let right = sum_of(abs(times(depths, tan) - reach));
    let left = sum_of(abs(times(depths, tan) + reach));
    let grown = slack * (1.0lf + tan);
    return tan * along - across + right + grown < 0.0lf || tan * along + across + left + grown < 0.0lf;
}

// `Frustum::excludes_world_box`.
fn is_outside(part: Body) -> bool {
    let half = times(part.world_max - part.world_min, 0.5lf);
    let offset = times(part.world_min + part.world_max, 0.5lf) - eye();
    let turn = to_view();
    let origin = part.origin - eye();
    let slack = cut.frustum_slack * (sum_of(abs(offset)) + sum_of(abs(half)) + sum_of(abs(origin)));
    return excludes(
        product(turn, offset),
        times(turn.x, half.x),
        times(turn.y, half.y),
        times(turn.z, half.z),
        slack,
    ) || is_cut_away(part, slack);
}

fn is_cut_away(part: Body, slack: f64) -> bool {
    for (var i = 0u; i < cut.section_count; i += 1u) {
        let low = vector(cut.sections[i].low);
        let high = vector(cut.sections[i].high);
        if cut.sections[i].is_box != 0u {
            let beyond = max(part.world_min - high, low - part.world_max);
            if max(max(beyond.x, beyond.y), beyond.z) > slack {
                return true;
            }
        } else {
            // The corner farthest back.
            let nearest = Vector(
                select(part.world_max.x, part.world_min.x, high.x > 0.0lf),
                select(part.world_max.y, part.world_min.y, high.y > 0.0lf),
                select(part.world_max.z, part.world_min.z, high.z > 0.0lf),
            );
            if inner(nearest - low, high) > slack {
                return true;
            }
        }
    }
    return false;
}

// How a node magnifies its errors; `is_known` is false if the box is not finite.
struct Magnification {
    focal_spread: f64,
    nearest: f64,
    seen: f64,
    is_known: bool,
}

fn magnification_of(part: Body) -> Magnification {
    let half = times(part.world_max - part.world_min, 0.5lf);
    let turn = to_view();
    let centre = product(turn, times(part.world_min + part.world_max, 0.5lf) - eye());
    let reach = Vector(
        inner(abs(Vector(turn.x.x, turn.y.x, turn.z.x)), half),
        inner(abs(Vector(turn.x.y, turn.y.y, turn.z.y)), half),
        inner(abs(Vector(turn.x.z, turn.y.z, turn.z.z)), half),
    );
    let nearest = -centre.z - reach.z;
    if !is_finite(nearest) {
        return Magnification(0.0lf, 0.0lf, 0.0lf, false);
    }
    var spread = cut.spread;
    if nearest > 0.0lf {
        let x = abs(centre.x) + reach.x;
        let y = abs(centre.y) + reach.y;
        spread = min(spread, root(1.0lf + quotient(x * x + y * y, nearest * nearest)));
    }
    let beyond = max(max(part.world_min - eye(), eye() - part.world_max), Vector());
    let distance = root(inner(beyond, beyond));
    return Magnification(cut.focal * spread, nearest, max(nearest, quotient(distance, spread)), true);
}

// Whether a level with this error is good enough.
fn is_good(magnification: Magnification, error: f64) -> bool {
    if error == 0.0lf {
        return true;
    }
    let depth = max(magnification.nearest, magnification.seen - error);
    if !(magnification.is_known && depth > cut.near) {
        return false;
    }
    return quotient(magnification.focal_spread * error, depth) <= cut.epsilon;
}
