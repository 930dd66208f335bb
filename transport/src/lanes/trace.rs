//! A debug-level span for each frame sent or received: its time, items and bytes.

use tracing::field::Empty;
use tracing::{Span, debug, debug_span};
use trimaran_wire::FrameNumber;

use super::shared::Shared;
use crate::stats::Direction;

/// The span of the open frame. If nobody listens it is disabled, and costs a check of a flag.
#[derive(Debug)]
pub(crate) struct FrameSpan {
    span: Span,
    /// The bytes of frames before it.
    before: u64,
}

/// The direction of a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Way {
    Sent,
    Received,
}

impl Way {
    fn counts(self, shared: &Shared) -> &Direction {
        match self {
            Self::Sent => &shared.counters.sent,
            Self::Received => &shared.counters.received,
        }
    }
}

impl FrameSpan {
    pub(crate) fn none() -> Self {
        Self { span: Span::none(), before: 0 }
    }

    /// The span of a frame that begins now, with a beginning of `begin` bytes.
    pub(crate) fn open(way: Way, frame: FrameNumber, begin: usize, shared: &Shared) -> Self {
        let direction = match way {
            Way::Sent => "sent",
            Way::Received => "received",
        };
        let span = debug_span!("frame", number = frame.0, peer = %shared.peer, direction, items = Empty, bytes = Empty);
        if span.is_disabled() {
            return Self::none();
        }
        let counted = way.counts(shared).frame_bytes();
        // A beginning that has arrived was already counted.
        let before = match way {
            Way::Sent => counted,
            Way::Received => counted.saturating_sub(begin as u64),
        };
        Self { span, before }
    }

    /// The frame has ended, with so many items, perhaps incomplete.
    pub(crate) fn close(&mut self, way: Way, items: u32, whole: bool, shared: &Shared) {
        let Self { span, before } = std::mem::replace(self, Self::none());
        if span.is_disabled() {
            return;
        }
        span.record("items", items);
        span.record("bytes", way.counts(shared).frame_bytes().saturating_sub(before));
        if whole {
            debug!(parent: &span, "whole");
        } else {
            debug!(parent: &span, "with gaps");
        }
    }
}

#[cfg(test)]
#[cfg(feature = "inproc")]
mod tests {
    use parking_lot::Mutex;
    use std::io::{self, Write};
    use std::sync::Arc;

    use tracing_subscriber::filter::LevelFilter;
    use trimaran_wire::Fixed;

    use crate::conformance::{ARM, PANEL, Pose, Robot, greeting, receive, send_frame};
    use crate::{LinkConfig, Net, TokioNet, inproc};

    #[derive(Clone, Default)]
    struct Page(Arc<Mutex<Vec<u8>>>);

    impl Write for Page {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// The log of one frame of three items over a link.
    fn logged(level: LevelFilter) -> String {
        let page = Page::default();
        let writer = page.clone();
        let subscriber = tracing_subscriber::fmt()
            .with_max_level(level)
            .with_ansi(false)
            .with_writer(move || writer.clone())
            .finish();
        tracing::subscriber::with_default(subscriber, || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
            runtime.block_on(one_frame());
        });
        String::from_utf8(page.0.lock().clone()).unwrap()
    }

    async fn one_frame() {
        let net: Arc<dyn Net> = Arc::new(TokioNet::current().unwrap());
        let (near, far) = (greeting(ARM), greeting(PANEL));
        let (mut arm, mut panel) = inproc::pair::<Robot>(&net, near, far, &LinkConfig::default()).unwrap();
        send_frame(&mut arm.frames_tx, 7, &[1, 2, 3]).await.unwrap();
        receive(&mut panel.frames_rx).await.unwrap();
    }

    #[test]
    fn a_frame_has_a_span_at_each_end_with_what_it_took() {
        let page = logged(LevelFilter::DEBUG);
        // Begin, three items, end.
        let bytes = 4 + Pose::SIZE + 12 + 16;
        for (peer, direction) in [(PANEL, "sent"), (ARM, "received")] {
            let span =
                format!("frame{{number=7 peer={peer} direction=\"{direction}\" items=3 bytes={bytes}}}");
            let lines: Vec<_> = page.lines().filter(|line| line.contains(&span)).collect();
            assert!(lines.len() == 1 && lines[0].ends_with("whole"), "{span} is not once in: {page}");
        }
    }

    #[test]
    fn nothing_is_said_of_frames_above_that_level() {
        assert_eq!(logged(LevelFilter::INFO), "");
    }
}
