// A given list of boxes, tested one by one.

@group(0) @binding(2) var<storage, read_write> visible: array<u32>;

@compute @workgroup_size(LANES)
fn cs_test_boxes(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let answer = shows(group.x, lane);
    if lane == 0u {
        visible[group.x] = answer;
    }
}
