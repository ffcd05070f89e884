//! Load of a bus line: the exchanges per second, and the share of time for which they occupy the line. An exchange is a
//! request with its answer.
//!
//! The load is calculated for the busiest time without a fault, when Cz of every axis changes at each update.
//! Profiles do not state the answer time of devices, so a typical answer time is assumed. The preview also
//! shows the answer time at which the line would be full.

use std::time::Duration;

use serde::Serialize;

use super::traffic::{Exchange, traffic};
use crate::document::{Section, entries};
use crate::duration::ms;
use crate::kinds;
use crate::wording::counted;
use crate::{Bus, BusId, Device, Profile, ProfileError};

/// Load in percent above which a line has too little reserve for lost answers and retries.
const TIGHT: f64 = 80.0;
const FULL: f64 = 100.0;

/// Load of a bus line: the share of time for which the exchanges occupy the line.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Exchanges per second while Cz of every axis changes at each update.
    pub exchanges_per_second: f64,
    /// Share of the line's time for reading signals, in percent.
    pub polls_percent: f64,
    /// Share of the line's time for writing, including the reads before and after a write, in percent.
    pub writes_percent: f64,
    /// Share of the line's time for all exchanges (reading and writing), in percent.
    pub percent: f64,
    /// Assumed answer time of a device in milliseconds. On a serial port, it does not include the transfer of the
    /// bytes.
    pub answer_ms: f64,
    /// Answer time at which the line would be full, in milliseconds. `None` if the line is full even if devices answer
    /// at once.
    pub full_at_answer_ms: Option<f64>,
    /// Assessment of the load.
    pub verdict: Verdict,
    timeout_ms: f64,
    is_serial: bool,
}

/// Assessment of the load of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The exchanges fit into the time of the line.
    Fits,
    /// The exchanges fit, but without reserve for lost answers.
    Tight,
    /// The exchanges take more time than the line has.
    Full,
}

/// Duration of an exchange: the time `known`, plus `waits` times the answer time of the device.
struct Cost {
    known: Duration,
    waits: f64,
}

fn cost(bus: &Bus, device: &Device, asked: &Exchange) -> Cost {
    let quirks = &device.quirks;
    let serial = bus.transport.serial();
    let bytes = serial.map_or(Duration::ZERO, |serial| serial.exchange(asked.question, asked.answer));
    let known = bytes + quirks.pause_between_requests;
    if quirks.close_after_each {
        // The next request requires a new connection first.
        let lost = if quirks.loses_first_request { bus.timeout } else { Duration::ZERO };
        return Cost { known: known + quirks.pause_after_connect + lost, waits: 2.0 };
    }
    Cost { known, waits: 1.0 }
}

/// Returns the time of one exchange, including the assumed answer time of the device, its pauses, and a new connection
/// if the device needs one.
pub(super) fn exchange_time(bus: &Bus, device: &Device, asked: &Exchange) -> Duration {
    let Cost { known, waits } = cost(bus, device, asked);
    let (_, line) = kinds::of(bus.transport);
    known + line.answer.mul_f64(waits)
}

/// Warns about lines that have less time than their exchanges require.
pub fn warnings(profile: &Profile) -> Vec<ProfileError> {
    let loads = Load::of_lines(profile).into_iter().zip(&profile.buses);
    let loads = loads.filter_map(|(load, bus)| load.zip(Some(bus)));
    let full = loads.filter(|(load, _)| load.verdict == Verdict::Full);
    let warning = full.map(|(load, bus)| {
        let help = if load.polls_percent > load.writes_percent {
            "poll the devices of this line less often (`every`), or put some of the devices on another line"
        } else {
            "update the axes less often (`every`; `refresh` of their outputs), or put the outputs on \
             another line"
        };
        let message = format!(
            "{}: readings will be older, and corrections later, than the profile \
                     requires",
            load.asked_of_it()
        );
        let about = ProfileError::about(profile.path.display().to_string(), message, Some(help.to_owned()));
        ProfileError { key: format!("bus.{}", bus.name), ..about }
    });
    warning.collect()
}

