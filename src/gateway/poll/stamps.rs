//! How old a reading is that a server has stamped with the time of its source.
//!
//! That time is compared with the server's own, which comes in the same answer: it does not matter how far either is from
//! this computer's. A stamp makes a reading older, never younger than the question. So one that is an hour behind makes it
//! an hour old, whether the value or the clock is; one that is ahead says that a clock is wrong, and then nobody knows how
//! old the value is.

use std::time::Duration;

use crate::fieldbus::wire::Stamped;
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;
use isotherm_profile::{Device, SourceTime};

/// What the time stamps of a device say.
#[derive(Clone, Copy, Debug)]
pub(super) struct SourceStamps(Option<SourceTime>);

impl SourceStamps {
    pub(super) const fn of(device: &Device) -> SourceStamps {
        SourceStamps(device.source_time)
    }

    /// How long before the answer it was taken, by its stamp; `None` where that is not looked at.
    pub(super) fn age(self, stamped: Stamped) -> Option<Duration> {
        match (self.0, stamped) {
            (Some(SourceTime::Sampled), Stamped::Ago(age)) => Some(age),
            _ => None,
        }
    }

    /// The value with the moment at which it was taken, of a question that left then.
    pub(super) fn believed(
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

    fn believed(source_time: SourceTime, stamped: Stamped) -> (Result<f64, Reason>, Moment) {
        SourceStamps(Some(source_time)).believed(stamped, Ok(27.5), Moment::default().after(2 * HOUR))
    }

    #[test]
    fn a_value_that_was_measured_an_hour_ago_is_an_hour_old() {
        let (value, taken) = believed(SourceTime::Sampled, Stamped::Ago(HOUR));
        assert_eq!((value, taken), (Ok(27.5), Moment::default().after(HOUR)));
    }

    #[test]
    fn a_value_that_is_stamped_ahead_of_its_server_is_not_believed() {
        let (value, _) = believed(SourceTime::Sampled, Stamped::Ahead);
        assert_eq!(value, Err(Reason::SourceClock));
    }

    #[test]
    fn where_stamps_say_when_a_value_changed_it_is_as_old_as_its_question() {
        for stamped in [Stamped::Ago(HOUR), Stamped::Ahead, Stamped::Unknown] {
            assert_eq!(believed(SourceTime::Changed, stamped), (Ok(27.5), Moment::default().after(2 * HOUR)));
        }
    }

    #[test]
    fn a_bad_value_keeps_its_reason_whatever_it_is_stamped_with() {
        let stamps = SourceStamps(Some(SourceTime::Sampled));
        let bad = Err(Reason::Status(0x808c_0000));
        assert_eq!(stamps.believed(Stamped::Ahead, bad, Moment::default()).0, bad);
    }
}
