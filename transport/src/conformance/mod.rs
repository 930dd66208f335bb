//! The requirements on every transport: a suite of tests for authors of new ones.
//!
//! A transport joins by making pairs of links of the protocol [`Robot`]. If an endpoint leads to it,
//! [`Joined`] does that, and one line makes all the tests:
//!
//! ```
//! mod tests {
//!     use trimaran_transport::Options;
//!     use trimaran_transport::conformance::{Joined, Overhead};
//!
//!     // Messages have a header of 4 bytes, and a handshake takes 4 messages in each direction.
//!     const OVERHEAD: Overhead = Overhead { header_bytes: 4, handshake: 4, coded: true };
//!
//!     trimaran_transport::conformance!(Joined::at("tcp://127.0.0.1:0", Options::default(), OVERHEAD));
//! }
//! ```
//!
//! Anything else implements [`Pairs`]:
//!
//! ```
//! use std::sync::Arc;
//! use std::time::Duration;
//! use trimaran_transport::conformance::{Overhead, Pairs, block_on, meet};
//! use trimaran_transport::{ConnectError, Link, LinkConfig, Options, Protocol, conformance};
//!
//! struct InProcess;
//!
//! impl Pairs for InProcess {
//!     fn overhead(&self) -> Overhead {
//!         Overhead { header_bytes: 0, handshake: 0, coded: false }
//!     }
//!
//!     async fn join<P: Protocol, Q: Protocol>(
//!         &self,
//!         hellos: (P::Hello, Q::Hello),
//!         link: LinkConfig,
//!         within: Duration,
//!     ) -> Result<(Link<P>, Link<Q>), ConnectError> {
//!         let (net, options) = (self.net(), Options::default().with_link(link));
//!         let at = "inproc:conformance".parse().unwrap();
//!         meet([&net, &net], &at, [&options, &options], hellos, within, Clone::clone).await
//!     }
//! }
//!
//! // One case by itself, in a runtime of its own; `conformance!(InProcess)` makes a test of each.
//! block_on(conformance::a_value_is_read_once(&InProcess));
//! ```
//!
//! A case that fails panics with its finding. To run tests in another way, such as in virtual time, give
//! [`conformance_cases!`](crate::conformance_cases) a macro of your own.
//!
//! | module | contents |
//! |---|---|
//! | `frames`, `latest`, `records`, `waiting`, `endings`, `publishing`, `channels` | the cases |
//! | `robot`, `coding` | their protocol |
//! | `rover` | one with channels |
//! | `record_lanes` | messages and blocks, for cases of both |
//! | `talk`, `pairs` | the messages of its peers, and pairs of links |

#![allow(clippy::unwrap_used, clippy::panic, reason = "a check that fails panics: that is how a test fails")]

mod blobs;
mod channels;
mod coding;
mod endings;
mod frames;
mod latest;
mod pairs;
mod publishing;
mod record_lanes;
mod records;
mod robot;
mod rover;
mod talk;
mod waiting;

pub use blobs::*;
pub use channels::*;
pub use endings::*;
pub use frames::*;
pub use latest::*;
pub use pairs::{Joined, Overhead, Pairs, meet};
pub use publishing::*;
pub use records::*;
pub use robot::{Command, Greeting, Pose, PoseError, RejectionCode, Robot};
pub use rover::{Distance, OtherRover, Rover, Ticks};
pub use talk::{
    ARM, GRIPPER, MAP, PANEL, Received, block, command, finished, greeting, points, pose, receive,
    send_frame, start,
};
pub use waiting::*;

/// Runs a case in a runtime of two threads.
pub fn block_on(case: impl Future<Output = ()>) {
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    runtime.worker_threads(2).enable_all().build().unwrap().block_on(case);
}

/// Makes a test of each case for the [`Pairs`] that the expression returns.
#[macro_export]
macro_rules! conformance {
    (@each $pairs:expr; tasks: $($task:ident),+; threads: $($thread:ident),+;) => {
        $crate::conformance!(@tests $pairs; $($task),+, $($thread),+);
    };
    (@tests $pairs:expr; $($case:ident),+) => {
        $(
            #[test]
            fn $case() {
                $crate::conformance::block_on(async { $crate::conformance::$case(&$pairs).await });
            }
        )+
    };
    ($pairs:expr) => {
        $crate::conformance_cases!($crate::conformance!(@each $pairs;));
    };
}

