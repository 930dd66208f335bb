//! The bytes of a frame on the network, by the paper's formula and as sent, over the ids a frame and the ids
//! a batch.
//!
//!     cargo run --example bandwidth

use trimaran::report::FrameLoad;

fn main() {
    println!("at 30 frames a second, with 50 bytes of headers a packet, in megabits a second:\n");
    println!("ids a frame   ids a batch   paper's formula   as sent");
    for ids in [100.0, 1_000.0, 4_000.0, 20_000.0] {
        for batch in [1.0, 10.0, 100.0, 1_024.0] {
            let load = FrameLoad { ids, batch, header: 50.0, receivers: 2 };
            let [paper, sent] = [load.paper_bytes(), load.sent_bytes()].map(|bytes| 8.0 * bytes * 30.0 / 1e6);
            println!("{ids:11} {batch:13} {paper:17.2} {sent:9.2}");
        }
    }
}
