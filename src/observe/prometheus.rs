//! State of the gateway as Prometheus metrics. For each request, the metrics are made from the status.
//!
//! A value that is not known has no line; it is neither NaN nor zero. Lengths are in meters, because Prometheus uses
//! base units. Counters exist from the start of the gateway, so that their first count is an increase.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::events::{Alarm, Level};
use super::status::{AxisStatus, BusStatus, DeviceStatus, OutputStatus, ProbeStatus, SignalStatus, Status};
use isotherm_core::compensation::{AxisState, Stages};
use isotherm_core::display::Display;

/// Names of the gauges, with their help texts.
const GAUGES: [(&str, &str); 36] = [
    ("isotherm_axis_verified_cz_meters", "Compensation that was last verified in the control."),
    ("isotherm_axis_verified_age_seconds", "Time since the compensation was verified."),
    ("isotherm_axis_unreachable", "1 while the value in the control cannot be read."),
    (
        "isotherm_axis_cz_meters",
        "Compensation after the limits of the axis: limit, deadband, step, rate, rounding.",
    ),
    ("isotherm_axis_raw_meters", "Compensation as the model computes it."),
    ("isotherm_axis_expected_meters", "Expected residual error, as one standard deviation."),
    ("isotherm_axis_state", "1 for the present state of the axis, 0 for the other states."),
    ("isotherm_axis_armed", "1 when the axis may write."),
    ("isotherm_axis_wanted", "1 when the axis has a model and is not switched off: it must compensate."),
    (
        "isotherm_probe_correction_meters",
        "Correction by measured errors that is added to the model's compensation.",
    ),
    ("isotherm_probe_residual_meters", "Residual error of the model at the last probing."),
    (
        "isotherm_probe_residual_rms_meters",
        "Root mean square of the residual errors of the last probings, 48 at most.",
    ),
    ("isotherm_probe_residuals", "Number of probings in isotherm_probe_residual_rms_meters."),
    ("isotherm_probe_warn_meters", "Absolute residual error above which there is a warning."),
    ("isotherm_probe_worse", "1 while probings show that the model is worse than no compensation."),
    ("isotherm_probe_gain_change", "Relative change of a gain by measured errors."),
    ("isotherm_axis_limit_meters", "Limit of the compensation: its largest permitted absolute value."),
    ("isotherm_axis_warned", "1 while the absolute compensation is above its warning level."),
    ("isotherm_axis_tripped", "1 when a model has requested more than the error level since arming."),
    (
        "isotherm_axis_extrapolating",
        "1 when the inputs are outside the range on which the model in use was identified.",
    ),
    (
        "isotherm_axis_excess_ratio",
        "Distance of the inputs from the edge of the model's range; below 0 inside.",
    ),
    (
        "isotherm_guard_acting",
        "1 when this limit (limit, deadband, step, rate, round) changed the last compensation.",
    ),
    ("isotherm_signal_value", "Last usable value of the signal, in the unit of its label."),
    ("isotherm_signal_good", "1 when the signal may be used."),
    ("isotherm_signal_age_seconds", "Time since the signal was measured."),
    ("isotherm_device_up", "1 when the device answers."),
    ("isotherm_bus_connected", "1 when the bus has a connection."),
    ("isotherm_output_value", "Last verified value of the output, in the unit of its label."),
    (
        "isotherm_output_late_write_wait_seconds",
        "Longest time until the gateway changes the register: an earlier write may still arrive.",
    ),
    ("isotherm_output_verified", "1 when the last write was read back as written."),
    ("isotherm_output_state", "1 for the present state of the output, 0 for the other states."),
    ("isotherm_alarms", "Active alarms, by level and whether they are acknowledged."),
    (
        "isotherm_clock_synchronised",
        "1 when the computer's clock is synchronised; absent if that is not known.",
    ),
    ("isotherm_mqtt_connected", "1 when the broker has accepted the connection."),
    ("isotherm_mqtt_queued_messages", "Messages that wait for the broker."),
    ("isotherm_build_info", "Always 1; the version is the label."),
];

