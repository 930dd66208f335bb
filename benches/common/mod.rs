//! The setup of measurements that walk many displays along one path, with processes of the program.

use std::{
    error::Error,
    net::{SocketAddr, TcpListener},
    path::Path,
    process::{Child, Command, Stdio},
    sync::Arc,
    time::Duration,
};

use trimaran_actors::Link;
use trimaran_cull::{LodRule, Viewport};
use trimaran_proto::{Camera, FrameNumber, Identity, Role, SceneOutline, SessionKey, Settings, Walkthrough};
use trimaran_scene::{
    Scene,
    path::{AutoPathOptions, PosePath, auto},
};
use trimaran_transport::{Endpoint, Net, Options, connect};

pub(crate) type Failed = Box<dyn Error + Send + Sync>;

const SIDE: u32 = 512;
const EPSILON_PX: f64 = 2.0;
pub(crate) const POSES: u32 = 120;

/// All displays come from one address, at once.
const LIMITS: [&str; 3] = ["peers=300", "handshakes_per_s=10000", "handshakes_per_s_per_address=10000"];

/// A role's process, which ends with this.
pub(crate) struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ended = self.0.kill();
        let _code = self.0.wait();
    }
}

/// An automatic path through a scene, to be walked with processes of a program.
pub(crate) struct Walk {
    program: String,
    scene: String,
    /// How long each row takes.
    pub(crate) seconds: u32,
    outline: SceneOutline,
    path: PosePath,
    near: f32,
}

impl Walk {
    /// As the command line of a bench asks for; nothing if it names no scene.
    pub(crate) fn of_args(bench: &str, seconds: u32) -> Result<Option<Self>, Failed> {
        let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
        let [scene, rest @ ..] = words.as_slice() else {
            println!(
                "skipped: give a cooked scene: cargo bench --bench {bench} -- X.scene [SECONDS [PROGRAM]]"
            );
            return Ok(None);
        };
        let opened = Scene::open(Path::new(scene))?;
        let path = auto(&opened, &AutoPathOptions { frames: POSES, seed: 1, teleport: false })?.path;
        Ok(Some(Self {
            program: rest.get(1).map_or(env!("CARGO_BIN_EXE_trimaran"), String::as_str).to_owned(),
            scene: scene.clone(),
            seconds: rest.first().map_or(Ok(seconds), |word| word.parse())?,
            outline: opened.outline(),
            near: path.near().ok_or("the path names no near distance")?,
            path,
        }))
    }

    /// A culler of the scene, and where it listens.
    pub(crate) fn culler(&self) -> Result<(Process, Endpoint), Failed> {
        self.start("culler", &["--scene", &self.scene, "--depth-memory", "4GiB"])
    }

    /// A role in a process of its own, and where it listens.
    pub(crate) fn start(&self, role: &str, args: &[&str]) -> Result<(Process, Endpoint), Failed> {
        let at = format!("tcp://{}", port()?);
        let mut command = Command::new(&self.program);
        command.args(["role", role, "--listen", &at]).args(args);
        for limit in LIMITS {
            command.args(["-o", &format!("limits.{limit}")]);
        }
        let process = Process(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?);
        Ok((process, at.parse()?))
    }

    /// A display's link. Without a key it only watches.
    pub(crate) async fn join(
        &self,
        net: &Arc<dyn Net>,
        at: &Endpoint,
        key: Option<u64>,
    ) -> Result<Link, Failed> {
        let settings = Settings::new(Viewport::new(SIDE, SIDE)?, LodRule::new(EPSILON_PX)?);
        let session = key.map(|key| (SessionKey(key), settings));
        let identity = Identity { role: Role::Display, scene: Some(self.outline), session };
        let by = net.now().after(Duration::from_secs(60));
        Ok(connect::<Walkthrough>(net, at, identity, &Options::default(), by).await?)
    }

    /// The camera at a pose of the path, which begins anew after its end. Its near distance is scaled.
    pub(crate) fn camera(&self, pose: u32, near: f32, frame: u32) -> Result<Camera, Failed> {
        let pose = self.path.frames().get((pose % POSES) as usize).ok_or("a short path")?;
        Ok(pose.camera(self.path.vfov_deg(), self.near * near, FrameNumber(frame))?)
    }
}

/// A free port of this machine.
pub(crate) fn port() -> Result<SocketAddr, Failed> {
    Ok(TcpListener::bind("127.0.0.1:0")?.local_addr()?)
}
