//! Puts the page that a browser shows into the program: the files of `roles/page`, whose script and style are
//! bundled by `./x page`.

use std::{env, fmt::Write as _, fs, io, path::PathBuf};

/// The files: their place, how a browser asks for them, and what they are.
const FILES: [(&str, &str, &str); 3] = [
    ("static/index.html", "/", "text/html; charset=utf-8"),
    ("target/page/main.css", "/main.css", "text/css; charset=utf-8"),
    ("target/page/main.js", "/main.js", "text/javascript; charset=utf-8"),
];

fn main() -> io::Result<()> {
    let variable = |name| env::var_os(name).map(PathBuf::from).ok_or(io::ErrorKind::NotFound);
    let page = variable("CARGO_MANIFEST_DIR")?.join("roles/page");
    let mut files = String::from("&[");
    for (place, path, kind) in FILES {
        let file = page.join(place);
        println!("cargo::rerun-if-changed={}", file.display());
        if !file.exists() {
            // Without its script the page is none.
            files = String::from("&[");
            break;
        }
        let _infallible = write!(
            files,
            "Asset {{ path: {path:?}, kind: {kind:?}, bytes: include_bytes!({:?}) }}, ",
            file.display().to_string()
        );
    }
    files += "]";
    fs::write(variable("OUT_DIR")?.join("assets.rs"), files)
}
