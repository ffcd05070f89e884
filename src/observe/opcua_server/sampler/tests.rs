use super::super::example::{event, status};
use super::super::tree::Tree;
use super::*;

/// Variables of a machine, and their samples.
struct Machine {
    tree: Tree,
    sampler: Sampler,
}

impl Machine {
    fn new() -> Machine {
        let mut machine = Machine { tree: Tree::of(&status()), sampler: Sampler::default() };
        let all = machine.sampler.refresh(&machine.tree.variables, status());
        assert_eq!(all.len(), machine.tree.variables.len(), "the first sample sets every variable");
        machine
    }

    fn refresh(&mut self, status: Status) -> Vec<String> {
        let changed = self.sampler.refresh(&self.tree.variables, status);
        changed.into_iter().map(|place| self.tree.variables[place].id.clone()).collect()
    }

    fn sample(&self, id: &str) -> &Sample {
        let place = self.tree.variables.iter().position(|variable| variable.id == id);
        self.sampler.sample(place.unwrap_or_else(|| panic!("there is no {id}"))).unwrap()
    }
}

fn at(text: &str) -> Moment {
    time::parse(text).unwrap()
}

#[test]
fn a_variable_has_the_value_the_quality_and_the_time_of_its_field() {
    let machine = Machine::new();
    let now = at("2026-07-02T12:00:00Z");
    let text = |text: &str| Value::Text(text.to_owned());
    let texts = |texts: &[&str]| Value::Texts(texts.iter().map(|text| (*text).to_owned()).collect());
    for (id, value, quality, time) in [
        ("signal.bed.value", Value::Number(21.25), Quality::Good, at("2026-07-02T11:59:59.5Z")),
        ("signal.air.value", Value::Null, Quality::SensorFailure, now),
        ("signal.air.quality", text("open-circuit"), Quality::Good, now),
        ("axis.z.verified_um", Value::Number(12.5), Quality::Good, at("2026-07-02T11:59:58Z")),
        ("axis.z.cz_um", Value::Number(12.5), Quality::Good, now),
        ("axis.z.warn_um", Value::Null, Quality::NoData, now),
        ("axis.z.acted", texts(&["step", "round"]), Quality::Good, now),
        ("axis.z.armed", Value::Flag(true), Quality::Good, now),
        ("axis.z.shown", text("active"), Quality::Good, now),
        ("axis.z.probe.correction_um", Value::Number(-1.5), Quality::Good, now),
        ("axis.z.probe.last.error_um", Value::Null, Quality::NoData, now),
        ("output.cnc_z.shares.share", Value::Number(10.5), Quality::Good, at("2026-07-02T11:59:58Z")),
        ("machine.log_dropped", Value::Count(3), Quality::Good, now),
        ("machine.ComponentName", text("研削盤"), Quality::Good, now),
        ("gateway.Model", text("isotherm"), Quality::Good, now),
        ("alarms.count", Value::Count(1), Quality::Good, now),
        ("alarms.cause", texts(&["open circuit"]), Quality::Good, now),
        ("alarms.hint", texts(&[""]), Quality::Good, now),
        ("events.text", texts(&["signal bed: good again", "signal air: open circuit"]), Quality::Good, now),
    ] {
        let found = machine.sample(id);
        assert_eq!((&found.value, found.quality, found.at), (&value, quality, time), "{id}");
    }
}

#[test]
fn only_what_has_changed_is_set_and_keeps_the_time_of_its_change() {
    let mut machine = Machine::new();
    let mut later = status();
    later.now = "2026-07-02T12:00:01Z".to_owned();
    // The reading and the register were read again; the axis has moved.
    later.signals[0].age_s = Some(0.5);
    later.axes[0].cz_um = 13.0;
    later.axes[0].verified_age_s = Some(3.0);
    later.outputs[0].age_s = Some(3.0);
    let changed = machine.refresh(later.clone());
    assert_eq!(changed, ["axis.z.cz_um", "signal.bed.value"]);
    assert_eq!(machine.sample("axis.z.cz_um").at, at("2026-07-02T12:00:01Z"));
    assert_eq!(machine.sample("axis.z.state").at, at("2026-07-02T12:00:00Z"));
    assert!(machine.refresh(later.clone()).is_empty());
    later.events.push(event("axis z: armed"));
    let changed = machine.refresh(later);
    assert_eq!(changed, ["events.count", "events.at", "events.kind", "events.level", "events.text"]);
}

