// Quotients and roots of f64, rounded to the nearest as IEEE 754 has it. Vulkan promises no more for the
// device's own than what f32 has. So these are guesses here: Newton's method brings them within one step of
// the result, and the exact remainder chooses between the two neighbours. Sums and products are rounded to
// the nearest on devices that have f64 at all, and the build script forbids to fuse them.

// For Dekker's splitting of a number in two of half as many bits.
const SPLIT = 134217729.0lf;
// x + STEP |x| rounds to the next number above x (Rump, Zimmermann, Boldo, Melquiond 2009).
const STEP = 1.1102230246251568e-16lf;
// Beyond these, splitting might overflow or remainders vanish. No coordinate of a scene is near them.
const LEAST = 1e-140lf;
const GREATEST = 1e140lf;

fn is_moderate(x: f64) -> bool {
    return abs(x) >= LEAST && abs(x) <= GREATEST;
}

// a - b c, where that is a number: b is within a few steps of a / c.
fn remainder(a: f64, b: f64, c: f64) -> f64 {
    let product = b * c;
    let split_b = SPLIT * b;
    let high_b = split_b - (split_b - b);
    let low_b = b - high_b;
    let split_c = SPLIT * c;
    let high_c = split_c - (split_c - c);
    let low_c = c - high_c;
    let rest = low_b * low_c - (((product - high_b * high_c) - low_b * high_c) - high_b * low_c);
    return (a - product) - rest;
}

// The number next to one.
fn neighbour(x: f64, above: bool) -> f64 {
    return select(x - STEP * abs(x), x + STEP * abs(x), above);
}

fn quotient(a: f64, b: f64) -> f64 {
    return quotient_from(a / b, a, b);
}

fn quotient_from(first: f64, a: f64, b: f64) -> f64 {
    var guess = first;
    if !(is_moderate(a) && is_moderate(b)) {
        return guess;
    }
    guess += remainder(a, guess, b) / b;
    guess += remainder(a, guess, b) / b;
    return nearest_quotient(guess, a, b);
}

// Of a guess and its neighbour on the side of its remainder, the one with the smaller remainder.
fn nearest_quotient(guess: f64, a: f64, b: f64) -> f64 {
    let rest = remainder(a, guess, b);
    if rest == 0.0lf {
        return guess;
    }
    let other = neighbour(guess, (rest > 0.0lf) == (b > 0.0lf));
    return select(guess, other, abs(remainder(a, other, b)) < abs(rest));
}

fn root(a: f64) -> f64 {
    return root_from(sqrt(a), a);
}

fn root_from(first: f64, a: f64) -> f64 {
    var guess = first;
    if !is_moderate(a) {
        return guess;
    }
    guess += remainder(a, guess, guess) / (guess + guess);
    guess += remainder(a, guess, guess) / (guess + guess);
    return nearest_root(guess, a);
}

fn nearest_root(guess: f64, a: f64) -> f64 {
    let rest = remainder(a, guess, guess);
    if rest == 0.0lf {
        return guess;
    }
    let other = neighbour(guess, rest > 0.0lf);
    return select(guess, other, abs(remainder(a, other, other)) < abs(rest));
}

const MOST_F64 = 1.7976931348623157e308lf;

fn is_finite(x: f64) -> bool {
    return abs(x) <= MOST_F64;
}

// f64 to f32 and back.
fn narrowed(x: f64) -> f64 {
    return f64(f32(x));
}

// Vectors of f64, with operations in the order of the host. The built-in ones leave the order open.
alias Vector = vec3<f64>;

fn times(v: Vector, factor: f64) -> Vector {
    return v * Vector(factor, factor, factor);
}

fn inner(a: Vector, b: Vector) -> f64 {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

fn outer(a: Vector, b: Vector) -> Vector {
    return Vector(a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y);
}

fn sum_of(v: Vector) -> f64 {
    return v.x + v.y + v.z;
}

// A matrix by columns, and its product with a vector.
struct Matrix {
    x: Vector,
    y: Vector,
    z: Vector,
}

fn product(m: Matrix, v: Vector) -> Vector {
    return times(m.x, v.x) + times(m.y, v.y) + times(m.z, v.z);
}
