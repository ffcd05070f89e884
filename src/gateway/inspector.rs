//! Reads the checks of the devices on one line, and sets up first those that want it: CANopen nodes, before each of their
//! starts.

use std::time::Duration;

use super::commissioning::Finding;
use crate::fieldbus::error::{CallerFault, Fault, PeerFault};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, CanRequest, Request};
use crate::gateway::can::Can;
use crate::gateway::line_handle::LineHandle;
use crate::observe::events::Event;
use isotherm_core::codec::Encoded;
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;
use isotherm_profile::{BusId, DeviceId, Profile, Setup};

/// How soon a device that could not be asked is asked again; the line's own pauses come on top.
const ASK_AGAIN: Duration = Duration::from_secs(1);

/// How soon a device that is set wrongly is looked at again.
const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// After so many attempts that the device did not answer, while it answered its polls, the register is not there.
const BELIEVED_SILENT: u32 = 3;

/// Reads the checks of the devices on one line.
#[derive(Debug)]
pub(super) struct Inspector(Vec<Inspection>);

#[derive(Debug)]
struct Inspection {
    device: DeviceId,
    due: Moment,
    missed: u32,
    /// Polls, or frames that the device sends, show whether it is present.
    is_heard: bool,
    /// The round for which it was set up.
    set_up: Option<u64>,
}

/// Result of reading the checks of a device.
enum Found {
    Known(Finding),
    /// The device does not answer, which is reported elsewhere.
    NoAnswer,
    /// Another device may have replaced it between two answers.
    Exchanged,
}

impl Inspector {
    pub(super) fn new(profile: &Profile, bus: BusId, start: Moment) -> Inspector {
        let checked = profile.devices_on(bus).filter(|(_, device)| device.is_checked());
        let inspection = |(device, _)| {
            let is_heard = profile.device(device).can.is_some() || !profile.requests(device).is_empty();
            Inspection { device, due: start, missed: 0, is_heard, set_up: None }
        };
        Inspector(checked.map(inspection).collect())
    }

    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Looks at the devices that are not known to be fit, where it is time.
    pub(super) async fn inspect(&mut self, line: &mut DeviceLine, shared: &LineHandle, can: Option<&Can>) {
        for inspection in &mut self.0 {
            let (id, now) = (inspection.device, shared.clock.now());
            let round = shared.core().commissioning.round(id);
            let is_due = now >= inspection.due || inspection.set_up.is_some_and(|known| known != round);
            if !is_due || inspection.is_needless(shared) || line.is_resting(id, now) {
                continue;
            }
            let found = inspection.look(line, shared, can, round).await;
            let pause = match found {
                // The answers may come from two devices.
                Found::Exchanged => continue,
                Found::Known(Finding::Wrong(_)) => LOOK_AGAIN,
                Found::Known(_) => Duration::ZERO,
                Found::NoAnswer => ASK_AGAIN,
            };
            inspection.due = shared.clock.now().after(pause);
            if let Found::Known(found) = found {
                commissioned(shared, id, found);
            }
        }
    }
}

impl Inspection {
    /// Whether nothing is to be checked now: it is fit; or it did not answer, and its polls shall find out first whether it is
    /// there at all.
    fn is_needless(&self, shared: &LineHandle) -> bool {
        let core = shared.core();
        let lost = core.contact.devices[self.device.0].lost.as_ref();
        core.commissioning.is_fit(self.device)
            || (self.is_heard && self.missed > 0 && lost.is_some_and(|lost| lost.answers_since.is_none()))
    }

