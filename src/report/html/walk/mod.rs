//! `report.html`: a walk's settings, speed and errors.

mod comparison;
mod figures;
#[cfg(feature = "lab")]
mod flip;
mod headline;
mod tables;

use maud::{PreEscaped, html};

use super::{document, embeddable};
use crate::report::schema::{Frame, Report};
#[cfg(feature = "lab")]
pub(crate) use comparison::pane_of;
pub(in crate::report) use comparison::{Comparison, choose};
#[cfg(feature = "lab")]
pub(crate) use flip::flip_pane;

/// The page.
///
/// # Errors
/// If the report cannot be made JSON.
pub(in crate::report) fn page(
    report: &Report,
    comparisons: &[Comparison],
) -> Result<String, serde_json::Error> {
    let body = html! {
        (headline::headline(report))
        main {
            (comparison::comparisons(report, comparisons))
            (figures::figures(report))
            (tables::tables(report))
        }
        script type="application/json" id="report" { (PreEscaped(embedded(report)?)) }
        script { (PreEscaped(include_str!("script.js"))) }
    };
    let title = format!("Trimaran: {}", file_name(&report.run.scene.file));
    Ok(document(&title, &body).into_string())
}

/// The report as JSON for a script element. The lists of visible objects stay in `report.json`: they can be a
/// hundred times the rest.
fn embedded(report: &Report) -> Result<String, serde_json::Error> {
    let frames = report.frames.iter().map(|f| Frame { visible: None, ..f.clone() }).collect();
    let slim = Report { frames, ..report.clone() };
    embeddable(&slim)
}

/// The last part of a path, as typed.
pub(crate) fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().filter(|n| !n.is_empty()).unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::sample;
    use crate::report::schema::Projection;

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
    fn pictures_that_were_not_exact_yet_are_told_where_there_were_some() {
        let html = page(&sample::report(), &[]).unwrap();
        assert!(
            html.contains("2 of 60 pictures had coarser drawables")
                && html.contains("1 such frame became exact")
        );
        assert!(!page(&sample::bare(), &[]).unwrap().contains("coarser drawables"));
    }

    #[test]
    fn falsely_culled_nodes_without_a_cause_are_not_none() {
        let Report { run, width, height, vfov_deg, near, mut frames, summary, .. } = sample::report();
        frames.iter_mut().for_each(|frame| frame.false_culls.clear());
        let projection = Projection { width, height, vfov_deg, near };
        let html = page(&Report::new(run, projection, frames, None, summary.ended), &[]).unwrap();
        assert!(html.contains("no cause was looked for</th><td>3</td><td>41</td>"));
    }

    #[test]
    fn the_passes_of_devices_are_charted_where_they_were_measured() {
        let passes = "The passes of a frame take ";
        let html = page(&sample::report(), &[]).unwrap();
        assert!(html.contains(passes) && html.contains("depth pyramid"));
        assert!(!page(&sample::bare(), &[]).unwrap().contains(passes));
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
}
