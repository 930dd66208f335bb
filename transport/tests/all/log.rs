//! The log for peers that do not come, and for those that do not fit.

use std::time::Duration;

use bytes::BytesMut;
use tokio::io::AsyncWriteExt;
use tokio::net::TcpStream;
use trimaran_transport::conformance::{ARM, Greeting, PANEL, greeting};
use trimaran_transport::{Lane, Options, SessionId, sleep_until};

use crate::common::page::Page;
use crate::common::{Listener, connect, introduce, last_failure, net, soon};

#[tokio::test(start_paused = true)]
async fn who_connects_says_once_what_stands_in_the_way_and_again_when_that_changes() {
    let (page, _logged) = Page::log();
    let (net, options) = (net(), Options::default());
    let at = "inproc:moving".parse().unwrap();
    let other = Greeting { map: 0xdead, ..greeting(ARM) };
    let (nobody, map) = (["INFO", "trying again", "nobody"], ["WARN", "trying again", "dead"]);
    let changes = async {
        let minute = || sleep_until(&*net, net.now().after(Duration::from_secs(60)));
        minute().await;
        assert_eq!((page.lines(&nobody), page.lines(&map)), (1, 0));
        let stranger = Listener::bind(&net, &at, other, &options).await.unwrap();
        minute().await;
        assert_eq!((page.lines(&nobody), page.lines(&map)), (1, 1));
        drop(stranger);
        minute().await;
        assert_eq!((page.lines(&nobody), page.lines(&map)), (2, 1));
        let mut listener = Listener::bind(&net, &at, greeting(ARM), &options).await.unwrap();
        listener.accept(soon(&net)).await
    };
    let by = net.now().after(Duration::from_secs(3600));
    let (there, here) = tokio::join!(connect(&net, &at, greeting(PANEL), &options, by), changes);
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
}

#[tokio::test]
async fn a_listener_goes_on_waiting_whatever_peers_it_meets_and_does_not_fill_the_log_with_them() {
    let (page, _logged) = Page::log();
    let (net, options) = (net(), Options::default());
    let begun = net.now();
    let mut listener =
        Listener::bind(&net, &"tcp://127.0.0.1:0".parse().unwrap(), greeting(ARM), &options).await.unwrap();
    let at = listener.local_endpoint().clone();
    let address = at.to_string().replace("tcp://", "");
    let other = Greeting { map: 0xdead, ..greeting(PANEL) };
    for session in 0..50 {
        let mut hello = BytesMut::new();
        introduce(&other, SessionId(session), Lane::Frames).encode(&mut hello);
        TcpStream::connect(&address).await.unwrap().write_all(&hello).await.unwrap();
        last_failure(&mut listener).await;
    }
    let most = 1 + net.now().since(begun).as_secs() / 5;
    let lines = page.lines(&["WARN", "turned away", "dead"]) as u64;
    assert!((1..=most).contains(&lines), "{lines} lines, not 1 to {most}");
    let (there, here) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)),);
    assert!(there.is_ok() && here.is_ok(), "{there:?} {here:?}");
}
