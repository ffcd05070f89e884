//! Health of a CAN bus: error frames, full send queues and lost frames (together called trouble). Trouble is reported
//! when it begins, gets worse or is over, with a count of occurrences. Single frames are not reported.

use std::time::Duration;

use crate::fieldbus::kinds::can::{ErrorFrame, ErrorSeverity};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Moment;

/// Time without a new occurrence after which the gateway reports that the trouble is over.
const OVER_AFTER: Duration = Duration::from_secs(10);

/// Counters of trouble on one CAN bus. An episode is one period of trouble.
#[derive(Debug, Default)]
pub(super) struct Health {
    errors: Option<Episode>,
    worst: Option<ErrorSeverity>,
    full: Meter,
    lost: Meter,
}

#[derive(Clone, Copy, Debug)]
struct Episode {
    since: Moment,
    last: Moment,
    count: u64,
}

/// Counter of full queues or lost frames of a CAN interface: its last total, and the present period of trouble.
#[derive(Debug, Default)]
struct Meter {
    read: u64,
    episode: Option<Episode>,
}

/// Change of the health of a CAN bus that must be reported.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum HealthChange {
    /// Trouble begins, or has become worse. `is_off`: the interface is bus-off, so it no longer takes part in the bus.
    Worse { what: Explained, is_off: bool },
    /// Trouble is over. `count`: number of occurrences. `what`: kind of trouble. `within`: time between first and
    /// last occurrence.
    Over { count: u64, what: &'static str, within: Duration },
}

impl Episode {
    /// Adds `count` occurrences to the episode (period of trouble), or begins an episode with them. Returns `true` if
    /// the episode has just begun.
    fn add(episode: &mut Option<Episode>, count: u64, now: Moment) -> bool {
        let is_first = episode.is_none();
        let known = episode.get_or_insert(Episode { since: now, last: now, count: 0 });
        (known.last, known.count) = (now, known.count + count);
        is_first
    }

    fn end(episode: &mut Option<Episode>, what: &'static str, now: Moment) -> Option<HealthChange> {
        let Episode { since, last, count } =
            episode.take_if(|episode| now >= episode.last.after(OVER_AFTER))?;
        Some(HealthChange::Over { count, what, within: last.since(since) })
    }
}

impl Meter {
    fn read(&mut self, total: u64, now: Moment) -> bool {
        let more = total.saturating_sub(self.read);
        self.read = total;
        more > 0 && Episode::add(&mut self.episode, more, now)
    }
}

impl Health {
    pub(super) fn trouble(&mut self, trouble: &ErrorFrame, now: Moment) -> Vec<HealthChange> {
        let gravity = trouble.gravity();
        if gravity == ErrorSeverity::Over {
            // The bus works again, but the episode continues. A later bus-off is reported again.
            self.worst = self.worst.map(|_| ErrorSeverity::Error);
            return Vec::new();
        }
        Episode::add(&mut self.errors, 1, now);
        let is_worse =
            self.worst.replace(self.worst.map_or(gravity, |worst| worst.max(gravity))) < Some(gravity);
        let worse = || HealthChange::Worse {
            what: trouble.to_string().into(),
            is_off: gravity == ErrorSeverity::BusOff,
        };
        is_worse.then(worse).into_iter().collect()
    }

    /// Counts new occurrences of a full send queue and of lost frames, and ends the periods of trouble that are over.
    /// `full` and `lost` are the totals since the start. Returns the changes to report.
    pub(super) fn tick(&mut self, full: u64, lost: u64, now: Moment) -> Vec<HealthChange> {
        let mut changes = Vec::new();
        if self.full.read(full, now) {
            let what = Explained::new(
                "the interface's queue is full; frames wait",
                "check that another node on the bus acknowledges frames, and that the bus is not overloaded. If neither \
                 is the cause, increase `txqueuelen` of the interface",
            );
            changes.push(HealthChange::Worse { what, is_off: false });
        }
        if self.lost.read(lost, now) {
            let what = Explained::new(
                "frames are lost: this computer does not read them fast enough",
                "check whether another program loads the computer, or configure the nodes to send less often",
            );
            changes.push(HealthChange::Worse { what, is_off: false });
        }
        let over = Episode::end(&mut self.errors, "error frames", now);
        if over.is_some() {
            self.worst = None;
        }
        changes.extend(over);
        changes.extend(Episode::end(
            &mut self.full.episode,
            "times the queue of the interface was full",
            now,
        ));
        changes.extend(Episode::end(&mut self.lost.episode, "frames lost", now));
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(seconds: u64) -> Moment {
        Moment::default().after(Duration::from_secs(1000 + seconds))
    }

    fn error(class: u32) -> ErrorFrame {
        ErrorFrame::from_class(class)
    }

    #[test]
    fn error_frames_are_reported_when_they_begin_when_they_get_worse_and_when_they_are_over() {
        let mut health = Health::default();
        assert_eq!(health.trouble(&error(0x80), at(0)).len(), 1);
        for second in 1..5 {
            assert_eq!(health.trouble(&error(0x80), at(second)), []);
        }
        let off = health.trouble(&error(0x40), at(5));
        assert!(matches!(off.as_slice(), [HealthChange::Worse { is_off: true, .. }]), "{off:?}");
        assert_eq!(health.trouble(&error(0x100), at(6)), []);
        // A second bus-off is reported again.
        assert_eq!(health.trouble(&error(0x40), at(7)).len(), 1);
        assert_eq!(health.tick(0, 0, at(16)), []);
        let over = HealthChange::Over { count: 7, what: "error frames", within: Duration::from_secs(7) };
        assert_eq!(health.tick(0, 0, at(17)), [over]);
        assert_eq!(health.tick(0, 0, at(40)), []);
    }

    #[test]
    fn a_full_queue_and_lost_frames_are_reported_once_and_counted() {
        let mut health = Health::default();
        assert_eq!(health.tick(3, 0, at(0)).len(), 1);
        assert_eq!(health.tick(8, 0, at(5)), []);
        assert_eq!(health.tick(8, 40, at(6)).len(), 1);
        let full = HealthChange::Over {
            count: 8,
            what: "times the queue of the interface was full",
            within: Duration::from_secs(5),
        };
        assert_eq!(health.tick(8, 40, at(15)), [full]);
        let lost = HealthChange::Over { count: 40, what: "frames lost", within: Duration::ZERO };
        assert_eq!(health.tick(8, 40, at(16)), [lost]);
    }
}
