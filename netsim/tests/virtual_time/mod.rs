//! The conformance suite of the transports as tests in virtual time.

/// Makes a test of each case but the one whose receiver is a thread of its own: there are none here. `$machines` gives a
/// simulation and what makes pairs of links on it.
#[macro_export]
macro_rules! conformance_in_virtual_time {
    ($machines:expr => $($case:ident),+ $(,)?) => {
        $(
            #[test]
            fn $case() {
                let (simulation, pairs) = $machines();
                simulation.run($crate::common::conformance::$case(&pairs)).unwrap();
            }
        )+
    };
    ($machines:expr) => {
        $crate::conformance_in_virtual_time!($machines =>
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
            dropping_a_wait_loses_nothing,
            goodbye_comes_after_everything,
            death_within_a_frame_is_no_goodbye,
            death_behind_every_step_of_a_frame_is_a_loss,
            a_dead_receiver_fails_the_sender,
            frames_in_the_wrong_order_are_refused,
            both_directions_at_once,
            every_byte_is_counted,
        );
    };
}
