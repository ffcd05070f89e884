//! Checks of the devices on one bus line. A check compares a register with the value that `verify` in the profile
//! requires. CANopen nodes are also set up here, before each of their starts.
//!
//! The gateway reads the checks of a device before it arms an axis that needs the device. After each break of
//! the continuity, it reads the checks again. A break is an event after which another device or other
//! settings are possible. While a check does not pass, the gateway reads the checks every few seconds.
//!
//! While the device is confirmed (all checks have passed), each check is read once in its period. This detects
//! settings that are changed at the device. For example, a module that is changed from tenths of a degree to whole
//! degrees still sends plausible temperatures.

use std::time::Duration;

use super::can::Can;
use crate::fieldbus::error::{CallerFault, Fault, PeerFault};
use crate::fieldbus::kinds;
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::shared::line_handle::LineHandle;
use crate::gateway::shared::namespaces::NamespaceWatch;
use crate::gateway::shared::state::GatewayState;
use crate::observe::events::Event;
use isotherm_core::codec::Encoded;
use isotherm_core::continuity::{CheckFailure, Continuity, Difference, sentence};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::preview::checks;
use isotherm_profile::{BusId, Device, DeviceId, Expected, Profile, Setup};

/// Delay before the checks of a silent device are read again. It is added to the back-off of the line (waiting time
/// after failures).
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// Delay before the checks of a device with wrong settings are read again.
const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// Number of unanswered attempts after which the gateway assumes that the device does not have the register of a
/// check. The device must have answered its polls in between.
const ASSUMED_SILENT: u32 = 3;

/// Modbus exception codes of a device that will answer later: acknowledge and busy.
const ACKNOWLEDGE: u8 = 5;
const BUSY: u8 = 6;

/// Reads the checks of the devices on one line.
#[derive(Debug)]
pub(super) struct Inspector {
    bus: BusId,
    inspections: Vec<Inspection>,
    /// Whether the line is a connection to an OPC UA server, whose namespaces must be checked.
    is_server: bool,
    namespaces: NamespaceWatch,
}

/// State of the checks of one device.
#[derive(Debug)]
struct Inspection {
    device: DeviceId,
    due: Moment,
    /// Number of consecutive attempts to read the checks that gave no value, and the time of the last such attempt.
    missed: (u32, Moment),
    /// Whether the gateway regularly receives data from the device: answers to polls, or CAN frames.
    is_received: bool,
    /// Whether the gateway also polls signals of the device, in addition to its checks.
    is_polled: bool,
    identified: Identified,
    /// Number of resets of the device before its last setup. `None` if the gateway has not set up the device.
    set_up: Option<u64>,
    /// Number of breaks in the device's continuity at the last time when all checks were read.
    read_after: u64,
    /// State of the repeated reads of each check, in the order of the profile.
    again: Vec<Repetition>,
}

/// Means by which the gateway verifies that a device is the expected device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Identified {
    ByChecks,
    /// The device has no checks. Only the OPC UA namespaces of its server identify the device. `is_new`: the
    /// namespaces have not been compared yet since the line task began.
    ByNamespaces {
        is_new: bool,
    },
}

/// Repeated reads of one check while the device of the check is confirmed.
#[derive(Clone, Copy, Debug)]
struct Repetition {
    period: Duration,
    due: Moment,
    /// Whether the check has passed in the present round. A round ends when all checks of the device have passed.
    has_passed: bool,
    /// Number of consecutive attempts to read this check that gave no value, and the time of the last such attempt.
    unread: (u32, Moment),
}

/// Result of an attempt to read all checks of a device.
enum CheckRound {
    /// The checks were read. The number is the count of breaks in the continuity before the reads. The list contains
    /// the differences from the expected values.
    Known(u64, Vec<Difference>),
    /// The device does not answer. Other code reports the lost device.
    NoAnswer,
    /// The continuity of the device was broken between two answers, so the answers may come from different devices.
    Broken,
}

