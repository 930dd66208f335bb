//! What an application gets without asking, and how its types become bytes.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod robot;

use robot::{NotFinite, Pose, Robot, Time};
use trimaran_wire::{
    Batch, BatchSize, CodingError, Decoder, Delivery, Fixed, Format, FrameAssembler, FrameWriter, MAX_FIXED,
    Message, Protocol, ProtocolName, to_bytes,
};

#[test]
fn an_application_that_says_no_more_takes_everybody_and_codes_nothing() {
    let (ours, theirs) = ("arm".to_owned(), "leg".to_owned());
    assert_eq!(Robot::admit(&ours, &theirs), Ok(()));
    assert_eq!(Robot::role(&theirs), None);
    assert_eq!(Robot::batching(&ours, &theirs), None);
    for delivery in [Delivery::Ordered, Delivery::Lossy] {
        assert!(Robot::encoder(delivery).is_none());
    }
    assert!(Robot::decoder(1000).is_none());
    assert_eq!(Robot::count_coded(&[1, 2, 3]), None);
    assert_eq!(Robot::name(&ours), "arm");
}

#[test]
fn a_format_has_the_sizes_of_the_types() {
    let format = Format::of::<Robot>();
    assert_eq!((format.latest, format.header, format.item), (12, 8, 4));
    assert_eq!((format.begin(), format.batch(BatchSize::new(100).unwrap())), (12, 400));
    assert_eq!((format.count_coded)(&[1]), None);
    assert_eq!(ProtocolName::new(Robot::NAME).as_str(), Robot::NAME);
}

#[test]
fn a_fixed_value_reads_back_or_says_why_not() {
    let pose = Pose { x: 1.0, y: -2.0, heading: 0.5 };
    let bytes = to_bytes(&pose);
    assert_eq!(bytes.len(), Pose::SIZE);
    assert_eq!(Pose::read(&bytes), Ok(pose));
    let lost = to_bytes(&Pose { x: f32::NAN, y: 0.0, heading: 0.0 });
    assert_eq!(Pose::read(&lost), Err(NotFinite));
    assert_eq!(Time::read(&to_bytes(&Time(1 << 40))), Ok(Time(1 << 40)));
    assert_eq!((to_bytes(&()).len(), <()>::read(&[])), (0, Ok(())));
}

/// As large as values may be: they are on the heap then, and no different.
#[test]
fn a_value_may_have_a_kilobyte() {
    #[derive(Debug, PartialEq)]
    struct Large([u8; MAX_FIXED]);

    impl Fixed for Large {
        const SIZE: usize = MAX_FIXED;
        type Error = NotFinite;

        fn write(&self, out: &mut [u8]) {
            out.copy_from_slice(&self.0);
        }

        fn read(bytes: &[u8]) -> Result<Self, NotFinite> {
            bytes.first_chunk().copied().map(Self).ok_or(NotFinite)
        }
    }

    let large = Large(std::array::from_fn(|at| at as u8));
    assert_eq!(Large::read(&to_bytes(&large)), Ok(large));
}

#[test]
fn an_applications_own_error_is_passed_on() {
    let error = CodingError(Box::new(NotFinite));
    assert_eq!(error.to_string(), "not finite");
    assert!(error.0.downcast_ref::<NotFinite>().is_some());
}

/// Links move them between tasks, whatever the application's types are.
#[test]
fn what_links_hold_can_go_to_another_thread() {
    fn sendable<T: Send + Sync>() {}
    sendable::<Message>();
    sendable::<Decoder>();
    sendable::<FrameAssembler>();
    sendable::<FrameWriter<*const u8>>();
    sendable::<Batch<*const u8>>();
    sendable::<Format>();
    sendable::<CodingError>();
}
