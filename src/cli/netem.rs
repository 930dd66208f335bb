//! `trimaran netem`: puts the simulator's network between real programs.

use std::io::{self, IsTerminal, Write};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use trimaran::netem::{Emulation, NetemError, Report};
use trimaran_actors::Stop;
use trimaran_netsim::Profile;
use trimaran_transport::{Net, TokioNet, sleep_until};

use super::{
    Failure,
    args::NetemArgs,
    number, print_json, printed,
    walking::{runtime, stop_on_signal},
};

/// How often the counters on a terminal are updated.
const GLANCE: Duration = Duration::from_millis(100);

pub(super) fn run(args: &NetemArgs) -> Result<(), Failure> {
    let profile = Profile::find(&args.profile).map_err(Failure::bad_input)?;
    let failure = |e: NetemError| if e.is_usage() { Failure::bad_input(e) } else { Failure::broken(e) };
    let runtime = runtime()?;
    // Set before anything is made, so that nothing is left behind.
    let stop = stop_on_signal(&runtime);
    let emulation = Emulation::start(&profile, &args.namespaces, args.seed).map_err(failure)?;
    if !args.json && io::stdout().is_terminal() {
        for (host, namespace) in emulation.machines() {
            println!("{:<12} {} and {}: `ip netns exec {0} COMMAND`", namespace.name(), host.v4(), host.v6());
        }
    }
    let net = TokioNet::new(runtime.handle().clone());
    runtime.block_on(watch(&emulation, &net, args.seconds.map(Duration::from_secs_f64), &stop));
    let report = emulation.finish().map_err(failure)?;
    if args.json { print_json(&report) } else { printed(print(&report)) }
}

/// Shows the counters until it is time to end.
async fn watch(emulation: &Emulation, net: &dyn Net, time: Option<Duration>, stop: &Stop) {
    let bar = ProgressBar::new_spinner();
    bar.set_style(ProgressStyle::default_spinner());
    let end = time.map(|time| net.now().after(time));
    while !stop.requested() && emulation.is_running() && end.is_none_or(|end| net.now() < end) {
        bar.set_message(line(&emulation.report()));
        bar.tick();
        let next = net.now().after(GLANCE);
        sleep_until(net, end.map_or(next, |end| end.min(next))).await;
    }
    bar.finish_and_clear();
}

fn line(report: &Report) -> String {
    let totals = &report.totals;
    let dropped = totals.mtu + totals.queue + totals.managed + totals.lost + totals.corrupted;
    format!(
        "{} packets: {} delivered, {} dropped, {} under way; {:.0} us late at most",
        number(totals.sent),
        number(totals.delivered),
        number(dropped),
        number(totals.underway),
        report.late.max_us
    )
}

fn print(report: &Report) -> io::Result<()> {
    let mut out = super::terminal::stdout();
    let Report { totals, strangers, late, links } = report;
    let columns = ["sent", "copies", "delivered", "lost", "corrupt", "queue", "managed", "mtu", "under way"];
    write!(out, "{:<24}", "packets")?;
    for column in columns {
        write!(out, " {column:>11}")?;
    }
    writeln!(out, " {:>15}", "bytes sent")?;
    for link in links {
        let (tally, dropped) = (&link.tally, &link.tally.dropped);
        let counts = [
            tally.offered,
            tally.duplicated,
            tally.delivered,
            dropped.lost,
            dropped.corrupted,
            dropped.queue,
            dropped.managed,
            dropped.mtu,
            tally.queued + tally.flying,
        ];
        write!(out, "{:<24}", link.name)?;
        for count in counts {
            write!(out, " {:>11}", number(count.packets))?;
        }
        writeln!(out, " {:>15}", number(tally.offered.bytes))?;
    }
    let counts = [
        totals.sent,
        totals.duplicated,
        totals.delivered,
        totals.lost,
        totals.corrupted,
        totals.queue,
        totals.managed,
        totals.mtu,
        totals.underway,
    ];
    write!(out, "{:<24}", "from machine to machine")?;
    for count in counts {
        write!(out, " {:>11}", number(count))?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "late by {:.0} us in the median, {:.0} at the 99th percentile, {:.0} at most; {} packets were for nobody here",
        late.p50_us,
        late.p99_us,
        late.max_us,
        number(*strangers)
    )
}