impl Inspector {
    pub(super) fn new(profile: &Profile, bus: BusId, start: Moment) -> Inspector {
        // The nodes of a server are identified by their namespaces.
        let is_server = kinds::of(profile.bus(bus).transport).has_namespaces;
        let checked = profile.devices_on(bus).filter(|(_, device)| is_server || device.is_checked());
        let stretch = checks::stretch(profile, bus);
        let inspection = |(id, device): (DeviceId, &Device)| {
            let has_requests = !profile.requests(id).is_empty();
            let is_received = device.can.is_some() || has_requests;
            let is_polled = has_requests || profile.signals_of(id).next().is_some();
            let identified = match device.is_checked() {
                true => Identified::ByChecks,
                false => Identified::ByNamespaces { is_new: true },
            };
            let repetition = |check: &Expected| {
                let period = checks::period(check, stretch);
                Repetition { period, due: start, has_passed: false, unread: (0, start) }
            };
            let again = device.verify.iter().map(repetition).collect();
            Inspection {
                device: id,
                due: start,
                missed: (0, start),
                is_received,
                is_polled,
                identified,
                set_up: None,
                read_after: 0,
                again,
            }
        };
        let inspections = checked.map(inspection).collect();
        Inspector { bus, inspections, is_server, namespaces: NamespaceWatch::default() }
    }

    pub(in crate::gateway) fn is_empty(&self) -> bool {
        self.inspections.is_empty()
    }

    /// Reads the checks that are due, for each device of the line. Returns after one check of a confirmed device,
    /// because another action of the line may be due.
    pub(super) async fn inspect(&mut self, line: &mut DeviceLine, shared: &LineHandle, can: Option<&Can>) {
        self.check_namespaces(shared);
        for place in 0..self.inspections.len() {
            let (inspection, now) = (&mut self.inspections[place], shared.clock.now());
            let id = inspection.device;
            if let Identified::ByNamespaces { is_new } = &mut inspection.identified
                && !self.namespaces.is_lost()
            {
                // The previous task of the line may have found the device changed.
                if std::mem::take(is_new) && !shared.core().devices.is_confirmed(id) {
                    let breaks = shared.core().devices.of(id).breaks_so_far();
                    verified(shared, id, breaks, Vec::new());
                }
                continue;
            }
            if line.is_backing_off(id, now) {
                continue;
            }
            if shared.core().devices.is_confirmed(id) {
                // Only one check is read in one turn of the line task, because a heartbeat or a position may be due.
                if inspection.read_again(line, shared, can, now).await {
                    return;
                }
                continue;
            }
            let breaks = shared.core().devices.of(id).breaks_so_far();
            let is_due = now >= inspection.due || inspection.read_after != breaks;
            if !is_due || inspection.waits_for_polls(shared) {
                continue;
            }
            if self.is_server && self.namespaces.is_lost() {
                // The server may have loaded the namespace in the meantime.
                (inspection.due, inspection.read_after) = (now.after(LOOK_AGAIN), breaks);
                if line.request_unverified(id, Request::read_namespaces()).await.is_err() {
                    continue;
                }
                self.check_namespaces(shared);
            }
            let known = self.namespaces.differences(&shared.profile.path, &shared.profile.device(id).name);
            let inspection = &mut self.inspections[place];
            round_begins(shared, id);
            let found = inspection.read_all(line, shared, can, (breaks, known)).await;
            inspection.take_round(shared, found);
        }
    }

    /// Compares the namespaces of an OPC UA server with the profile. If a namespace cannot be identified, reports the
    /// devices as changed. Otherwise makes the checks of the devices due, and treats each device without checks as
    /// verified.
    fn check_namespaces(&mut self, shared: &LineHandle) {
        let Some(table) = shared.core().devices.namespaces(self.bus) else { return };
        if !self.namespaces.check(shared.profile.bus(self.bus), &table, &mut shared.core()) {
            return;
        }
        for inspection in &mut self.inspections {
            let id = inspection.device;
            inspection.due = shared.clock.now();
            let found = self.namespaces.differences(&shared.profile.path, &shared.profile.device(id).name);
            let (breaks, is_confirmed) = {
                let core = shared.core();
                (core.devices.of(id).breaks_so_far(), core.devices.is_confirmed(id))
            };
            if is_confirmed != found.is_empty() && (is_confirmed || !inspection.has_checks()) {
                verified(shared, id, breaks, found);
            }
        }
    }
}

impl Inspection {
    fn has_checks(&self) -> bool {
        self.identified == Identified::ByChecks
    }

