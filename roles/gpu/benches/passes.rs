//! What passes and testers take.

fn main() {}
