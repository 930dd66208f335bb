// The box that is tested in place of a node, and its record: `BoxMaker`, `ScreenProjection` and
// `ScreenRecords` of the host, bit by bit.

// The findings about a box before any depth is read.
const OUTSIDE = 0u;
const EYE_INSIDE = 1u;
const ACROSS_NEAR = 2u;
const NOT_FINITE = 3u;
// These are tested: shown or hidden without reading a depth, or by a record.
const SHOWN = 4u;
const HIDDEN = 5u;
const BY_DEPTH = 6u;

const MOST_F32 = 3.4028234663852886e38lf;
const LEAST_F32 = 1.1754943508222875e-38lf;

struct Prepared {
    kind: u32,
    record: Box,
}

fn prepared(kind: u32) -> Prepared {
    var result: Prepared;
    result.kind = kind;
    return result;
}

// A unit vector, if `is_known`.
struct Direction {
    is_known: bool,
    unit: Vector,
}

fn direction_of(v: Vector) -> Direction {
    let squared = inner(v, v);
    if !(squared > 0.0lf) {
        return Direction(false, Vector());
    }
    let per_length = quotient(1.0lf, root(squared));
    return Direction(is_finite(per_length) && per_length > 0.0lf, times(v, per_length));
}

fn any_orthonormal(v: Vector) -> Vector {
    // That of -0 counts.
    let sign = select(1.0lf, -1.0lf, (bitcast<u32>(f32(v.z)) >> 31u) != 0u);
    let a = quotient(-1.0lf, sign + v.z);
    let b = v.x * v.y * a;
    return Vector(b, sign + v.y * v.y * a, -v.y);
}

// `frame_of`: the longest edge first; of equally long ones the first.
fn frame_of(edges: Matrix) -> Matrix {
    var longest = edges.x;
    var middle = edges.y;
    var shortest = edges.z;
    if inner(longest, longest) < inner(middle, middle) {
        longest = edges.y;
        middle = edges.x;
    }
    if inner(middle, middle) < inner(shortest, shortest) {
        shortest = middle;
        middle = edges.z;
        if inner(longest, longest) < inner(middle, middle) {
            middle = longest;
            longest = edges.z;
        }
    }
    let first = direction_of(longest);
    if !first.is_known {
        return Matrix(
            Vector(1.0lf, 0.0lf, 0.0lf),
            Vector(0.0lf, 1.0lf, 0.0lf),
            Vector(0.0lf, 0.0lf, 1.0lf),
        );
    }
    var second = second_of(first.unit, middle);
    if !second.is_known {
        second = second_of(first.unit, shortest);
    }
    if !second.is_known {
        second.unit = any_orthonormal(first.unit);
    }
    return Matrix(first.unit, second.unit, outer(first.unit, second.unit));
}

fn second_of(first: Vector, edge: Vector) -> Direction {
    let rest = edge - times(first, inner(first, edge));
    if inner(rest, rest) <= 1e-24lf * inner(edge, edge) {
        return Direction(false, Vector());
    }
    return direction_of(rest - times(first, inner(first, rest)));
}

// The box of a node or a piece.
fn prepare_box(part: Body) -> Prepared {
    let turn = to_view();
    let middle = times(part.local_min + part.local_max, 0.5lf);
    let local_half = times(part.local_max - part.local_min, 0.5lf);
    let linear = Matrix(
        product(turn, part.linear.x),
        product(turn, part.linear.y),
        product(turn, part.linear.z),
    );
    let centre = product(turn, part.origin - eye()) + product(linear, middle);
    let edges = Matrix(
        times(linear.x, local_half.x),
        times(linear.y, local_half.y),
        times(linear.z, local_half.z),
    );
    let frame = frame_of(edges);
    let half = Vector(
        width_along(frame.x, edges),
        width_along(frame.y, edges),
        width_along(frame.z, edges),
    );
    let a = times(frame.x, half.x);
    let b = times(frame.y, half.y);
    let c = times(frame.z, half.z);
    let thickness = abs(a.z) + abs(b.z) + abs(c.z);
    let nearest = -centre.z - thickness;
    let farthest = -centre.z + thickness;
    let far = root(inner(centre, centre)) + root(inner(half, half)) + part.reach;
    let position = cut.position_slack * far;
    let depth = quotient(cut.depth_slack * farthest * farthest, max(nearest, cut.near));
    let slack = position + max(depth, 0.0lf);
    if !(is_finite(slack) && slack <= MOST_F32) {
        return prepared(NOT_FINITE);
    }
    if excludes(centre, a, b, c, slack) {
        return prepared(OUTSIDE);
    }
    let grown = half + Vector(slack, slack, slack);
    let from_eye = abs(Vector(inner(frame.x, centre), inner(frame.y, centre), inner(frame.z, centre)));
    if from_eye.x <= grown.x && from_eye.y <= grown.y && from_eye.z <= grown.z {
        return prepared(EYE_INSIDE);
    }
    let axes = Matrix(times(frame.x, grown.x), times(frame.y, grown.y), times(frame.z, grown.z));
    if -centre.z - (abs(axes.x.z) + abs(axes.y.z) + abs(axes.z.z)) <= cut.nearest_tested {
        return prepared(ACROSS_NEAR);
    }
    let narrow = Matrix(narrow_of(axes.x), narrow_of(axes.y), narrow_of(axes.z));
    let narrow_centre = narrow_of(centre);
    if !(fits(narrow_centre) && fits(narrow.x) && fits(narrow.y) && fits(narrow.z)) {
        return prepared(NOT_FINITE);
    }
    return record_of(narrow_centre, narrow);
}

