//! Imports point down only: crates stand in layers, modules of a crate form no circle, and servers need no
//! laboratory.

use std::{
    collections::{BTreeMap, BTreeSet},
    env, fs,
    path::{Path, PathBuf},
    process::Command,
};

/// The crates, from the bottom up, with their folders. A crate may depend on those above it in this list.
const CRATES: [(&str, &str); 15] = [
    ("trimaran-net", "transport/net"),
    ("trimaran-wire", "transport/wire"),
    ("trimaran-udp", "transport/udp"),
    ("trimaran-transport", "transport"),
    ("trimaran-python", "transport/python"),
    ("trimaran-netsim", "netsim"),
    ("trimaran-proto", "proto"),
    ("trimaran-scene", "roles/scene"),
    ("trimaran-cook", "roles/cook"),
    ("trimaran-cull", "roles/cull"),
    ("trimaran-gpu", "roles/gpu"),
    ("trimaran-actors", "roles/actors"),
    ("trimaran-audit", "lab/audit"),
    ("trimaran-rays", "lab/rays"),
    ("trimaran", "."),
];

/// The packages that prove and compare.
const LABORATORY: [&str; 5] = ["trimaran-netsim", "trimaran-audit", "trimaran-rays", "obvhs", "tun-rs"];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The name at the beginning of a text.
fn first_name(text: &str) -> &str {
    text.split(|c: char| !(c.is_alphanumeric() || c == '_')).next().unwrap_or_default()
}

/// The names that follow `start` in paths: `a` of `crate::a::b`, and `a` and `c` of `crate::{a::b, c}`.
fn names_after(code: &str, start: &str) -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    for (at, _) in code.match_indices(start) {
        let rest = &code[at + start.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            names.insert(first_name(rest).to_owned());
            continue;
        };
        let mut depth = 1;
        let outermost: String = list
            .chars()
            .take_while(|c| {
                depth += i32::from(*c == '{') - i32::from(*c == '}');
                depth > 0
            })
            .collect();
        let mut depth = 0;
        let items = outermost.split(move |c| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            c == ',' && depth == 0
        });
        names.extend(items.map(|item| first_name(item.trim()).to_owned()));
    }
    names
}

/// The code of a file, without comments and without tests at its end.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let code = text.split("\nmod tests {").next().unwrap_or_default();
    code.lines().map(|line| line.split("//").next().unwrap_or_default()).collect::<Vec<_>>().join("\n")
}

/// Each source file below a folder.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files(&path, found);
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            found.push(path);
        }
    }
}

/// For each top-level module of a crate the others that it imports.
fn imports(source: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let mut all = Vec::new();
    files(source, &mut all);
    let module = |path: &Path| {
        let top = path.strip_prefix(source).unwrap().iter().next().unwrap().to_str().unwrap();
        top.trim_end_matches(".rs").to_owned()
    };
    // A name that lib.rs hands on belongs to its module.
    let library = code(&source.join("lib.rs"));
    let mut homes = BTreeMap::new();
    for statement in library.split("pub use ").skip(1).chain(library.split("pub(crate) use ").skip(1)) {
        let statement = statement.split(';').next().unwrap_or_default();
        let Some((home, items)) = statement.split_once("::") else { continue };
        for item in items.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|item| !item.is_empty())
        {
            homes.insert(item.to_owned(), home.to_owned());
        }
    }
    let mut graph: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for path in all.iter().filter(|path| !["lib.rs", "main.rs"].iter().any(|root| path.ends_with(root))) {
        let code = code(path);
        let mut names = names_after(&code, "crate::");
        if path.parent() == Some(source) {
            names.extend(names_after(&code, "super::"));
        }
        let of = module(path);
        let names = names.into_iter().map(|name| homes.get(&name).cloned().unwrap_or(name));
        graph.entry(of.clone()).or_default().extend(names.filter(|name| *name != of));
    }
    let modules: BTreeSet<String> = graph.keys().cloned().collect();
    graph.values_mut().for_each(|imported| imported.retain(|name| modules.contains(name)));
    graph
}

/// The modules that are left when those that import none of the rest, or that none of the rest imports, are
/// taken away, again and again.
fn in_circles(mut graph: BTreeMap<String, BTreeSet<String>>) -> BTreeMap<String, BTreeSet<String>> {
    loop {
        let left: BTreeSet<String> = graph.keys().cloned().collect();
        graph.values_mut().for_each(|imported| imported.retain(|name| left.contains(name)));
        let before = graph.len();
        let imported: BTreeSet<String> = graph.values().flatten().cloned().collect();
        graph.retain(|name, imports| !imports.is_empty() && imported.contains(name));
        if graph.len() == before {
            return graph;
        }
    }
}

#[test]
fn modules_of_a_crate_form_no_circle() {
    for (name, folder) in CRATES {
        let graph = imports(&root().join(folder).join("src"));
        assert!(graph.len() > 3, "{name}: only {graph:?}");
        let circles = in_circles(graph);
        assert!(circles.is_empty(), "{name}: these modules import each other: {circles:#?}");
    }
}

#[test]
fn crates_depend_on_crates_below_them_only() {
    for (place, (name, folder)) in CRATES.iter().enumerate() {
        let text = fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
        let manifest: toml::Table = text.parse().unwrap();
        let dependencies = manifest["dependencies"].as_table().unwrap();
        for dependency in dependencies.keys().filter(|name| name.starts_with("trimaran")) {
            let below = CRATES[..place].iter().any(|(other, _)| other == dependency);
            assert!(below, "{name} depends on {dependency}, which is not below it");
            let is_optional =
                folder.starts_with("lab/") || dependencies[dependency].get("optional").is_some();
            assert!(is_optional || !LABORATORY.contains(&dependency.as_str()), "{name} needs {dependency}");
        }
    }
}

#[test]
fn a_server_has_no_laboratory() {
    let arguments = ["tree", "--package", "trimaran", "--edges", "normal", "--prefix", "none", "--offline"];
    let tree = |more: &[&str]| {
        let cargo = env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let output = Command::new(cargo).args(arguments).args(more).current_dir(root()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().filter_map(|line| line.split(' ').next()).map(str::to_owned).collect::<BTreeSet<_>>()
    };
    let (whole, server) = (tree(&[]), tree(&["--no-default-features"]));
    for name in LABORATORY {
        assert!(whole.contains(name), "{name} is no part of the program");
        assert!(!server.contains(name), "a program without the feature lab has {name}");
    }
    assert!(server.contains("trimaran-actors"), "{server:?}");
}