    /// Returns whether the checks must wait for a poll. The result is true if the device did not answer a check, and
    /// no poll since then was answered.
    fn waits_for_polls(&self, shared: &LineHandle) -> bool {
        let core = shared.core();
        let lost = core.device_health.devices[self.device.0].lost.as_ref();
        self.is_received && self.missed.0 > 0 && lost.is_some_and(|lost| lost.answers_since.is_none())
    }

    /// Reads the check that has been due for the longest time, of a confirmed device. Returns true if a check was
    /// due. If the value is not the expected one, reads all checks again. Also reads all checks again after several
    /// attempts without a value, if the device delivered other values in between.
    async fn read_again(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        can: Option<&Can>,
        now: Moment,
    ) -> bool {
        let due = (0..self.again.len()).filter(|place| self.again[*place].due <= now);
        let Some(place) = due.min_by_key(|place| self.again[*place].due) else { return false };
        let (attempts, last) = self.again[place].unread;
        // If the polls are refused or not answered as well, nothing is known about this register.
        if self.is_polled && attempts > 0 && shared.core().devices.of(self.device).delivered_at() <= last {
            self.again[place].due = now.after(ASK_AGAIN);
            return false;
        }
        if self.again.iter().all(|again| !again.has_passed) {
            round_begins(shared, self.device);
        }
        let breaks = shared.core().devices.of(self.device).breaks_so_far();
        let check = &shared.profile.device(self.device).verify[place];
        let found = read(line, self.device, check).await;
        let (now, again) = (shared.clock.now(), &mut self.again[place]);
        let mut evidence = None;
        match found {
            Ok(None) => {
                (again.due, again.has_passed, again.unread) = (now.after(again.period), true, (0, now));
                if self.again.iter().all(|again| again.has_passed) {
                    self.again.iter_mut().for_each(|again| again.has_passed = false);
                    verified(shared, self.device, breaks, Vec::new());
                }
                return true;
            }
            Ok(Some(difference)) if difference.is_value() => {
                (again.due, evidence) = (now.after(ASK_AGAIN), Some(difference));
            }
            // Answers to another master say nothing about the register, and neither does a failed connection.
            Err(fault)
                if fault.is_of_the_line()
                    || matches!(
                        fault,
                        Fault::Peer(PeerFault::Foreign | PeerFault::Unit(_) | PeerFault::OutOfOrder)
                    ) =>
            {
                again.due = now.after(ASK_AGAIN);
                return true;
            }
            // A device that starts may report for a while that it has no such register.
            Ok(Some(_)) | Err(_) => {
                again.unread = (attempts + 1, now);
                again.due = now.after(ASK_AGAIN * (attempts + 1));
                if again.unread.0 < ASSUMED_SILENT {
                    return true;
                }
                self.missed = (ASSUMED_SILENT, now);
            }
        }
        let found = match (self.read_all(line, shared, can, (breaks, Vec::new())).await, evidence) {
            // The difference that was found first is valid until all checks pass.
            (CheckRound::NoAnswer, Some(difference)) if self.is_after(breaks, shared) => {
                CheckRound::Known(breaks, vec![difference])
            }
            (round, _) => round,
        };
        self.take_round(shared, found);
        true
    }

    /// Processes the result of reading all checks, and sets the time of their next read.
    fn take_round(&mut self, shared: &LineHandle, found: CheckRound) {
        let pause = match &found {
            // The answers may come from two devices.
            CheckRound::Broken => return,
            CheckRound::Known(_, differences) if differences.is_empty() => Duration::ZERO,
            CheckRound::Known(..) => LOOK_AGAIN,
            CheckRound::NoAnswer => ASK_AGAIN,
        };
        let now = shared.clock.now();
        self.due = now.after(pause);
        self.read_after = shared.core().devices.of(self.device).breaks_so_far();
        if let CheckRound::Known(breaks, differences) = found {
            for again in &mut self.again {
                (again.due, again.has_passed, again.unread) = (now.after(again.period), false, (0, now));
            }
            verified(shared, self.device, breaks, differences);
        }
    }

