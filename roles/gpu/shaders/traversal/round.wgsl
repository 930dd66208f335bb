// The operations whose rounding decides, on given numbers.

@group(0) @binding(0) var<storage, read_write> numbers: array<array<f64, 2>>;
@group(0) @binding(1) var<storage, read_write> results: array<array<f64, 11>>;

const POOR = 1e-7lf;
// A little more than half the distance to the next number.
const NEXT = 1.11022302462516e-16lf;

@compute @workgroup_size(64)
fn cs_round(@builtin(global_invocation_id) at: vec3<u32>) {
    let a = numbers[at.x][0];
    let b = numbers[at.x][1];
    let sum = a + b;
    results[at.x][0] = quotient(a, b);
    results[at.x][1] = root(abs(a));
    results[at.x][2] = narrowed(a);
    results[at.x][3] = sum - a;
    results[at.x][4] = a * b - sum * a;
    // From guesses as poor as Vulkan allows: they have f32's precision.
    results[at.x][5] = quotient_from((a / b) * (1.0lf + POOR), a, b);
    results[at.x][6] = root_from(sqrt(abs(a)) * (1.0lf - POOR), abs(a));
    // From the neighbours of the results.
    let ratio = quotient(a, b);
    let side = root(abs(a));
    results[at.x][7] = nearest_quotient(ratio + NEXT * abs(ratio), a, b);
    results[at.x][8] = nearest_quotient(ratio - NEXT * abs(ratio), a, b);
    results[at.x][9] = nearest_root(side + NEXT * side, abs(a));
    results[at.x][10] = nearest_root(side - NEXT * side, abs(a));
}