    /// Sets it up and reads every check.
    async fn look(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        can: Option<&Can>,
        mut round: u64,
    ) -> Found {
        let mut wrong = Vec::new();
        if can.is_some() && self.set_up != Some(round) {
            match set_up(line, shared, self.device).await {
                Ok(found) if found.is_empty() => self.set_up = Some(round),
                // Nothing can be set up, and still it is to be read.
                Ok(found) if shared.dry_run => wrong = found,
                Ok(found) if self.is_of(round, shared) => {
                    return Found::Known(Finding::Wrong(found.join("; ")));
                }
                Ok(_) => return Found::Exchanged,
                Err(_) => {
                    self.missed += 1;
                    return Found::NoAnswer;
                }
            }
        }
        for (place, expected) in shared.profile.device(self.device).verify.iter().enumerate() {
            let request = Request::read(&expected.address, expected.encoding.data_type);
            let Some(request) = request else {
                wrong.push(expected.unreadable(Fault::Caller(CallerFault::Function)));
                continue;
            };
            let found = line.request_unverified(self.device, request).await;
            if place == 0 && can.is_none() {
                // The first answer comes from the present device, even if the connection was lost before it.
                round = shared.core().commissioning.round(self.device);
            }
            match found.and_then(|found| found.answer.believed()) {
                Ok(found) => wrong.extend(expected.mismatch(registers(&found).registers())),
                Err(fault) if fault.is_refusal() => wrong.push(expected.unreadable(fault)),
                Err(fault) => {
                    // A connection that cannot be made says nothing of the register.
                    self.missed = if fault.is_of_the_line() { self.missed.max(1) } else { self.missed + 1 };
                    // It answers its polls and never this: some devices are silent where they have no register.
                    let is_silent = self.is_heard && self.missed >= BELIEVED_SILENT;
                    return match is_silent {
                        true => Found::Known(Finding::Wrong(expected.unreadable(fault))),
                        false => Found::NoAnswer,
                    };
                }
            }
        }
        if !self.is_of(round, shared) {
            return Found::Exchanged;
        }
        self.missed = 0;
        if let Some(can) = can {
            can.is_set_up(self.device);
        }
        Found::Known(if wrong.is_empty() { Finding::Fit } else { Finding::Wrong(wrong.join("; ")) })
    }

    /// Whether the device has not been exchanged or restarted since this round began.
    fn is_of(&self, round: u64, shared: &LineHandle) -> bool {
        shared.core().commissioning.round(self.device) == round
    }
}

/// Writes the setup list of a CANopen node, in its order. A dry run writes nothing, so there it is only compared. What is
/// wrong with it afterwards; nothing, where it is set up.
///
/// # Errors
/// The node does not answer.
async fn set_up(line: &mut DeviceLine, shared: &LineHandle, device: DeviceId) -> Result<Vec<String>, Fault> {
    let Some(can) = &shared.profile.device(device).can else { return Ok(Vec::new()) };
    let mut wrong = Vec::new();
    for setup in &can.setup {
        let value = setup.object.registers(&setup.bytes());
        let value = value.ok_or(Fault::Peer(PeerFault::Width))?;
        let request = match shared.dry_run {
            true => CanRequest::Read { object: setup.object },
            false => CanRequest::Write { object: setup.object, values: value.registers() },
        };
        match line.request_unverified(device, Request::Can(request)).await.map(|answered| answered.answer) {
            Ok(Answer::Registers(found)) if found != value.registers() => wrong.push(format!(
                "{} is not {} yet, and nothing is set up while nothing may be written",
                named(setup),
                setup.value
            )),
            Ok(_) => {}
            Err(fault) if fault.is_refusal() => {
                wrong.push(format!("{} cannot be set to {}: {fault}", named(setup), setup.value));
                // What comes after it may rely on it.
                break;
            }
            Err(fault) => return Err(fault),
        }
    }
    Ok(wrong)
}

/// `1800:05 (event timer)`.
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

/// A device was looked at. What changed is reported. An axis that reads from it takes its fault action; one that would
/// write to it is off.
fn commissioned(shared: &LineHandle, id: DeviceId, found: Finding) {
    let name = &shared.profile.device(id).name;
    let mut core = shared.core();
    let before = core.commissioning.note(id, found.clone());
    match found {
        _ if before == found => {}
        Finding::Wrong(found) => {
            let why =
                Explained::new(format!("device {name}: {found}"), "arm it when the device is set right");
            core.events.push(Event::NotAsExpected { device: name.clone(), found: found.into() });
            for output in shared.profile.outputs.iter().filter(|output| output.device == id) {
                // One that is off keeps waiting to be armed.
                if core.arming[output.axis.0].armed {
                    core.disarm(output.axis, why.clone());
                }
            }
        }
        Finding::Fit if matches!(before, Finding::Wrong(_)) => {
            core.events.push(Event::AsExpected { device: name.clone() });
        }
        Finding::Fit | Finding::Unknown => {}
    }
}
