//! Numbers for people: few digits, grouped thousands.

use indicatif::HumanCount;

use super::schema::{Loading, SentAhead, Summary, SweepPoint};

/// A figure with about three significant digits, thousands grouped by narrow spaces: `0`, `0.0123`, `4.56`,
/// `78.9`, `1 234`.
pub(crate) fn figure(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        "–".to_owned()
    } else if size >= 99.95 {
        grouped(value)
    } else if value == 0.0 {
        "0".to_owned()
    } else if size < 1e-4 {
        format!("{value:.1e}")
    } else {
        let decimals = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
        let text = format!("{value:.decimals$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

/// A figure beside an axis: short, with k and M for thousands and millions.
pub(super) fn tick_figure(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => format!("{} M", figure(value / 1e6)),
        size if size >= 1e4 => format!("{} k", figure(value / 1e3)),
        _ => figure(value),
    }
}

/// A whole number with its thousands grouped by narrow no-break spaces.
pub(crate) fn grouped(value: f64) -> String {
    // Rounds halves to even, like figures with decimals.
    let digits = HumanCount(value.abs().round_ties_even() as u64).to_string().replace(',', "\u{202f}");
    if value < 0.0 && digits != "0" { format!("-{digits}") } else { digits }
}

/// A figure with its unit; the words `none` if it was not measured.
pub(crate) fn with_unit(value: Option<f64>, unit: &str, none: &str) -> String {
    match value {
        None => none.to_owned(),
        Some(value) if unit.is_empty() => figure(value),
        Some(value) => format!("{} {unit}", figure(value)),
    }
}

/// `one` or `many`, after its number.
pub(crate) fn plural(count: u64, one: &str, many: &str) -> String {
    format!("{} {}", grouped(count as f64), if count == 1 { one } else { many })
}

/// How many of the frames a display that culls for itself did not cull, if any.
pub(super) fn not_culled(summary: &Summary) -> Option<String> {
    (summary.not_culled_frames > 0).then(|| {
        format!(
            "{} of {} drew all in the frustum: occlusion culling would have cost more.",
            grouped(f64::from(summary.not_culled_frames)),
            plural(u64::from(summary.frames), "frame", "frames"),
        )
    })
}

/// How many of the pictures were not exact yet, and when: a sentence each.
pub(super) fn loading(found: &Loading, pictures: u32) -> Vec<String> {
    let lacking = format!(
        "{} of {} had coarser drawables in the place of some that had not come yet.",
        grouped(f64::from(found.frames)),
        plural(u64::from(pictures), "picture", "pictures"),
    );
    let pixels = found.pixels.map(|pixels| {
        let audited = plural(u64::from(found.audited_frames), "audited picture", "audited pictures");
        format!("Not exact yet: {} of {audited}.", plural(pixels, "pixel", "pixels"))
    });
    let exact = found.exact_after_ms.map_or_else(
        || "None of these frames was exact before the next one was shown.".to_owned(),
        |after| {
            let frames = plural(u64::from(after.frames), "such frame", "such frames");
            let (median, max) = (figure(after.median), figure(after.max));
            format!("{frames} became exact, {median} ms after the camera (median; at most {max} ms).")
        },
    );
    [Some(lacking), pixels, Some(exact)].into_iter().flatten().collect()
}

/// Geometry sent before a frame needed it, and the share of it that was used.
pub(super) fn sent_ahead(ahead: &SentAhead) -> String {
    let megabytes = |bytes: u64| figure(bytes as f64 * 1e-6);
    let share = 100.0 * ahead.used_bytes as f64 / ahead.bytes as f64;
    let (came, used) = (megabytes(ahead.bytes), megabytes(ahead.used_bytes));
    format!("{came} MB of geometry before a frame needed it; {used} MB were used, {share:.0} %")
}

/// Whether the runs of a sweep differ in their cullers.
pub(super) fn cullers_differ(points: &[SweepPoint]) -> bool {
    let who = |point: &SweepPoint| (point.cullers, point.schedule.clone());
    points.windows(2).any(|pair| matches!(pair, [a, b] if who(a) != who(b)))
}

/// A point of a sweep over cullers, in the columns of its tables; `none` for figures not measured.
pub(super) fn culler_cells(point: &SweepPoint, none: &str) -> Vec<String> {
    let value = |v: Option<f64>| with_unit(v, "", none);
    vec![
        grouped(f64::from(point.cullers)),
        if point.cullers == 0 { none.to_owned() } else { point.schedule.clone() },
        figure(point.epsilon_px),
        value(point.fps()),
        value(point.latency_ms),
        value(point.object_tightness),
        value(point.triangle_tightness),
        value(point.bytes),
    ]
}

/// A point of a sweep over epsilon, in the columns of its tables; `none` for figures not measured.
pub(super) fn sweep_cells(point: &SweepPoint, none: &str) -> Vec<String> {
    let value = |v: Option<f64>| with_unit(v, "", none);
    vec![
        figure(point.epsilon_px),
        value(point.fps()),
        value(point.or_ms),
        value(point.hc_ms),
        value(point.rvg_ms),
        value(point.triangles_drawn),
        point.cut_mismatch_pixels.map_or_else(|| none.to_owned(), |pixels| grouped(pixels as f64)),
        value(point.psnr_db),
        value(point.flip_mean),
        value(point.silhouette_max_px),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_keep_three_digits() {
        let cases = [
            (0.0, "0"),
            (0.012_345, "0.0123"),
            (1.0, "1"),
            (4.561, "4.56"),
            (78.94, "78.9"),
            (99.97, "100"),
            (1234.5, "1\u{202f}234"),
            (-3.0, "-3"),
            (0.000_012, "1.2e-5"),
            (f64::NAN, "–"),
        ];
        for (value, text) in cases {
            assert_eq!(figure(value), text);
        }
        assert_eq!(tick_figure(200_000.0), "200 k");
        assert_eq!(tick_figure(1_500_000.0), "1.5 M");
        assert_eq!(tick_figure(0.05), "0.05");
        assert_eq!(grouped(12_804_256.0), "12\u{202f}804\u{202f}256");
        assert_eq!(grouped(-0.2), "0");
    }
}
