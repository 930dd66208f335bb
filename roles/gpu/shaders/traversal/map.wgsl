// Maps drawables to their counterparts in the cut, as `OccluderMapper` does it on the host: first they mark
// their nodes and all above, and then the traversal follows the marks.

// By node, and then by drawable. A node: twice the stamp of the mapping in which it was marked last, and one
// more if one of its own drawables was mapped. A drawable: the stamp.
@group(0) @binding(12) var<storage, read_write> stamps: array<atomic<u32>>;

const UNMARKED = 2u;

// The drawables stand where the second step's entries will.
@compute @workgroup_size(PREPARED_AT_ONCE)
fn cs_mark(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x >= cut.mapped {
        return;
    }
    let entry = entries[test.capacity + at.x];
    let place = place_of(cut.drawable_pages, entry.id);
    if place == ABSENT {
        leave_unmarked(entry);
        return;
    }
    atomicStore(&stamps[cut.nodes + entry.id], cut.stamp);
    var number = drawables[place].node;
    var mark = 2u * cut.stamp + 1u;
    while number < cut.nodes {
        let before = atomicMax(&stamps[number], mark);
        // Another one goes on from here.
        if before >= 2u * cut.stamp {
            return;
        }
        let place = place_of(0u, number);
        if place == ABSENT {
            leave_unmarked(Entry(number, 0u));
            return;
        }
        number = nodes[place].parent;
        mark = 2u * cut.stamp;
    }
}

// The host brings what is absent, and all are marked anew.
fn leave_unmarked(entry: Entry) {
    leave(entry);
    atomicOr(&counters.overflow, UNMARKED);
}

fn is_mapped(drawable: u32) -> bool {
    return atomicLoad(&stamps[cut.nodes + drawable]) == cut.stamp;
}

// Goes on below a node in the frustum, or takes its level or a piece.
fn follow(outcome: Outcome, node: u32) {
    let step = step_of(outcome.entry);
    let all_below = outcome.entry.step_and_kind & ALL_BELOW;
    let end = outcome.first + outcome.count;
    if is_piece(outcome.entry) || outcome.refines == 0u && outcome.count == 1u {
        keep(outcome.first);
    } else if outcome.refines != 0u {
        if all_below != 0u || atomicLoad(&stamps[node]) == 2u * cut.stamp + 1u {
            visit(outcome.first, outcome.count, 2u * step + 2u | ALL_BELOW);
            return;
        }
        for (var child = outcome.first; child < end; child += 1u) {
            if atomicLoad(&stamps[child]) >= 2u * cut.stamp {
                visit(child, 1u, 2u * step + 2u);
            }
        }
    } else {
        // A mapped piece of the level stands for itself, and anything else for all of them.
        var in_part = false;
        for (var piece = outcome.first; piece < end && all_below == 0u; piece += 1u) {
            in_part = in_part || is_mapped(piece);
        }
        for (var piece = outcome.first; piece < end; piece += 1u) {
            if !in_part || is_mapped(piece) {
                visit(piece, 1u, 2u * step + 3u);
            }
        }
    }
}
