//! Peers that have a link, and break the rules or die.

use std::time::Duration;

use super::{bytes, hello, listener};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use trimaran_transport::conformance::{PANEL, Robot, finished, greeting, points, pose, receive, start};
use trimaran_transport::{
    CloseReason, DecodeFault, Endpoint, FrameEnd, FrameEvent, FrameNumber, FrameOutcome, FrameReceiver,
    FrameStart, FrameViolation, Kind, Lane, LinkConfig, Loss, MAX_MESSAGE, Options, ProtocolError, RecvError,
    SendError, until,
};
use trimaran_wire::{FrameMessage, Message, to_bytes};

use crate::common::{Link, answer, connect, net, soon};

/// The arm's link to a panel of bare sockets, and these: of the frames lane, of the latest lane, of the
/// messages lane and of the bulk lane.
async fn raw_panel() -> (Link, [TcpStream; 4]) {
    raw_panel_of(&Options::default()).await
}

async fn raw_panel_of(options: &Options) -> (Link, [TcpStream; 4]) {
    let net = net();
    let (mut listener, address) = listener(&net, options).await;
    let connection = async |lane| {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(&bytes(&[hello(lane)])).await.unwrap();
        stream
    };
    let mut panel = [
        connection(Lane::Frames).await,
        connection(Lane::Latest).await,
        connection(Lane::Messages).await,
        connection(Lane::Bulk).await,
    ];
    let link = listener.accept(soon(&net)).await.unwrap();
    // Read first, because closing with unread data resets the connection.
    let mut accept = vec![0; bytes(&[answer()]).len()];
    for stream in &mut panel {
        stream.read_exact(&mut accept).await.unwrap();
    }
    (link, panel)
}

fn published(number: u32) -> Message {
    Message::Latest(to_bytes(&pose(number)))
}

fn begin(frame: u32) -> Message {
    let FrameStart { frame, header } = start(frame);
    Message::Frame(FrameMessage::Begin { frame, header: to_bytes(&header) })
}

fn violation(error: RecvError) -> FrameViolation {
    match error {
        RecvError::Protocol { cause: ProtocolError::Frame(violation), .. } => violation,
        other => panic!("{other:?}"),
    }
}

fn fault(error: RecvError) -> DecodeFault {
    match error {
        RecvError::Protocol { cause: ProtocolError::Decode(error), .. } => error.fault,
        other => panic!("{other:?}"),
    }
}

async fn error(rx: &mut FrameReceiver<Robot>) -> RecvError {
    loop {
        if let Err(error) = rx.recv().await {
            return error;
        }
    }
}

#[tokio::test]
async fn a_panel_of_bare_sockets_is_a_panel() {
    let (mut link, [mut frames, mut latest, _messages, _bulk]) = raw_panel().await;
    latest.write_all(&bytes(&[published(1), published(2)])).await.unwrap();
    assert_eq!(link.latest_rx.latest().await.unwrap(), pose(2));
    let begin = bytes(&[begin(0)]);
    for byte in begin {
        frames.write_all(&[byte]).await.unwrap();
        tokio::task::yield_now().await;
    }
    assert_eq!(link.frames_rx.recv().await.unwrap(), FrameEvent::Begin(start(0)));
}

#[tokio::test]
async fn garbage_after_the_handshake_is_an_error() {
    let (mut link, [mut frames, mut latest, mut messages, mut bulk]) = raw_panel().await;
    messages.write_all(&[0x77; 100]).await.unwrap();
    let on_messages = fault(link.messages_rx.recv().await.unwrap_err());
    assert_eq!(on_messages, DecodeFault::UnknownKind { code: 0x77 });
    bulk.write_all(&[0x88; 100]).await.unwrap();
    let on_bulk = fault(link.bulk.as_mut().unwrap().rx.recv().await.unwrap_err());
    assert_eq!(on_bulk, DecodeFault::UnknownKind { code: 0x88 });
    frames.write_all(&[0xee; 100]).await.unwrap();
    latest.write_all(&[0x99; 100]).await.unwrap();
    assert_eq!(fault(error(&mut link.frames_rx).await), DecodeFault::UnknownKind { code: 0xee });
    assert_eq!(fault(link.latest_rx.latest().await.unwrap_err()), DecodeFault::UnknownKind { code: 0x99 });
    assert_eq!(fault(link.latest_rx.try_latest().unwrap_err()), DecodeFault::UnknownKind { code: 0x99 });
}

#[tokio::test]
async fn messages_on_the_wrong_lane_are_errors() {
    let (mut link, [mut frames, mut latest, mut messages, mut bulk]) = raw_panel().await;
    messages.write_all(&bytes(&[begin(0)])).await.unwrap();
    bulk.write_all(&bytes(&[Message::Message(vec![7, 0].into())])).await.unwrap();
    frames.write_all(&bytes(&[published(0)])).await.unwrap();
    latest.write_all(&bytes(&[begin(0)])).await.unwrap();
    let misplaced = |error: RecvError| match error {
        RecvError::Protocol { cause: ProtocolError::Misplaced { kind, lane }, .. } => (kind, lane),
        other => panic!("{other:?}"),
    };
    assert_eq!(misplaced(error(&mut link.frames_rx).await), (Kind::Latest, Lane::Frames));
    assert_eq!(misplaced(link.latest_rx.latest().await.unwrap_err()), (Kind::Begin, Lane::Latest));
    assert_eq!(misplaced(link.messages_rx.recv().await.unwrap_err()), (Kind::Begin, Lane::Messages));
    assert_eq!(
        misplaced(link.bulk.as_mut().unwrap().rx.recv().await.unwrap_err()),
        (Kind::Message, Lane::Bulk)
    );
}

