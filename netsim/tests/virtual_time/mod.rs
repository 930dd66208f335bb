//! The conformance suite of the transports as tests in virtual time.

/// Makes a test of each case but those in which threads take part: there are none here. `$machines` gives a
/// simulation and what makes pairs of links on it.
#[macro_export]
macro_rules! conformance_in_virtual_time {
    ($machines:expr) => { $crate::conformance_cases!(conformance_in_virtual_time, $machines); };
    ($machines:expr; tasks: $($case:ident),+; threads: $($thread:ident),+;) => {
        $(
            #[test]
            fn $case() {
                let (simulation, pairs) = $machines();
                simulation.run($crate::common::conformance::$case(&pairs)).unwrap();
            }
        )+
    };
}