/// Names of the counters, with their help texts.
const COUNTERS: [(&str, &str); 11] = [
    ("isotherm_device_requests_total", "Requests sent."),
    ("isotherm_device_failures_total", "Requests that failed, by cause."),
    ("isotherm_bus_cycles_total", "Cycles of the bus."),
    ("isotherm_bus_overruns_total", "Cycles that ended too late."),
    ("isotherm_output_writes_total", "Writes that were verified."),
    ("isotherm_events_total", "Events, by kind."),
    ("isotherm_refused_total", "Requests that the web page rejected, by reason."),
    ("isotherm_mqtt_published_total", "Messages sent to the broker."),
    ("isotherm_mqtt_dropped_total", "Messages dropped because the queue was full."),
    ("isotherm_mqtt_connections_total", "Connections that the broker has accepted."),
    ("isotherm_log_dropped_total", "Log rows lost because the queue to the disk was full."),
];

/// Returns the metrics in the exposition format 0.0.4. `refused` contains the number of requests that the web page
/// refused, by reason.
pub(super) fn exposition(status: &Status, refused: &[(&'static str, u64)]) -> String {
    let mut samples = Samples::default();
    record(status, &mut samples);
    for (why, count) in refused {
        samples.count("isotherm_refused_total", &labels(&status.machine, &[("why", why)]), *count);
    }
    let mut text = samples.text();
    write_jitter(&mut text, status);
    write_lock(&mut text, status);
    text
}

/// Lines of the metrics. The key is the name of the metric. Each line contains labels and value.
#[derive(Default)]
struct Samples(BTreeMap<&'static str, String>);

impl Samples {
    /// Adds a gauge. A value that is unknown or infinite gets no line.
    fn set(&mut self, name: &'static str, labels: &str, value: Option<f64>) {
        if let Some(value) = value.filter(|value| value.is_finite()) {
            self.add(name, labels, &value);
        }
    }

    fn count(&mut self, name: &'static str, labels: &str, value: u64) {
        self.add(name, labels, &value);
    }

    fn add(&mut self, name: &'static str, labels: &str, value: &dyn std::fmt::Display) {
        let lines = self.0.entry(name).or_default();
        // Writing to a string never fails.
        let _ = writeln!(lines, "{name}{{{labels}}} {value}");
    }

    fn text(self) -> String {
        let mut text = String::new();
        let gauges = GAUGES.iter().map(|named| (named, "gauge"));
        let counters = COUNTERS.iter().map(|named| (named, "counter"));
        for ((name, help), kind) in gauges.chain(counters) {
            if let Some(lines) = self.0.get(name) {
                head(&mut text, name, help, kind);
                text.push_str(lines);
            }
        }
        text
    }
}

fn record(status: &Status, samples: &mut Samples) {
    let of = |more: &[(&'static str, &str)]| labels(&status.machine, more);
    let is_synchronised = match status.clock {
        "synchronised" => Some(1.0),
        "not synchronised" => Some(0.0),
        _ => None,
    };
    samples.set("isotherm_clock_synchronised", &of(&[]), is_synchronised);
    samples.set("isotherm_build_info", &of(&[("version", status.version)]), Some(1.0));
    for (kind, count) in &status.event_counts {
        samples.count("isotherm_events_total", &of(&[("kind", kind)]), *count);
    }
    samples.count("isotherm_log_dropped_total", &of(&[]), status.log_dropped);
    record_alarms(&status.alarms, &of, samples);
    status.axes.iter().for_each(|axis| record_axis(axis, &of, samples));
    status.signals.iter().for_each(|signal| record_signal(signal, &of, samples));
    status.devices.iter().for_each(|device| record_device(device, &of, samples));
    status.buses.iter().for_each(|bus| record_bus(bus, &of, samples));
    status.outputs.iter().for_each(|output| record_output(output, &of, samples));
    if let Some(mqtt) = &status.mqtt {
        samples.set("isotherm_mqtt_connected", &of(&[]), Some(flag(mqtt.connected)));
        samples.set(
            "isotherm_mqtt_queued_messages",
            &of(&[]),
            Some(u32::try_from(mqtt.queued).map_or(f64::MAX, f64::from)),
        );
        samples.count("isotherm_mqtt_published_total", &of(&[]), mqtt.published);
        samples.count("isotherm_mqtt_dropped_total", &of(&[]), mqtt.dropped);
        samples.count("isotherm_mqtt_connections_total", &of(&[]), mqtt.connections);
    }
}

/// Function that formats the labels of a line: the machine, and the labels in the argument.
type Labels<'a> = &'a dyn Fn(&[(&'static str, &str)]) -> String;

fn record_alarms(alarms: &[Alarm], of: Labels<'_>, samples: &mut Samples) {
    for (level, name) in [(Level::Warning, "warning"), (Level::Error, "error")] {
        for (seen, word) in [(false, "no"), (true, "yes")] {
            let is_one = |alarm: &&Alarm| alarm.level == level && alarm.acknowledged.is_some() == seen;
            let named = of(&[("level", name), ("acknowledged", word)]);
            samples.set("isotherm_alarms", &named, Some(count(alarms.iter().filter(is_one).count())));
        }
    }
}

fn record_axis(axis: &AxisStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("axis", &axis.name)]);
    samples.set("isotherm_axis_verified_cz_meters", &named, axis.verified_um.map(meters));
    samples.set("isotherm_axis_verified_age_seconds", &named, axis.verified_age_s);
    samples.set("isotherm_axis_unreachable", &named, Some(flag(axis.shown == Display::Unreachable)));
    samples.set("isotherm_axis_cz_meters", &named, Some(meters(axis.cz_um)));
    samples.set("isotherm_axis_raw_meters", &named, axis.raw_um.map(meters));
    samples.set("isotherm_axis_expected_meters", &named, axis.expected_um.map(meters));
    samples.set("isotherm_axis_armed", &named, Some(flag(axis.arming.armed)));
    samples.set("isotherm_axis_wanted", &named, Some(flag(axis.is_wanted())));
    if let Some(probe) = &axis.probe {
        record_probe(axis, probe, of, samples);
    }
    samples.set("isotherm_axis_limit_meters", &named, Some(meters(axis.limit_um)));
    samples.set("isotherm_axis_warned", &named, axis.warn_um.map(|_| flag(axis.warned)));
    samples.set("isotherm_axis_tripped", &named, axis.error_um.map(|_| flag(axis.tripped)));
    samples.set(
        "isotherm_axis_extrapolating",
        &named,
        axis.excess.map(|_| flag(axis.extrapolating.is_some())),
    );
    samples.set("isotherm_axis_excess_ratio", &named, axis.excess);
    for state in AxisState::NAMES.into_iter().chain(["waiting"]) {
        let named = of(&[("axis", &axis.name), ("state", state)]);
        samples.set("isotherm_axis_state", &named, Some(flag(axis.state == state)));
    }
    for (_, stage) in Stages::ALL {
        let named = of(&[("axis", &axis.name), ("stage", stage)]);
        samples.set("isotherm_guard_acting", &named, Some(flag(axis.acted.contains(&stage))));
    }
}

fn record_probe(axis: &AxisStatus, probe: &ProbeStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("axis", &axis.name)]);
    let residuals = || probe.history.iter().map(|(_, residual)| *residual);
    let number = count(probe.history.len());
    let rms = (number > 0.0).then(|| (residuals().map(|um| um * um).sum::<f64>() / number).sqrt());
    samples.set("isotherm_probe_correction_meters", &named, Some(meters(probe.correction_um)));
    samples.set("isotherm_probe_residual_meters", &named, residuals().next_back().map(meters));
    samples.set("isotherm_probe_residual_rms_meters", &named, rms.map(meters));
    samples.set("isotherm_probe_residuals", &named, Some(number));
    samples.set("isotherm_probe_warn_meters", &named, probe.warn_um.map(meters));
    samples.set("isotherm_probe_worse", &named, Some(flag(probe.worse.is_some())));
    for (place, gain) in probe.gains.iter().enumerate() {
        let term = place.to_string();
        let labels =
            [("axis", axis.name.as_str()), ("model", &gain.model), ("signal", &gain.signal), ("term", &term)];
        samples.set("isotherm_probe_gain_change", &of(&labels), Some(gain.change));
    }
}

fn record_signal(signal: &SignalStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("signal", &signal.name)]);
    samples.set(
        "isotherm_signal_value",
        &of(&[("signal", &signal.name), ("unit", signal.unit)]),
        signal.value,
    );
    samples.set("isotherm_signal_good", &named, Some(flag(signal.quality == "good")));
    samples.set("isotherm_signal_age_seconds", &named, signal.age_s);
}

fn record_device(device: &DeviceStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("device", &device.name), ("bus", &device.bus)]);
    samples.set("isotherm_device_up", &named, Some(flag(device.state == "ok")));
    samples.count("isotherm_device_requests_total", &named, device.requests);
    for blame in DeviceStatus::BLAMES {
        let named = of(&[("device", &device.name), ("bus", &device.bus), ("blame", blame)]);
        let count = device.failures.get(blame).copied().unwrap_or_default();
        samples.count("isotherm_device_failures_total", &named, count);
    }
}