/// Passes all cases to a macro, behind its own arguments: first those that need only tasks, then those with
/// threads.
///
/// ```
/// macro_rules! names {
///     (of $what:literal; tasks: $($task:ident),+; threads: $($thread:ident),+;) => {
///         [$(stringify!($task)),+, $(stringify!($thread)),+]
///     };
/// }
/// let names = trimaran_transport::conformance_cases!(names!(of "anything";));
/// assert!(names.contains(&"a_value_is_read_once"));
/// ```
#[macro_export]
macro_rules! conformance_cases {
    ($($make:tt)::+ ! ($($given:tt)*)) => {
        $($make)::+ ! { $($given)*
            tasks:
                frames_of_every_size_arrive_in_order,
                a_whole_frame_is_sent_by_one_call,
                batches_are_full_but_the_last,
                flush_sends_a_part_of_a_batch,
                the_newest_value_wins,
                publishing_never_waits,
                a_value_is_read_once,
                messages_arrive_in_order_beside_a_frame_that_nobody_reads,
                a_sender_of_messages_waits_for_its_receiver,
                a_sender_of_messages_waits_no_longer_than_its_timeout,
                messages_arrive_before_the_close,
                messages_arrive_before_a_link_is_dropped,
                a_dead_receiver_of_messages_fails_the_sender,
                a_message_that_is_too_long_is_refused,
                a_peer_without_a_message_fails_nobody,
                dropping_a_wait_for_messages_loses_none,
                links_close_in_the_middle_of_messages,
                blocks_arrive_in_order_beside_a_frame_that_nobody_reads,
                a_sender_of_blocks_waits_for_its_receiver,
                a_sender_of_blocks_waits_no_longer_than_its_timeout,
                blocks_arrive_before_the_close,
                blocks_arrive_before_a_link_is_dropped,
                a_dead_receiver_of_blocks_fails_the_sender,
                a_block_that_is_too_long_is_refused,
                a_peer_without_a_block_fails_nobody,
                dropping_a_wait_for_blocks_loses_none,
                links_close_in_the_middle_of_blocks,
                blobs_of_any_length_arrive,
                a_blob_can_be_cancelled_and_refused,
                a_slow_receiver_holds_the_sender_back,
                a_receiver_that_catches_up_gets_everything,
                a_reader_of_the_newest_frames_holds_nobody_up,
                a_slow_subscriber_holds_up_no_other,
                who_subscribes_late_gets_the_last_frame,
                published_frames_are_coded_for_whoever_can_read_them,
                a_dead_subscriber_leaves,
                links_send_shared_frames_between_their_own,
                a_quiet_peer_is_no_dead_peer,
                a_deadline_leaves_the_link_usable,
                polling_takes_what_is_there,
                dropping_a_wait_loses_nothing,
                close_comes_after_everything,
                what_was_sent_before_a_link_is_dropped_arrives,
                death_within_a_frame_is_no_close,
                death_behind_every_step_of_a_frame_is_a_loss,
                a_dead_receiver_fails_the_sender,
                a_link_whose_peer_is_gone_can_still_be_used,
                frames_in_the_wrong_order_are_refused,
                both_directions_at_once,
                every_byte_is_counted,
                frames_alike_cost_little_when_coded,
                channels_of_each_kind_carry_their_own_types,
                a_channel_is_coded_as_its_declaration_says,
                a_channel_that_nobody_reads_holds_up_no_other,
                an_open_frame_holds_up_no_other_channel,
                a_channel_is_published_and_its_newest_frames_are_kept,
                channels_close_with_their_link_or_by_themselves,
                a_dead_peer_is_lost_on_every_channel,
                channels_that_differ_are_refused_by_name,
                a_channel_of_another_name_or_type_is_an_error;
            threads:
                a_busy_receiver_is_no_dead_peer,
                polling_without_a_pause_sees_everything;
        }
    };
}
