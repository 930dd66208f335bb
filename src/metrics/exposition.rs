//! The text format of Prometheus, version 0.0.4, which all tools read.

use std::borrow::Cow;

/// The media type.
pub(super) const TEXT_FORMAT: &str = "text/plain; version=0.0.4; charset=utf-8";

/// The text of a registry, encoded as OpenMetrics, in this format. There a family's name lacks the suffix of its
/// samples, `_total` or `_info`.
pub(super) fn in_text_format(text: &str) -> String {
    let (mut told, mut help) = (String::with_capacity(text.len()), None);
    for line in text.lines() {
        let mut words = line.splitn(4, ' ');
        let of = [words.next(), words.next(), words.next(), words.next()];
        let line = match of {
            [Some("#"), Some("HELP"), Some(name), about] => {
                help = Some((name, about.unwrap_or_default()));
                continue;
            }
            [Some("#"), Some("TYPE"), Some(name), Some(kind)] => {
                let (suffix, kind) = match kind {
                    "counter" => ("_total", kind),
                    "info" => ("_info", "gauge"),
                    _ => ("", kind),
                };
                let about = help.take().filter(|(of, _)| *of == name).map_or("", |(_, about)| about);
                format!("# HELP {name}{suffix} {about}\n# TYPE {name}{suffix} {kind}").into()
            }
            [Some("#"), ..] => continue,
            _ => Cow::from(line),
        };
        told.push_str(&line);
        told.push('\n');
    }
    told
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_have_the_names_of_their_samples_and_samples_stay() {
        let open = "# HELP frames Frames.\n# TYPE frames counter\nframes_total{stage=\"or\"} 3\n\
                    # HELP build The version.\n# TYPE build info\nbuild_info{version=\"1\"} 1\n\
                    # HELP seconds Time.\n# TYPE seconds histogram\n# UNIT seconds seconds\n\
                    seconds_sum 0.5\nseconds_count 1\nseconds_bucket{le=\"+Inf\"} 1\n# EOF\n";
        let text = "# HELP frames_total Frames.\n# TYPE frames_total counter\nframes_total{stage=\"or\"} 3\n\
                    # HELP build_info The version.\n# TYPE build_info gauge\nbuild_info{version=\"1\"} 1\n\
                    # HELP seconds Time.\n# TYPE seconds histogram\n\
                    seconds_sum 0.5\nseconds_count 1\nseconds_bucket{le=\"+Inf\"} 1\n";
        assert_eq!(in_text_format(open), text);
    }
}