fn record_bus(bus: &BusStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("bus", &bus.name)]);
    samples.set("isotherm_bus_connected", &named, Some(flag(bus.connected)));
    samples.count("isotherm_bus_cycles_total", &named, bus.cycles);
    samples.count("isotherm_bus_overruns_total", &named, bus.overruns);
}

fn record_output(output: &OutputStatus, of: Labels<'_>, samples: &mut Samples) {
    let named = of(&[("output", &output.name), ("axis", &output.axis)]);
    let unit = output.unit();
    samples.set("isotherm_output_verified", &named, Some(flag(output.state == "verified")));
    samples.count("isotherm_output_writes_total", &named, output.writes_done);
    for state in OutputStatus::STATES {
        let named = of(&[("output", &output.name), ("axis", &output.axis), ("state", state)]);
        samples.set("isotherm_output_state", &named, Some(flag(output.state == state)));
    }
    let named = of(&[("output", &output.name), ("axis", &output.axis), ("unit", unit)]);
    samples.set("isotherm_output_value", &named, output.value);
    samples.set("isotherm_output_late_write_wait_seconds", &named, output.waits_s);
}

fn meters(um: f64) -> f64 {
    um / 1e6
}

fn count(of: usize) -> f64 {
    f64::from(u32::try_from(of).unwrap_or(u32::MAX))
}

