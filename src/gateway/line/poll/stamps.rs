//! Age of a reading with a source timestamp of a server.
//!
//! The timestamp is compared with the server's own time in the same answer. Therefore the difference between either
//! clock and the clock of this computer does not matter. A timestamp makes a reading older, never younger than its
//! request. If it is one hour behind, the reading is one hour old, whether the value or the source clock is late. If it
//! is ahead, a clock is wrong, and the age of the value is unknown.

use std::time::Duration;

use crate::fieldbus::wire::Stamped;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::{Device, SourceTime};

/// Meaning of the source timestamps of a device: time of the sample, or of the last change. `None` if they are not
/// used.
#[derive(Clone, Copy, Debug)]
pub(super) struct SourceStamps(Option<SourceTime>);

impl SourceStamps {
    pub(super) const fn of(device: &Device) -> SourceStamps {
        SourceStamps(device.source_time)
    }

    /// Returns the time between the sample and the answer, according to the timestamp. `None` if the timestamp is not
    /// used.
    pub(super) fn age(self, stamped: Stamped) -> Option<Duration> {
        match (self.0, stamped) {
            (Some(SourceTime::Sampled), Stamped::Ago(age)) => Some(age),
            _ => None,
        }
    }

    /// Returns the value and the time of its sample. `asked`: time of the request.
    pub(super) fn accepted(
        self,
        stamped: Stamped,
        value: Result<f64, Reason>,
        asked: Moment,
    ) -> (Result<f64, Reason>, Moment) {
        match (self.0, stamped) {
            (Some(SourceTime::Sampled), Stamped::Ago(age)) => (value, asked.before(age)),
            (Some(SourceTime::Sampled), Stamped::Ahead) => (value.and(Err(Reason::SourceClock)), asked),
            _ => (value, asked),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_hours(1);

    fn accepted(source_time: SourceTime, stamped: Stamped) -> (Result<f64, Reason>, Moment) {
        SourceStamps(Some(source_time)).accepted(stamped, Ok(27.5), Moment::default().after(2 * HOUR))
    }

    #[test]
    fn a_value_that_was_measured_an_hour_ago_is_an_hour_old() {
        let (value, taken) = accepted(SourceTime::Sampled, Stamped::Ago(HOUR));
        assert_eq!((value, taken), (Ok(27.5), Moment::default().after(HOUR)));
    }

    #[test]
    fn a_value_that_is_stamped_ahead_of_its_server_is_not_believed() {
        let (value, _) = accepted(SourceTime::Sampled, Stamped::Ahead);
        assert_eq!(value, Err(Reason::SourceClock));
    }

    #[test]
    fn where_stamps_say_when_a_value_changed_it_is_as_old_as_its_question() {
        for stamped in [Stamped::Ago(HOUR), Stamped::Ahead, Stamped::Unknown] {
            assert_eq!(accepted(SourceTime::Changed, stamped), (Ok(27.5), Moment::default().after(2 * HOUR)));
        }
    }

    #[test]
    fn a_bad_value_keeps_its_reason_whatever_it_is_stamped_with() {
        let stamps = SourceStamps(Some(SourceTime::Sampled));
        let bad = Err(Reason::Status(0x808c_0000));
        assert_eq!(stamps.accepted(Stamped::Ahead, bad, Moment::default()).0, bad);
    }
}
