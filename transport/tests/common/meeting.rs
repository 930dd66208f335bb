//! A listener over any transport between processes, and a panel that it knows.

use crate::common::{Listener, net};
use trimaran_transport::conformance::{ARM, greeting};
use trimaran_transport::keys::{Keys, Security};
use trimaran_transport::{Endpoint, Options};

/// Makes a test of each case for each transport.
#[macro_export]
macro_rules! over_every_transport {
    ($($case:ident),+ $(,)?) => {
        $crate::over_every_transport!(@ tcp "tcp://127.0.0.1:0" $($case)+);
        $crate::over_every_transport!(@ unix "unix:" $($case)+);
        $crate::over_every_transport!(@ ws "ws://127.0.0.1:0/robot" $($case)+);
        $crate::over_every_transport!(@ quic "quic://127.0.0.1:0" $($case)+);
        $crate::over_every_transport!(@ udp "udp://127.0.0.1:0" $($case)+);
    };
    (@ $transport:ident $endpoint:literal $($case:ident)+) => {
        mod $transport {
            $(
                #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
                async fn $case() {
                    super::$case($endpoint).await;
                }
            )+
        }
    };
}

/// A listener, its endpoint, and the options of a panel.
pub(crate) struct Meeting {
    pub(crate) listener: Listener,
    pub(crate) at: Endpoint,
    /// The options of a panel that the listener knows.
    pub(crate) panel: Options,
    /// Those of the listener.
    #[allow(dead_code, reason = "not every test program listens again")]
    pub(crate) ours: Options,
    pub(crate) _folder: tempfile::TempDir,
}

impl Meeting {
    /// A meeting at `endpoint`, with these options except for the keys.
    pub(crate) async fn at(endpoint: &str, options: &Options) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let endpoint = match endpoint {
            "unix:" => format!("unix:{}", folder.path().join("socket").display()),
            other => other.to_owned(),
        };
        let keys = |name: &str| Keys::generate(name.parse().unwrap()).unwrap();
        let (a, b) = (keys("a"), keys("b"));
        let with = |keys: &Keys, peer: &Keys| {
            let security = Security { keys: keys.clone(), peers: vec![peer.public().clone().into()].into() };
            options.clone().with_security(Some(security))
        };
        let (ours, panel) = (with(&a, &b), with(&b, &a));
        let endpoint = endpoint.parse().unwrap();
        let listener = Listener::bind(&net(), &endpoint, greeting(ARM), &ours).await.unwrap();
        let at = listener.local_endpoint().clone();
        Self { listener, at, panel, ours, _folder: folder }
    }
}
