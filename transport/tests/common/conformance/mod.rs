//! What every transport must do, whatever is below it. A transport joins by making pairs of links.

mod endings;
mod frames;
mod latest;
mod waiting;

use std::sync::Arc;
use std::time::Duration;

use trimaran_proto::BatchSize;
use trimaran_transport::{Link, LinkConfig, Net};

use super::net;

pub(crate) use endings::*;
pub(crate) use frames::*;
pub(crate) use latest::*;
pub(crate) use waiting::*;

/// Makes pairs of joined links: switch A first, the display at its other end.
pub(crate) trait Pairs {
    async fn pair(&self, config: LinkConfig) -> (Link, Link);
    /// The network whose time the links keep.
    fn net(&self) -> Arc<dyn Net> {
        net()
    }
    /// The bytes of a header.
    const HEADER: u64;
    /// Whether ids travel as changes where the peers agreed on that.
    const CODES: bool = true;
    /// How many messages a handshake takes in each direction.
    const HANDSHAKE: u64;
}

/// Hands all cases to the macro `$make`, with `$pairs` in front: those that need nothing but tasks, and those
/// in which threads take part.
#[macro_export]
macro_rules! conformance_cases {
    ($make:ident, $pairs:expr) => {
        $crate::$make! { $pairs;
            tasks:
                frames_of_every_size_arrive_in_order,
                batches_are_full_but_the_last,
                flush_sends_a_part_of_a_batch,
                the_newest_camera_wins,
                publishing_never_waits,
                a_camera_is_read_once,
                a_slow_receiver_holds_the_sender_back,
                a_receiver_that_catches_up_gets_everything,
                silence_ends_in_an_error,
                a_deadline_leaves_the_link_usable,
                polling_takes_what_is_there,
                dropping_a_wait_loses_nothing,
                goodbye_comes_after_everything,
                what_was_sent_before_a_link_is_dropped_arrives,
                death_within_a_frame_is_no_goodbye,
                death_behind_every_step_of_a_frame_is_a_loss,
                a_dead_receiver_fails_the_sender,
                frames_in_the_wrong_order_are_refused,
                both_directions_at_once,
                every_byte_is_counted,
                frames_alike_cost_little_as_changes;
            threads:
                a_busy_receiver_is_no_dead_peer,
                polling_without_a_pause_sees_everything;
        }
    };
}

/// Makes a test of each case, for one transport.
#[macro_export]
macro_rules! conformance {
    ($pairs:expr) => { $crate::conformance_cases!(conformance, $pairs); };
    ($pairs:expr; tasks: $($task:ident),+; threads: $($thread:ident),+;) => {
        $crate::conformance!(@tests $pairs; $($task),+, $($thread),+);
    };
    (@tests $pairs:expr; $($case:ident),+) => {
        $(
            #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
            async fn $case() {
                $crate::common::conformance::$case(&$pairs).await;
            }
        )+
    };
}

fn patient() -> LinkConfig {
    LinkConfig { patience: Duration::from_secs(60), ..LinkConfig::default() }
}

fn batches_of(ids: u32) -> LinkConfig {
    LinkConfig { batch: BatchSize::new(ids).unwrap(), ..patient() }
}
