//! Puts the page that a browser shows into the program: the files of `roles/page`, whose script and style are
//! bundled by `./x page`, each also compressed.

use std::{
    env,
    fmt::Write as _,
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    io,
    path::Path,
};

/// The bundle's files that the page begins with. Without them the program has no page.
const FIRST: [&str; 2] = ["main.css", "main.js"];

/// The endings of the bundle's files, and what they are. The others, as source maps, are left out.
const KINDS: [(&str, &str); 2] = [(".css", "text/css"), (".js", "text/javascript")];

/// Content codings, and the endings of files in them, the smallest first.
const CODINGS: [(&str, &str); 2] = [("br", "br"), ("gzip", "gz")];

fn main() -> io::Result<()> {
    let variable = |name| env::var(name).map_err(io::Error::other);
    let root = variable("CARGO_MANIFEST_DIR")?;
    let bundle = Path::new(&root).join("roles/page/target/page");
    let mut assets = String::from("&[");
    // A file that is named and not there would have this run at each build.
    let is_there = FIRST.iter().all(|name| bundle.join(name).exists());
    let watched = if is_there { &*bundle } else { Path::new("roles/page") };
    println!("cargo::rerun-if-changed={}", watched.display());
    if is_there {
        assets += &asset(&root, "/roles/page/static/index.html", "/", "text/html")?;
        for name in names(&bundle)? {
            if let Some((_, kind)) = KINDS.iter().find(|(ending, _)| name.ends_with(ending)) {
                let place = format!("/roles/page/target/page/{name}");
                assets += &asset(&root, &place, &format!("/{name}"), kind)?;
            }
        }
    }
    assets += "]";
    fs::write(Path::new(&variable("OUT_DIR")?).join("assets.rs"), assets)
}

/// The names of a folder's files, in order.
fn names(folder: &Path) -> io::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder)? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// The code of an `Asset`: a file, named from the folder of the package, the path by which a browser asks for
/// it, and its type. The code is the same in any folder, and so is the program's debug information.
fn asset(root: &str, place: &str, path: &str, kind: &str) -> io::Result<String> {
    let file = format!("{root}{place}");
    println!("cargo::rerun-if-changed={file}");
    let mut hasher = DefaultHasher::new();
    fs::read(file)?.hash(&mut hasher);
    // All codings have the same content: the tag is a weak one.
    let tag = format!("W/\"{:016x}\"", hasher.finish());
    let bytes = |place: &str| format!("include_bytes!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {place:?}))");
    let mut coded = String::new();
    for (coding, ending) in CODINGS {
        let packed = format!("{place}.{ending}");
        if Path::new(&format!("{root}{packed}")).exists() {
            let _infallible = write!(coded, "({coding:?}, {}), ", bytes(&packed));
        }
    }
    let (kind, bytes) = (format!("{kind}; charset=utf-8"), bytes(place));
    Ok(format!(
        "Asset {{ path: {path:?}, kind: {kind:?}, tag: {tag:?}, bytes: {bytes}, coded: &[{coded}] }}, "
    ))
}