impl Load {
    /// Calculates the load of each line, in the order of the buses. An entry is `None` if nothing is
    /// requested on the line, for example on a CAN line whose devices send by themselves. The entry is also
    /// `None` for sensors of this computer, because all of them are read at the same time.
    pub fn of_lines(profile: &Profile) -> Vec<Option<Load>> {
        let lines = profile.buses.iter().zip(traffic(profile));
        lines.map(|(bus, asked)| Load::of_exchanges(profile, bus, &asked)).collect()
    }

    /// Calculates the load of one line. `None` in the same cases as in the result of [`Load::of_lines`].
    pub fn of(profile: &Profile, id: BusId) -> Option<Load> {
        Load::of_lines(profile).swap_remove(id.0)
    }

    fn of_exchanges(profile: &Profile, bus: &Bus, asked: &[Exchange]) -> Option<Load> {
        let (kind, line) = kinds::of(bus.transport);
        if !kind.has_load || asked.is_empty() {
            return None;
        }
        let answer = line.answer;
        let (mut known, mut waits, mut percent) = (0.0, 0.0, [0.0; 2]);
        for asked in asked {
            let cost = cost(bus, profile.device(asked.device), asked);
            let (seconds, times) =
                (asked.per_second * cost.known.as_secs_f64(), asked.per_second * cost.waits);
            known += seconds;
            waits += times;
            percent[usize::from(asked.writes)] += 100.0 * (seconds + times * answer.as_secs_f64());
        }
        let [polls_percent, writes_percent] = percent;
        let percent = polls_percent + writes_percent;
        Some(Load {
            exchanges_per_second: asked.iter().map(|asked| asked.per_second).sum(),
            polls_percent,
            writes_percent,
            percent,
            answer_ms: ms(answer),
            full_at_answer_ms: (known < 1.0).then_some(1000.0 * (1.0 - known) / waits),
            verdict: match percent {
                over if over > FULL => Verdict::Full,
                over if over > TIGHT => Verdict::Tight,
                _ => Verdict::Fits,
            },
            timeout_ms: ms(bus.timeout),
            is_serial: bus.transport.serial().is_some(),
        })
    }

    pub(super) fn preview(&self) -> Section {
        let full = match self.full_at_answer_ms {
            Some(full) if full >= self.timeout_ms => {
                "only if an answer takes longer than the timeout".to_owned()
            }
            Some(full) => format!("if an answer takes longer than {} ms", figure(full)),
            None => "even if its devices answer at once".to_owned(),
        };
        let mut section = Section::default();
        section.line(format!("  {}; full {full}", self.asked_of_it()));
        if self.verdict == Verdict::Tight {
            section.line(
                "  note: there is little time left for lost answers; a longer `every` leaves more time",
            );
        }
        entries!(section, exchanges_per_second = self.exchanges_per_second);
        entries!(section, polls_percent = self.polls_percent, writes_percent = self.writes_percent);
        entries!(section, percent = self.percent, answer_ms = self.answer_ms);
        entries!(section, full_at_answer_ms = self.full_at_answer_ms, verdict = self.verdict);
        section
    }

    /// Formats the load: `load 241 % (polls 1 %, writes 240 %), up to 241 exchanges a second at 10 ms an
    /// answer`.
    fn asked_of_it(&self) -> String {
        let answer = if self.is_serial { "for a device to begin its answer" } else { "an answer" };
        let exchanges = counted(figure(self.exchanges_per_second), "exchange");
        format!(
            "load {} % (polls {} %, writes {} %), up to {exchanges} a second at {} ms {answer}",
            figure(self.percent),
            figure(self.polls_percent),
            figure(self.writes_percent),
            figure(self.answer_ms),
        )
    }
}

/// Formats a number with at most one decimal below 10, and without decimals from 10.
fn figure(number: f64) -> String {
    if number < 9.95 && number.fract().abs() > 0.0 {
        let text = format!("{number:.1}");
        return text.strip_suffix(".0").unwrap_or(&text).to_owned();
    }
    format!("{number:.0}")
}
