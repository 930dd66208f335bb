//! The configuration of a role in a deployment: what a TOML file says, checked.

use std::{
    fs,
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};
use thiserror::Error;
use trimaran_transport::Endpoint;

/// Which machine of the pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PairSeat {
    /// Culls even frames and listens for the second.
    First,
    /// Culls odd frames and connects to the first.
    Second,
}

/// `trimaran role switch --config`: one machine of the pair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SwitchConfig {
    /// The cooked scene; all three roles hold the same one. Relative to the configuration file's folder.
    pub scene: PathBuf,
    /// Which of the two machines this is.
    pub seat: PairSeat,
    /// Where the display listens, such as `tcp://show:7400`.
    pub display: Endpoint,
    /// Where the machines of the pair meet: the first listens there, the second connects to it. It need not be the transport
    /// that leads to the display.
    pub pair: Endpoint,
    /// The Vulkan device, by a part of its name; the best there is if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How long to wait for the other roles at the start, seconds.
    #[serde(default = "default_patience")]
    pub patience_s: f64,
}

/// `trimaran role display --config`: the machine that shows the pictures, holds the camera and dictates the session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DisplayConfig {
    /// The cooked scene. Relative to the configuration file's folder.
    pub scene: PathBuf,
    /// Where to listen, such as `tcp://0.0.0.0:7400` or `unix:/run/trimaran/display.sock`.
    pub listen: Endpoint,
    /// The Vulkan device, by a part of its name; the best there is if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// How long to wait for the other roles at the start, seconds.
    #[serde(default = "default_patience")]
    pub patience_s: f64,
    /// What is walked and how.
    #[serde(default)]
    pub session: SessionConfig,
    /// Where report and frames go. Relative to the configuration file's folder.
    pub out: PathBuf,
}

/// What is walked and how.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SessionConfig {
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// The largest error on the screen, pixels.
    pub epsilon_px: f64,
    /// How many ids travel in one batch, 1 to 16384.
    pub batch: u16,
    /// What tests boxes: `query`, `raster` or `hzb`.
    pub tester: String,
    /// Walk by the clock, so many poses of the path a second; without it every pose is a frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub live_hz: Option<f64>,
    /// Whether culling stops at what shows at fewer pixels than epsilon (paper, section 4.5.2); not with the tester `hzb`.
    pub few_pixels: bool,
    /// How many frames; as many as the path has if not given, 200 for an automatic one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// `auto`, a path file or a report.json.
    pub path: String,
    /// The seed of an automatic path.
    pub seed: u64,
    /// Every how many frames the report checks one against the truth; 0 checks none.
    pub audit_every: u32,
    /// Whether the report names the objects exactly visible at full detail.
    pub visible: bool,
}

impl Default for SessionConfig {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            epsilon_px: 2.0,
            batch: 1024,
            tester: "hzb".to_owned(),
            live_hz: None,
            few_pixels: false,
            frames: None,
            path: "auto".to_owned(),
            seed: 1,
            audit_every: 10,
            visible: false,
        }
    }
}

/// Why a configuration could not be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}: {cause}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        #[source]
        cause: std::io::Error,
    },
    /// The file is not what it should be; the cause names line, column and key.
    #[error("the configuration {path} is not valid: {cause}", path = path.display())]
    Parse {
        /// The file.
        path: PathBuf,
        /// What is wrong and where.
        #[source]
        cause: Box<toml::de::Error>,
    },
    /// A value is outside its range.
    #[error("the configuration {path} has a bad {key}: {why}", path = path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// What it should be.
        why: &'static str,
    },
}

impl SwitchConfig {
    /// Reads and checks a configuration file.
    ///
    /// # Errors
    /// Names the file and what in it is wrong.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let config: Self = read(path)?;
        check_patience(path, config.patience_s)?;
        Ok(Self { scene: beside(path, &config.scene), ..config })
    }
}

