//! `trimaran clash`: its list, its exit codes, and that it leaves nothing half-written.

use std::fs;

use serde_json::Value;

use crate::common::cubes::grouped_row;
use crate::common::program::{Bench, Process, said};

/// Boxes of 1 m in a row, with these gaps between them; their names are those of pipes and steel in turn.
fn row(gaps: &[f64]) -> Bench {
    let bench = Bench::empty();
    let (mut text, mut x) = (String::new(), 0.0);
    for (number, gap) in [&[0.0][..], gaps].concat().into_iter().enumerate() {
        x += gap;
        let name = if number % 2 == 0 { "PIPE" } else { "STEEL" };
        text += &format!("o {name}-{number}\n");
        for corner in 0..8 {
            let at = |axis: u32| f64::from(corner >> axis & 1);
            text += &format!("v {} {} {}\n", x + at(0), at(1), at(2));
        }
        let first = 8 * number + 1;
        for face in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = face.map(|corner| first + corner);
            text += &format!("f {a} {b} {c} {d}\n");
        }
        x += 1.0;
    }
    bench.write("row.obj", text);
    bench.done(&["import", "row.obj", "-o", "row.scene"]);
    bench
}

/// Touching, 3 mm and 8 mm apart, and overlapping by 1 cm.
const GAPS: [f64; 4] = [0.0, 0.003, 0.008, -0.01];

fn lines(csv: &str) -> Vec<Vec<&str>> {
    csv.lines().map(|line| line.split(',').collect()).collect()
}

#[test]
fn clashes_are_listed_with_names_distances_places_and_a_view() {
    let bench = row(&GAPS);
    let found = bench.trimaran(&["clash", "row.scene", "--tolerance", "5mm", "--out", "clashes.csv"]);
    assert_eq!(found.status.code(), Some(1), "{}", said(&found));
    assert!(said(&found).contains("3 clashes, 2 of them hard, between 5 objects and 5"), "{}", said(&found));
    assert!(found.stdout.is_empty());
    let csv = fs::read_to_string(bench.path("clashes.csv")).unwrap();
    let rows = lines(&csv);
    assert_eq!(rows[0][..6], ["kind", "distance_m", "error_m", "name_1", "path_1", "object_1"]);
    let pairs: Vec<_> = rows[1..].iter().map(|row| [row[0], row[1], row[3], row[6]]).collect();
    let expected = [
        ["hard", "0.000000", "PIPE-0", "STEEL-1"],
        ["hard", "0.000000", "STEEL-3", "PIPE-4"],
        ["clearance", "0.003000", "STEEL-1", "PIPE-2"],
    ];
    assert_eq!(pairs, expected);
    assert_eq!((rows[3][4], rows[3][5], rows[3][8]), ("row.obj", "1", "2"));
    // The gap is between 2 m and 2.003 m.
    let at = |column: usize| rows[3][column].parse::<f64>().unwrap();
    assert!((at(9) - 2.0).abs() < 1e-5 && (at(12) - 2.003).abs() < 1e-5, "{:?}", rows[3]);
    // East is x, and north -z.
    assert_eq!(rows[0][15..], ["east_1_m", "north_1_m", "up_1_m", "east_2_m", "north_2_m", "up_2_m", "view"]);
    let negated = |text: &str| format!("{:.6}", 0.0 - text.parse::<f64>().unwrap());
    assert_eq!((rows[3][15], rows[3][17], rows[3][18]), (rows[3][9], rows[3][10], rows[3][12]));
    assert_eq!(rows[3][16], negated(rows[3][11]));
    assert!(rows[1..].iter().all(|row| row[21].starts_with("#v=") && row[21].len() > 100));
    // The same again, in place of the list.
    bench.trimaran(&["clash", "row.scene", "--tolerance", "0.9cm", "--out", "clashes.csv"]);
    assert_eq!(lines(&fs::read_to_string(bench.path("clashes.csv")).unwrap()).len(), 1 + 4);
}

#[test]
fn sets_are_found_by_names() {
    let bench = row(&GAPS);
    let clash = |more: &[&str]| {
        let output =
            bench.trimaran(&[&["clash", "row.scene", "--tolerance", "10mm", "--json"], more].concat());
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let pair = |one: &Value| [0, 1].map(|part| one["parts"][part]["name"].as_str().unwrap().to_owned());
        let pairs: Vec<_> = found["clashes"].as_array().unwrap().iter().map(pair).collect();
        (output.status.code(), pairs, found)
    };
    let (code, pairs, found) = clash(&["--between", "pipe 2"]);
    assert_eq!((code, pairs.len()), (Some(1), 2));
    assert_eq!(pairs, [["PIPE-2", "STEEL-1"], ["PIPE-2", "STEEL-3"]]);
    assert_eq!((&found["objects"], &found["tolerance"]), (&serde_json::json!([1, 4]), &0.01.into()));
    assert_eq!(found["clashes"][0]["camera"]["vfov_deg"], 60.0);
    let (_, pairs, _) = clash(&["--between", "pipe", "--and", "steel-1"]);
    assert_eq!(pairs, [["PIPE-0", "STEEL-1"], ["PIPE-2", "STEEL-1"]]);
    // Pipes are not next to each other.
    let (code, pairs, found) = clash(&["--between", "pipe", "--and", "pipe"]);
    assert_eq!((code, pairs.len(), &found["hard"]), (Some(0), 0, &0.into()));
    // Without a file the list is printed.
    let printed = bench.trimaran(&["clash", "row.scene"]);
    assert_eq!(lines(&String::from_utf8(printed.stdout).unwrap()).len(), 1 + 2);
}

