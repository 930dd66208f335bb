// HC: the traversal of the tree, as `Traversal` does it on the host. A dispatch prepares all nodes and pieces
// of a step, and the next one tests those that the depth decides. Both append what follows to the next step.

// `Entry`: a node or a piece to visit.
struct Entry {
    id: u32,
    // Twice the step of the traversal that it belongs to, and one more if it is a piece. The highest bit: all
    // below it is mapped.
    step_and_kind: u32,
}

// The fate of a node or piece that shows.
struct Outcome {
    entry: Entry,
    // The first child or the first piece of the level to draw.
    first: u32,
    count: u32,
    // Whether the children are visited.
    refines: u32,
}

// `StepCounts`.
struct Step {
    visited: atomic<u32>,
    outside: atomic<u32>,
    tested: atomic<u32>,
    eye_inside: atomic<u32>,
    near_visible: atomic<u32>,
    not_finite: atomic<u32>,
    hidden: atomic<u32>,
    refined: atomic<u32>,
    // Found: nodes whose level is one piece, and pieces.
    whole: atomic<u32>,
    pieces: atomic<u32>,
    // Nodes whose pieces follow.
    in_pieces: atomic<u32>,
}

struct Groups {
    x: atomic<u32>,
    y: u32,
    z: u32,
}

// A pair of dispatches.
struct Dispatches {
    prepare: Groups,
    test: Groups,
    entries: atomic<u32>,
    boxes: atomic<u32>,
}

const STEPS = 64u;

// `Counters`.
struct Counters {
    ids: atomic<u32>,
    missing: atomic<u32>,
    // OVERFLOW where something found no room, UNMARKED where a record was absent while drawables were marked.
    overflow: atomic<u32>,
    dispatches: array<Dispatches, 65>,
    steps: array<Step, 64>,
}

const PREPARED_AT_ONCE = 64u;
const ABSENT = 0xffffffffu;
const ALL_BELOW = 0x80000000u;
const OVERFLOW = 1u;

// The slots of pages: those of nodes first, then those of drawables.
@group(0) @binding(3) var<storage, read_write> pages: array<u32>;
@group(0) @binding(4) var<storage, read_write> nodes: array<Node>;
@group(0) @binding(5) var<storage, read_write> drawables: array<Drawable>;
// Two lists, used in turn.
@group(0) @binding(6) var<storage, read_write> entries: array<Entry>;
@group(0) @binding(7) var<storage, read_write> outcomes: array<Outcome>;
@group(0) @binding(8) var<storage, read_write> ids: array<u32>;
@group(0) @binding(9) var<storage, read_write> counters: Counters;
@group(0) @binding(10) var<storage, read_write> missing: array<Entry>;
// Two bits a node of the pages: `NodeAppearance`.
@group(0) @binding(11) var<storage, read_write> appearances: array<u32>;

const HIDDEN_NODE = 2u;
const MIXED_NODE = 3u;

// `PAGE`.
const PAGE_BITS = 6u;

// Where a record stands, or ABSENT.
fn place_of(first_page: u32, number: u32) -> u32 {
    let slot = pages[first_page + (number >> PAGE_BITS)];
    return select((slot << PAGE_BITS) | (number & ((1u << PAGE_BITS) - 1u)), ABSENT, slot == ABSENT);
}

fn step_of(entry: Entry) -> u32 {
    return (entry.step_and_kind & ~ALL_BELOW) >> 1u;
}

fn is_piece(entry: Entry) -> bool {
    return (entry.step_and_kind & 1u) != 0u;
}

// Leaves an entry to the host, which brings the records that it lacks.
fn leave(entry: Entry) {
    let at = atomicAdd(&counters.missing, 1u);
    if at < test.capacity {
        missing[at] = entry;
    } else {
        atomicOr(&counters.overflow, OVERFLOW);
    }
}

// Appends entries of the next step.
fn visit(first: u32, count: u32, step_and_kind: u32) {
    let next = test.step + 1u;
    let at = atomicAdd(&counters.dispatches[next].entries, count);
    if at + count > test.capacity {
        atomicOr(&counters.overflow, OVERFLOW);
        return;
    }
    for (var i = 0u; i < count; i += 1u) {
        entries[(next & 1u) * test.capacity + at + i] = Entry(first + i, step_and_kind);
    }
    let groups = (at + count + PREPARED_AT_ONCE - 1u) / PREPARED_AT_ONCE;
    atomicMax(&counters.dispatches[next].prepare.x, groups);
}

// Something that shows is drawn, or its children or pieces are visited.
fn show(outcome: Outcome) {
    let step = step_of(outcome.entry);
    if outcome.refines != 0u {
        atomicAdd(&counters.steps[step].refined, 1u);
        visit(outcome.first, outcome.count, 2u * step + 2u);
    } else if outcome.count != 1u {
        atomicAdd(&counters.steps[step].refined, 1u);
        atomicAdd(&counters.steps[step].in_pieces, 1u);
        visit(outcome.first, outcome.count, 2u * step + 3u);
    } else {
        if is_piece(outcome.entry) {
            atomicAdd(&counters.steps[step].pieces, 1u);
        } else {
            atomicAdd(&counters.steps[step].whole, 1u);
        }
        keep(outcome.first);
    }
}

