//! Reading of a signal: one value from the machine, with its time and its quality.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::Moment;

mod status;

pub use status::Status;

/// Index of a signal in the profile's list of signals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct SignalId(pub usize);

/// Value of a signal, with its time and quality.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Value in the signal's unit. The value has a meaning only if the quality is good.
    pub value: f64,
    /// Time of measurement.
    pub at: Moment,
    /// Quality: whether the value may be used, and if not, why.
    pub quality: Quality,
}

/// Quality of a reading: whether its value may be used, and if not, why.
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
    /// The signal has not been read since the gateway started.
    NeverRead,
    /// The last good value is older than the `max_age` of the profile.
    Stale,
    /// The raw count is a sentinel, which the device sends if it has no measurement.
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
    /// The CAN frame has fewer bytes than the value needs.
    ShortFrame,
    /// The value is a floating-point number that is NaN or infinite.
    NotANumber,
    /// The value is outside the `range` of the profile.
    OutOfRange,
    /// The value changed faster than the `max_rate` of the profile.
    TooFast,
    /// The value differs too much from the last value before contact with the device was lost. The limit is `max_rate`
    /// times the time without a value.
    Jumped,
    /// The scale of the value, which the device has in another register, has changed. The value is used again when it
    /// is plausible.
    ScaleChanged,
    /// The register of the value's scale contains no power of ten.
    NoScale,
    /// The device answered with this Modbus exception code.
    Exception(u8),
    /// The CANopen node refused to send the object.
    Refused,
    /// The OPC UA server sent the value with this status code, which is not good.
    Status(u32),
    /// The OPC UA node has another type than the profile states.
    WrongType,
    /// The value of the OPC UA node is not a number, and the profile states no type.
    NoNumber,
    /// The OPC UA node has no array, or the array does not have the element of the profile.
    NoElement,
    /// The source timestamp of the value is later than the time of the OPC UA server that sends the value.
    SourceClock,
    /// This computer has no sensor of this name.
    NotFound,
    /// This computer has several sensors of this name.
    SeveralFound,
    /// The kernel of this computer cannot read the sensor, or denies access.
    Unreadable,
    /// The checksum of the data from the sensor is wrong.
    Checksum,
    /// The 1-Wire sensor shows its fixed value after power-on, because it has not measured yet.
    PowerOnValue,
    /// The memory of the 1-Wire sensor reads zero, including its checksum: its bus line is shorted, or the sensor has
    /// no power.
    AllZero,
    /// The device did not answer within the timeout of the request.
    Timeout,
    /// The gateway has no connection to the device.
    LinkDown,
    /// The reply does not match the request: its length, device address, function code or transaction number differs.
    BadReply,
    /// The condition `fault_when` of the signal is true, or a signal in this condition cannot be read.
    FaultBit,
    /// The checks of the device's settings have not passed, so its readings are not used.
    NotAsExpected,
    /// The replayed log has no value for the signal in this row.
    NotInLog,
}

/// Equipment or settings that the operator must correct after a bad reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Remedy {
    /// The device gives no valid answer: the operator corrects its address, its bus line or its wiring.
    Connection,
    /// A setting of the device is not as the profile or its template expects: the operator changes the setting.
    DeviceSettings,
    /// The device reports a fault of the sensor: the operator repairs the sensor or its wiring.
    Sensor,
    /// The settings of the signal in the profile do not fit the device: the operator corrects the profile.
    Profile,
}

impl Reading {
    /// Reading of a signal that has not been read yet.
    pub const NEVER: Reading = Reading::bad(Moment::from_nanos(0), Reason::NeverRead);

    /// Creates a reading with this value, which may be used.
    pub const fn good(value: f64, at: Moment) -> Reading {
        Reading { value, at, quality: Quality::Good }
    }

    /// Creates a reading without a value, rejected for this reason.
    pub const fn bad(at: Moment, reason: Reason) -> Reading {
        Reading { value: f64::NAN, at, quality: Quality::Bad(reason) }
    }

    /// Returns the value if it may be used; else `None`.
    pub fn usable(&self) -> Option<f64> {
        (self.quality == Quality::Good && self.value.is_finite()).then_some(self.value)
    }