#[test]
fn clashes_within_a_group_are_left_out_and_counted() {
    let bench = Bench::empty();
    bench.write("groups.gltf", grouped_row());
    bench.done(&["import", "groups.gltf", "-o", "groups.scene"]);
    let clash = |more: &[&str]| bench.trimaran(&[&["clash", "groups.scene"], more].concat());
    let all = clash(&["--json"]);
    let all: Value = serde_json::from_slice(&all.stdout).unwrap();
    assert_eq!(all["clashes"].as_array().unwrap().len(), 3);
    assert_eq!((&all["ignore"], &all["ignored"], &all["group"]), (&Value::Null, &0.into(), &Value::Null));
    // The rule, how many clashes it leaves, and how many it leaves out.
    for (rule, left, ignored) in [("part", 2, 1), ("equipment", 1, 2), ("system", 0, 3)] {
        let rule_name = format!("same-{rule}");
        let found = clash(&["--ignore", &rule_name]);
        assert_eq!(found.status.code(), Some(i32::from(left > 0)), "{}", said(&found));
        assert!(
            said(&found).contains(&format!("; ignored: {ignored} in the same {rule}")),
            "{}",
            said(&found)
        );
        let csv = String::from_utf8(found.stdout).unwrap();
        let rows = lines(&csv);
        let last = &rows[rows.len() - 1];
        assert_eq!((rows.len(), last.len()), (2 + left, rows[0].len()));
        assert_eq!((last[0], last[3]), ("ignored", &*format!("{ignored} in the same {rule}")));
        let json: Value = serde_json::from_slice(&clash(&["--ignore", &rule_name, "--json"]).stdout).unwrap();
        assert_eq!((&json["ignore"], &json["ignored"]), (&rule_name.into(), &ignored.into()));
    }
    // Those that are left out are not among the most.
    assert_eq!(clash(&["--ignore", "same-equipment", "--most", "1"]).status.code(), Some(1));
    assert_eq!(clash(&["--most", "1"]).status.code(), Some(2));
    // Pairs of equipment: within A, and A with B.
    let found = clash(&["--group", "equipment", "--ignore", "same-part", "--out", "groups.csv"]);
    assert_eq!(found.status.code(), Some(1), "{}", said(&found));
    let csv = fs::read_to_string(bench.path("groups.csv")).unwrap();
    let rows = lines(&csv);
    assert_eq!(rows[0][..5], ["clashes", "hard", "group_1", "group_2", "kind"]);
    let of = |row: usize| (rows[row][0], rows[row][1], rows[row][2].rsplit(" > ").next().unwrap());
    assert_eq!((of(1), of(2)), (("1", "1", "A"), ("1", "1", "A")));
    assert!(rows[1][3].ends_with("> A") && rows[2][3].ends_with("> B"), "{csv}");
    assert_eq!((rows[3][0], rows[3][4], rows[3].len()), ("", "ignored", rows[0].len()));
    let json = clash(&["--group", "system", "--json"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert_eq!((&json["group"], json.get("clashes")), (&"system".into(), None));
    assert_eq!((&json["groups"][0]["clashes"], &json["groups"][0]["hard"]), (&3.into(), &3.into()));
    assert_eq!(json["groups"][0]["nearest"]["kind"], "hard");
    assert!(json["groups"].as_array().unwrap().len() == 1, "{json}");
    // A list of groups may be written over, too.
    assert_eq!(clash(&["--out", "groups.csv"]).status.code(), Some(1));
    assert_eq!(clash(&["--ignore", "same-zone"]).status.code(), Some(2));
}

#[test]
fn what_cannot_be_searched_is_told_with_exit_code_2() {
    let bench = row(&GAPS);
    bench.write("notes.csv", "my own list\n");
    bench.write("no.scene", "no scene at all, but long enough to look at");
    for (arguments, says) in [
        (&["clash", "row.scene", "--between", "valve"][..], "--between \"valve\" finds no object"),
        (&["clash", "row.scene", "--between", "pipe", "--and", "valve"], "--and \"valve\" finds no object"),
        (&["clash", "row.scene", "--and", "pipe"], "--between"),
        (&["clash", "row.scene", "--tolerance", "5"], "5mm"),
        (&["clash", "row.scene", "--tolerance=-5mm"], "from 0"),
        (&["clash", "row.scene", "--out", "notes.csv"], "is no list of clashes"),
        (&["clash", "row.scene", "--out", "row.scene"], "would be lost"),
        (&["clash", "row.scene", "--out", "nowhere/x.csv"], "cannot write"),
        (&["clash", "row.scene", "--most", "1"], "more than 1 clash was found"),
        (&["clash", "no.scene"], "no.scene"),
        (&["clash", "missing.scene"], "missing.scene"),
    ] {
        let output = bench.trimaran(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", said(&output));
        assert!(said(&output).contains(says), "{arguments:?}: {}", said(&output));
    }
    assert_eq!(fs::read_to_string(bench.path("notes.csv")).unwrap(), "my own list\n");
    let none = bench.trimaran(&["clash", "row.scene", "--between", "pipe 0", "--and", "steel 3"]);
    assert_eq!(none.status.code(), Some(0), "{}", said(&none));
}

#[test]
fn an_interrupted_search_leaves_no_file() {
    let bench = Bench::with_plant(3000);
    // Nearly all pairs: it takes far longer than the test.
    let arguments =
        ["clash", "plant.scene", "--tolerance", "1000m", "--most", "100000000", "--out", "clashes.csv"];
    let mut command = bench.command(&arguments);
    let mut searching = Process::start(command.env("TRIMARAN_LOG", "info"));
    searching.says("searches for clashes");
    searching.signal("INT");
    let told = searching.ends(130);
    assert!(told.contains("interrupted, and nothing was written"), "{told}");
    let left: Vec<_> =
        fs::read_dir(bench.path("")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left, ["plant.scene"]);
}
