//! A house to walk in, as the text of an OBJ file.

use std::fmt::Write as _;

/// A box, by two corners, metres.
type Corners = [[f64; 3]; 2];

/// Height and depth of a step of the stairs, and how many there are.
pub(crate) const RISE: f64 = 0.2;
const TREAD: f64 = 0.4;
pub(crate) const STEPS: u32 = 10;

/// A room with a wall at z = -4 for x below 0. Near x = 5, stairs begin at z = 2 and lead up to a landing.
pub(crate) fn house() -> String {
    obj(&parts())
}

fn parts() -> Vec<(String, Corners)> {
    let mut parts = vec![
        ("floor".to_owned(), [[-12.0, -0.2, -12.0], [12.0, 0.0, 12.0]]),
        ("north".to_owned(), [[-12.0, 0.0, -12.2], [12.0, 5.0, -12.0]]),
        ("south".to_owned(), [[-12.0, 0.0, 12.0], [12.0, 5.0, 12.2]]),
        ("west".to_owned(), [[-12.2, 0.0, -12.0], [-12.0, 5.0, 12.0]]),
        ("east".to_owned(), [[12.0, 0.0, -12.0], [12.2, 5.0, 12.0]]),
        ("wall".to_owned(), [[-12.0, 0.0, -4.2], [0.0, 3.0, -4.0]]),
    ];
    for step in 0..STEPS {
        let (height, begin) = (RISE * f64::from(step + 1), TREAD.mul_add(-f64::from(step), 2.0));
        parts.push((format!("step {step}"), [[4.0, 0.0, begin - TREAD], [6.0, height, begin]]));
    }
    let (height, begin) = (RISE * f64::from(STEPS), TREAD.mul_add(-f64::from(STEPS), 2.0));
    parts.push(("landing".to_owned(), [[3.0, height - 0.1, begin - 6.0], [7.0, height, begin]]));
    parts
}

fn obj(parts: &[(String, Corners)]) -> String {
    let mut text = String::new();
    for (at, (name, corners)) in parts.iter().enumerate() {
        writeln!(text, "o {name}").unwrap();
        for corner in 0..8 {
            let [x, y, z] = [0, 1, 2].map(|axis| corners[corner >> axis & 1][axis]);
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        let first = 8 * at + 1;
        for face in [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]] {
            let [a, b, c, d] = face.map(|corner| first + corner);
            writeln!(text, "f {a} {b} {c} {d}").unwrap();
        }
    }
    text
}
