//! Simulated machine: the true temperatures, axis positions and register values.

use std::f64::consts::TAU;
use std::time::Duration;

use crate::laws::Laws;

/// Lines; each has one device.
pub(crate) const SENSORS: usize = 0;
pub(crate) const CNC: usize = 1;
pub(crate) const PLC: usize = 2;
pub(crate) const SCALE: usize = 3;
pub(crate) const READOUT: usize = 4;
pub(crate) const LINES: [&str; 5] = ["sensors", "cnc", "plc", "scale", "readout"];

/// Raw value of a module for an open thermocouple.
pub(crate) const OPEN: i64 = -32_768;

/// Registers of the profile.
pub(crate) const X: u16 = 10;
pub(crate) const Y: u16 = 20;
pub(crate) const SEQUENCE: u16 = 30;
pub(crate) const Z: u16 = 31;
pub(crate) const W: u16 = 32;
pub(crate) const COMPLEMENT: u16 = 34;
pub(crate) const CORRECTED: u16 = 40;
pub(crate) const BEAT: u16 = 50;
/// Register of the thermocouple module's type code.
pub(crate) const TYPE_CODE: u16 = 60;
pub(crate) const EXPECTED: u16 = 7;
/// First of the two input registers that another master reads, and the higher temperature of their measuring points,
/// °C.
pub(crate) const OTHERS: u16 = 300;
const WARMER: f64 = 13.0;
/// Time in which a module is exchanged.
const EXCHANGE: Duration = Duration::from_secs(3);

/// Five devices, and what they measure.
pub(crate) struct Machine {
    /// Holding registers by line.
    holding: [[u16; 64]; LINES.len()],
    /// End of the time in which the wire of each thermocouple is broken.
    pub(crate) open_until: [Duration; 2],
    /// Begin and end of the time in which another module answers instead of the thermocouple module.
    pub(crate) other_module: (Duration, Duration),
    /// Settings of the module that were changed at its panel.
    panel: Settings,
    strobe: bool,
    acknowledge: bool,
    /// Time until which the PLC does not evaluate its strobe.
    pub(crate) deaf_until: Duration,
    taken_sequence: u16,
    phases: [f64; 4],
    /// Mean temperatures of bed and column.
    bases: [f64; 2],
    pub(crate) laws: Laws,
}

/// Changed settings of the module: begin, end, and scale.
#[derive(Clone, Copy, Debug, Default)]
struct Settings {
    from: Duration,
    to: Duration,
    /// Counts per °C.
    counts: u16,
}

/// A request as the device reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Question {
    Read { function: u8, at: u16, count: u16 },
    Write { function: u8, at: u16, count: u16, words: [u16; 8] },
    Nonsense,
}

/// A request in a compact form for notes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Brief {
    function: u8,
    at: u16,
    words: [u16; 5],
}

impl Question {
    pub(crate) fn of(message: &[u8]) -> Question {
        let word = |at: usize| message.get(at..at + 2).map(|two| u16::from_be_bytes([two[0], two[1]]));
        let (Some(&function), Some(at), Some(second)) = (message.first(), word(1), word(3)) else {
            return Question::Nonsense;
        };
        let mut words = [0; 8];
        match function {
            1..=4 => Question::Read { function, at, count: second },
            5 | 6 => {
                words[0] = second;
                Question::Write { function, at, count: 1, words }
            }
            16 => {
                for (place, slot) in words.iter_mut().enumerate().take(usize::from(second)) {
                    *slot = word(6 + 2 * place).unwrap_or_default();
                }
                Question::Write { function, at, count: second.min(8), words }
            }
            _ => Question::Nonsense,
        }
    }

    pub(crate) fn brief(self) -> Brief {
        match self {
            Question::Read { function, at, count } => Brief { function, at, words: [count, 0, 0, 0, 0] },
            Question::Write { function, at, words: [a, b, c, d, e, ..], .. } => {
                Brief { function, at, words: [a, b, c, d, e] }
            }
            Question::Nonsense => Brief { function: 0, at: 0, words: [0; 5] },
        }
    }

    pub(crate) fn is_write(self) -> bool {
        matches!(self, Question::Write { .. })
    }

