//! The zone that the computer's clock is shown in.

use jiff::tz::TimeZone;

/// Its IANA name; `UTC` where the computer does not say, or says it in a way that has no name.
pub fn zone() -> String {
    TimeZone::try_system()
        .ok()
        .and_then(|zone| zone.iana_name().map(str::to_owned))
        .unwrap_or("UTC".to_owned())
}
