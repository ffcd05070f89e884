//! Time zone of the computer's clock.

use jiff::tz::TimeZone;

/// Returns the IANA name of the computer's time zone; `UTC` if the zone is unknown or has no such name.
pub fn zone() -> String {
    TimeZone::try_system()
        .ok()
        .and_then(|zone| zone.iana_name().map(str::to_owned))
        .unwrap_or("UTC".to_owned())
}