    pub(crate) fn function(self) -> u8 {
        match self {
            Question::Read { function, .. } | Question::Write { function, .. } => function,
            Question::Nonsense => 0,
        }
    }
}

impl Machine {
    pub(crate) fn new(phases: [f64; 4], bases: [f64; 2], laws: Laws) -> Machine {
        let mut machine = Machine {
            holding: [[0; 64]; LINES.len()],
            open_until: [Duration::ZERO; 2],
            other_module: (Duration::ZERO, Duration::ZERO),
            panel: Settings::default(),
            strobe: false,
            acknowledge: false,
            deaf_until: Duration::ZERO,
            taken_sequence: 0,
            phases,
            bases,
            laws,
        };
        for (line, at, value) in machine.laws.standing() {
            machine.holding[line][usize::from(at)] = word(value);
        }
        machine
    }

    /// Temperature in °C: a slow variation with a fast one on it.
    pub(crate) fn temperature(&self, channel: usize, now: Duration) -> f64 {
        let turn = |period: f64, phase: f64| (TAU * (now.as_secs_f64() / period + phase)).sin();
        let (slow, quick) = (self.phases[2 * channel], self.phases[2 * channel + 1]);
        self.bases[channel] + 4.0 * turn(9000.0 + 3000.0 * slow, slow) + 0.6 * turn(420.0, quick)
    }

    /// Targets of x, y, z, w and u by the temperatures, µm.
    pub(crate) fn wanted(&self, now: Duration) -> [f64; 5] {
        let [bed, column] = [0, 1].map(|channel| self.temperature(channel, now) - self.bases[channel]);
        [(2.0 * bed).clamp(-8.0, 8.0), -2.0 * column, 1.5 * bed, 1.5 * column, 2.0 * column]
    }

    /// Position in µm.
    fn position(&self, now: Duration) -> i32 {
        let turn = (TAU * (now.as_secs_f64() / 40.0 + self.phases[0])).sin();
        #[allow(clippy::cast_possible_truncation, reason = "a metre at most")]
        let position = (200_000.0 + 20_000.0 * turn).round() as i32;
        position
    }

    /// Executes a request, and returns the reply; `None` for an unknown request.
    pub(crate) fn answer(&mut self, line: usize, asked: Question, now: Duration) -> Option<Vec<u8>> {
        match asked {
            Question::Read { function: 3, at: TYPE_CODE, .. } if line == SENSORS => {
                Some(registers(3, &[self.type_code(now)]))
            }
            Question::Read { function: 3, at, count } => {
                let words = self.holding[line].get(usize::from(at)..usize::from(at) + usize::from(count))?;
                Some(registers(3, words))
            }
            Question::Read { function: 4, at, count } if line == SENSORS => {
                let raw = |at| sensor(at).map(|sensor| self.raw(sensor, now));
                let words: Option<Vec<u16>> = (at..at.saturating_add(count)).map(raw).collect();
                Some(registers(4, &words?))
            }
            Question::Read { function: 4, .. } if line == SCALE => {
                let [a, b, c, d] = self.position(now).to_be_bytes();
                Some(vec![4, 4, a, b, c, d])
            }
            Question::Read { function: 2, .. } if line == PLC => {
                self.look_at_strobe(now);
                Some(vec![2, 1, u8::from(self.acknowledge)])
            }
            Question::Write { function: 5, words, at, .. } if line == PLC => {
                self.look_at_strobe(now);
                self.strobe = words[0] != 0;
                self.look_at_strobe(now);
                Some([&[5][..], &at.to_be_bytes(), &words[0].to_be_bytes()].concat())
            }
            Question::Write { function, at, count, words } => {
                let words = &words[..usize::from(count)];
                for (at, word) in (at..).zip(words) {
                    *self.holding[line].get_mut(usize::from(at))? = *word;
                    self.laws.arrives(line, at, value(*word));
                }
                let second = if function == 6 { words[0] } else { count };
                Some([&[function][..], &at.to_be_bytes(), &second.to_be_bytes()].concat())
            }
            _ => None,
        }
    }

    /// Returns whether another module answers instead of the thermocouple module.
    pub(crate) fn has_other_module(&self, now: Duration) -> bool {
        (self.other_module.0..self.other_module.1).contains(&now)
    }

