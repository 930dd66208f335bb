//! The faults of a file by kind: their count, and the first place.

use std::collections::BTreeMap;

use crate::import::report::{ImportReport, Warning, WarningKind};

/// Faults by kind, and by their context: a library, a word.
#[derive(Default)]
pub(super) struct Faults(BTreeMap<(WarningKind, String), Fault>);

#[derive(Default)]
struct Fault {
    count: u64,
    line: u32,
    what: String,
    objects: Vec<String>,
}

impl Faults {
    /// Notes a fault in a line; `what` is called only for the first such line.
    pub(super) fn note(
        &mut self,
        kind: WarningKind,
        of: &str,
        line: u32,
        object: &str,
        what: impl FnOnce() -> String,
    ) {
        let fault = self.0.entry((kind, of.to_owned())).or_default();
        if fault.count == 0 || line < fault.line {
            (fault.line, fault.what) = (line, what());
        }
        fault.count += 1;
        let is_new = !object.is_empty() && fault.objects.last().is_none_or(|last| last != object);
        if is_new && fault.objects.len() < Warning::OBJECTS {
            fault.objects.push(object.to_owned());
        }
    }

    /// The first fault of the file itself that caused an omission.
    pub(super) fn first(&self) -> Option<String> {
        let is_of_file = |kind: WarningKind, of: &str| match kind {
            // Here the context is a library.
            WarningKind::MalformedLine | WarningKind::TexturedMaterial => of.is_empty(),
            _ => true,
        };
        let of_file = self.0.iter().filter(|((kind, of), _)| is_of_file(*kind, of));
        let ((kind, _), Fault { line, what, .. }) = of_file.min_by_key(|(_, fault)| fault.line)?;
        let what = if what.is_empty() { kind.to_string() } else { what.clone() };
        Some(format!("line {line}: {what}"))
    }

    /// Adds them to the report.
    pub(super) fn report(self, report: &mut ImportReport) {
        for ((kind, of), Fault { count, line, what, objects }) in self.0 {
            let of = if of.is_empty() { of } else { format!("{of}, ") };
            let what = if what.is_empty() { what } else { format!(": {what}") };
            report.warn_first(kind, &format!("{of}first at line {line}{what}"), &objects, count);
        }
    }
}