#[test]
fn a_machine_with_thousands_of_events_has_short_arrays() {
    let mut machine = Machine::new();
    let mut busy = status();
    busy.events = (0..5000).map(|number| event(&format!("number {number}"))).collect();
    machine.refresh(busy);
    let Value::Texts(texts) = &machine.sample("events.text").value else { panic!("a list") };
    assert_eq!((texts.len(), texts[0].as_str()), (MOST_RECORDS, "number 4999"));
}

#[test]
fn every_reason_for_a_bad_reading_has_a_quality() {
    for (code, quality) in [
        ("good", Quality::Good),
        ("never-read", Quality::Waiting),
        ("stale", Quality::NoCommunication),
        ("link-down", Quality::NoCommunication),
        ("power-on-value", Quality::SensorFailure),
        ("too-fast", Quality::OutOfRange),
        ("switched-off", Quality::OutOfService),
        ("not-as-expected", Quality::Configuration),
        ("exception", Quality::DeviceFailure),
        ("a-reason-of-a-later-version", Quality::DeviceFailure),
    ] {
        assert_eq!(Quality::of_code(code), quality, "{code}");
    }
}

#[test]
fn a_value_that_can_no_longer_be_verified_is_the_last_usable_one() {
    use Quality::{Good, LastUsable, LastUsableNoAnswer};
    for (device, state, quality) in [
        ("ok", "verified", Good),
        ("ok", "off", Good),
        ("ok", "foreign", Good),
        ("ok", "unverified", LastUsable),
        ("ok", "interlocked", LastUsable),
        ("not-as-expected", "verified", LastUsable),
        ("lost", "verified", LastUsableNoAnswer),
        ("lost", "off", LastUsableNoAnswer),
        ("never-answered", "off", LastUsableNoAnswer),
    ] {
        let mut machine = Machine::new();
        let mut later = status();
        later.devices[0].state = device;
        later.outputs[0].device = "module".to_owned();
        later.outputs[0].state = state;
        machine.refresh(later);
        for (id, value) in
            [("output.cnc_z.value", 12.5), ("output.cnc_z.shares.share", 10.5), ("axis.z.verified_um", 12.5)]
        {
            let found = machine.sample(id);
            let sample = Sample { value: Value::Number(value), quality, at: at("2026-07-02T11:59:58Z") };
            assert_eq!(*found, sample, "{id}, device {device}, output {state}");
        }
        // The target is the gateway's own, and a value that is not there has no quality of its register.
        assert_eq!(machine.sample("axis.z.cz_um").quality, Good, "device {device}, output {state}");
        assert_eq!(machine.sample("output.cnc_z.applied").quality, Quality::NoData, "device {device}");
    }
}

#[test]
fn a_register_that_was_never_read_waits_for_its_first_value() {
    for (device, state, quality) in [
        ("never-answered", "off", Quality::Waiting),
        ("never-answered", "unknown", Quality::Waiting),
        ("ok", "unknown", Quality::Waiting),
        ("ok", "off", Quality::NoData),
    ] {
        let mut machine = Machine::new();
        let mut later = status();
        later.devices[0].state = device;
        let output = &mut later.outputs[0];
        (output.device, output.state) = ("module".to_owned(), state);
        (output.value, output.age_s) = (None, None);
        (later.axes[0].verified_um, later.axes[0].verified_age_s) = (None, None);
        machine.refresh(later);
        for id in ["output.cnc_z.value", "axis.z.verified_um"] {
            let found = machine.sample(id);
            assert_eq!((&found.value, found.quality), (&Value::Null, quality), "{id}: {device}, {state}");
        }
    }
}

#[test]
fn the_quality_of_an_axis_is_that_of_the_output_from_which_its_value_was_read() {
    let mut machine = Machine::new();
    let mut later = status();
    // Neither the output of another axis nor a slope contains this value.
    for (axis, writes) in [("x", "offset"), ("z", "slope")] {
        let mut other = later.outputs[0].clone();
        (other.axis, other.writes, other.state) = (axis.to_owned(), writes, "unverified");
        later.outputs.insert(0, other);
    }
    machine.refresh(later.clone());
    assert_eq!(machine.sample("axis.z.verified_um").quality, Quality::Good);
    later.outputs.clear();
    machine.refresh(later);
    assert_eq!(machine.sample("axis.z.verified_um").quality, Quality::Good);
}
