//! Pages of a status for the web page of a machine with many devices. Each page contains parts of the lists of the
//! status.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap, HashSet};

use serde::Serialize;

use super::events::{Alarm, Entry};
use super::status::{
    ArmingStatus, AxisStatus, BrokerStatus, BusStatus, DeviceStatus, FormerRegisterStatus, OutputStatus,
    SignalStatus, Status,
};
use isotherm_profile::Overridden;

/// Maximum number of devices on a page.
const DEVICES: usize = 50;
/// Maximum number of axes in the same state that every page contains. The web page shows at most four of
/// their names, and `…` if there are more.
const MOST_OF_A_KIND: usize = 5;
/// Maximum number of alarms on a page. If a network switch fails, each device of a large machine may have alarms.
const ALARMS: usize = 100;

/// Page of a status: some devices with their buses, signals, outputs and axes, and counts of the whole machine, for
/// example of its faulty devices. All other fields have the same meaning as in [`Status`].
#[derive(Debug, Serialize)]
pub(super) struct StatusPage<'s> {
    machine: &'s str,
    label: &'s str,
    description: &'s str,
    version: &'s str,
    now: &'s str,
    zone: &'s str,
    clock: &'s str,
    uptime_s: f64,
    machine_on_s: Option<f64>,
    overridden: &'s [Overridden],
    profile_changed: &'s [String],
    dry_run: bool,
    stopping: bool,
    ready: bool,
    axes: Vec<&'s AxisStatus>,
    signals: Vec<&'s SignalStatus>,
    buses: Vec<&'s BusStatus>,
    devices: &'s [DeviceStatus],
    outputs: Vec<&'s OutputStatus>,
    left: &'s [FormerRegisterStatus],
    log_dropped: u64,
    alarms: Vec<&'s Alarm>,
    events: &'s [Entry],
    event_counts: &'s BTreeMap<&'static str, u64>,
    mqtt: Option<&'s BrokerStatus>,
    page: PageNumber,
    /// Counts, alarms and some axes of the whole machine; `None` if the status has only one page.
    #[serde(skip_serializing_if = "Option::is_none")]
    whole: Option<WholeMachine<'s>>,
}

/// Number of a page, counted from 1, and the number of all pages.
#[derive(Debug, Serialize)]
struct PageNumber {
    number: usize,
    of: usize,
}

/// Part of the status that every page contains: counts, alarms and some axes of the whole machine.
#[derive(Debug, Serialize)]
struct WholeMachine<'s> {
    /// Some axes in each state, at most [`MOST_OF_A_KIND`].
    axes: Vec<&'s AxisStatus>,
    /// First output to which another program has written; empty if no other program has written.
    outputs: Vec<&'s OutputStatus>,
    /// Number of devices in another state than `ok`.
    lost: usize,
    /// Number of signals with another quality than `good`.
    bad: usize,
    /// Number of all alarms. The page contains only the most urgent alarms.
    alarm_count: usize,
    /// Number of the page that contains the subject of an alarm, by the `id` of the alarm. Alarms whose subject is on
    /// this page or on no page are left out.
    alarm_pages: BTreeMap<&'s str, usize>,
}

impl StatusPage<'_> {
    /// Returns a page of the status. If `number` is beyond the last page, the last page is returned. A machine with few
    /// devices has one page.
    pub(super) fn of(status: &Status, number: usize) -> StatusPage<'_> {
        let of = status.devices.len().div_ceil(DEVICES).max(1);
        let number = number.clamp(1, of);
        let first = (number - 1) * DEVICES;
        let devices = &status.devices[first..status.devices.len().min(first + DEVICES)];
        let names: HashSet<&str> = devices.iter().map(|device| device.name.as_str()).collect();
        let lines: HashSet<&str> = devices.iter().map(|device| device.bus.as_str()).collect();
        let is_here = |device: &str| names.contains(device);
        let outputs: Vec<&OutputStatus> =
            status.outputs.iter().filter(|output| of == 1 || is_here(&output.device)).collect();
        let driven: HashSet<&str> = outputs.iter().map(|output| output.axis.as_str()).collect();
        // An axis without an output is on the first page.
        let has_output: HashSet<&str> = status.outputs.iter().map(|output| output.axis.as_str()).collect();
        let is_first = |axis: &str| number == 1 && !has_output.contains(axis);
        let axes = status.axes.iter().filter(|axis| driven.contains(&*axis.name) || is_first(&axis.name));
        let alarms: Vec<&Alarm> =
            if of == 1 { status.alarms.iter().collect() } else { most_urgent(&status.alarms) };
        let whole = (of > 1).then(|| WholeMachine::of(status, number, &alarms));
        StatusPage {
            machine: &status.machine,
            label: &status.label,
            description: &status.description,
            version: status.version,
            now: &status.now,
            zone: &status.zone,
            clock: status.clock,
            uptime_s: status.uptime_s,
            machine_on_s: status.machine_on_s,
            overridden: &status.overridden,
            profile_changed: &status.profile_changed,
            dry_run: status.dry_run,
            stopping: status.stopping,
            ready: status.ready,
            axes: axes.collect(),
            signals: status.signals.iter().filter(|signal| of == 1 || is_here(&signal.device)).collect(),
            buses: status.buses.iter().filter(|bus| of == 1 || lines.contains(&*bus.name)).collect(),
            devices,
            outputs,
            left: &status.left,
            log_dropped: status.log_dropped,
            alarms,
            events: &status.events,
            event_counts: &status.event_counts,
            mqtt: status.mqtt.as_ref(),
            page: PageNumber { number, of },
            whole,
        }
    }
}