#[tokio::test]
async fn frames_that_break_the_rules_are_errors() {
    let (mut link, [mut frames, _latest, _messages, _bulk]) = raw_panel().await;
    let end = FrameEnd { frame: FrameNumber(0), items: 0, hash: 1 };
    frames.write_all(&bytes(&[begin(0), Message::Frame(FrameMessage::End(end))])).await.unwrap();
    let received = 0x2d06_8005_38d3_94c2;
    let expected = FrameViolation::Hash { frame: FrameNumber(0), announced: 1, received };
    assert_eq!(violation(error(&mut link.frames_rx).await), expected);
}

/// A command cut short, one with something behind it, and one that is too long.
#[tokio::test]
async fn a_message_that_is_none_is_an_error() {
    for message in [&[7][..], &[7, 1, b'x', 0], &[7; MAX_MESSAGE + 1]] {
        let (mut link, [_frames, _latest, mut messages, _bulk]) = raw_panel().await;
        messages.write_all(&bytes(&[Message::Message(message.to_vec().into())])).await.unwrap();
        let error = link.messages_rx.recv().await.unwrap_err();
        match error {
            RecvError::Protocol { cause: ProtocolError::Message(_), .. } if message.len() < 5 => {}
            RecvError::Protocol { cause: ProtocolError::Decode(_), .. } if message.len() > 5 => {}
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test]
async fn a_frame_with_missing_points_says_how_many() {
    let (mut link, [mut frames, _latest, _messages, _bulk]) = raw_panel().await;
    let end = FrameEnd { frame: FrameNumber(0), items: 9, hash: 1 };
    frames.write_all(&bytes(&[begin(0), Message::Frame(FrameMessage::End(end))])).await.unwrap();
    link.frames_rx.recv().await.unwrap();
    let expected = FrameOutcome::Incomplete { frame: FrameNumber(0), expected: 9, received: 0 };
    assert_eq!(link.frames_rx.recv().await.unwrap(), FrameEvent::End(expected));
}

#[tokio::test]
async fn death_within_a_message_says_where() {
    let (mut link, [mut frames, _latest, _messages, _bulk]) = raw_panel().await;
    frames.write_all(&bytes(&[begin(0)])[..40]).await.unwrap();
    drop(frames);
    let error = error(&mut link.frames_rx).await;
    let RecvError::Lost { cause: Loss::Cut { bytes: 40 }, .. } = error else { panic!("{error:?}") };
}

#[tokio::test]
async fn a_reset_is_a_loss() {
    let (mut link, [frames, _latest, _messages, _bulk]) = raw_panel().await;
    // As for a killed process with unread data.
    frames.set_zero_linger().unwrap();
    drop(frames);
    let error = error(&mut link.frames_rx).await;
    assert!(matches!(error, RecvError::Lost { cause: Loss::Io(_), .. }), "{error:?}");
}

#[tokio::test]
async fn close_survives_unread_data() {
    let net = net();
    let (mut listener, address) = listener(&net, &Options::default()).await;
    let (address, options) = (Endpoint::Tcp(address.into()), Options::default());
    let (there, here) = tokio::join!(
        connect(&net, &address, greeting(PANEL), &options, soon(&net)),
        listener.accept(soon(&net)),
    );
    let (there, mut here) = (there.unwrap(), here.unwrap());
    here.frames_tx.begin(start(0)).await.unwrap();
    here.frames_tx.push(&points(1000)).await.unwrap();
    here.latest_tx.publish(pose(0)).unwrap();
    there.close(CloseReason::new(1, "interrupted")).await.unwrap();
    // The peer sent the same on both lanes.
    let said = here.latest_rx.latest().await.unwrap_err();
    assert!(matches!(said, RecvError::Closed { .. }), "{said:?}");
    let error = receive(&mut here.frames_rx).await.unwrap_err();
    let reason = CloseReason::new(1, "interrupted");
    assert!(matches!(&error, RecvError::Closed { reason: said, .. } if *said == reason), "{error:?}");
}

#[tokio::test]
async fn a_panel_that_went_without_a_word_and_reads_nothing_has_not_heard_a_close() {
    let timeout = Duration::from_secs(1);
    let link = LinkConfig::default().with_timeout(timeout);
    let (mut link, [mut frames, mut latest, _messages, _bulk]) =
        raw_panel_of(&Options::default().with_link(link)).await;
    let (net, points) = (net(), points(16_384));
    link.frames_tx.begin(start(0)).await.unwrap();
    // Until the system takes no more: the close is behind it.
    let moment = || net.now().after(Duration::from_millis(100));
    while until(&*net, moment(), link.frames_tx.push(&points)).await.is_some() {}
    frames.shutdown().await.unwrap();
    latest.shutdown().await.unwrap();
    let said = link.close(finished()).await;
    assert!(matches!(said, Err(SendError::Stalled { .. })), "{said:?}");
}
