//! A script as it runs.

use super::{AcknowledgeFault, BusError, CanFault, Fault, FaultScript, Kind, Lasts, Reads, ReplyFault};
use isotherm_core::codec::CanId;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::DeviceId;

/// The faults of a run, with what has come of them.
#[derive(Clone, Debug)]
pub(crate) struct Faults {
    begin: Moment,
    running: Vec<Running>,
}

#[derive(Clone, Debug)]
struct Running {
    fault: Fault,
    begun: Option<Moment>,
    replies: u64,
    /// When it last made the device say something.
    said: Option<Moment>,
    /// The device has said that it is over.
    is_over: bool,
}

/// What a fault makes a device say on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Utterance {
    Babble(CanId),
    /// With code 0: it is over.
    Emergency(u16),
    Error(BusError),
}

impl Faults {
    pub(crate) fn new(script: FaultScript, begin: Moment) -> Faults {
        let fresh = |fault| Running { fault, begun: None, replies: 0, said: None, is_over: false };
        Faults { begin, running: script.faults.into_iter().map(fresh).collect() }
    }

    /// Calls devices that are one piece of hardware by one name.
    pub(crate) fn rename(&mut self, name: impl Fn(DeviceId) -> DeviceId) {
        for running in &mut self.running {
            running.fault.device = name(running.fault.device);
        }
    }

    /// Takes note of the time and of how many requests each device has had; gives the faults that happen once and are due.
    pub(crate) fn advance(
        &mut self,
        now: Moment,
        requests: impl Fn(DeviceId) -> u64,
    ) -> Vec<(DeviceId, Kind)> {
        let mut incidents = Vec::new();
        for Running { fault, begun, .. } in &mut self.running {
            let is_due = now.since(self.begin) >= fault.at;
            if begun.is_none() && is_due && (fault.after == 0 || requests(fault.device) > fault.after) {
                *begun = Some(now);
                if matches!(fault.kind, Kind::Register { .. } | Kind::Restart) {
                    incidents.push((fault.device, fault.kind.clone()));
                }
            }
        }
        incidents
    }

    /// What is wrong with the answer to this request; counts it.
    pub(crate) fn reply(&mut self, device: DeviceId, is_write: bool, now: Moment) -> Option<ReplyFault> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::ShortRead | ReplyFault::LongRead) if is_write => None,
            Kind::Reply(ReplyFault::WrongEcho | ReplyFault::IgnoredWrite) if !is_write => None,
            Kind::Reply(fault) => Some(*fault),
            _ => None,
        })
    }

    /// What is wrong with the answer to this SDO request, or with what is done about a frame that writes; counts it.
    pub(crate) fn sdo(&mut self, device: DeviceId, is_write: bool, now: Moment) -> Option<Kind> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::IgnoredWrite) if !is_write => None,
            Kind::Reply(ReplyFault::IgnoredWrite | ReplyFault::Late(_))
            | Kind::Can(CanFault::Refusal(_) | CanFault::WrongIndex) => Some(kind.clone()),
            _ => None,
        })
    }

    /// Whether a device on a CAN line neither sends this nor hears it; counts it.
    pub(crate) fn silences(&mut self, device: DeviceId, now: Moment) -> bool {
        self.strikes(device, now, |kind| (*kind == Kind::Reply(ReplyFault::Silent)).then_some(())).is_some()
    }

    /// What is wrong with a frame of measured values: garbage, or too short; counts it.
    pub(crate) fn spoils(&mut self, device: DeviceId, now: Moment) -> Option<Kind> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::Garbage) | Kind::Can(CanFault::ShortFrame) => Some(kind.clone()),
            _ => None,
        })
    }

    /// The first fault of the device that is at work now and of which something is wanted; it has struck once more.
    fn strikes<T>(&mut self, device: DeviceId, now: Moment, what: impl Fn(&Kind) -> Option<T>) -> Option<T> {
        self.running.iter_mut().filter(|running| running.fault.device == device).find_map(|running| {
            let found = what(&running.fault.kind).filter(|_| running.is_active(now))?;
            running.replies += 1;
            Some(found)
        })
    }

    /// What the device's broken signals read now.
    pub(crate) fn signals(&self, device: DeviceId, now: Moment) -> impl Iterator<Item = (SignalId, Reads)> {
        self.active(now).filter(move |fault| fault.device == device).filter_map(|fault| match fault.kind {
            Kind::Signal { signal, reads } => Some((signal, reads)),
            _ => None,
        })
    }

    /// One more request was answered while these signals were broken.
    pub(crate) fn count_signals(&mut self, device: DeviceId, now: Moment) {
        for running in self.running.iter_mut().filter(|running| running.fault.device == device) {
            if matches!(running.fault.kind, Kind::Signal { .. }) && running.is_active(now) {
                running.replies += 1;
            }
        }
    }

    /// What is wrong with the device's acknowledges now.
    pub(crate) fn acknowledges(&self, device: DeviceId, now: Moment) -> Option<AcknowledgeFault> {
        self.active(now).filter(|fault| fault.device == device).find_map(|fault| match fault.kind {
            Kind::Acknowledge(fault) => Some(fault),
            _ => None,
        })
    }

    /// The devices whose listener is closed now.
    pub(crate) fn refused(&self, now: Moment) -> impl Iterator<Item = DeviceId> {
        self.active(now).filter(|fault| fault.kind == Kind::Refuse).map(|fault| fault.device)
    }

    fn active(&self, now: Moment) -> impl Iterator<Item = &Fault> {
        self.running.iter().filter(move |running| running.is_active(now)).map(|running| &running.fault)
    }

    /// What the device says now because something is wrong with it.
    pub(crate) fn utter(&mut self, device: DeviceId, now: Moment) -> Vec<Utterance> {
        let of_device = self.running.iter_mut().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.utter(now)).collect()
    }

    /// When a fault of the device begins, or makes it say something.
    pub(crate) fn due(&self, device: DeviceId) -> Option<Moment> {
        let of_device = self.running.iter().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.due(self.begin)).min()
    }
}

