//! Periods of the reads and writes on each bus line, collected once for all lines.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use crate::duration::Timespan;
use crate::tables::raw_profile::RawProfile;

/// Default poll period of a device.
pub(in crate::tables) const EVERY: Duration = Duration::from_secs(1);
/// Longest default timeout. A line has this default if no read or write on the line has a period below 1 s.
pub(super) const TIMEOUT: Duration = Duration::from_millis(500);
const SHORTEST_TIMEOUT: Duration = Duration::from_millis(100);

/// Description and period of a periodic read or write. The description is the beginning of a sentence, for example
/// "device `bed` is read every".
pub(super) type Due = (String, Duration);

/// Periodic reads and writes of each bus line, by the name of the bus.
#[derive(Debug, Default)]
pub(in crate::tables) struct Periods(BTreeMap<String, Vec<Due>>);

impl Periods {
    pub(in crate::tables) fn new(raw: &RawProfile) -> Periods {
        let line = |device: Option<&String>| raw.device.get(device?)?.bus.as_ref();
        let mut periods = Periods::default();
        let are_read: BTreeSet<&String> =
            raw.signal.values().filter_map(|signal| signal.device.as_ref()).collect();
        for (name, device) in &raw.device {
            let every = device.every.or(are_read.contains(name).then_some(Timespan(EVERY)));
            periods.add(device.bus.as_ref(), || format!("device `{name}` is read every"), every);
        }
        let mut written: BTreeMap<&String, BTreeSet<&String>> = BTreeMap::new();
        for output in raw.output.values() {
            if let (Some(axis), Some(bus)) = (&output.axis, line(output.device.as_ref())) {
                written.entry(axis).or_default().insert(bus);
            }
        }
        for (name, axis) in &raw.axis {
            for bus in written.get(name).into_iter().flatten() {
                periods.add(Some(bus), || format!("axis `{name}` is written every"), axis.every);
            }
        }
        for (name, output) in &raw.output {
            let refreshed = || format!("output `{name}` is refreshed every");
            periods.add(line(output.device.as_ref()), refreshed, output.refresh);
        }
        if let Some(heartbeat) = &raw.heartbeat {
            let due = || "the heartbeat is written every".to_owned();
            periods.add(line(heartbeat.device.as_ref()), due, heartbeat.every);
        }
        periods
    }

    fn add(&mut self, bus: Option<&String>, what: impl FnOnce() -> String, every: Option<Timespan>) {
        if let (Some(bus), Some(Timespan(every))) = (bus, every) {
            self.0.entry(bus.clone()).or_default().push((what(), every));
        }
    }

    /// Returns the periodic reads and writes on a line.
    pub(super) fn of(&self, bus: &str) -> &[Due] {
        self.0.get(bus).map_or(&[], Vec::as_slice)
    }

    /// Returns the default timeout of a line: half the shortest period, from 100 to 500 ms. With less than 100 ms, even
    /// a healthy device might not answer in time.
    pub(super) fn timeout(&self, bus: &str) -> Duration {
        let halves = self.of(bus).iter().map(|(_, period)| (*period / 2).max(SHORTEST_TIMEOUT));
        halves.fold(TIMEOUT, Duration::min)
    }
}
