//! What goes wrong on a CAN line.

use std::time::Duration;

use super::{Faults, Kind, Lasts, ReplyFault, Running};
use isotherm_core::codec::CanId;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// What can be wrong with a device on a CAN line beside what can be wrong with any.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::virtual_machine) enum CanFault {
    /// Its frames end before the last byte that is needed.
    ShortFrame,
    /// SDO requests are refused with this code.
    Refusal(u32),
    /// SDO answers name another index.
    WrongIndex,
    /// It sends frames that nobody has asked for.
    Babbling { id: CanId, every: Duration },
    /// It complains, and says so when that is over.
    Emergency(u16),
    /// Its controller has trouble with the bus; once, or again and again.
    Errors { error: BusError, every: Option<Duration> },
}

/// What a controller says of the bus, as the kernel's error frames have it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::virtual_machine) enum BusError {
    NoAcknowledge,
    Stuff,
    Warning,
    Passive,
    BusOff,
    Restarted,
}

/// What is wrong with the answer to an SDO request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::virtual_machine) enum SdoFault {
    Refused(u32),
    WrongIndex,
    Late(Duration),
    Ignored,
}

/// What is wrong with a frame of measured values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::virtual_machine) enum Spoilt {
    Random,
    Short,
}

/// What a fault makes a device say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::virtual_machine) enum Utterance {
    Babble(CanId),
    /// With code 0: it is over.
    Emergency(u16),
    Error(BusError),
}

impl BusError {
    /// Each with its word in a script.
    pub(super) const ALL: [(&'static str, BusError); 6] = [
        ("no-acknowledge", BusError::NoAcknowledge),
        ("stuff", BusError::Stuff),
        ("warning", BusError::Warning),
        ("passive", BusError::Passive),
        ("bus-off", BusError::BusOff),
        ("restarted", BusError::Restarted),
    ];

    /// Class and data of the error frame (linux/can/error.h).
    pub(in crate::virtual_machine) const fn frame(self) -> (u32, [u8; 8]) {
        match self {
            BusError::NoAcknowledge => (0x020, [0; 8]),
            BusError::Stuff => (0x088, [0, 0, 0x04, 0, 0, 0, 0, 0]),
            BusError::Warning => (0x204, [0, 0x08, 0, 0, 0, 0, 97, 0]),
            BusError::Passive => (0x204, [0, 0x20, 0, 0, 0, 0, 128, 0]),
            BusError::BusOff => (0x040, [0; 8]),
            BusError::Restarted => (0x100, [0; 8]),
        }
    }
}

impl Faults {
    /// Whether the device neither sends this nor hears it; counts it.
    pub(in crate::virtual_machine) fn silences(&mut self, device: DeviceId, now: Moment) -> bool {
        self.find(device, now, |kind| (*kind == Kind::Reply(ReplyFault::Silent)).then_some(())).is_some()
    }

    /// What is wrong with a frame of measured values; counts it.
    pub(in crate::virtual_machine) fn spoils(&mut self, device: DeviceId, now: Moment) -> Option<Spoilt> {
        self.find(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::Garbage) => Some(Spoilt::Random),
            Kind::Can(CanFault::ShortFrame) => Some(Spoilt::Short),
            _ => None,
        })
    }

    /// What is wrong with the answer to this SDO request, or with what is done about a frame that writes; counts it.
    pub(in crate::virtual_machine) fn sdo(
        &mut self,
        device: DeviceId,
        is_write: bool,
        now: Moment,
    ) -> Option<SdoFault> {
        self.find(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::IgnoredWrite) if is_write => Some(SdoFault::Ignored),
            Kind::Reply(ReplyFault::Late(delay)) => Some(SdoFault::Late(*delay)),
            Kind::Can(CanFault::Refusal(code)) => Some(SdoFault::Refused(*code)),
            Kind::Can(CanFault::WrongIndex) => Some(SdoFault::WrongIndex),
            _ => None,
        })
    }

    fn find<T>(&mut self, device: DeviceId, now: Moment, what: impl Fn(&Kind) -> Option<T>) -> Option<T> {
        self.running.iter_mut().filter(|running| running.fault.device == device).find_map(|running| {
            let found = what(&running.fault.kind).filter(|_| running.is_active(now))?;
            running.replies += 1;
            Some(found)
        })
    }

    /// What the device says now because something is wrong with it.
    pub(in crate::virtual_machine) fn utter(&mut self, device: DeviceId, now: Moment) -> Vec<Utterance> {
        let of_device = self.running.iter_mut().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.utter(now)).collect()
    }

    /// When a fault of the device begins, or makes it say something.
    pub(in crate::virtual_machine) fn due(&self, device: DeviceId) -> Option<Moment> {
        let of_device = self.running.iter().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.due(self.begin)).min()
    }
}

impl Running {
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
