//! Dependencies of axes and bus lines, determined once from the profile. The time for a read then depends only on the
//! axes that use the values.

use std::collections::HashSet;
use std::sync::Arc;
use std::time::Duration;

use isotherm_core::codec::Address;
use isotherm_core::compensation::model::Model;
use isotherm_core::reading::SignalId;
use isotherm_profile::{Axis, AxisId, BusId, DeviceId, Members, Output, Profile};

/// Minimum period of the reports about changed signals, if the profile has no axis.
const SHORTEST_REPORT_PERIOD: Duration = Duration::from_secs(1);

/// Settings that never change while the gateway runs.
#[derive(Clone)]
pub(in crate::gateway) struct RunConfig {
    pub(in crate::gateway) profile: Arc<Profile>,
    pub(in crate::gateway) dependents: Arc<Dependents>,
    pub(in crate::gateway) dry_run: bool,
}

/// Dependencies of axes and bus lines. Each list is in ascending order and has no duplicates.
#[derive(Debug)]
pub(in crate::gateway) struct Dependents {
    /// Signals that each model of each axis reads: first index axis, second index model.
    pub(in crate::gateway) inputs: Vec<Vec<Vec<SignalId>>>,
    /// Axes whose error is measured by a probing cycle of the control.
    pub(in crate::gateway) probed: Vec<AxisId>,
    /// Axes with a probing cycle, for each bus line: the line reads the measured error, or the trigger that announces
    /// the error.
    pub(in crate::gateway) probed_on: Vec<Vec<AxisId>>,
    /// Whether each bus line reads a signal that shows a restart of a control: a boot counter or `machine.on`.
    pub(in crate::gateway) shows_restarts: Vec<bool>,
    /// Whether each bus line may have to write after a step of the axes. Also `true` for a line that receives
    /// `machine.on` in CAN frames, because no read then triggers its check for a restart of the control.
    pub(in crate::gateway) follows_steps: Vec<bool>,
    /// Bus lines on which axes are stepped (calculated): the line of the axis's first input, or of its output if it
    /// has no input. Without an axis, this is the line of the first signal, and its task reports the changes of all
    /// signals.
    pub(in crate::gateway) stepping: HashSet<BusId>,
    /// Outputs on each bus line.
    pub(in crate::gateway) outputs_on: Members,
    /// Devices from which the gateway reads a position that an output corrects.
    pub(in crate::gateway) corrected: HashSet<DeviceId>,
    /// Bus lines on which the gateway reads a position that it corrects on another line.
    pub(in crate::gateway) corrected_elsewhere: HashSet<BusId>,
    /// Shortest `max_age` of all signals of the profile.
    pub(in crate::gateway) shortest_age: Duration,
    /// Shortest period of the calculation of an axis. `None` if the profile has no axis.
    pub(in crate::gateway) shortest_period: Option<Duration>,
    /// Period of the reports about changed signals, if the profile has no axis: the shortest period of the devices,
    /// but at least one second. `None` if the profile has an axis, because a step of the axes then reports the
    /// changes.
    pub(in crate::gateway) reports_every: Option<Duration>,
}

impl Dependents {
    pub(in crate::gateway) fn new(profile: &Profile) -> Dependents {
        let line_of = |device: DeviceId| profile.device(device).bus;
        let line = |signal: SignalId| line_of(profile.signal(signal).device);
        let inputs = |axis: &Axis| axis.settings.models.iter().map(Model::signals).collect();
        let mut probed = Vec::new();
        let mut probed_on = vec![Vec::new(); profile.buses.len()];
        for (place, axis) in profile.axes.iter().enumerate() {
            probed.extend(axis.probe_input.map(|_| AxisId(place)));
            let read = axis.probe_input.map(|input| [Some(input.signal), input.trigger]);
            for signal in read.into_iter().flatten().flatten() {
                add(&mut probed_on[line(signal).0], AxisId(place));
            }
        }
        let mut shows_restarts = vec![false; profile.buses.len()];
        let counters = profile.outputs.iter().filter_map(|output| output.boot_counter);
        for signal in counters.chain(profile.machine.on) {
            shows_restarts[line(signal).0] = true;
        }
        let mut follows_steps = vec![false; profile.buses.len()];
        for output in profile.outputs.iter().filter(|output| follows_steps_of_axes(output)) {
            follows_steps[profile.device(output.device).bus.0] = true;
        }
        let is_received = |signal: &SignalId| matches!(profile.signal(*signal).address, Address::Frame(_));
        if let Some(signal) = profile.machine.on.filter(is_received) {
            follows_steps[line(signal).0] = true;
        }
        // For each output that corrects a position: the device from which it is read, and the device to which it is
        // written.
        let of_position =
            |output: &Output| Some((profile.signal(output.writes.position()?).device, output.device));
        let positions = || profile.outputs.iter().filter_map(of_position);
        let elsewhere = positions().map(|(from, to)| (line_of(from), line_of(to)));
        let outputs = profile.outputs.iter().enumerate();
        let polled = profile.devices.iter().map(|device| device.every).min().unwrap_or_default();
        Dependents {
            inputs: profile.axes.iter().map(inputs).collect(),
            probed,
            probed_on,
            shows_restarts,
            follows_steps,
            stepping: home_lines(profile).collect(),
            outputs_on: outputs.map(|(place, output)| (line_of(output.device).0, place)).collect(),
            corrected: positions().map(|(from, _)| from).collect(),
            corrected_elsewhere: elsewhere.filter(|(from, to)| from != to).map(|(from, _)| from).collect(),
            shortest_age: profile.shortest_age(),
            shortest_period: profile.axes.iter().map(|axis| axis.settings.every).min(),
            reports_every: profile.axes.is_empty().then(|| polled.max(SHORTEST_REPORT_PERIOD)),
        }
    }
}

