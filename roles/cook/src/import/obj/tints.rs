//! Vertex colours, which many programs write after the coordinates.

/// The values after each vertex's coordinates: three or four.
#[derive(Default)]
pub(super) struct Tints(Vec<[f32; 4]>);

/// The interpretation of a file's values.
pub(super) struct Scale<'t> {
    tints: &'t Tints,
    /// Whether the first of four values is a weight, rather than the last one an opacity.
    weighted: bool,
    /// The value of full colour.
    full: f32,
}

/// A vertex without a colour.
const NONE: [f32; 4] = [f32::NAN; 4];

impl Tints {
    /// Sets the values after a vertex's coordinates; a missing fourth value is NaN.
    pub(super) fn set(&mut self, vertex: usize, values: [f64; 4]) {
        self.0.resize(vertex, NONE);
        self.0.push(values.map(|value| value as f32));
    }

    /// Determines the interpretation of the file's values. Full colour is 1, or 255 if a value is above 2:
    /// some programs write a little more than 1. Of four values the first one is the format's weight, if it
    /// is 1 in all vertices or if the last one is 0 in all. Else the last one is an opacity.
    pub(super) fn scale(&self) -> Scale<'_> {
        let fours = || self.0.iter().filter(|values| values.iter().all(|value| !value.is_nan()));
        let weighted = fours().all(|[first, ..]| *first == 1.0) || fours().all(|[.., last]| *last == 0.0);
        let largest = |largest: f32, [a, b, c, d]: &[f32; 4]| {
            // Infinite values are no colours.
            [a, b, c, d]
                .into_iter()
                .filter(|value| value.is_finite())
                .fold(largest, |most, &value| most.max(value))
        };
        let full = if self.0.iter().fold(0.0, largest) > 2.0 { 255.0 } else { 1.0 };
        Scale { tints: self, weighted, full }
    }
}

impl Scale<'_> {
    /// Red, green, blue and opacity of a vertex, each 1 where it is full; none if it has no colour.
    pub(super) fn of(&self, vertex: u32) -> Option<[f64; 4]> {
        let &[a, b, c, d] = self.tints.0.get(vertex as usize)?;
        let part = |value: f32| f64::from((value / self.full).clamp(0.0, 1.0));
        let [r, g, b, opacity] = match d.is_nan() {
            true => [a, b, c, self.full],
            false if self.weighted => [b, c, d, self.full],
            false => [a, b, c, d],
        };
        (!r.is_nan() && !g.is_nan() && !b.is_nan()).then(|| [r, g, b, opacity].map(part))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(vertices: &[&[f64]]) -> Vec<Option<[f64; 4]>> {
        let mut tints = Tints::default();
        for (vertex, values) in vertices.iter().enumerate().filter(|(_, values)| !values.is_empty()) {
            let value = |place: usize| values.get(place).copied().unwrap_or(f64::NAN);
            tints.set(vertex, [0, 1, 2, 3].map(value));
        }
        let scale = tints.scale();
        (0..vertices.len() as u32).map(|vertex| scale.of(vertex)).collect()
    }

    #[test]
    fn three_values_are_a_colour_of_either_scale_and_none_is_none() {
        assert_eq!(read(&[&[], &[1.0, 0.5, 0.0], &[]]), [None, Some([1.0, 0.5, 0.0, 1.0]), None]);
        assert_eq!(read(&[&[255.0, 51.0, 0.0]]), [Some([1.0, 0.2_f32.into(), 0.0, 1.0])]);
        assert_eq!(read(&[&[1.01, -1.0, 0.0], &[f64::NAN, 0.0, 0.0]]), [Some([1.0, 0.0, 0.0, 1.0]), None]);
    }

    #[test]
    fn of_four_values_one_is_a_weight_or_an_opacity() {
        let weights = [&[1.0, 1.0, 0.0, 0.0][..], &[1.0, 0.0, 0.0, 1.0]];
        assert_eq!(read(&weights), [Some([1.0, 0.0, 0.0, 1.0]), Some([0.0, 0.0, 1.0, 1.0])]);
        let half = [&[0.5, 1.0, 0.25, 0.0][..]];
        assert_eq!(read(&half), [Some([1.0, 0.25, 0.0, 1.0])]);
        let opacities = [&[1.0, 0.0, 0.0, 1.0][..], &[0.0, 1.0, 0.0, 0.5]];
        assert_eq!(read(&opacities), [Some([1.0, 0.0, 0.0, 1.0]), Some([0.0, 1.0, 0.0, 0.5])]);
    }
}