fn width_along(u: Vector, edges: Matrix) -> f64 {
    return abs(inner(u, edges.x)) + abs(inner(u, edges.y)) + abs(inner(u, edges.z));
}

fn narrow_of(v: Vector) -> Vector {
    return Vector(narrowed(v.x), narrowed(v.y), narrowed(v.z));
}

fn fits(v: Vector) -> bool {
    return abs(v.x) <= MOST_F32 && abs(v.y) <= MOST_F32 && abs(v.z) <= MOST_F32;
}

// `ScreenRecords::find`.
fn record_of(centre: Vector, axes: Matrix) -> Prepared {
    let thickness = abs(axes.x.z) + abs(axes.y.z) + abs(axes.z.z);
    let front = -centre.z - thickness;
    let back = -centre.z + thickness;
    if !(front > LEAST_F32) {
        return prepared(SHOWN);
    }
    var low = Vector(MOST_F64, MOST_F64, 0.0lf);
    var high = -low;
    let one = centre + axes.z;
    let other = centre - axes.z;
    for (var corner = 0u; corner < 8u; corner += 1u) {
        let base = select(other, one, (corner & 1u) != 0u);
        let p = axes.x;
        let q = axes.y;
        var side = p + q;
        switch corner >> 1u {
            case 1u: { side = p - q; }
            case 2u: { side = q - p; }
            case 3u: { side = -p - q; }
            default: {}
        }
        let at = base + side;
        let inverse = quotient(-1.0lf, at.z);
        let place = Vector(at.x * inverse, -at.y * inverse, 0.0lf);
        low = min(low, place);
        high = max(high, place);
    }
    let x0 = first_pixel(low.x, cut.screen_focal[0], cut.screen_middle[0]);
    let x1 = last_pixel(high.x, cut.screen_focal[0], cut.screen_middle[0], cut.screen_last[0]);
    let y0 = first_pixel(low.y, cut.screen_focal[1], cut.screen_middle[1]);
    let y1 = last_pixel(high.y, cut.screen_focal[1], cut.screen_middle[1], cut.screen_last[1]);
    if !(x0 <= x1 && y0 <= y1) {
        return prepared(HIDDEN);
    }
    var record: Box;
    record.nearest = quotient(cut.near, front) * cut.nearer;
    record.farthest = quotient(cut.near, back);
    record.x0 = u32(x0);
    record.x1 = u32(x1);
    record.y0 = u32(y0);
    record.y1 = u32(y1);
    record.budget = cut.budget;
    let longest = max(record.x1 - record.x0, record.y1 - record.y0);
    let level = select(0u, firstLeadingBit(max(longest, 4u)) - 1u, longest >= 4u);
    record.level = min(level, cut.last_level);
    add_planes(&record, centre, axes);
    return Prepared(BY_DEPTH, record);
}

fn first_pixel(low: f64, focal: f64, middle: f64) -> f64 {
    return max(ceil(middle + focal * low - cut.grown - 0.5lf), 0.0lf);
}

fn last_pixel(high: f64, focal: f64, middle: f64, last: f64) -> f64 {
    return min(floor(middle + focal * high + cut.grown - 0.5lf), last);
}

// `Planes`: those that face the eye first.
fn add_planes(record: ptr<function, Box>, centre: Vector, axes: Matrix) {
    let middle_x = 0.5lf * f64((*record).x0 + (*record).x1 + 1u);
    let middle_y = 0.5lf * f64((*record).y0 + (*record).y1 + 1u);
    let ray = Vector(
        quotient(middle_x - cut.screen_middle[0], cut.screen_focal[0]),
        quotient(-(middle_y - cut.screen_middle[1]), cut.screen_focal[1]),
        -1.0lf,
    );
    var backs: array<Plane, 6>;
    var back_count = 0u;
    var front_count = 0u;
    for (var face = 0u; face < 6u; face += 1u) {
        var axis = axes.x;
        switch face >> 1u {
            case 1u: { axis = axes.y; }
            case 2u: { axis = axes.z; }
            default: {}
        }
        let along = inner(axis, centre);
        let half = inner(axis, axis);
        let is_upper = (face & 1u) == 0u;
        let offset = select(along - half, along + half, is_upper);
        let is_front = select(along - half > 0.0lf, along + half < 0.0lf, is_upper);
        let scale = quotient(cut.near, offset);
        if offset == 0.0lf || !is_finite(scale) {
            continue;
        }
        let plane = Plane(
            inner(axis, ray) * scale,
            quotient(axis.x * scale, cut.screen_focal[0]),
            quotient(-axis.y * scale, cut.screen_focal[1]),
        );
        if !is_front {
            backs[back_count] = plane;
            back_count += 1u;
        } else if front_count < 3u {
            (*record).planes[front_count] = plane;
            front_count += 1u;
        }
    }
    for (var i = 0u; i < min(back_count, 6u - front_count); i += 1u) {
        (*record).planes[front_count + i] = backs[i];
    }
    (*record).fronts = front_count;
    (*record).backs = back_count;
}
