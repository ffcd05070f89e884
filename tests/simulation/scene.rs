//! Machines of the simulation: a profile, and what happens to its thermometers beyond the usual.

use isotherm_profile::Profile;

use crate::day;
use crate::panel::RATE;
use crate::second_master::MAX_RATE;

/// Profile of a machine, and what else happens to it.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) profile: Profile,
    pub(crate) beyond: Beyond,
}

/// Events of the module with the thermocouples that only some machines have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Beyond {
    /// None.
    Nothing,
    /// Its settings are changed at its panel while contact lasts.
    Panel,
    /// It is behind a gateway to a serial line, which gives a late answer to the question that is open then.
    Shifts,
    /// It is on an RTU line with another master.
    SecondMaster,
}

impl Scene {
    /// The usual machine, by this profile.
    pub(crate) fn usual(profile: Profile) -> Scene {
        Scene { profile, beyond: Beyond::Nothing }
    }

    /// The same with changes at the panel. Its axes are slow, so that it matters for how long they follow wrong values.
    pub(crate) fn panel(text: &str) -> Scene {
        let profile = day::parsed(&text.replace("rate = 1.0", &format!("rate = {RATE}")));
        Scene { profile, beyond: Beyond::Panel }
    }

    /// The same behind a gateway that shifts answers, by two requests of the same form. The profile says that it is there, or denies it.
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

    /// The same on an RTU line behind a serial server, with another master. The profile limits how fast the temperatures change, or does
    /// not.
    pub(crate) fn second_master(is_limited: bool) -> Scene {
        let (bus, age) = ("[bus.sensors]\ntype = \"modbus-", "max_age = \"3s\"\n");
        let text = day::TEXT.replace(&format!("{bus}tcp\""), &format!("{bus}rtu-over-tcp\""));
        let limited = text.replace(age, &format!("{age}max_rate = {MAX_RATE}\n"));
        let profile = day::parsed(if is_limited { &limited } else { &text });
        Scene { profile, beyond: Beyond::SecondMaster }
    }
}

impl Beyond {
    /// Of a hundred events, so many are of this kind.
    pub(crate) fn share(self) -> u32 {
        match self {
            Beyond::Nothing => 0,
            Beyond::Panel => 3,
            Beyond::Shifts => 8,
            Beyond::SecondMaster => 10,
        }
    }

    /// Temperatures about which bed and column move, °C. Values that are exchanged must show.
    pub(crate) fn bases(self) -> [f64; 2] {
        match self {
            Beyond::Nothing | Beyond::Panel | Beyond::SecondMaster => [20.0, 20.0],
            Beyond::Shifts => [20.0, 33.0],
        }
    }
}
