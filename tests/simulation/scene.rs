//! Simulated machines: a profile, and additional events of its thermocouple module.

use isotherm_profile::Profile;

use crate::day;
use crate::panel::RATE;
use crate::second_master::MAX_RATE;

/// Profile of a machine, and its additional events.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) profile: Profile,
    pub(crate) beyond: Beyond,
}

/// Events of the thermocouple module that only some machines have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beyond {
    /// No additional events.
    Nothing,
    /// Its settings are changed at its panel while contact lasts.
    Panel,
    /// Modbus gateway between line and module, which uses a late reply for the request that is open then.
    Shifts,
    /// Serial line with another master.
    SecondMaster,
}

impl Scene {
    /// The usual machine, with this profile.
    pub(crate) fn usual(profile: Profile) -> Scene {
        Scene { profile, beyond: Beyond::Nothing }
    }

    /// Machine with changes at the panel. Its axes are slow, so that the time for which they follow wrong values
    /// matters.
    pub(crate) fn panel(text: &str) -> Scene {
        let profile = day::parsed(&text.replace("rate = 1.0", &format!("rate = {RATE}")));
        Scene { profile, beyond: Beyond::Panel }
    }

    /// Machine behind a Modbus gateway that exchanges replies between two requests of the same form. `is_known` is
    /// whether the profile declares the Modbus gateway.
    pub(crate) fn gateway(is_known: bool) -> Scene {
        let [_, warmer] = Beyond::Shifts.bases();
        let line = "bus = \"sensors\"\nunit = 1\n";
        let text = day::TEXT
            .replace(line, &format!("{line}quirks = {{ gateway = {is_known} }}\n"))
            .replace("register = \"input:1\"", "register = \"input:100\"");
        let of_column = |line: &str| match line.contains("signal = \"column\"") {
            true => line.replace("reference = 20.0", &format!("reference = {warmer:.1}")),
            false => line.to_owned(),
        };
        let text: Vec<String> = text.lines().map(of_column).collect();
        Scene { profile: day::parsed(&text.join("\n")), beyond: Beyond::Shifts }
    }

    /// Machine on a serial line behind a serial server, with another master. `kind` is the type of the bus. `is_limited`
    /// is whether the profile limits the rate of the temperatures.
    pub(crate) fn second_master(kind: &str, is_limited: bool) -> Scene {
        let (bus, no_rate) = ("[bus.sensors]\ntype = \"", "max_rate = \"none\"\n");
        let text = day::TEXT.replace(&format!("{bus}modbus-tcp\""), &format!("{bus}{kind}\""));
        let limited = text.replace(no_rate, &format!("max_rate = {MAX_RATE}\n"));
        let profile = day::parsed(if is_limited { &limited } else { &text });
        Scene { profile, beyond: Beyond::SecondMaster }
    }
}

impl Beyond {
    /// Percentage of events of this kind.
    pub(crate) fn share(self) -> u32 {
        match self {
            Beyond::Nothing => 0,
            Beyond::Panel => 3,
            Beyond::Shifts => 8,
            Beyond::SecondMaster => 10,
        }
    }

    /// Mean temperatures of bed and column, °C. They differ if exchanged values must be detected.
    pub(crate) fn bases(self) -> [f64; 2] {
        match self {
            Beyond::Nothing | Beyond::Panel | Beyond::SecondMaster => [20.0, 20.0],
            Beyond::Shifts => [20.0, 33.0],
        }
    }
}
