//! A network as command lines of `tc`, for kernels that have its `netem`.

use std::time::Duration;

use trimaran_netsim::Profile;
use trimaran_netsim::link::{
    Conditions, Discipline, Distribution, Framing, Jitter, LinkModel, Loss, Probability,
};

/// What `tc` counts of Ethernet's framing by itself: the header, but not the check sequence, the preamble and
/// the gap.
const COUNTED_BY_TC: i64 = 14;

/// The command lines of `tc` for a network, a shell script with `DEV` for the network card; what `tc` cannot
/// say is a comment.
#[must_use]
pub fn tc_commands(profile: &Profile) -> String {
    let mut script = format!("# {}: {}\n", profile.name, profile.about);
    let mut link = |place: &str, model: &LinkModel| {
        script += &format!("# {place}\n{}", commands(model));
    };
    link("what a machine sends: on each machine, DEV leads to the switch", &profile.up);
    link("what a machine gets: on the switch, DEV leads to the machine; once for each", &profile.down);
    if let Some((out, back)) = &profile.wan {
        link("between the sites: at the cullers', DEV leads to the display's", out);
        link("and back: at the display's, DEV leads to the cullers'", back);
    }
    script
}

fn commands(model: &LinkModel) -> String {
    let mut text = format!("tc qdisc replace dev DEV root netem {}\n", arguments(model, &model.conditions));
    for phase in &model.phases {
        text += &format!(
            "# after {}: tc qdisc change dev DEV root netem {}\n",
            time(phase.at),
            arguments(model, &phase.conditions)
        );
    }
    if let Some(period) = model.repeat {
        text += &format!("# after {}: from the start again\n", time(period));
    }
    if model.mtu != 1500 {
        text += &format!("ip link set DEV mtu {}\n", model.mtu);
    }
    if model.queue.bytes < u64::MAX {
        text += &format!("# not in tc: the queue holds {} bytes at most\n", model.queue.bytes);
    }
    if let Discipline::CoDel(codel) = model.queue.discipline {
        let (target, interval) = (time(codel.target), time(codel.interval));
        text +=
            &format!("# not in tc: the queue is kept short by CoDel, target {target}, interval {interval}\n");
    }
    if let Some(reorder) = model.conditions.reorder {
        let (share, by) = (percent(reorder.share), time(reorder.by));
        text += &format!("# not in tc: {share} of the packets come {by} later than the others\n");
    }
    if model.conditions.jitter.is_some_and(|jitter| !jitter.reorders) {
        text += "# not in tc: packets stay in order; tc's overtake one another where the delay varies\n";
    }
    text
}

fn arguments(model: &LinkModel, conditions: &Conditions) -> String {
    let mut words = Vec::new();
    if let Some(rate) = conditions.rate {
        let added = match model.framing {
            Framing::Ethernet => i64::from(Framing::Ethernet.line_bytes(1500)) - 1500,
            Framing::Bytes(bytes) => bytes.into(),
        };
        words.push(format!("rate {}bit {}", rate.bits_per_second(), added - COUNTED_BY_TC));
    }
    words.extend(delay(conditions.delay, conditions.jitter.as_ref()));
    match conditions.loss {
        Loss::None => {}
        Loss::Independent(share) => words.push(format!("loss random {}", percent(share))),
        Loss::GilbertElliott(model) => words.push(format!(
            "loss gemodel {} {} {} {}",
            percent(model.to_bad),
            percent(model.to_good),
            percent(model.lost_in_bad),
            percent(model.lost_in_good)
        )),
    }
    for (word, share) in [("corrupt", conditions.corrupt), ("duplicate", conditions.duplicate)] {
        if share.get() > 0.0 {
            words.push(format!("{word} {}", percent(share)));
        }
    }
    words.push(format!("limit {}", limit(model, conditions)));
    words.join(" ")
}

fn delay(delay: Duration, jitter: Option<&Jitter>) -> Option<String> {
    let Some(jitter) = jitter else {
        return (!delay.is_zero()).then(|| format!("delay {}", time(delay)));
    };
    let mut text = format!("delay {} {}", time(delay), time(jitter.deviation));
    if jitter.correlation.get() > 0.0 {
        text += &format!(" {}", percent(jitter.correlation));
    }
    // Without a word for it tc draws evenly.
    text += match jitter.distribution {
        Distribution::Uniform => "",
        Distribution::Normal => " distribution normal",
        Distribution::Pareto => " distribution pareto",
    };
    Some(text)
}

/// tc's limit is for the packets on their way as well.
fn limit(model: &LinkModel, conditions: &Conditions) -> u64 {
    let rate = conditions.rate.map_or(0, |rate| rate.bits_per_second());
    let on_the_way = conditions.delay.as_secs_f64() * rate as f64 / (8.0 * f64::from(model.mtu));
    u64::from(model.queue.packets).saturating_add(on_the_way.ceil() as u64).min(u32::MAX.into())
}

/// As tc reads it.
fn time(duration: Duration) -> String {
    format!("{}us", duration.as_nanos() as f64 / 1e3)
}

fn percent(share: Probability) -> String {
    // As many digits as a share has in a profile, without those that the multiplication makes up.
    format!("{}%", (share.get() * 1e11).round() / 1e9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_networks_that_come_along_are_said_as_tc_reads_them() {
        let commands = |name| tc_commands(&Profile::find(name).unwrap());
        let wifi = commands("wifi");
        assert!(
            wifi.contains(
                "tc qdisc replace dev DEV root netem rate 100000000bit 22 \
                 delay 1000us 700us 50% distribution pareto loss random 1% limit 1009\n"
            ),
            "{wifi}"
        );
        assert!(wifi.contains("packets stay in order"), "{wifi}");
        let switch = commands("fast-ethernet");
        assert!(switch.contains("netem rate 100000000bit 24 delay 5us limit 1001\n"), "{switch}");
        assert!(switch.contains("# not in tc: the queue holds 524288 bytes"), "{switch}");
        assert!(
            commands("wan-20ms").contains("delay 10000us 100us 50% distribution pareto loss random 0.001%")
        );
    }

    #[test]
    fn what_tc_can_say_is_said_and_the_rest_is_a_comment() {
        let profile = Profile::parse(
            "mine",
            "about = \"a\"\nsources = []\n[up]\nmtu = 1400\ndelay = \"3ms\"\nduplicate = 0.02\ncorrupt = 0.001\n\
             loss = { gilbert_elliott = { to_bad = 0.003, to_good = 0.25, lost_in_bad = 0.75 } }\n\
             queue = { packets = 50, discipline = { codel = { target = \"2ms\" } } }\n\
             jitter = { deviation = \"1ms\", distribution = \"uniform\" }\n\
             reorder = { share = 0.05, by = \"4ms\" }\nrepeat = \"20s\"\n\
             phases = [{ at = \"10s\", rate = \"1 Mbit/s\" }]\n",
        )
        .unwrap();
        let script = tc_commands(&profile);
        for expected in [
            "netem delay 3000us 1000us loss gemodel 0.3% 25% 75% 0% corrupt 0.1% duplicate 2% limit 50\n",
            "ip link set DEV mtu 1400\n",
            "# after 10000000us: tc qdisc change dev DEV root netem rate 1000000bit 24 delay 3000us",
            "# after 20000000us: from the start again\n",
            "# not in tc: the queue is kept short by CoDel, target 2000us, interval 100000us\n",
            "# not in tc: 5% of the packets come 4000us later than the others\n",
        ] {
            assert!(script.contains(expected), "{expected:?} is not in\n{script}");
        }
    }
}
