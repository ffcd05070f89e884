//! State of a fault script during a run: which faults are active, and the number of faulty replies of each fault.

use super::{
    AcknowledgeFault, BusError, CanFault, Fault, FaultDuration, FaultScript, Kind, Reads, ReplyFault,
};
use isotherm_core::codec::CanId;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::SignalId;
use isotherm_profile::DeviceId;

/// Faults of a run, each with its state: its start, and the number of faulty replies so far.
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
    /// Time at which the fault last caused a frame; `None` before the first one.
    said: Option<Moment>,
    /// Whether the device has reported the end of the fault.
    is_over: bool,
}

/// Frame that a fault causes on a CAN line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FaultFrame {
    Babble(CanId),
    /// Emergency message with this code; code 0 reports the end of the error.
    Emergency(u16),
    Error(BusError),
}

impl Faults {
    pub(crate) fn new(script: FaultScript, begin: Moment) -> Faults {
        let fresh = |fault| Running { fault, begun: None, replies: 0, said: None, is_over: false };
        Faults { begin, running: script.faults.into_iter().map(fresh).collect() }
    }

    /// Replaces the device of each fault by the result of `name`: the first device of the same hardware unit.
    pub(crate) fn rename(&mut self, name: impl Fn(DeviceId) -> DeviceId) {
        for running in &mut self.running {
            running.fault.device = name(running.fault.device);
        }
    }

    /// Begins the faults that are due by time and by number of requests. Returns those new faults that happen only
    /// once: a write by another client, or a restart.
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

    /// Returns the active fault of the answer to this request; `None` if no such fault is active. If a fault is
    /// returned, counts a faulty reply.
    pub(crate) fn reply(&mut self, device: DeviceId, is_write: bool, now: Moment) -> Option<ReplyFault> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::ShortRead | ReplyFault::LongRead) if is_write => None,
            Kind::Reply(ReplyFault::WrongEcho | ReplyFault::IgnoredWrite) if !is_write => None,
            Kind::Reply(fault) => Some(*fault),
            _ => None,
        })
    }

    /// Returns the active fault of an SDO request or of a frame with written values; `None` if no such fault is active.
    /// If a fault is returned, counts a faulty reply.
    pub(crate) fn sdo(&mut self, device: DeviceId, is_write: bool, now: Moment) -> Option<Kind> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::IgnoredWrite) if !is_write => None,
            Kind::Reply(ReplyFault::IgnoredWrite | ReplyFault::Late(_))
            | Kind::Can(CanFault::Refusal(_) | CanFault::WrongIndex) => Some(kind.clone()),
            _ => None,
        })
    }

    /// Returns whether a fault prevents a CAN device from sending or receiving a frame. If so, counts a faulty reply.
    pub(crate) fn silences(&mut self, device: DeviceId, now: Moment) -> bool {
        self.strikes(device, now, |kind| (*kind == Kind::Reply(ReplyFault::Silent)).then_some(())).is_some()
    }

    /// Returns the active fault of a frame with measured values (random bytes, or too short); `None` if no such fault
    /// is active. If a fault is returned, counts a faulty reply.
    pub(crate) fn spoils(&mut self, device: DeviceId, now: Moment) -> Option<Kind> {
        self.strikes(device, now, |kind| match kind {
            Kind::Reply(ReplyFault::Garbage) | Kind::Can(CanFault::ShortFrame) => Some(kind.clone()),
            _ => None,
        })
    }

    /// Finds the first active fault of the device for which `what` returns `Some`, and returns this result.
    /// Counts a faulty reply for this fault. Returns `None` if there is no such fault.
    fn strikes<T>(&mut self, device: DeviceId, now: Moment, what: impl Fn(&Kind) -> Option<T>) -> Option<T> {
        self.running.iter_mut().filter(|running| running.fault.device == device).find_map(|running| {
            let found = what(&running.fault.kind).filter(|_| running.is_active(now))?;
            running.replies += 1;
            Some(found)
        })
    }

    /// Returns the broken signals of the device with the values that they show now.
    pub(crate) fn signals(&self, device: DeviceId, now: Moment) -> impl Iterator<Item = (SignalId, Reads)> {
        self.active(now).filter(move |fault| fault.device == device).filter_map(|fault| match fault.kind {
            Kind::Signal { signal, reads } => Some((signal, reads)),
            _ => None,
        })
    }

    /// Returns the signals of the device whose OPC UA nodes now contain a bad status or a text instead of a number.
    #[cfg(feature = "opcua")]
    pub(crate) fn nodes(
        &self,
        device: DeviceId,
        now: Moment,
    ) -> impl Iterator<Item = (SignalId, super::NodeFault)> {
        self.active(now).filter(move |fault| fault.device == device).filter_map(|fault| match fault.kind {
            Kind::Node { signal, fault } => Some((signal, fault)),
            _ => None,
        })
    }

    /// Returns whether the device sends nothing at all now. A fault that ends after a number of replies is ignored
    /// here, because it affects only replies to calls.
    #[cfg(feature = "opcua")]
    pub(crate) fn is_silent(&self, device: DeviceId, now: Moment) -> bool {
        self.active(now).filter(|fault| fault.device == device).any(|fault| {
            let is_counted = matches!(fault.lasts, FaultDuration::Replies(_));
            fault.kind == Kind::Reply(ReplyFault::Silent) && !is_counted
        })
    }

    /// Counts one faulty reply for each active fault of a signal of the device.
    pub(crate) fn count_signals(&mut self, device: DeviceId, now: Moment) {
        self.count_shown(device, now, |_| true);
    }

    /// Counts one faulty reply for each active fault of a signal that the answer contains. `is_shown` returns whether
    /// the answer contains a signal.
    pub(crate) fn count_shown(&mut self, device: DeviceId, now: Moment, is_shown: impl Fn(SignalId) -> bool) {
        for running in self.running.iter_mut().filter(|running| running.fault.device == device) {
            let is_counted = match running.fault.kind {
                Kind::Signal { signal, .. } | Kind::Node { signal, .. } => is_shown(signal),
                _ => false,
            };
            if is_counted && running.is_active(now) {
                running.replies += 1;
            }
        }
    }

    /// Returns the active fault of the device's handshakes; `None` if there is none.
    pub(crate) fn acknowledges(&self, device: DeviceId, now: Moment) -> Option<AcknowledgeFault> {
        self.active(now).filter(|fault| fault.device == device).find_map(|fault| match fault.kind {
            Kind::Acknowledge(fault) => Some(fault),
            _ => None,
        })
    }

    /// Returns the devices whose listener must be closed now.
    pub(crate) fn refused(&self, now: Moment) -> impl Iterator<Item = DeviceId> {
        self.active(now).filter(|fault| fault.kind == Kind::Refuse).map(|fault| fault.device)
    }

    fn active(&self, now: Moment) -> impl Iterator<Item = &Fault> {
        self.running.iter().filter(move |running| running.is_active(now)).map(|running| &running.fault)
    }

    /// Returns the frames that faults of the device cause now.
    pub(crate) fn utter(&mut self, device: DeviceId, now: Moment) -> Vec<FaultFrame> {
        let of_device = self.running.iter_mut().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.utter(now)).collect()
    }

    /// Returns the time at which the next fault of the device begins, or causes a frame; `None` if that time is not
    /// known.
    pub(crate) fn due(&self, device: DeviceId) -> Option<Moment> {
        let of_device = self.running.iter().filter(|running| running.fault.device == device);
        of_device.filter_map(|running| running.due(self.begin)).min()
    }
}