// A drawable of the result.
fn keep(id: u32) {
    let at = atomicAdd(&counters.ids, 1u);
    if at < test.capacity {
        ids[at] = id;
    } else {
        atomicOr(&counters.overflow, OVERFLOW);
    }
}

// How many entries the step has: none where a list has overflowed, because some of its places hold no entry.
fn entry_count() -> u32 {
    return select(atomicLoad(&counters.dispatches[test.step].entries), 0u, atomicLoad(&counters.overflow) != 0u);
}

@compute @workgroup_size(PREPARED_AT_ONCE)
fn cs_prepare(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x < entry_count() {
        prepare_entry(entries[(test.step & 1u) * test.capacity + at.x]);
    }
}

// After the last step: the host goes on.
@compute @workgroup_size(PREPARED_AT_ONCE)
fn cs_leave(@builtin(global_invocation_id) at: vec3<u32>) {
    if at.x < entry_count() {
        leave(entries[(test.step & 1u) * test.capacity + at.x]);
    }
}

fn prepare_entry(entry: Entry) {
    let step = step_of(entry);
    if step >= STEPS {
        atomicOr(&counters.overflow, OVERFLOW);
        return;
    }
    var number = entry.id;
    var drawable: Drawable;
    if is_piece(entry) {
        let place = place_of(cut.drawable_pages, entry.id);
        if place == ABSENT {
            leave(entry);
            return;
        }
        drawable = drawables[place];
        number = drawable.node;
    }
    let place = place_of(0u, number);
    if place == ABSENT {
        leave(entry);
        return;
    }
    let node = nodes[place];
    var body = body_of(node);
    var outcome = Outcome(entry, entry.id, 1u, 0u);
    var is_gone = false;
    if is_piece(entry) {
        body = piece_of(body, widened(drawable.local_min), widened(drawable.local_max));
        is_gone = is_outside(body);
    } else {
        let appearance = (appearances[place >> 4u] >> (2u * (place & 15u))) & 3u;
        is_gone = appearance == HIDDEN_NODE || is_outside(body);
        if !is_gone && !choose(node, body, appearance == MIXED_NODE, &outcome) {
            leave(entry);
            return;
        }
    }
    atomicAdd(&counters.steps[step].visited, 1u);
    if cut.mapped != 0u {
        if !is_gone {
            follow(outcome, number);
        }
        return;
    }
    if is_gone {
        atomicAdd(&counters.steps[step].outside, 1u);
        return;
    }
    let ready = prepare_box(body);
    switch ready.kind {
        case OUTSIDE: {
            atomicAdd(&counters.steps[step].outside, 1u);
            return;
        }
        case EYE_INSIDE: { atomicAdd(&counters.steps[step].eye_inside, 1u); }
        case ACROSS_NEAR: { atomicAdd(&counters.steps[step].near_visible, 1u); }
        case NOT_FINITE: { atomicAdd(&counters.steps[step].not_finite, 1u); }
        default: { atomicAdd(&counters.steps[step].tested, 1u); }
    }
    if ready.kind == HIDDEN {
        atomicAdd(&counters.steps[step].hidden, 1u);
    } else if ready.kind != BY_DEPTH {
        show(outcome);
    } else {
        let at = atomicAdd(&counters.dispatches[test.step].boxes, 1u);
        if at < test.capacity {
            boxes[at] = ready.record;
            outcomes[at] = outcome;
            atomicMax(&counters.dispatches[test.step].test.x, at + 1u);
        } else {
            atomicOr(&counters.overflow, OVERFLOW);
        }
    }
}

// `LodCut::choose`: the coarsest level that is good enough, a leaf's finest one, or else the children. False
// where a record is absent.
fn choose(node: Node, body: Body, is_mixed: bool, outcome: ptr<function, Outcome>) -> bool {
    (*outcome).first = node.first_child;
    (*outcome).count = node.child_count;
    (*outcome).refines = 1u;
    if is_mixed {
        return true;
    }
    let magnification = magnification_of(body);
    let end = node.first_drawable + node.drawable_count;
    var first = node.first_drawable;
    while first < end {
        let place = place_of(cut.drawable_pages, first);
        if place == ABSENT {
            return false;
        }
        let drawable = drawables[place];
        let is_finest_of_a_leaf = node.child_count == 0u && first == node.first_drawable;
        if is_finest_of_a_leaf || is_good(magnification, f64(drawable.error)) {
            (*outcome).first = first;
            (*outcome).count = drawable.pieces;
            (*outcome).refines = 0u;
        }
        first += max(drawable.pieces, 1u);
    }
    return true;
}

@compute @workgroup_size(LANES)
fn cs_test(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let answer = shows(group.x, lane);
    if lane == 0u {
        let outcome = outcomes[group.x];
        if answer != 0u {
            show(outcome);
        } else {
            atomicAdd(&counters.steps[step_of(outcome.entry)].hidden, 1u);
        }
    }
}
