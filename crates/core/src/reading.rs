//! One value from the machine, with its time and its quality.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::Moment;

mod status;

pub use status::Status;

/// Index of a signal in the list of the profile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SignalId(pub usize);

/// Value of a signal, with its time and quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Value in the signal's unit. Meaningless unless the quality is good.
    pub value: f64,
    /// Time of measurement.
    pub at: Moment,
    /// Whether the value may be used.
    pub quality: Quality,
}

/// Whether a value may be used, and if not, why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Quality {
    /// The value is recent and within its range, and its device has no fault.
    Good,
    /// The value must not be used, for this reason.
    Bad(Reason),
}

/// Reason why a value must not be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Reason {
    /// No answer since the gateway started.
    NeverRead,
    /// The last good value is older than `max_age`.
    Stale,
    /// The raw count is one that the device sends if it has no measurement.
    Sentinel,
    /// The device reports that the circuit of the sensor is open.
    OpenCircuit,
    /// The device reports that the circuit of the sensor is shorted.
    ShortCircuit,
    /// The device reports that the channel is switched off.
    SwitchedOff,
    /// The device reports a value above its measuring range.
    AboveRange,
    /// The device reports a value below its measuring range.
    BelowRange,
    /// The device reports that the value is not available.
    NotAvailable,
    /// The device reports that the sensor is faulty.
    SensorFault,
    /// A CAN frame has fewer bytes than the value needs.
    ShortFrame,
    /// A floating-point register holds NaN or infinity.
    NotANumber,
    /// The value is outside of `range`.
    OutOfRange,
    /// The value changed faster than `max_rate`.
    TooFast,
    /// The difference from the last value before a break exceeds `max_rate` times the time without a value.
    Jumped,
    /// The device answered with this Modbus exception code.
    Exception(u8),
    /// The node refused to send the object.
    Refused,
    /// The OPC UA server sends the value with this status, which is not good.
    Status(u32),
    /// The node has another type than the profile states.
    WrongType,
    /// The source timestamp of the value is later than the time of the server that sends it.
    SourceClock,
    /// This computer has no sensor of this name.
    NotFound,
    /// This computer has several sensors of this name.
    SeveralFound,
    /// The kernel of this computer cannot read the sensor, or denies access.
    Unreadable,
    /// The checksum of the data from the sensor is wrong.
    Checksum,
    /// The 1-Wire sensor shows its value after power-on, because it has not measured yet.
    PowerOnValue,
    /// The memory of the sensor reads zero, including its checksum: no device drives the line.
    AllZero,
    /// The device did not answer in time.
    Timeout,
    /// No connection to the device.
    LinkDown,
    /// The reply does not match the request (length, unit, function, transaction).
    BadReply,
    /// The signal's `fault_when` holds, or the signals in it cannot be read.
    FaultBit,
    /// The checks of the device have not confirmed its expected settings.
    NotAsExpected,
    /// The replayed log has no value here.
    NotInLog,
}

impl Reading {
    /// Reading before the first answer.
    pub const NEVER: Reading = Reading::bad(Moment::from_nanos(0), Reason::NeverRead);

    /// Creates a good reading.
    pub const fn good(value: f64, at: Moment) -> Reading {
        Reading { value, at, quality: Quality::Good }
    }

    /// Creates a reading without a value, for this reason.
    pub const fn bad(at: Moment, reason: Reason) -> Reading {
        Reading { value: f64::NAN, at, quality: Quality::Bad(reason) }
    }

    /// Returns the value if it may be used.
    pub fn usable(&self) -> Option<f64> {
        (self.quality == Quality::Good && self.value.is_finite()).then_some(self.value)
    }

    /// Returns the reading as it counts at `now`: a good one older than `max_age` is stale.
    pub fn aged(self, now: Moment, max_age: Duration) -> Reading {
        if self.quality == Quality::Good && now.since(self.at) > max_age {
            return Reading { quality: Quality::Bad(Reason::Stale), ..self };
        }
        self
    }
}