/// Returns whether a step of the axes may make a write of the output necessary. A corrected position is written after
/// each read instead. Only the dashes of its display depend on a step.
fn follows_steps_of_axes(output: &Output) -> bool {
    output.set.is_some() || output.writes.position().is_none() || output.display.stale.is_some()
}

/// Returns the bus line on which each axis is stepped. If the profile has no axis, returns the line of the first
/// signal.
fn home_lines(profile: &Profile) -> impl Iterator<Item = BusId> {
    let mut outputs = vec![None; profile.axes.len()];
    for output in profile.outputs.iter().rev() {
        outputs[output.axis.0] = Some(output.device);
    }
    let homes = profile.axes.iter().zip(outputs).map(move |(axis, output)| {
        let input = axis.settings.models.iter().flat_map(Model::signals).next();
        let input = input.map(|signal| profile.signal(signal).device);
        input.or(output).map_or(BusId(0), |device| profile.device(device).bus)
    });
    let first = profile.signals.first().filter(|_| profile.axes.is_empty());
    homes.chain(first.map(|signal| profile.device(signal.device).bus))
}

fn add<T: Ord>(list: &mut Vec<T>, item: T) {
    if let Err(place) = list.binary_search(&item) {
        list.insert(place, item);
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use super::super::test_profiles::bench;
    use super::*;

    const SIGNALS: &str = r#"
        [signal.bed]
        device = "module"
        register = "input:0"
        type = "i16"
        scale = 0.1
        unit = "degC"
        max_age = "5s"
        [signal.place]
        device = "module"
        register = "input:1"
        type = "i16"
        scale = 0.01
        unit = "mm"
        max_age = "5s"
    "#;

    #[test]
    fn a_step_wakes_no_line_that_only_corrects_positions_or_only_reads() {
        let mut text = SIGNALS.to_owned();
        let corrected = "writes = \"corrected\"\nposition = \"place\"\nscale = 0.01";
        let with_dashes = format!("{corrected}\nstale = {{ register = \"holding:50\", text = \"----\" }}");
        let offset = "writes = \"offset\"\nscale = 1.0";
        let lines = [("cnc", offset), ("display", with_dashes.as_str()), ("readout", corrected)];
        for (port, (name, keys)) in (1503..).zip(lines) {
            write!(
                text,
                "[bus.{name}]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:{port}\"\n\
                 [device.{name}]\nbus = \"{name}\"\nunit = 1\n\
                 [axis.{name}]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\nevery = \"1s\"\n\
                 on_fault = {{ action = \"hold\" }}\n\
                 [[axis.{name}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
                 terms = [ {{ signal = \"bed\", gain = 1.0, reference = 20.0 }} ]\n\
                 [output.{name}]\naxis = \"{name}\"\ndevice = \"{name}\"\nregister = \"holding:10\"\n\
                 type = \"i16\"\nverify = \"echo\"\n{keys}\n"
            )
            .unwrap();
        }
        let profile = bench(&text);
        let follows = Dependents::new(&profile).follows_steps;
        let buses = profile.buses.iter().zip(follows).filter(|(_, follows)| *follows);
        let mut names: Vec<&str> = buses.map(|(bus, _)| bus.name.as_str()).collect();
        names.sort_unstable();
        assert_eq!(names, ["cnc", "display"]);
    }

    #[test]
    fn a_step_wakes_the_line_that_receives_machine_on_in_a_frame() {
        let frame = r#"
            [bus.can]
            type = "can"
            interface = "can0"
            [device.plc]
            bus = "can"
            [signal.power]
            device = "plc"
            frame = { id = 0x300, start = 0, length = 1 }
        "#;
        let mut profile = bench(&format!("{SIGNALS}{frame}"));
        // Without the key, with a signal that is read, and with one that is received.
        for (on, follows) in [(None, false), (Some("bed"), false), (Some("power"), true)] {
            let named = |name: &str| profile.signals.iter().position(|signal| signal.name == name);
            profile.machine.on = on.and_then(named).map(SignalId);
            assert_eq!(Dependents::new(&profile).follows_steps, [false, follows], "{on:?}");
        }
    }
}
