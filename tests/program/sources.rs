//! Rules for the sources as a whole: tests named by a page exist, and each test file is compiled.

use std::{
    fs,
    path::{Path, PathBuf},
};

/// All sources below a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() && !name.starts_with('.') && !["target", "node_modules"].contains(&name) {
            sources(&path, found);
        } else if name.ends_with(".rs") || name.ends_with(".ts") {
            found.push(path);
        }
    }
}

fn all_sources() -> Vec<PathBuf> {
    let mut all = Vec::new();
    sources(Path::new(env!("CARGO_MANIFEST_DIR")), &mut all);
    all
}

/// The last column of tables with the heading "test", with line numbers.
fn tests_of(page: &str) -> Vec<(usize, &str)> {
    let mut is_of_tests = false;
    let cells = page.lines().enumerate().filter_map(|(at, line)| {
        let cell = line.strip_suffix('|').and_then(|row| row.rsplit('|').next()).map(str::trim);
        is_of_tests = cell.is_some_and(|cell| is_of_tests || cell == "test");
        cell.filter(|cell| is_of_tests && *cell != "test" && !cell.starts_with('-'))
            .map(|cell| (at + 1, cell))
    });
    cells.collect()
}

#[test]
fn every_line_of_the_page_on_security_names_a_test_that_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let all = all_sources();
    let page = fs::read_to_string(root.join("docs/security.md")).unwrap();
    let lines = tests_of(&page);
    assert!(lines.len() > 50, "only {} lines name a test", lines.len());
    for (line, cell) in lines {
        let mut text = String::new();
        let mut names = 0;
        for name in cell.split('`').skip(1).step_by(2) {
            names += 1;
            if name.ends_with(".rs") || name.ends_with(".ts") {
                let files = all.iter().filter(|path| path.ends_with(name));
                text = files.map(|path| fs::read_to_string(path).unwrap()).collect();
                assert!(!text.is_empty(), "docs/security.md:{line}: there is no {name}");
            } else {
                assert!(text.contains(name), "docs/security.md:{line}: no test begins with {name}");
            }
        }
        assert!(names > 0, "docs/security.md:{line}: no test is named in \"{cell}\"");
    }
}

#[test]
fn every_file_of_tests_is_named_in_the_main_file_beside_it() {
    let all = all_sources();
    let mut count = 0;
    for path in all.iter().filter(|path| path.extension().is_some_and(|kind| kind == "rs")) {
        let main = path.with_file_name("main.rs");
        let is_of_tests = path.ancestors().nth(2).is_some_and(|folder| folder.ends_with("tests"));
        if is_of_tests && *path != main && main.exists() {
            let name = path.file_stem().unwrap().to_str().unwrap();
            let main = fs::read_to_string(main).unwrap();
            assert!(main.contains(&format!("mod {name};")), "{} is not compiled", path.display());
            count += 1;
        }
    }
    assert!(count > 80, "only {count} files of tests were found");
}