fn flag(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn labels(machine: &str, more: &[(&'static str, &str)]) -> String {
    let mut text = format!("machine=\"{}\"", escaped(machine));
    for (name, value) in more {
        // Writing to a string never fails.
        let _ = write!(text, ",{name}=\"{}\"", escaped(value));
    }
    text
}

/// Writes the histogram of the delays of each bus. The line `_sum` is missing, because the gateway counts delays and
/// does not add them up.
fn write_jitter(text: &mut String, status: &Status) {
    const NAME: &str = "isotherm_bus_jitter_seconds";
    if status.buses.is_empty() {
        return;
    }
    head(text, NAME, "Delay of the start of cycles.", "histogram");
    for bus in &status.buses {
        let named = labels(&status.machine, &[("bus", &bus.name)]);
        let buckets = bus.jitter_ms.iter().map(|(bound_ms, count)| (bound_ms / 1000.0, *count));
        write_buckets(text, NAME, &named, buckets);
    }
}

fn write_lock(text: &mut String, status: &Status) {
    const NAME: &str = "isotherm_lock_held_seconds";
    if status.lock_held.is_empty() {
        return;
    }
    head(
        text,
        NAME,
        "Time for which the state that the bus lines share was locked; one lock of seventeen is measured.",
        "histogram",
    );
    let named = labels(&status.machine, &[]);
    write_buckets(text, NAME, &named, status.lock_held.iter().copied());
}

fn head(text: &mut String, name: &str, help: &str, kind: &str) {
    text.push_str(&format!(
        "# HELP {name} {help}
# TYPE {name} {kind}
"
    ));
}

/// Writes the buckets of a histogram. Each bucket has its upper bound in seconds, and the number of values between the
/// previous bound and this bound.
fn write_buckets(text: &mut String, name: &str, named: &str, buckets: impl Iterator<Item = (f64, u64)>) {
    let mut total = 0_u64;
    for (bound, count) in buckets {
        total = total.saturating_add(count);
        if bound.is_finite() {
            text.push_str(&format!("{name}_bucket{{{named},le=\"{bound}\"}} {total}\n"));
        }
    }
    text.push_str(&format!(
        "{name}_bucket{{{named},le=\"+Inf\"}} {total}\n{name}_count{{{named}}} {total}\n"
    ));
}

fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}