impl Running {
    fn is_active(&self, now: Moment) -> bool {
        let Some(begun) = self.begun else { return false };
        match self.fault.lasts {
            Lasts::Replies(count) => self.replies < count,
            Lasts::Time(span) => now.since(begun) < span,
            Lasts::Ever => true,
        }
    }

    fn utter(&mut self, now: Moment) -> Option<Utterance> {
        let Kind::Can(fault) = self.fault.kind else { return None };
        let begun = self.begun?;
        if let CanFault::Emergency(code) = fault {
            let stands = self.is_active(now);
            return match self.said.replace(begun) {
                None if stands => Some(Utterance::Emergency(code)),
                Some(_) if !stands && !self.is_over => {
                    self.is_over = true;
                    Some(Utterance::Emergency(0))
                }
                _ => None,
            };
        }
        let (utterance, every) = match fault {
            CanFault::Babbling { id, every } => (Utterance::Babble(id), Some(every)),
            CanFault::Errors { error, every } => (Utterance::Error(error), every),
            _ => return None,
        };
        let due = match (self.said, every) {
            (None, _) => begun,
            (Some(said), Some(every)) => said.after(every),
            (Some(_), None) => return None,
        };
        if due > now || !self.is_active(now) {
            return None;
        }
        self.said = Some(match every {
            // In its grid, what was missed skipped.
            Some(every) if self.said.is_some() => now.next_tick(due, every).before(every),
            _ => now,
        });
        self.replies += 1;
        Some(utterance)
    }

    fn due(&self, begin: Moment) -> Option<Moment> {
        let Some(begun) = self.begun else {
            // Requests may have to come first, and then nobody knows when.
            return (self.fault.after == 0).then(|| begin.after(self.fault.at));
        };
        let end = match self.fault.lasts {
            Lasts::Time(span) => Some(begun.after(span)),
            _ => None,
        };
        match self.fault.kind {
            Kind::Can(CanFault::Emergency(_)) => end.filter(|_| !self.is_over),
            Kind::Can(CanFault::Babbling { every, .. } | CanFault::Errors { every: Some(every), .. }) => {
                let next = self.said.map_or(begun, |said| said.after(every));
                let is_spent = matches!(self.fault.lasts, Lasts::Replies(count) if self.replies >= count);
                Some(next).filter(|next| !is_spent && end.is_none_or(|end| *next < end))
            }
            _ => None,
        }
    }
}