    /// Sets the device up and reads every check. `breaks`: number of breaks in the continuity so far. `differences`:
    /// known differences from the expected values.
    async fn read_all(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        can: Option<&Can>,
        (mut breaks, mut differences): (u64, Vec<Difference>),
    ) -> CheckRound {
        let resets = shared.core().devices.of(self.device).resets_so_far();
        if can.is_some() && self.set_up != Some(resets) {
            match set_up(line, shared, self.device).await {
                Ok(found) if found.is_empty() => self.set_up = Some(resets),
                // A dry run sets nothing up, and still reads the checks.
                Ok(found) if shared.dry_run => differences = found,
                Ok(found) if self.is_after(breaks, shared) => return CheckRound::Known(breaks, found),
                Ok(_) => return CheckRound::Broken,
                Err(_) => {
                    self.missed.0 += 1;
                    return CheckRound::NoAnswer;
                }
            }
        }
        for (place, check) in shared.profile.device(self.device).verify.iter().enumerate() {
            let found = read(line, self.device, check).await;
            if place == 0 && can.is_none() {
                // The first answer comes from the present device, even if the connection was lost before it.
                breaks = shared.core().devices.of(self.device).breaks_so_far();
            }
            match found {
                Ok(difference) => differences.extend(difference),
                Err(fault) => {
                    return match self.is_in_vain(fault, shared) {
                        true => CheckRound::Known(breaks, vec![check.unreadable(fault)]),
                        false => CheckRound::NoAnswer,
                    };
                }
            }
        }
        if !self.is_after(breaks, shared) {
            return CheckRound::Broken;
        }
        self.missed.0 = 0;
        if let Some(can) = can {
            can.is_set_up(self.device);
        }
        CheckRound::Known(breaks, differences)
    }

    /// Counts an attempt to read a check that gave no value. Returns true if the device seems not to have the
    /// register: it gave no value several times, although it answers its polls, or it refused the request
    /// several times. Some devices are silent or report "busy" if they do not have a register.
    fn is_in_vain(&mut self, fault: Fault, shared: &LineHandle) -> bool {
        let (attempts, last) = self.missed;
        let delivers = shared.core().devices.of(self.device).delivered_at() > last;
        let now = shared.clock.now();
        if fault.is_of_the_line() {
            // A failed connection says nothing about the register.
            self.missed = (attempts.clamp(1, ASSUMED_SILENT - 1), now);
            return false;
        }
        // Neither does a refusal while the polls are refused as well.
        let attempts = match fault.is_refusal() && self.is_polled && !delivers {
            true => attempts.max(1),
            false => attempts + 1,
        };
        self.missed = (attempts, now);
        let is_busy = fault.is_of_a_gateway() || matches!(fault, Fault::Exception(ACKNOWLEDGE | BUSY));
        let is_known = self.is_received || (fault.is_refusal() && !is_busy);
        is_known && attempts >= ASSUMED_SILENT
    }

    /// Returns whether the number of breaks in the continuity of the device is still `breaks`.
    fn is_after(&self, breaks: u64, shared: &LineHandle) -> bool {
        shared.core().devices.of(self.device).breaks_so_far() == breaks
    }
}

/// Reads the register of one check. Returns the difference from the expected value; `None` if the values are equal. A
/// missing register is a difference, too.
///
/// # Errors
/// The device did not answer, or refused the request for another reason.
async fn read(
    line: &mut DeviceLine,
    device: DeviceId,
    check: &Expected,
) -> Result<Option<Difference>, Fault> {
    let Some(request) = Request::read(&check.address, check.encoding.data_type) else {
        return Ok(Some(check.absent(Fault::Caller(CallerFault::Function))));
    };
    let found = line.read_unverified(device, request).await;
    match found.and_then(|found| found.answer.accepted()) {
        Ok(found) => Ok(check.mismatch(registers(&found).registers())),
        Err(fault) if fault.is_absence() => Ok(Some(check.absent(fault))),
        Err(fault) => Err(fault),
    }
}

/// Writes the setup list of a CANopen node, in the order of the list. A dry run writes nothing, and only compares the
/// values. Returns the differences that remain. The list is empty if the node is set up.
///
/// # Errors
/// The node does not answer.
async fn set_up(
    line: &mut DeviceLine,
    shared: &LineHandle,
    device: DeviceId,
) -> Result<Vec<Difference>, Fault> {
    let Some(can) = &shared.profile.device(device).can else { return Ok(Vec::new()) };
    let mut wrong = Vec::new();
    for setup in &can.setup {
        let value = setup.object.registers(&setup.bytes());
        let value = value.ok_or(Fault::Peer(PeerFault::Width))?;
        let request = match shared.dry_run {
            true => Request::read_object(setup.object),
            false => Request::write_object(setup.object, value.registers()),
        };
        match line.request_unverified(device, request).await.map(|answered| answered.answer) {
            Ok(Answer::Registers(found)) if found != value.registers() => wrong.push(not_set_up(
                setup,
                format!("is not {} yet, and a dry run does not change settings", setup.value),
            )),
            Ok(_) => {}
            Err(fault) if fault.is_refusal() => {
                wrong.push(not_set_up(setup, format!("cannot be set to {}: {fault}", setup.value)));
                // Later objects may depend on this one.
                break;
            }
            Err(fault) => return Err(fault),
        }
    }
    Ok(wrong)
}