/// Returns the most urgent alarms, at most [`ALARMS`]. Errors come first. Among alarms of equal severity,
/// alarms without an acknowledgement come first, then the newest alarms.
fn most_urgent(alarms: &[Alarm]) -> Vec<&Alarm> {
    let mut alarms: Vec<&Alarm> = alarms.iter().collect();
    // The status has the newest alarms first, and this sort keeps the order of equals.
    alarms.sort_by_key(|alarm| (Reverse(alarm.level), alarm.acknowledged.is_some()));
    alarms.truncate(ALARMS);
    alarms
}

/// Returns the number of the page of each alarm whose subject is on another page than `number`. The key is the `id` of
/// the alarm.
fn pages_elsewhere<'s>(status: &'s Status, number: usize, alarms: &[&'s Alarm]) -> BTreeMap<&'s str, usize> {
    if alarms.is_empty() {
        return BTreeMap::new();
    }
    let pages = pages_by_name(status);
    let elsewhere = |alarm: &&'s Alarm| {
        // The subject ends with a name, as in `arming of axis z`.
        let name = alarm.id.rsplit(' ').next()?;
        let page = *pages.get(name)?;
        (page != number).then_some((alarm.id.as_str(), page))
    };
    alarms.iter().filter_map(elsewhere).collect()
}

/// Returns the number of the first page of each device, bus, signal, output and axis. The key is the name.
fn pages_by_name(status: &Status) -> HashMap<&str, usize> {
    let devices = status.devices.iter().enumerate();
    let devices: HashMap<&str, usize> =
        devices.map(|(place, device)| (device.name.as_str(), place / DEVICES + 1)).collect();
    let buses = status.devices.iter().map(|device| (&device.bus, &device.name));
    let signals = status.signals.iter().map(|signal| (&signal.name, &signal.device));
    let outputs = status.outputs.iter().map(|output| (&output.name, &output.device));
    let driven = status.outputs.iter().map(|output| (&output.axis, &output.device));
    let mut pages = devices.clone();
    for (name, device) in buses.chain(signals).chain(outputs).chain(driven) {
        if let Some(page) = devices.get(device.as_str()) {
            pages.entry(name).or_insert(*page);
        }
    }
    for axis in &status.axes {
        pages.entry(&axis.name).or_insert(1);
    }
    pages
}

impl<'s> WholeMachine<'s> {
    fn of(status: &'s Status, number: usize, alarms: &[&'s Alarm]) -> WholeMachine<'s> {
        let mut found: HashMap<_, usize> = HashMap::new();
        let is_among_the_first = |axis: &&AxisStatus| {
            let ArmingStatus { armed, release, .. } = axis.arming;
            let kind = (axis.display(), axis.acted.contains(&"limit"), armed, release, axis.has_model);
            let count = found.entry(kind).or_default();
            *count += 1;
            *count <= MOST_OF_A_KIND
        };
        WholeMachine {
            axes: status.axes.iter().filter(is_among_the_first).collect(),
            outputs: status.outputs.iter().find(|output| output.state == "foreign").into_iter().collect(),
            lost: status.devices.iter().filter(|device| device.state != "ok").count(),
            bad: status.signals.iter().filter(|signal| signal.quality != "good").count(),
            alarm_count: status.alarms.len(),
            alarm_pages: pages_elsewhere(status, number, alarms),
        }
    }
}
