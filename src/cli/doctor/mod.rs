//! `trimaran doctor`: checks this machine, and names missing packages; or a deployment on it.

mod access;
mod culling;
mod deployment;
mod network;
mod service_user;

use std::{net::TcpListener, thread};

use trimaran_gpu::{DeviceChoice, DeviceKind, Gpu, GpuInfo, GpuOptions, HzbPlace, Optional};

use super::{
    Failure,
    args::DoctorArgs,
    finding::{self, Finding},
};

pub(super) fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let findings = match &args.config {
        Some(file) => deployment::check(file, args)?,
        None => gpus().into_iter().chain([memory(), sockets(args)]).collect(),
    };
    finding::conclude(&findings, args.json)
}

fn gpus() -> Vec<Finding> {
    let devices = match Gpu::list() {
        Ok(devices) => devices,
        Err(error) => return vec![Finding::missing("gpu", error)],
    };
    let mut findings: Vec<_> = devices.iter().enumerate().map(listed).collect();
    // Listing shows only the claims of a device; opening it is the proof.
    let device = DeviceChoice::from_environment();
    let opened = Gpu::open(&GpuOptions { device, check_traversals: true, ..GpuOptions::default() });
    let detail = match &opened {
        Ok(gpu) => format!("opened {}", gpu.info().name),
        Err(error) => error.to_string(),
    };
    findings.push(Finding::new("vulkan", opened.is_ok(), detail));
    findings.extend(opened.iter().map(culling::check));
    findings
}

/// A device, with all that `device` of a configuration may name it by.
fn listed((number, info): (usize, &GpuInfo)) -> Finding {
    let GpuInfo { name, driver, uuid, pci, .. } = info;
    let driver = driver.trim_end();
    let (major, minor, patch) = info.api_version;
    let pci = pci.map(|pci| format!(", PCI {pci}")).unwrap_or_default();
    let mut detail = format!(
        "#{number} {name} ({}), Vulkan {major}.{minor}.{patch}, {driver}, UUID {uuid}{pci}",
        kind(info.kind)
    );
    if info.hzb_place == HzbPlace::Device {
        detail += "; culls on the device";
    }
    if !info.missing.is_empty() {
        detail += &format!("; cannot be used, lacks {}", info.missing.join(", "));
    }
    // A device that cannot be used is no fault as long as another can.
    let lack = |lack: &Optional| format!("{}: {}", lack.name(), lack.without());
    Finding::ok("gpu", detail).lacking(info.lacks.iter().map(lack).collect())
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
        Ok(_) => Finding::ok("sockets", format!("can listen on {}", args.listen)),
        Err(error) => {
            let detail =
                format!("cannot listen on {}: {error}; give another address with --listen", args.listen);
            Finding::missing("sockets", detail)
        }
    }
}
