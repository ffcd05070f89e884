//! The units that a signal may have.

/// Engineering units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unit(pub &'static str);

impl Unit {
    /// The units a profile may name; "1" is a number without one.
    pub const WORDS: [&'static str; 23] = [
        "degC", "K", "mm", "um", "rpm", "bool", "percent", "mm/min", "m/s", "l/min", "bar", "V", "mV", "A",
        "mA", "W", "kW", "N", "Nm", "Hz", "s", "count", "1",
    ];

    /// The unit with this name.
    pub fn named(name: &str) -> Option<Unit> {
        Unit::WORDS.into_iter().find(|known| *known == name).map(Unit)
    }
}

impl std::fmt::Display for Unit {
    /// As people write it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self.0 {
            "degC" => "°C",
            "um" => "µm",
            "percent" => "%",
            "1" => "",
            name => name,
        })
    }
}
