//! Reads of a device whose last attempt failed. The advice in messages depends on the size of the failed
//! read, and on whether the device answers other requests.

use crate::fieldbus::error::Fault;
use crate::fieldbus::seen::{Asked, Others, Seen};
use crate::fieldbus::wire::Request;
use isotherm_core::reading::SignalId;
use isotherm_profile::{DeviceId, Profile};

/// Number of consecutive failures of one read after which the whole device may be lost. An answer of the device to
/// another request resets the number.
const OTHERS_UNKNOWN_AFTER: u8 = 3;

/// Planned reads of registers of all devices.
#[derive(Debug)]
pub(in crate::gateway) struct PlannedReads {
    /// Planned reads of each device, in the order of the requests.
    of_device: Vec<Vec<PlannedRead>>,
    /// Index of each signal's read in the list of its device. `None` for a signal that is not read from registers.
    of_signal: Vec<Option<usize>>,
}

/// One planned read: its request, and a description of its size for the advice in messages.
#[derive(Debug)]
struct PlannedRead {
    request: Request<'static>,
    asked: Asked,
}

/// Reads of one device that failed at their last attempt. Empty if the last attempt of every read returned data.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(in crate::gateway) struct FailedReads(Vec<FailedRead>);

/// Read whose last attempt failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FailedRead {
    /// Index of the read in the list of its device.
    place: usize,
    fault: Fault,
    others: Others,
    /// Number of consecutive failures since the device last answered another request.
    failures: u8,
}

impl PlannedReads {
    pub(in crate::gateway) fn of(profile: &Profile) -> PlannedReads {
        let mut of_signal = vec![None; profile.signals.len()];
        let of_device = (0..profile.devices.len()).map(|device| {
            let mut reads = Vec::new();
            for planned in profile.requests(DeviceId(device)) {
                let Some(request) = Request::in_registers(&planned.asks) else { continue };
                for field in planned.values() {
                    of_signal[field.signal.0] = Some(reads.len());
                }
                reads.push(PlannedRead { request, asked: Asked::of(&planned) });
            }
            reads
        });
        let of_device = of_device.collect();
        PlannedReads { of_device, of_signal }
    }

    /// Returns the index of the planned read with this request in the list of the device; `None` if the request is
    /// not planned.
    fn place(&self, device: DeviceId, request: Request<'_>) -> Option<usize> {
        self.of_device[device.0].iter().position(|read| read.request == request)
    }

