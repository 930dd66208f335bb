//! Opens a secret address in a browser. Other users see a browser's arguments, so it is given a private file
//! that redirects to the address.

use std::{
    io::{self, Write as _},
    path::{Path, PathBuf},
};

use etcetera::home_dir;
use tempfile::{Builder, NamedTempFile, TempDir};

use trimaran::scene_cache::private_folder;

/// The file that was opened; dropped, it is removed with its folder.
#[derive(Debug)]
pub(super) struct Redirect {
    file: NamedTempFile,
    _folder: TempDir,
}

/// Opens `url`.
///
/// # Errors
/// When there is no browser, or no place for the file.
pub(super) fn open(url: &str) -> io::Result<Redirect> {
    let redirect = Redirect::new(&folder()?, url)?;
    webbrowser::open(&format!("file://{}", redirect.file.path().display()))?;
    Ok(redirect)
}

/// The user's cache. A browser that is a snap sees no hidden folder of the home: there the home itself.
fn folder() -> io::Result<PathBuf> {
    match home_dir() {
        Ok(home) if Path::new("/snap/bin").exists() => Ok(home),
        _ => private_folder(),
    }
}

impl Redirect {
    fn new(within: &Path, url: &str) -> io::Result<Self> {
        let mut folder = Builder::new();
        folder.prefix("trimaran-open-");
        #[cfg(unix)]
        folder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        let folder = folder.tempdir_in(within)?;
        // Such a file has mode 600.
        let mut file = Builder::new().prefix("model-").suffix(".html").tempfile_in(folder.path())?;
        file.write_all(page(url).as_bytes())?;
        Ok(Self { file, _folder: folder })
    }
}

/// A page that redirects to another one, and leaves no entry in the browser's history.
fn page(url: &str) -> String {
    let text = url.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
    format!(
        "<!DOCTYPE html>\n<meta charset=\"utf-8\">\n<meta name=\"referrer\" content=\"no-referrer\">\n\
         <title>Trimaran</title>\n<a id=\"to\" href=\"{text}\">Open the model</a>\n\
         <script>location.replace(document.getElementById(\"to\").href)</script>\n"
    )
}
