//! Puts the page that a browser shows into the program: the files of `roles/page`, whose script and style are
//! bundled by `./x page`, each also compressed.

use std::{
    env,
    fmt::Write as _,
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    io,
    path::PathBuf,
};

/// The files: their place, how a browser asks for them, and what they are.
const FILES: [(&str, &str, &str); 3] = [
    ("static/index.html", "/", "text/html; charset=utf-8"),
    ("target/page/main.css", "/main.css", "text/css; charset=utf-8"),
    ("target/page/main.js", "/main.js", "text/javascript; charset=utf-8"),
];

/// Content codings, and the endings of files in them, the smallest first.
const CODINGS: [(&str, &str); 2] = [("br", "br"), ("gzip", "gz")];

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
        let mut hasher = DefaultHasher::new();
        fs::read(&file)?.hash(&mut hasher);
        // All codings have the same content: the tag is a weak one.
        let tag = format!("W/\"{:016x}\"", hasher.finish());
        let mut coded = String::new();
        for (coding, ending) in CODINGS {
            let packed = page.join(format!("{place}.{ending}"));
            if packed.exists() {
                println!("cargo::rerun-if-changed={}", packed.display());
                let packed = packed.display().to_string();
                let _infallible = write!(coded, "({coding:?}, include_bytes!({packed:?})), ");
            }
        }
        let _infallible = write!(
            files,
            "Asset {{ path: {path:?}, kind: {kind:?}, tag: {tag:?}, bytes: include_bytes!({:?}), \
             coded: &[{coded}] }}, ",
            file.display().to_string()
        );
    }
    files += "]";
    fs::write(variable("OUT_DIR")?.join("assets.rs"), files)
}
