//! A listener with several addresses answers from the one that was used: its peer takes answers from no
//! other.

use std::net::SocketAddr;

use trimaran_transport::Endpoint;
use trimaran_transport::conformance::{ARM, PANEL, greeting, points, pose, receive, send_frame};

use crate::common::udp::shared;
use crate::common::{Listener, connect, net, soon};

/// A panel connects to a listener at `at` through `asked`, another of its addresses than the system would
/// answer from; both talk.
async fn asks(at: &str, asked: &str) {
    let (net, options) = (net(), shared(1));
    let Ok(mut listener) =
        Listener::bind(&net, &format!("udp://{at}").parse().unwrap(), greeting(ARM), &options).await
    else {
        println!("skipped: no such address here: {at}");
        return;
    };
    let Endpoint::Udp(bound) = listener.local_endpoint() else { panic!("{:?}", listener.local_endpoint()) };
    let port = bound.at.to_string().parse::<SocketAddr>().unwrap().port();
    let there = format!("udp://{asked}:{port}").parse().unwrap();
    let (panel, machine) = tokio::join!(
        connect(&net, &there, greeting(PANEL), &options, soon(&net)),
        listener.accept(soon(&net)),
    );
    let (mut panel, mut machine) = (panel.unwrap(), machine.unwrap());
    for number in 0..3 {
        panel.latest_tx.publish(pose(number)).unwrap();
        assert_eq!(machine.latest_rx.latest().await.unwrap(), pose(number));
        send_frame(&mut machine.frames_tx, number, &points(5000)).await.unwrap();
        assert_eq!(receive(&mut panel.frames_rx).await.unwrap().points, points(5000));
    }
}

/// All of 127.0.0.0/8 is on the loopback interface, and answers to 127.0.0.1 leave from there unless set
/// otherwise.
#[tokio::test]
async fn a_listener_at_every_address_answers_from_the_one_that_was_asked() {
    for asked in ["127.0.0.1", "127.0.0.2", "127.1.2.3"] {
        asks("0.0.0.0:0", asked).await;
    }
}

#[tokio::test]
async fn a_listener_for_both_families_answers_from_the_address_that_was_asked() {
    for asked in ["127.0.0.2", "[::1]"] {
        asks("[::]:0", asked).await;
    }
}

#[tokio::test]
async fn a_listener_at_one_address_answers_from_there() {
    asks("127.0.0.3:0", "127.0.0.3").await;
}
