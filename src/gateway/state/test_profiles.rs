//! Profiles of the unit tests of the gateway: one Modbus device, with or without signals.

use std::path::Path;

use isotherm_profile::Profile;

const DEVICE: &str = r#"
    [machine]
    name = "bench"
    [bus.cell]
    type = "modbus-tcp"
    address = "127.0.0.1:1502"
    [device.module]
    bus = "cell"
    unit = 1
"#;

/// Signals for two read requests. One request reads `bed` and `spindle` with a gap between their registers. The other
/// request reads `oil`.
pub(super) const THREE_SIGNALS: &str = r#"
    [signal.bed]
    device = "module"
    register = "input:0"
    type = "i16"
    unit = "degC"
    max_age = "5s"
    [signal.spindle]
    device = "module"
    register = "input:4"
    type = "i16"
    unit = "degC"
    max_age = "5s"
    [signal.oil]
    device = "module"
    register = "holding:0"
    type = "i16"
    unit = "degC"
    max_age = "5s"
"#;

/// Parses a profile with the device `module`. `more` contains further keys of this device, and after them signals and
/// axes.
pub(in crate::gateway) fn bench(more: &str) -> Profile {
    let parsed = isotherm_profile::parse(Path::new("bench.toml"), &format!("{DEVICE}{more}"), &[], &[]);
    parsed.unwrap_or_else(|errors| panic!("{errors}")).profile
}