impl Running {
    fn is_active(&self, now: Moment) -> bool {
        let Some(begun) = self.begun else { return false };
        match self.fault.lasts {
            FaultDuration::Replies(count) => self.replies < count,
            FaultDuration::Time(span) => now.since(begun) < span,
            FaultDuration::Ever => true,
        }
    }

    fn utter(&mut self, now: Moment) -> Option<FaultFrame> {
        let Kind::Can(fault) = self.fault.kind else { return None };
        let begun = self.begun?;
        if let CanFault::Emergency(code) = fault {
            let is_on = self.is_active(now);
            return match self.said.replace(begun) {
                None if is_on => Some(FaultFrame::Emergency(code)),
                Some(_) if !is_on && !self.is_over => {
                    self.is_over = true;
                    Some(FaultFrame::Emergency(0))
                }
                _ => None,
            };
        }
        let (utterance, every) = match fault {
            CanFault::Babbling { id, every } => (FaultFrame::Babble(id), Some(every)),
            CanFault::Errors { error, every } => (FaultFrame::Error(error), every),
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
            // On its time grid, without the missed ones.
            Some(every) if self.said.is_some() => now.next_tick(due, every).before(every),
            _ => now,
        });
        self.replies += 1;
        Some(utterance)
    }

    fn due(&self, begin: Moment) -> Option<Moment> {
        let Some(begun) = self.begun else {
            // If the fault also waits for requests, its time is unknown.
            return (self.fault.after == 0).then(|| begin.after(self.fault.at));
        };
        let end = match self.fault.lasts {
            FaultDuration::Time(span) => Some(begun.after(span)),
            _ => None,
        };
        match self.fault.kind {
            Kind::Can(CanFault::Emergency(_)) => end.filter(|_| !self.is_over),
            Kind::Can(CanFault::Babbling { every, .. } | CanFault::Errors { every: Some(every), .. }) => {
                let next = self.said.map_or(begun, |said| said.after(every));
                let is_spent =
                    matches!(self.fault.lasts, FaultDuration::Replies(count) if self.replies >= count);
                Some(next).filter(|next| !is_spent && end.is_none_or(|end| *next < end))
            }
            _ => None,
        }
    }
}
