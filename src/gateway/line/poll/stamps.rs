//! Age of a reading, from the source timestamp that an OPC UA server sends with a value.
//!
//! The timestamp is compared with the server's own time in the same answer. Therefore the clock of the server need
//! not agree with the clock of this computer. A timestamp can only make a reading older than its request, never
//! younger. A timestamp that is one hour old makes the reading one hour old, even if only the source clock is slow. A
//! timestamp in the future shows that a clock is wrong, and the age of the value is then unknown.

use std::time::Duration;

use crate::fieldbus::wire::Stamped;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::SourceTime;

/// Returns the value, the time of its sample, and the time between the sample and the answer. The last time is `None`
/// if the timestamp is not used.
///
/// `source_time`: meaning of the device's source timestamps (time of the sample, or of the last change); `None` if
/// they are not used. `asked`: time of the request.
pub(super) fn accepted(
    source_time: Option<SourceTime>,
    stamped: Stamped,
    value: Result<f64, Reason>,
    asked: Moment,
) -> (Result<f64, Reason>, Moment, Option<Duration>) {
    match (source_time, stamped) {
        (Some(SourceTime::Sampled), Stamped::Ago(age)) => (value, asked.before(age), Some(age)),
        (Some(SourceTime::Sampled), Stamped::Ahead) => (value.and(Err(Reason::SourceClock)), asked, None),
        _ => (value, asked, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_hours(1);

    fn stamped_by(source_time: SourceTime, stamped: Stamped) -> (Result<f64, Reason>, Moment) {
        let asked = Moment::default().after(2 * HOUR);
        let (value, taken, _) = accepted(Some(source_time), stamped, Ok(27.5), asked);
        (value, taken)
    }

    #[test]
    fn a_value_that_was_measured_an_hour_ago_is_an_hour_old() {
        let (value, taken) = stamped_by(SourceTime::Sampled, Stamped::Ago(HOUR));
        assert_eq!((value, taken), (Ok(27.5), Moment::default().after(HOUR)));
    }

    #[test]
    fn a_value_that_is_stamped_ahead_of_its_server_is_not_believed() {
        let (value, _) = stamped_by(SourceTime::Sampled, Stamped::Ahead);
        assert_eq!(value, Err(Reason::SourceClock));
    }

    #[test]
    fn where_stamps_say_when_a_value_changed_it_is_as_old_as_its_question() {
        for stamped in [Stamped::Ago(HOUR), Stamped::Ahead, Stamped::Unknown] {
            let asked = Moment::default().after(2 * HOUR);
            assert_eq!(stamped_by(SourceTime::Changed, stamped), (Ok(27.5), asked));
        }
    }

    #[test]
    fn a_bad_value_keeps_its_reason_whatever_it_is_stamped_with() {
        let bad = Err(Reason::Status(0x808c_0000));
        assert_eq!(accepted(Some(SourceTime::Sampled), Stamped::Ahead, bad, Moment::default()).0, bad);
    }
}
