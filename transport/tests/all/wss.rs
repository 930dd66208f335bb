//! Links over `wss://`: through a proxy that ends TLS, whose certificate is checked.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tempfile::TempDir;
use tokio::io::copy_bidirectional;
use tokio::net::{TcpListener, TcpStream};
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring::default_provider;
use tokio_rustls::rustls::pki_types::PrivatePkcs8KeyDer;
use trimaran_transport::conformance::{ARM, PANEL, finished, greeting, points, pose, receive, start};
use trimaran_transport::ws::WsOptions;
use trimaran_transport::{ConnectError, Endpoint, ListenError, Options, causes};

use crate::common::{Listener, connect, net, soon};

/// A proxy that ends TLS in front of a listener, with a certificate for `localhost`.
struct Proxy {
    port: u16,
    folder: TempDir,
}

impl Proxy {
    async fn before(at: &Endpoint) -> Self {
        let Endpoint::Ws(at) = at else { panic!("{at}") };
        let to = at.at.to_string();
        let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("ca.pem"), made.cert.pem()).unwrap();
        let key = PrivatePkcs8KeyDer::from(made.signing_key.serialize_der());
        let config = ServerConfig::builder_with_provider(Arc::new(default_provider()))
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![made.cert.into()], key.into())
            .unwrap();
        let acceptor = TlsAcceptor::from(Arc::new(config));
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        let net = net();
        let tasks = Arc::clone(&net);
        net.spawn(Box::pin(async move {
            while let Ok((stream, _)) = listener.accept().await {
                let (acceptor, to) = (acceptor.clone(), to.clone());
                tasks.spawn(Box::pin(async move {
                    if let Ok(mut encrypted) = acceptor.accept(stream).await {
                        let mut plain = TcpStream::connect(to).await.unwrap();
                        let _ended = copy_bidirectional(&mut encrypted, &mut plain).await;
                    }
                }));
            }
        }));
        Self { port, folder }
    }

    fn endpoint(&self, host: &str) -> Endpoint {
        format!("wss://{host}:{}/link?token=7", self.port).parse().unwrap()
    }

    fn ca(&self) -> PathBuf {
        self.folder.path().join("ca.pem")
    }
}

fn trusting(ca: PathBuf) -> Options {
    Options::default().with_ws(WsOptions::default().with_ca(Some(ca)))
}

async fn listener() -> (Listener, Proxy) {
    let at = "ws://127.0.0.1:0/link?token=7".parse().unwrap();
    let listener = Listener::bind(&net(), &at, greeting(ARM), &Options::default()).await.unwrap();
    let proxy = Proxy::before(listener.local_endpoint()).await;
    (listener, proxy)
}

#[tokio::test]
async fn a_link_is_made_through_a_proxy_with_tls() {
    let (mut listener, proxy) = listener().await;
    let (net, options, at) = (net(), trusting(proxy.ca()), proxy.endpoint("localhost"));
    let (panel, arm) =
        tokio::join!(connect(&net, &at, greeting(PANEL), &options, soon(&net)), listener.accept(soon(&net)));
    let (mut panel, mut arm) = (panel.unwrap(), arm.unwrap());
    assert!(panel.capabilities().encrypted && !arm.capabilities().encrypted);
    panel.latest_tx.publish(pose(7)).unwrap();
    assert_eq!(arm.latest_rx.latest().await.unwrap(), pose(7));
    let send = async {
        arm.frames_tx.begin(start(0)).await.unwrap();
        arm.frames_tx.push(&points(50_000)).await.unwrap();
        arm.frames_tx.finish().await.unwrap();
    };
    let ((), frame) = tokio::join!(send, receive(&mut panel.frames_rx));
    assert_eq!(frame.unwrap().points, points(50_000));
    let (left, heard) = tokio::join!(arm.close(finished()), panel.close(finished()));
    left.and(heard).unwrap();
}

#[tokio::test]
async fn a_certificate_of_others_makes_no_link() {
    let (_listener, proxy) = listener().await;
    let (_other, others) = listener().await;
    let net = net();
    for (host, ca, why) in [
        ("localhost", others.ca(), "certificate"),
        // The certificate is for another name.
        ("127.0.0.1", proxy.ca(), "certificate not valid for name"),
    ] {
        let briefly = net.now().after(Duration::from_millis(300));
        let refused = connect(&net, &proxy.endpoint(host), greeting(PANEL), &trusting(ca), briefly).await;
        let Err(refused @ ConnectError::Deadline { .. }) = refused else { panic!("{refused:?}") };
        let told = causes(&refused);
        assert!(told.contains(why), "{told}");
    }
}

#[tokio::test]
async fn authorities_that_cannot_be_read_are_told_at_once() {
    let (_listener, proxy) = listener().await;
    fs::write(proxy.folder.path().join("empty.pem"), "").unwrap();
    fs::write(
        proxy.folder.path().join("bad.pem"),
        "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n",
    )
    .unwrap();
    let net = net();
    for (name, why) in
        [("none.pem", "cannot read"), ("empty.pem", "no certificate"), ("bad.pem", "cannot be used")]
    {
        let options = trusting(proxy.folder.path().join(name));
        let refused =
            connect(&net, &proxy.endpoint("localhost"), greeting(PANEL), &options, soon(&net)).await;
        let Err(refused @ ConnectError::Failed { .. }) = refused else { panic!("{refused:?}") };
        let told = causes(&refused);
        assert!(told.contains(why) && told.contains(name) && told.contains("ws.ca"), "{told}");
    }
}

#[tokio::test]
async fn nobody_listens_over_tls() {
    let at = "wss://127.0.0.1:0/link".parse().unwrap();
    let refused = Listener::bind(&net(), &at, greeting(ARM), &Options::default()).await;
    let refused: ListenError = refused.err().unwrap();
    assert!(!refused.may_pass() && causes(&refused).contains("behind a proxy"), "{}", causes(&refused));
}