    /// Returns the reading as it is valid at `now`: a good reading older than `max_age` becomes stale.
    pub fn aged(self, now: Moment, max_age: Duration) -> Reading {
        if self.quality == Quality::Good && now.since(self.at) > max_age {
            return Reading { quality: Quality::Bad(Reason::Stale), ..self };
        }
        self
    }
}

impl Reason {
    /// Meanings that a profile can give to a raw value, each with its name in the profile.
    pub const MEANINGS: [(&'static str, Reason); 7] = [
        ("open circuit", Reason::OpenCircuit),
        ("short circuit", Reason::ShortCircuit),
        ("switched off", Reason::SwitchedOff),
        ("above range", Reason::AboveRange),
        ("below range", Reason::BelowRange),
        ("not available", Reason::NotAvailable),
        ("sensor fault", Reason::SensorFault),
    ];

    /// Returns the name of the reason for programs: in metrics, JSON and logs.
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
            Reason::ScaleChanged => "scale-changed",
            Reason::NoScale => "no-scale",
            Reason::Exception(_) => "exception",
            Reason::Refused => "refused",
            Reason::Status(_) => "status",
            Reason::WrongType => "wrong-type",
            Reason::NoNumber => "no-number",
            Reason::NoElement => "no-element",
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

    /// Returns the equipment or settings that the operator must most probably correct.
    pub const fn remedy(self) -> Remedy {
        match self {
            Reason::NeverRead | Reason::Timeout | Reason::LinkDown | Reason::BadReply => Remedy::Connection,
            Reason::NotAsExpected => Remedy::DeviceSettings,
            Reason::Sentinel
            | Reason::OpenCircuit
            | Reason::ShortCircuit
            | Reason::SwitchedOff
            | Reason::AboveRange
            | Reason::BelowRange
            | Reason::NotAvailable
            | Reason::SensorFault
            | Reason::PowerOnValue
            | Reason::AllZero
            | Reason::FaultBit => Remedy::Sensor,
            Reason::Stale
            | Reason::ShortFrame
            | Reason::NotANumber
            | Reason::OutOfRange
            | Reason::TooFast
            | Reason::Jumped
            | Reason::ScaleChanged
            | Reason::NoScale
            | Reason::Exception(_)
            | Reason::Refused
            | Reason::Status(_)
            | Reason::WrongType
            | Reason::NoNumber
            | Reason::NoElement
            | Reason::SourceClock
            | Reason::NotFound
            | Reason::SeveralFound
            | Reason::Unreadable
            | Reason::Checksum
            | Reason::NotInLog => Remedy::Profile,
        }
    }
}

/// Returns a short name of a Modbus exception code, after the Modbus specification.
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
            Reason::Jumped => "jumped while its device did not answer",
            Reason::ScaleChanged => "its scale in the device has changed",
            Reason::NoScale => "its scale register contains no power of ten",
            Reason::Exception(code) => return write!(f, "exception {code} ({})", exception(*code)),
            Reason::Refused => "the node refuses to give its value",
            Reason::Status(code) => return write!(f, "{}", Status(*code)),
            Reason::WrongType => "the node has another type than the profile says",
            Reason::NoNumber => "the value of the node is not a number",
            Reason::NoElement => "the node does not have this element of an array",
            Reason::SourceClock => "time stamp later than its server's own time: a clock is wrong",
            Reason::NotFound => "this computer has no sensor of this name",
            Reason::SeveralFound => "this computer has several sensors of this name",
            Reason::Unreadable => "this computer cannot read the sensor",
            Reason::Checksum => "wrong checksum: the data was disturbed on the line",
            Reason::PowerOnValue => "85 °C, which the sensor shows at power-on: it has not measured yet",
            Reason::AllZero => "all zero: line shorted, or sensor without power",
            Reason::Timeout => "no answer in time",
            Reason::LinkDown => "no connection",
            Reason::BadReply => "wrong reply",
            Reason::FaultBit => "fault bit set",
            Reason::NotAsExpected => "the settings of its device are not as expected",
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
