//! `report.html`: one page that opens offline. It embeds the report's data, its pictures, its style and a
//! little script, and refers to nothing outside.

mod chart;
mod exhibit;
mod figures;
mod headline;
pub(super) mod simulation;
mod tables;
mod timeline;

pub(super) use exhibit::{Exhibit, choose};

use super::schema::{Frame, Report};

/// The page.
///
/// # Errors
/// If the report cannot be made JSON.
pub(super) fn page(report: &Report, exhibits: &[Exhibit]) -> Result<String, serde_json::Error> {
    let title = format!("Trimaran: {}", file_name(&report.run.scene.file));
    let pictures: String = exhibits.iter().map(|e| e.html(report)).collect();
    let pictures = if pictures.is_empty() {
        String::new()
    } else {
        format!(
            "<h2 id=\"pictures\">Pictures</h2><p class=\"hint\">Click a picture to enlarge it. Pictures are scaled down; \
             frames/ has them in full.</p>{pictures}"
        )
    };
    Ok(format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <meta name=\"color-scheme\" content=\"light dark\"><title>{title}</title>\n<style>\n{style}</style></head>\n<body>\n\
         {headline}\n<main>\n{pictures}\n{figures}\n{tables}\n</main>\n\
         <script type=\"application/json\" id=\"report\">{data}</script>\n<script>\n{script}</script>\n</body></html>\n",
        title = escape(&title),
        style = include_str!("style.css"),
        headline = headline::html(report),
        figures = figures::html(report),
        tables = tables::html(report),
        data = embedded(report)?,
        script = include_str!("script.js"),
    ))
}

/// The report as JSON for a script element. The lists of visible objects stay in `report.json`: they can be a
/// hundred times the rest.
fn embedded(report: &Report) -> Result<String, serde_json::Error> {
    let frames = report.frames.iter().map(|f| Frame { visible: None, ..f.clone() }).collect();
    let slim = Report { frames, ..report.clone() };
    // Within JSON `<` occurs in strings only; escaped, no string can end the script element.
    Ok(serde_json::to_string(&slim)?.replace('<', "\\u003c"))
}

/// Text as it may stand in HTML, in attributes too.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // Control characters have no place in HTML.
            c if c.is_control() && c != '\n' && c != '\t' => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// The last part of a path, as typed.
fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().filter(|n| !n.is_empty()).unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sample;
    use crate::report::schema::Report;

    #[test]
    fn the_page_refers_to_nothing_outside() {
        let html = page(&sample::report(), &[]).unwrap();
        for outside in ["http", "//cdn", "url(", "@import", "<link", " href=", "src=\"/"] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn names_cannot_leave_their_place() {
        let html = page(&sample::report(), &[]).unwrap();
        assert!(!html.contains("<b>platform"));
        assert!(html.contains("&lt;b&gt;platform.scene"));
        assert!(!html.contains("<script>alert(1)"));
        assert_eq!(html.matches("</script>").count(), 2, "the data's and the script's own");
    }

    #[test]
    fn the_embedded_data_is_the_report_without_its_lists_of_objects() {
        let report = sample::report();
        let text = embedded(&report).unwrap();
        let back: Report = serde_json::from_str(&text).unwrap();
        assert_eq!(back.summary, report.summary);
        assert!(report.frames.iter().any(|f| f.visible.is_some()));
        assert!(back.frames.iter().all(|f| f.visible.is_none()));
    }

    #[test]
    fn an_unaudited_run_is_not_called_right() {
        let html = page(&sample::bare(), &[]).unwrap();
        assert!(html.contains("No frame was audited"));
        assert!(!html.contains("Culling changed no pixel"));
        assert!(!html.contains("NaN") && !html.contains("inf\""));
    }

    #[test]
    fn a_model_is_called_one() {
        let html = page(&sample::report(), &[]).unwrap();
        assert!(html.contains("<span class=\"badge\">model</span>"));
        assert!(!html.contains("measured, this machine"), "no walk's speed stands beside it");
    }

    #[test]
    fn a_run_whose_roles_computed_at_once_is_no_model_and_says_how_to_get_one() {
        let html = page(&sample::bare(), &[]).unwrap();
        assert!(!html.contains("<span class=\"badge\">model</span>"));
        assert!(html.contains("no figure") && html.contains("run with --alone"));
    }

    #[test]
    fn escaping_covers_attributes_and_control_characters() {
        assert_eq!(escape("a<b>&\"'\u{1}ü"), "a&lt;b&gt;&amp;&quot;&#39;\u{fffd}ü");
    }
}