    /// Returns whether the module is being exchanged, so that nothing answers on the line.
    pub(crate) fn is_without_module(&self, now: Duration) -> bool {
        let (from, to) = self.other_module;
        to > from && [from, to].iter().any(|begin| (*begin..*begin + EXCHANGE).contains(&now))
    }

    /// Changes the scale of the module for this time. Its type code changes too.
    pub(crate) fn sets(&mut self, counts: u16, now: Duration, span: Duration) {
        self.panel = Settings { from: now, to: now + span, counts };
        self.laws.settings_change(now);
    }

    /// Returns whether the module has changed settings.
    pub(crate) fn has_other_settings(&self, now: Duration) -> bool {
        (self.panel.from..self.panel.to).contains(&now)
    }

    fn type_code(&self, now: Duration) -> u16 {
        EXPECTED + u16::from(self.has_other_module(now)) + 2 * u16::from(self.has_other_settings(now))
    }

    fn raw(&self, (channel, warmer): (usize, f64), now: Duration) -> u16 {
        if now < self.open_until[channel] {
            return word(OPEN);
        }
        let counts = match (self.has_other_module(now), self.has_other_settings(now)) {
            // The other module has a scale of 0.1 °C.
            (true, _) => 10.0,
            (_, true) => f64::from(self.panel.counts),
            _ => 100.0,
        };
        #[allow(clippy::cast_possible_truncation, reason = "hundredths of a degree")]
        let raw = (counts * (self.temperature(channel, now) + warmer)).round() as i64;
        word(raw)
    }

    /// The PLC takes a set if its strobe is high, its check word is correct, and its number differs from the last one.
    fn look_at_strobe(&mut self, now: Duration) {
        if now < self.deaf_until {
            return;
        }
        let block = &self.holding[PLC][usize::from(SEQUENCE)..=usize::from(COMPLEMENT)];
        let sum = block[..4].iter().fold(0u16, |sum, word| sum.wrapping_add(*word));
        if self.strobe && !self.acknowledge && block[4] == !sum && block[0] != self.taken_sequence {
            self.taken_sequence = block[0];
            self.laws.takes([value(block[1]), value(block[2])]);
        }
        self.acknowledge = self.strobe;
    }

    /// Restarts the control on this line. It loses its register values, or keeps them.
    pub(crate) fn restarts(&mut self, line: usize, forgets: bool, now: Duration) {
        if line == PLC {
            (self.strobe, self.acknowledge, self.taken_sequence) = (false, false, 0);
        }
        if forgets {
            self.holding[line] = [0; 64];
            self.laws.cleared(line, now);
        }
    }

    /// Writes a value on behalf of another client than the gateway.
    pub(crate) fn puts(&mut self, line: usize, at: u16, value: i64, now: Duration) {
        self.holding[line][usize::from(at)] = word(value);
        self.laws.moved(line, at, value, now);
    }

    pub(crate) fn stands(&self, line: usize, at: u16) -> i64 {
        value(self.holding[line][usize::from(at)])
    }
}

/// Channel of an input register: bed, column, and column again at an address that requires a separate request.
pub(crate) fn channel(at: u16) -> Option<usize> {
    match at {
        0 => Some(0),
        1 | 100 => Some(1),
        _ => None,
    }
}

/// Channel of an input register, also of one that another master reads, and the higher temperature of its measuring
/// point, °C.
fn sensor(at: u16) -> Option<(usize, f64)> {
    let of_other = || at.checked_sub(OTHERS).map(usize::from).filter(|channel| *channel < 2);
    channel(at).map(|channel| (channel, 0.0)).or_else(|| of_other().map(|channel| (channel, WARMER)))
}

fn registers(function: u8, words: &[u16]) -> Vec<u8> {
    let mut message = Vec::with_capacity(2 + 2 * words.len());
    message.extend([function, u8::try_from(2 * words.len()).unwrap_or_default()]);
    words.iter().for_each(|word| message.extend(word.to_be_bytes()));
    message
}

pub(crate) fn value(word: u16) -> i64 {
    i64::from(i16::from_be_bytes(word.to_be_bytes()))
}

pub(crate) fn word(value: i64) -> u16 {
    u16::from_be_bytes(i16::try_from(value).unwrap_or_default().to_be_bytes())
}
