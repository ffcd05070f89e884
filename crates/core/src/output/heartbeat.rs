//! Heartbeats: counters that show a control that the gateway runs, and that it computes the decisions of the axes in
//! time.

use serde::{Deserialize, Serialize};

/// Change of the heartbeat count in the next request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Beat {
    /// No heartbeat is sent in a dry run (a run that writes nothing). With `arm = "manual"`, no heartbeat is sent
    /// before the first arming of an axis. Otherwise, none is sent before the first reading of a signal.
    #[default]
    Silent,
    /// The count does not change, because the gateway did not compute the decisions of the axes in time.
    Stands,
    /// The count increases with each request.
    Counts,
}

/// Counter of a heartbeat that has a register of its own. A failed request is not repeated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeartbeatController {
    count: u16,
}

impl HeartbeatController {
    /// Returns the count to write, or `None` if no heartbeat is sent. `highest` is the largest count of the register.
    pub fn next(&mut self, beat: Beat, highest: u16) -> Option<u16> {
        if beat == Beat::Counts {
            self.count = count_after(self.count, highest);
        }
        (beat != Beat::Silent).then_some(self.count)
    }
}

/// Returns the count after `count`: one more, or zero after `highest`.
pub(super) fn count_after(count: u16, highest: u16) -> u16 {
    if count >= highest { 0 } else { count + 1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heartbeat_counts_stands_or_is_silent_and_starts_again_after_its_highest_count() {
        let mut one = HeartbeatController { count: 65534 };
        let beats = [Beat::Silent, Beat::Counts, Beat::Stands, Beat::Counts, Beat::Silent, Beat::Counts];
        let counts = beats.map(|beat| one.next(beat, u16::MAX));
        assert_eq!(counts, [None, Some(65535), Some(65535), Some(0), None, Some(1)]);
        assert_eq!(
            (count_after(0, 32767), count_after(32766, 32767), count_after(32767, 32767)),
            (1, 32767, 0)
        );
    }
}