    /// Records the result of a request to a device. Returns the description of the request if the request has failed.
    pub(in crate::gateway) fn record(
        &self,
        failed: &mut FailedReads,
        (device, request): (DeviceId, Request<'_>),
        outcome: Result<(), Fault>,
    ) -> Option<Seen> {
        // Almost every request is answered.
        if outcome.is_ok() && failed.0.is_empty() {
            return None;
        }
        let place = self.place(device, request);
        match (outcome, place) {
            (Ok(()), _) => {
                failed.0.retain(|read| Some(read.place) != place);
                failed.0.iter_mut().for_each(|read| (read.others, read.failures) = (Others::Answered, 0));
                None
            }
            (Err(fault), None) => {
                let is_write = !request.is_read() && request.function() != 0;
                Some(Seen::of(fault, if is_write { Asked::Write(request.function()) } else { Asked::Any }))
            }
            (Err(fault), Some(place)) => {
                // After another fault the count begins again, because the device may be lost.
                let before = failed.0.iter().find(|read| read.place == place && read.fault == fault);
                let failures = before.map_or(1, |read| read.failures.saturating_add(1));
                let others = before.filter(|_| failures < OTHERS_UNKNOWN_AFTER);
                let others = others.map_or(Others::Unknown, |read| read.others);
                failed.0.retain(|read| read.place != place);
                failed.0.push(FailedRead { place, fault, others, failures });
                Some(Seen { fault, asked: self.of_device[device.0][place].asked, others })
            }
        }
    }

    /// Returns the description of the read of a signal, if its last attempt has failed.
    pub(in crate::gateway) fn of_signal(
        &self,
        failed: &FailedReads,
        (signal, device): (SignalId, DeviceId),
    ) -> Option<Seen> {
        let place = self.of_signal.get(signal.0).copied().flatten()?;
        let FailedRead { fault, others, .. } = *failed.0.iter().find(|read| read.place == place)?;
        Some(Seen { fault, asked: self.of_device[device.0][place].asked, others })
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_profiles::{THREE_SIGNALS, bench};
    use super::*;
    use crate::fieldbus::error::LinkFault;
    use isotherm_core::codec::{Register, Table};

    const MODULE: DeviceId = DeviceId(0);
    const TIMEOUT: Result<(), Fault> = Err(Fault::Timeout);

    fn planned() -> (PlannedReads, [SignalId; 3]) {
        let profile = bench(THREE_SIGNALS);
        let named = |name: &str| profile.signals.iter().position(|signal| signal.name == name).unwrap();
        let signals = ["bed", "spindle", "oil"].map(|name| SignalId(named(name)));
        (PlannedReads::of(&profile), signals)
    }

    fn read(table: Table, count: u16) -> Request<'static> {
        Request::read_registers(Register { table, offset: 0 }, count)
    }

    #[test]
    fn a_failed_read_is_known_with_its_extent_until_it_is_answered() {
        let (planned, [bed, spindle, oil]) = planned();
        let mut failed = FailedReads::default();
        let over_gap = (MODULE, read(Table::Input, 5));
        let asked = Asked::Read { values: 2, gap: 3 };
        let seen = Seen::of(Fault::Exception(2), asked);
        assert_eq!(planned.record(&mut failed, over_gap, Err(Fault::Exception(2))), Some(seen));
        for signal in [bed, spindle] {
            assert_eq!(planned.of_signal(&failed, (signal, MODULE)), Some(seen));
        }
        assert_eq!(planned.of_signal(&failed, (oil, MODULE)), None);
        assert_eq!(planned.record(&mut failed, over_gap, Ok(())), None);
        assert_eq!(failed, FailedReads::default());
    }

    #[test]
    fn a_read_that_fails_while_others_are_answered_is_known_as_such() {
        let (planned, [bed, _, oil]) = planned();
        let mut failed = FailedReads::default();
        let (over_gap, single) = ((MODULE, read(Table::Input, 5)), (MODULE, read(Table::Holding, 1)));
        let others = |seen: Option<Seen>| seen.map(|seen| seen.others);
        assert_eq!(others(planned.record(&mut failed, over_gap, TIMEOUT)), Some(Others::Unknown));
        assert_eq!(others(planned.record(&mut failed, over_gap, TIMEOUT)), Some(Others::Unknown));
        assert_eq!(planned.record(&mut failed, single, Ok(())), None);
        assert_eq!(others(planned.of_signal(&failed, (bed, MODULE))), Some(Others::Answered));
        assert_eq!(others(planned.record(&mut failed, over_gap, TIMEOUT)), Some(Others::Answered));
        assert_eq!(others(planned.record(&mut failed, single, TIMEOUT)), Some(Others::Unknown));
        assert_eq!(others(planned.of_signal(&failed, (oil, MODULE))), Some(Others::Unknown));
        // Another fault: the device is lost.
        let closed = Err(Fault::Link(LinkFault::Broken));
        assert_eq!(others(planned.record(&mut failed, over_gap, closed)), Some(Others::Unknown));
    }

    /// The gateway usually repeats only one read at a device that no longer answers.
    #[test]
    fn a_device_that_answers_nothing_any_more_does_not_answer_others() {
        let (planned, _) = planned();
        let mut failed = FailedReads::default();
        let (over_gap, single) = ((MODULE, read(Table::Input, 5)), (MODULE, read(Table::Holding, 1)));
        planned.record(&mut failed, over_gap, TIMEOUT);
        planned.record(&mut failed, single, Ok(()));
        let mut again = || planned.record(&mut failed, over_gap, TIMEOUT).map(|seen| seen.others);
        let others = [again(), again(), again(), again()];
        let (answered, unknown) = (Some(Others::Answered), Some(Others::Unknown));
        assert_eq!(others, [answered, answered, unknown, unknown]);
        planned.record(&mut failed, single, Ok(()));
        assert_eq!(planned.record(&mut failed, over_gap, TIMEOUT).map(|seen| seen.others), answered);
    }

    #[test]
    fn a_write_is_known_with_its_function() {
        let (planned, _) = planned();
        let write = Request::write_holding(8, &[1, 2], isotherm_profile::Functions::ALL);
        let seen = planned.record(&mut FailedReads::default(), (MODULE, write), TIMEOUT);
        assert_eq!(seen, Some(Seen::of(Fault::Timeout, Asked::Write(16))));
        let check = read(Table::Coil, 1);
        let seen = planned.record(&mut FailedReads::default(), (MODULE, check), TIMEOUT);
        assert_eq!(seen, Some(Seen::from(Fault::Timeout)));
    }
}
