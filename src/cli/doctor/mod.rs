//! `trimaran doctor`: checks this machine, and names missing packages.

mod culling;

use std::{io::Write as _, net::TcpListener, thread};

use serde::Serialize;
use trimaran_gpu::{DeviceKind, Gpu, GpuInfo, GpuOptions, HzbPlace, Optional};

use super::{Failure, args::DoctorArgs, print_json, printed, terminal};

/// The result of one check.
#[derive(Debug, Serialize)]
struct Finding {
    what: &'static str,
    works: bool,
    /// The result; if it does not work, the remedy.
    detail: String,
    /// Missing optional features, and the effect of their absence.
    lacks: Vec<String>,
}

impl Finding {
    const fn new(what: &'static str, works: bool, detail: String) -> Self {
        Self { what, works, detail, lacks: Vec::new() }
    }

    fn lines(&self) -> String {
        let mark = if self.works { "ok      " } else { "MISSING " };
        let lacks = self.lacks.iter().map(|lack| format!("{:16}lacks {lack}\n", ""));
        format!("{mark}{:8}{}\n", self.what, self.detail) + &lacks.collect::<String>()
    }
}

pub(super) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let mut findings = gpus();
    findings.push(memory());
    findings.push(sockets(args));
    let healthy = findings.iter().all(|finding| finding.works);
    if args.json {
        print_json(&serde_json::json!({ "works": healthy, "findings": findings }))?;
    } else {
        printed(write!(terminal::stdout(), "{}", findings.iter().map(Finding::lines).collect::<String>()))?;
    }
    if healthy {
        Ok(())
    } else {
        Err(Failure::broken("something that a walkthrough needs is missing; see above"))
    }
}

fn gpus() -> Vec<Finding> {
    let devices = match Gpu::list() {
        Ok(devices) => devices,
        Err(error) => return vec![Finding::new("gpu", false, error.to_string())],
    };
    let mut findings: Vec<_> = devices.iter().map(listed).collect();
    // Listing shows only the claims of a device; opening it is the proof.
    let opened = Gpu::open(&GpuOptions { check_traversals: true, ..GpuOptions::default() });
    let detail = match &opened {
        Ok(gpu) => format!("opened {}", gpu.info().name),
        Err(error) => error.to_string(),
    };
    findings.push(Finding::new("vulkan", opened.is_ok(), detail));
    findings.extend(opened.iter().map(culling::check));
    findings
}

fn listed(info: &GpuInfo) -> Finding {
    let (major, minor, patch) = info.api_version;
    let mut detail =
        format!("{} ({}), Vulkan {major}.{minor}.{patch}, {}", info.name, kind(info.kind), info.driver);
    if info.hzb_place == HzbPlace::Device {
        detail += "; culls on the device";
    }
    if !info.missing.is_empty() {
        detail += &format!("; cannot be used, lacks {}", info.missing.join(", "));
    }
    // A device that cannot be used is no fault as long as another can.
    let lack = |lack: &Optional| format!("{}: {}", lack.name(), lack.without());
    Finding { lacks: info.lacks.iter().map(lack).collect(), ..Finding::new("gpu", true, detail) }
}

const fn kind(kind: DeviceKind) -> &'static str {
    match kind {
        DeviceKind::Discrete => "discrete GPU",
        DeviceKind::Integrated => "integrated GPU",
        DeviceKind::Virtual => "virtual GPU",
        DeviceKind::Cpu => "draws on the CPU",
        _ => "of an unknown kind",
    }
}

fn memory() -> Finding {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let available = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
        line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()
    });
    let detail = match available {
        Some(kib) => format!("{:.1} GiB available, {cores} cores", kib as f64 / f64::from(1 << 20)),
        None => format!("{cores} cores; this system does not say how much memory is available"),
    };
    let works = available.is_none_or(|kib| kib >= 1 << 20);
    let detail = if works { detail } else { format!("{detail}; cooking a plant needs 1 GiB") };
    Finding::new("memory", works, detail)
}

fn sockets(args: &DoctorArgs) -> Finding {
    match TcpListener::bind(args.listen) {
        Ok(_) => Finding::new("sockets", true, format!("can listen on {}", args.listen)),
        Err(error) => {
            let detail =
                format!("cannot listen on {}: {error}; give another address with --listen", args.listen);
            Finding::new("sockets", false, detail)
        }
    }
}
