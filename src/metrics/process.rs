//! The operating system's figures of this process, by the names that client libraries of Prometheus use.

use std::fmt;

use prometheus_client::{
    collector::Collector,
    encoding::{DescriptorEncoder, EncodeMetric},
    metrics::{MetricType, counter::ConstCounter, gauge::ConstGauge},
};

/// This process. Where the system does not tell, there are no figures.
#[derive(Debug)]
pub(super) struct Process;

impl Collector for Process {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> Result<(), fmt::Error> {
        let Some(Figures { cpu_seconds, gauges }) = Figures::read() else { return Ok(()) };
        let help = "CPU time of the process, in user and in kernel mode";
        let counter = encoder.encode_descriptor("process_cpu_seconds", help, None, MetricType::Counter)?;
        ConstCounter::new(cpu_seconds).encode(counter)?;
        for (name, help, value) in gauges {
            let gauge = encoder.encode_descriptor(name, help, None, MetricType::Gauge)?;
            ConstGauge::new(value).encode(gauge)?;
        }
        Ok(())
    }
}

struct Figures {
    cpu_seconds: f64,
    /// By name, with a help text.
    gauges: Vec<(&'static str, &'static str, f64)>,
}

impl Figures {
    #[cfg(target_os = "linux")]
    fn read() -> Option<Self> {
        use procfs::{WithCurrentSystemInfo, process::LimitValue};

        let process = procfs::process::Process::myself().ok()?;
        let stat = process.stat().ok()?;
        let ticks = procfs::ticks_per_second() as f64;
        let mut gauges = vec![
            (
                "process_resident_memory_bytes",
                "Memory of the process that is resident",
                stat.rss_bytes().get() as f64,
            ),
            ("process_virtual_memory_bytes", "Address space of the process", stat.vsize as f64),
            ("process_threads", "Threads of the process", stat.num_threads as f64),
        ];
        if let Ok(boot) = procfs::boot_time_secs() {
            let started = boot as f64 + stat.starttime as f64 / ticks;
            gauges.push(("process_start_time_seconds", "When the process started, Unix time", started));
        }
        if let Ok(open) = process.fd_count() {
            gauges.push(("process_open_fds", "Open file descriptors", open as f64));
        }
        if let Ok(limits) = process.limits()
            && let LimitValue::Value(most) = limits.max_open_files.soft_limit
        {
            gauges.push(("process_max_fds", "The most file descriptors that may be open", most as f64));
        }
        Some(Self { cpu_seconds: (stat.utime + stat.stime) as f64 / ticks, gauges })
    }

    #[cfg(not(target_os = "linux"))]
    fn read() -> Option<Self> {
        None
    }
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use crate::metrics::Metrics;

    fn value(text: &str, name: &str) -> f64 {
        let line = text.lines().find_map(|line| line.strip_prefix(&format!("{name} ")));
        line.unwrap_or_else(|| panic!("no {name} in {text}")).parse().unwrap()
    }

    #[test]
    fn the_process_tells_its_memory_and_its_descriptors() {
        let held = std::fs::File::open("/dev/null").unwrap();
        let text = Metrics::new("culler").text().unwrap();
        drop(held);
        assert!(value(&text, "process_resident_memory_bytes") > 1e6, "{text}");
        assert!(value(&text, "process_open_fds") >= 4.0, "{text}");
        assert!(value(&text, "process_max_fds") >= value(&text, "process_open_fds"), "{text}");
        // After the year 2020.
        assert!(value(&text, "process_start_time_seconds") > 1.5e9, "{text}");
        assert!(text.contains("trimaran_build_info{version="), "{text}");
    }
}