impl DisplayConfig {
    /// Reads and checks a configuration file.
    ///
    /// # Errors
    /// Names the file and what in it is wrong.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let config: Self = read(path)?;
        check_patience(path, config.patience_s)?;
        let session = &config.session;
        let value = |key, why| ConfigError::Value { path: path.to_owned(), key, why };
        if session.width == 0 || session.height == 0 {
            return Err(value("session.width or session.height", "a picture has at least one pixel a side"));
        }
        if !(session.epsilon_px.is_finite() && session.epsilon_px > 0.0) {
            return Err(value("session.epsilon_px", "give a number of pixels above 0"));
        }
        if !(1..=16384).contains(&session.batch) {
            return Err(value("session.batch", "give 1 to 16384"));
        }
        if !session.live_hz.is_none_or(|hz| hz.is_finite() && hz > 0.0) {
            return Err(value("session.live_hz", "give poses a second above 0, or leave it out"));
        }
        if session.few_pixels && session.tester == "hzb" {
            return Err(value("session.few_pixels", "it needs the tester query or raster"));
        }
        if session.frames == Some(0) {
            return Err(value("session.frames", "give at least 1, or leave it out"));
        }
        Ok(Self { scene: beside(path, &config.scene), out: beside(path, &config.out), ..config })
    }
}

fn read<T: for<'de> Deserialize<'de>>(path: &Path) -> Result<T, ConfigError> {
    let text =
        fs::read_to_string(path).map_err(|cause| ConfigError::Read { path: path.to_owned(), cause })?;
    toml::from_str(&text)
        .map_err(|cause| ConfigError::Parse { path: path.to_owned(), cause: Box::new(cause) })
}

fn check_patience(path: &Path, seconds: f64) -> Result<(), ConfigError> {
    if (0.0..=86_400.0).contains(&seconds) {
        return Ok(());
    }
    Err(ConfigError::Value { path: path.to_owned(), key: "patience_s", why: "give 0 to 86400 seconds" })
}

/// A path of the configuration as seen from the working directory: relative ones start at the file's folder.
fn beside(config: &Path, path: &Path) -> PathBuf {
    config.parent().unwrap_or(Path::new("")).join(path)
}

const fn default_patience() -> f64 {
    30.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(text: &str) -> (tempfile::TempDir, PathBuf) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("role.toml");
        fs::write(&path, text).unwrap();
        (dir, path)
    }

    #[test]
    fn a_short_configuration_is_filled_with_defaults_and_paths_start_beside_it() {
        let (dir, path) = written("scene = 'a.scene'\nlisten = 'tcp://[::]:7400'\nout = '/tmp/x'\n");
        let config = DisplayConfig::read(&path).unwrap();
        assert_eq!(config.session, SessionConfig::default());
        assert_eq!(config.scene, dir.path().join("a.scene"));
        assert_eq!(config.out, Path::new("/tmp/x"));
    }

    #[test]
    fn a_switch_configuration_survives_a_round_trip() {
        let config = SwitchConfig {
            scene: "/s/a.scene".into(),
            seat: PairSeat::Second,
            display: "tcp://show:7400".parse().unwrap(),
            pair: "tcp://one:7401".parse().unwrap(),
            device: None,
            patience_s: 5.0,
        };
        let (_dir, path) = written(&toml::to_string(&config).unwrap());
        assert_eq!(SwitchConfig::read(&path).unwrap(), config);
    }

    #[test]
    fn a_misspelt_key_is_named_with_its_line() {
        let (_dir, path) = written("scene = 'a'\nlisten = 'tcp://x:1'\nout = 'o'\n[session]\nepsilon = 2\n");
        let message = DisplayConfig::read(&path).unwrap_err().to_string();
        assert!(message.contains("epsilon") && message.contains("line 5"), "{message}");
    }

    #[test]
    fn an_address_without_a_transport_is_refused_with_what_is_expected() {
        let (_dir, path) = written("scene = 'a'\nlisten = 'show:7400'\nout = 'o'\n");
        let message = DisplayConfig::read(&path).unwrap_err().to_string();
        assert!(message.contains("line 2") && message.contains("tcp://host:port"), "{message}");
    }

    #[test]
    fn values_outside_their_range_are_refused_by_key() {
        for (key, line) in [
            ("session.batch", "batch = 0"),
            ("session.batch", "batch = 16385"),
            ("session.epsilon_px", "epsilon_px = nan"),
            ("session.width", "width = 0"),
            ("session.frames", "frames = 0"),
            ("session.live_hz", "live_hz = 0"),
            ("session.few_pixels", "few_pixels = true"),
        ] {
            let (_dir, path) =
                written(&format!("scene = 'a'\nlisten = 'tcp://x:1'\nout = 'o'\n[session]\n{line}\n"));
            let message = DisplayConfig::read(&path).unwrap_err().to_string();
            assert!(message.contains(key), "{line}: {message}");
        }
    }
}