impl Reason {
    /// Meanings of raw values that a profile can state, with their names there.
    pub const MEANINGS: [(&'static str, Reason); 7] = [
        ("open circuit", Reason::OpenCircuit),
        ("short circuit", Reason::ShortCircuit),
        ("switched off", Reason::SwitchedOff),
        ("above range", Reason::AboveRange),
        ("below range", Reason::BelowRange),
        ("not available", Reason::NotAvailable),
        ("sensor fault", Reason::SensorFault),
    ];

    /// Name for programs: metrics, JSON, logs.
    pub fn code(self) -> &'static str {
        match self {
            Reason::NeverRead => "never-read",
            Reason::Stale => "stale",
            Reason::Sentinel => "sentinel",
            Reason::OpenCircuit => "open-circuit",
            Reason::ShortCircuit => "short-circuit",
            Reason::SwitchedOff => "switched-off",
            Reason::AboveRange => "above-range",
            Reason::BelowRange => "below-range",
            Reason::NotAvailable => "not-available",
            Reason::SensorFault => "sensor-fault",
            Reason::ShortFrame => "short-frame",
            Reason::NotANumber => "not-a-number",
            Reason::OutOfRange => "out-of-range",
            Reason::TooFast => "too-fast",
            Reason::Jumped => "jumped",
            Reason::Exception(_) => "exception",
            Reason::Refused => "refused",
            Reason::Status(_) => "status",
            Reason::WrongType => "wrong-type",
            Reason::SourceClock => "source-clock",
            Reason::NotFound => "not-found",
            Reason::SeveralFound => "several-found",
            Reason::Unreadable => "unreadable",
            Reason::Checksum => "checksum",
            Reason::PowerOnValue => "power-on-value",
            Reason::AllZero => "all-zero",
            Reason::Timeout => "timeout",
            Reason::LinkDown => "link-down",
            Reason::BadReply => "bad-reply",
            Reason::FaultBit => "fault-bit",
            Reason::NotAsExpected => "not-as-expected",
            Reason::NotInLog => "not-in-log",
        }
    }
}

/// Name of a Modbus exception in its specification.
pub const fn exception(code: u8) -> &'static str {
    match code {
        1 => "illegal function",
        2 => "illegal data address",
        3 => "illegal data value",
        4 => "device failure",
        5 => "acknowledge",
        6 => "device busy",
        8 => "memory parity error",
        10 => "gateway path unavailable",
        11 => "gateway target does not respond",
        _ => "unknown code",
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Reason::NeverRead => "never read",
            Reason::Stale => "stale",
            Reason::Sentinel => "no measurement",
            Reason::OpenCircuit => "open circuit",
            Reason::ShortCircuit => "short circuit",
            Reason::SwitchedOff => "channel switched off",
            Reason::AboveRange => "above the measuring range",
            Reason::BelowRange => "below the measuring range",
            Reason::NotAvailable => "not available",
            Reason::SensorFault => "sensor fault",
            Reason::ShortFrame => "frame too short",
            Reason::NotANumber => "not a number",
            Reason::OutOfRange => "out of range",
            Reason::TooFast => "changing too fast",
            Reason::Jumped => "jumped while its device was away",
            Reason::Exception(code) => return write!(f, "exception {code} ({})", exception(*code)),
            Reason::Refused => "the node refuses to give its value",
            Reason::Status(code) => return write!(f, "{}", Status(*code)),
            Reason::WrongType => "the node has another type than the profile says",
            Reason::SourceClock => "stamped later than its server's own time: a clock is wrong",
            Reason::NotFound => "this computer has no sensor of this name",
            Reason::SeveralFound => "this computer has several sensors of this name",
            Reason::Unreadable => "this computer cannot read the sensor",
            Reason::Checksum => "wrong checksum: disturbed on its way",
            Reason::PowerOnValue => "85 °C, which the sensor shows at power-on: it has not measured",
            Reason::AllZero => "all zero: line shorted, or sensor without power",
            Reason::Timeout => "no answer in time",
            Reason::LinkDown => "no connection",
            Reason::BadReply => "wrong reply",
            Reason::FaultBit => "fault bit set",
            Reason::NotAsExpected => "its device is not set as expected",
            Reason::NotInLog => "not in the log",
        })
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Quality::Good => f.write_str("good"),
            Quality::Bad(reason) => reason.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_good_reading_turns_stale_when_it_is_older_than_its_maximum_age() {
        let taken = Moment::from_nanos(0);
        let reading = Reading::good(27.5, taken);
        let age = Duration::from_secs(5);
        assert_eq!(reading.aged(taken.after(age), age).usable(), Some(27.5));
        let late = reading.aged(taken.after(age + Duration::from_nanos(1)), age);
        assert_eq!(late.quality, Quality::Bad(Reason::Stale));
        assert_eq!(late.usable(), None);
    }

    #[test]
    fn a_bad_reading_keeps_its_first_reason_when_it_ages() {
        let reading = Reading::bad(Moment::from_nanos(0), Reason::Sentinel);
        let later = reading.aged(Moment::from_nanos(u64::MAX), Duration::from_secs(1));
        assert_eq!(later.quality, Quality::Bad(Reason::Sentinel));
    }
}