/// Creates the difference that reports an object of the setup list that could not be set.
fn not_set_up(setup: &Setup, why: String) -> Difference {
    let (what, was) = (named(setup), setup.value.to_string());
    let is = CheckFailure::Described(format!("{what} {why}"));
    Difference { what, was, is, meaning: String::new(), remedy: String::new() }
}

/// Returns number and name of an object of the setup list, for example `1800:05 (event timer)`.
fn named(setup: &Setup) -> String {
    match setup.what.as_str() {
        "" => setup.object.to_string(),
        what => format!("{} ({what})", setup.object),
    }
}

fn registers(answer: &Answer) -> Encoded {
    match answer {
        Answer::Registers(_) | Answer::Nodes(_) => Encoded::of(answer.registers()),
        Answer::Bits(bits) => {
            Encoded::of(&bits.iter().take(1).map(|bit| u16::from(*bit)).collect::<Vec<_>>())
        }
        Answer::Done => Encoded::of(&[]),
    }
}

fn round_begins(shared: &LineHandle, id: DeviceId) {
    let mut core = shared.core();
    let GatewayState { devices, compensation, arming, .. } = &mut *core;
    devices.round_begins(id, compensation, arming);
}

/// Processes the result of all checks of a device, and reports each change. An axis that reads from a changed device
/// runs its fault action. If a check proves that the settings were changed, the axis returns to its Cz (compensation
/// value) before the last round of checks. An axis that writes to the device is disarmed.
fn verified(shared: &LineHandle, id: DeviceId, breaks: u64, differences: Vec<Difference>) {
    let name = &shared.profile.device(id).name;
    let mut core = shared.core();
    let found = sentence(&differences);
    let is_evident = differences.iter().any(Difference::is_evidence);
    let has_remedies = differences.iter().all(|difference| !difference.remedy.is_empty());
    let Some(before) = core.devices.verified(id, breaks, differences) else { return };
    if found.is_empty() {
        let GatewayState { devices, arming, .. } = &mut *core;
        devices.round_passed(id, arming);
        if matches!(before, Continuity::Changed(_)) {
            core.events.push(Event::AsExpected { device: name.clone() });
        }
        return;
    }
    if core.devices.of(id).state() == &before {
        return;
    }
    let is_of_settings = before == Continuity::Confirmed && is_evident;
    let found =
        if is_of_settings { format!("the settings of the device were changed: {found}") } else { found };
    let why = Explained::new(format!("device {name}: {found}"), "correct the setting, then arm the axis");
    let reported = match has_remedies {
        true => Explained::new(found, "until the setting is correct, no axis that needs the device is armed"),
        false => found.into(),
    };
    core.events.push(Event::NotAsExpected { device: name.clone(), found: reported });
    // A check that cannot be read proves no change.
    let was_evident =
        matches!(&before, Continuity::Changed(known) if known.iter().any(Difference::is_evidence));
    if is_evident && !was_evident && core.devices.of(id).has_lasted() {
        let GatewayState { devices, arming, .. } = &mut *core;
        devices.settings_changed(id, arming);
    }
    // After a break, no reading was used that has these settings.
    if before == Continuity::Confirmed {
        let GatewayState { devices, board, .. } = &mut *core;
        let (now, rates) = (shared.clock.now(), devices.of(id).breaks_without_checks());
        for (signal, _) in shared.profile.signals_of(id) {
            board.store(signal, Err(Reason::NotAsExpected), now, rates);
        }
    }
    for output in shared.profile.outputs.iter().filter(|output| output.device == id) {
        // An axis that is off keeps waiting to be armed.
        if core.arming[output.axis.0].is_armed() {
            core.disarm(output.axis, why.clone());
        }
    }
}
