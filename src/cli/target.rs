//! Which line and which unit a verb speaks to: named in a profile, or written out.

use std::path::PathBuf;
use std::time::Duration;

use super::values::{self, key_and_value};
use super::{Failure, load_with};
use crate::discovery::Register;
use crate::discovery::bus::Place;
use isotherm_profile::{BusId, Profile, Quirks};

/// How long an answer is waited for where nothing is said.
const TIMEOUT: Duration = Duration::from_millis(500);

/// A line, with a profile or without one.
#[derive(clap::Args, Debug)]
pub(super) struct Target {
    /// The machine's profile, or the name of a shipped one
    #[arg(value_name = "PROFILE")]
    pub(super) profile: Option<PathBuf>,
    /// Overrides one key, as often as needed: `--set bus.cell.address=10.0.0.7:502`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value, requires = "profile")]
    pub(super) set: Vec<(String, String)>,
    /// The line: tcp://192.168.0.10:502, rtu:///dev/ttyUSB0?baud=9600&parity=none, rtu+tcp://192.168.0.11:4001;
    /// with a profile the name of one of its buses
    #[arg(long, value_name = "BUS")]
    pub(super) bus: Option<String>,
    /// Longest wait for one answer; else the profile's, or 500ms
    #[arg(long, value_name = "SPAN", value_parser = timeout)]
    pub(super) timeout: Option<Duration>,
}

/// A line that has been found.
pub(super) struct Found {
    pub(super) place: Place,
    pub(super) bus: isotherm_profile::Bus,
    pub(super) quirks: Quirks,
    /// The bus of the profile, and its name there.
    pub(super) known: Option<(Profile, BusId)>,
}

impl Target {
    /// The profile, if one is named.
    pub(super) fn load(&self, json: bool) -> Result<Option<Profile>, Failure> {
        self.profile.as_ref().map(|path| load_with(path, &self.set, json)).transpose()
    }

    /// The line.
    pub(super) fn find(&self, json: bool) -> Result<Found, Failure> {
        let Some(profile) = self.load(json)? else {
            let place: Place = self.bus.as_deref().unwrap_or_default().parse().map_err(anyhow::Error::msg)?;
            let bus = place.bus(self.timeout.unwrap_or(TIMEOUT));
            return Ok(Found { place, bus, quirks: Quirks::default(), known: None });
        };
        let names: Vec<&str> = profile.buses.iter().map(|bus| bus.name.as_str()).collect();
        let bus = match (&self.bus, names.len()) {
            (Some(name), _) => names.iter().position(|known| known == name),
            (None, 1) => Some(0),
            (None, _) => None,
        };
        let Some(bus) = bus.map(BusId) else {
            let wanted = self
                .bus
                .as_deref()
                .map_or("--bus is missing".to_owned(), |name| format!("the profile has no bus `{name}`"));
            return Err(anyhow::anyhow!("{wanted}; it has: {}", names.join(", ")).into());
        };
        Target::of(profile, bus, self.timeout)
    }

    /// A bus of a profile; on CAN nothing has registers.
    pub(super) fn of(profile: Profile, id: BusId, timeout: Option<Duration>) -> Result<Found, Failure> {
        if profile.bus(id).transport.is_can() {
            let name = &profile.bus(id).name;
            return Err(anyhow::anyhow!(
                "bus {name} is a CAN line, where nothing has registers; `isotherm read PROFILE` reads its signals"
            )
            .into());
        }
        let mut bus = profile.bus(id).clone();
        bus.timeout = timeout.unwrap_or(bus.timeout);
        Ok(Found { place: Place::of(&bus), bus, quirks: Quirks::default(), known: Some((profile, id)) })
    }
}

fn timeout(text: &str) -> Result<Duration, String> {
    let hint = "write a time above zero and of at most 60s, such as 300ms";
    values::span(text, Duration::from_secs(60), hint)
}

/// `3` or `1..247`, both ends included.
pub(super) fn units(text: &str) -> Result<(u8, u8), String> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    match (from.trim().parse(), to.trim().parse()) {
        (Ok(from), Ok(to)) if from <= to => Ok((from, to)),
        _ => Err(format!("`{text}` are no units; write 1..247 or 3, from 0 to 255")),
    }
}

/// `holding:0..99` or `40001..40100`, both ends included: the first and how many.
pub(super) fn stretch(text: &str) -> Result<(Register, u16), String> {
    let (from, to) =
        text.split_once("..").ok_or_else(|| format!("`{text}` is no stretch; write holding:0..99"))?;
    let first: Register = from.trim().parse()?;
    let to = to.trim();
    let last = match to.parse() {
        Ok(last) if from.contains(':') => last,
        _ => {
            to.parse::<Register>()
                .map_err(|_| format!("`{to}` is no end of a stretch; write holding:0..99"))?
                .offset
        }
    };
    let count = u32::from(last).checked_sub(u32::from(first.offset)).map(|count| count + 1);
    let count = count.and_then(|count| u16::try_from(count).ok()).filter(|count| *count <= MOST);
    count
        .map(|count| (first, count))
        .ok_or_else(|| format!("`{text}` is no stretch of 1 to {MOST} registers; write holding:0..99"))
}

/// Registers that are walked at once: at 9600 baud, some minutes.
const MOST: u16 = 10_000;
