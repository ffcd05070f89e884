//! How full a line is: what is asked on it in a second, and what part of its time that takes.
//!
//! Counted is the busiest time without a fault: every axis moves at each of its updates. How long a device takes to
//! answer no profile says, so it is assumed, and the answer time at which the line would be full stands beside it.

use std::time::Duration;

use serde::Serialize;

use super::traffic::{Exchange, traffic};
use crate::document::Section;
use crate::wording::counted;
use crate::{Bus, BusId, Device, Profile, ProfileError, Transport};

/// What a device of today needs to begin its answer, its network included.
const ANSWER: Duration = Duration::from_millis(10);
/// The same through a plain serial server: two short frames at 9600 baud, whose speed no profile knows, come on top.
const ANSWER_THROUGH_SERVER: Duration = Duration::from_millis(30);
/// Beyond this part of its time, in percent, a line has no room for lost answers and repetitions.
const TIGHT: f64 = 80.0;
const FULL: f64 = 100.0;

/// What is asked of a line, and what that takes of its time.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Questions in a second while every axis moves at each of its updates.
    pub exchanges_per_second: f64,
    /// The part of the line's time that reading signals takes, in percent.
    pub polls_percent: f64,
    /// The part that writing takes, with what is read for it, in percent.
    pub writes_percent: f64,
    /// Both.
    pub percent: f64,
    /// How long a device is assumed to take for an answer, milliseconds; on a serial port besides the bytes.
    pub answer_ms: f64,
    /// With a longer one the line would be full, milliseconds; `None`: it is full whatever its devices do.
    pub full_at_answer_ms: Option<f64>,
    /// Whether it fits.
    pub verdict: Verdict,
    timeout_ms: f64,
    is_serial: bool,
}

/// Whether what is asked fits into a line's time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It does.
    Fits,
    /// It does, with no room for lost answers.
    Tight,
    /// It does not.
    Full,
}

/// What an exchange takes: a time that is known, and how often an answer is waited for.
struct Cost {
    known: Duration,
    waits: f64,
}

fn cost(bus: &Bus, device: &Device, asked: &Exchange) -> Cost {
    let quirks = &device.quirks;
    let bytes = match bus.transport {
        Transport::Serial(serial) => serial.exchange(asked.question, asked.answer),
        Transport::Tcp | Transport::RtuOverTcp | Transport::Can | Transport::OpcUa | Transport::Sysfs => {
            Duration::ZERO
        }
    };
    let known = bytes + quirks.pause_between_requests;
    if quirks.close_after_each {
        // The next question waits for a new connection first.
        return Cost { known: known + quirks.pause_after_connect, waits: 2.0 };
    }
    Cost { known, waits: 1.0 }
}

/// Returns how long one exchange takes, with the time that a device is assumed to need for its answer.
pub(super) fn exchange_time(bus: &Bus, device: &Device, asked: &Exchange) -> Duration {
    let Cost { known, waits } = cost(bus, device, asked);
    known + answer_time(bus.transport).mul_f64(waits)
}

/// Returns how long a device on such a line is assumed to take for an answer.
fn answer_time(transport: Transport) -> Duration {
    match transport {
        Transport::RtuOverTcp => ANSWER_THROUGH_SERVER,
        Transport::Tcp | Transport::Serial(_) | Transport::Can | Transport::OpcUa | Transport::Sysfs => {
            ANSWER
        }
    }
}

pub(super) fn ms(span: Duration) -> f64 {
    1000.0 * span.as_secs_f64()
}

/// Lines of which more is asked than there is time for.
pub fn warnings(profile: &Profile) -> Vec<ProfileError> {
    let loads = (0..profile.buses.len())
        .filter_map(|place| Load::of(profile, BusId(place)).zip(profile.buses.get(place)));
    let full = loads.filter(|(load, _)| load.verdict == Verdict::Full);
    let warning = full.map(|(load, bus)| {
        let help = if load.polls_percent > load.writes_percent {
            "poll its devices less often (`every`), or put some of them on another line"
        } else {
            "update the axes less often (`every`; `refresh` of their outputs), or put the outputs on another line"
        };
        let message =
            format!("{}: readings get older and corrections later than the profile says", load.asked_of_it());
        let about = ProfileError::about(profile.path.display().to_string(), message, Some(help.to_owned()));
        ProfileError { key: format!("bus.{}", bus.name), ..about }
    });
    warning.collect()
}

impl Load {
    /// The load of a line; `None` where nobody is asked, as on a CAN line whose devices send by themselves, and where all are asked at
    /// once, as the sensors of this computer.
    pub fn of(profile: &Profile, id: BusId) -> Option<Load> {
        let bus = profile.bus(id);
        if bus.transport == Transport::Sysfs {
            return None;
        }
        let asked = traffic(profile, id);
        if asked.is_empty() {
            return None;
        }
        let answer = answer_time(bus.transport);
        let (mut known, mut waits, mut percent) = (0.0, 0.0, [0.0; 2]);
        for asked in &asked {
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
            is_serial: matches!(bus.transport, Transport::Serial(_)),
        })
    }

    pub(super) fn preview(&self) -> Section {
        let full = match self.full_at_answer_ms {
            Some(full) if full >= self.timeout_ms => "only where it takes longer than the timeout".to_owned(),
            Some(full) => format!("where it takes longer than {} ms", figure(full)),
            None => "however quick its devices are".to_owned(),
        };
        let mut section = Section::default();
        section.line(format!("  {}; full {full}", self.asked_of_it()));
        if self.verdict == Verdict::Tight {
            section.line("  note: that leaves little room for lost answers; a longer `every` makes some");
        }
        section.entry("exchanges_per_second", self.exchanges_per_second);
        section.entry("polls_percent", self.polls_percent);
        section.entry("writes_percent", self.writes_percent);
        section.entry("percent", self.percent);
        section.entry("answer_ms", self.answer_ms);
        section.entry("full_at_answer_ms", self.full_at_answer_ms);
        section.entry("verdict", self.verdict);
        section
    }

    /// `load 241 % (polls 1 %, writes 240 %), up to 241 exchanges a second at 10 ms an answer`.
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

/// Two digits where there are few, whole numbers beyond.
fn figure(number: f64) -> String {
    if number < 9.95 && number.fract().abs() > 0.0 {
        let text = format!("{number:.1}");
        return text.strip_suffix(".0").unwrap_or(&text).to_owned();
    }
    format!("{number:.0}")
}
