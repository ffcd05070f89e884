//! Conversion of the state of the gateway to metrics for publishing.
//!
//! Values that always change, for example counts of requests, are left out, because they would be published
//! every second. Prometheus can read these values. The age of a verified value is published only in steps.

use std::time::Duration;

use super::moment;
use crate::observe::status::{AxisStatus, BusStatus, DeviceStatus, OutputStatus, SignalStatus, Status};
use isotherm_core::codec::DataType;
use isotherm_core::quantity::Moment;
use isotherm_plant::{Metric, Subject, Value};
use isotherm_profile::{Profile, Signal};

/// Minimum increase, in seconds, after which the age of a verified value is published again.
const AGES_BY_S: f64 = 30.0;
/// Minimum change of a length, µm, after which the length is published again: half of the displayed resolution.
const RESOLUTION_UM: f64 = 0.05;

/// Returns for each signal the minimum change after which it is published again, in the profile's order. This is half
/// of the signal's resolution, or zero for a floating-point number.
pub(super) fn resolutions(profile: &Profile) -> Vec<f64> {
    let resolution = |signal: &Signal| match signal.encoding.data_type {
        DataType::F32 | DataType::F64 => 0.0,
        // The device may make its counts smaller.
        _ if signal.scale_from.is_some() => 0.0,
        _ => signal.encoding.scale.get().abs() / 2.0,
    };
    profile.signals.iter().map(resolution).collect()
}

/// Converts a status of the gateway to metrics. `resolutions` are the results of [`resolutions`].
pub(super) fn metrics(status: &Status, resolutions: &[f64]) -> Vec<Metric> {
    let mut list = List { now: moment(&status.now).unwrap_or_default(), metrics: Vec::new() };
    list.gateway(status);
    status.axes.iter().for_each(|axis| list.axis(axis));
    for (signal, resolution) in status.signals.iter().zip(resolutions) {
        list.signal(signal, *resolution);
    }
    status.outputs.iter().for_each(|output| list.output(output));
    status.devices.iter().for_each(|device| list.device(device));
    status.buses.iter().for_each(|bus| list.bus(bus));
    list.metrics
}

struct List {
    now: Moment,
    metrics: Vec<Metric>,
}

/// Builder for the metrics of one subject, for example of an axis.
struct Of<'l> {
    list: &'l mut List,
    subject: Subject,
    at: Moment,
}

impl List {
    fn of(&mut self, subject: Subject) -> Of<'_> {
        let at = self.now;
        Of { list: self, subject, at }
    }

    fn gateway(&mut self, status: &Status) {
        let mut of = self.of(Subject::Gateway);
        of.text("version", status.version);
        of.flag("ready", status.ready);
        of.flag("stopping", status.stopping);
        of.flag("dry_run", status.dry_run);
        of.text("clock", status.clock);
        of.count("alarms", u64::try_from(status.alarms.len()).unwrap_or(u64::MAX));
        of.count("log_dropped", status.log_dropped);
    }

    fn axis(&mut self, axis: &AxisStatus) {
        let mut of = self.of(Subject::Axis(axis.name.clone()));
        // The value in the control comes first, then the decision.
        of.micron("verified_um", axis.verified_um);
        of.real("verified_age_s", axis.verified_age_s.map(f64::round), "s", AGES_BY_S);
        of.text("shown", axis.shown.name());
        of.text("state", axis.state);
        of.text("why", &axis.why.to_string());
        of.text("model", axis.model.as_deref().unwrap_or_default());
        of.flag("armed", axis.arming.armed);
        of.flag("warned", axis.warned);
        of.flag("tripped", axis.tripped);
        of.flag("extrapolating", axis.extrapolating.is_some());
        of.micron("cz_um", Some(axis.cz_um));
        of.micron("raw_um", axis.raw_um);
        of.micron("expected_um", axis.expected_um);
        of.micron("limit_um", Some(axis.limit_um));
        let probe = axis.probe.as_ref();
        of.flag("worse", probe.is_some_and(|probe| probe.worse.is_some()));
        of.micron("correction_um", probe.map(|probe| probe.correction_um));
        of.micron("residual_um", probe.and_then(|probe| probe.history.last()).map(|(_, residual)| *residual));
        // An axis that does not learn has no such values.
        let Some(learned) = &axis.learned else { return };
        let candidate = learned.candidate.as_ref();
        of.flag("candidate_better", candidate.is_some_and(|candidate| candidate.better));
        of.micron("candidate_um", candidate.and_then(|candidate| candidate.candidate_um));
        of.micron("in_use_um", candidate.and_then(|candidate| candidate.in_use_um));
    }

    fn signal(&mut self, signal: &SignalStatus, resolution: f64) {
        let mut of = self.of(Subject::Signal(signal.name.clone()));
        let age = signal.age_s.and_then(|age| Duration::try_from_secs_f64(age).ok());
        of.at = of.at.before(age.unwrap_or_default());
        of.real("value", signal.value, signal.unit, resolution);
        of.text("quality", signal.quality);
        of.text("reason", &signal.reason);
    }

    fn output(&mut self, output: &OutputStatus) {
        let mut of = self.of(Subject::Output(output.name.clone()));
        let unit = match output.unit() {
            "µm" => "um",
            unit => unit,
        };
        of.real("value", output.value, unit, 0.0);
        of.text("state", output.state);
    }

    fn device(&mut self, device: &DeviceStatus) {
        let mut of = self.of(Subject::Device(device.name.clone()));
        of.text("state", device.state);
        of.text("fault", &device.fault);
    }

    fn bus(&mut self, bus: &BusStatus) {
        let mut of = self.of(Subject::Bus(bus.name.clone()));
        of.flag("connected", bus.connected);
        of.count("overruns", bus.overruns);
    }
}

impl Of<'_> {
    fn add(
        &mut self,
        name: &'static str,
        kind: Value,
        value: Option<Value>,
        unit: &'static str,
        resolution: f64,
    ) {
        let (subject, at) = (self.subject.clone(), self.at);
        self.list.metrics.push(Metric { subject, name, value, kind, unit, resolution, at });
    }

    fn text(&mut self, name: &'static str, text: &str) {
        self.add(name, Value::Text(String::new()), Some(Value::Text(text.to_owned())), "", 0.0);
    }

    fn flag(&mut self, name: &'static str, flag: bool) {
        self.add(name, Value::Flag(false), Some(Value::Flag(flag)), "", 0.0);
    }

    fn count(&mut self, name: &'static str, count: u64) {
        self.add(name, Value::Count(0), Some(Value::Count(count)), "", 0.0);
    }

    fn micron(&mut self, name: &'static str, micron: Option<f64>) {
        // Rounds to the nanometre. Further digits are rounding errors.
        let micron = micron.map(|micron| (micron * 1000.0).round() / 1000.0);
        self.real(name, micron, "um", RESOLUTION_UM);
    }

    fn real(&mut self, name: &'static str, value: Option<f64>, unit: &'static str, resolution: f64) {
        let value = value.filter(|value| value.is_finite()).map(Value::Real);
        self.add(name, Value::Real(0.0), value, unit, resolution);
    }
}
