//! Laws of the offset, checked against the bytes on the lines and the true state of the machine. The check does not
//! query the gateway.

use std::time::Duration;

use crate::machine::{CNC, CORRECTED, PLC, Question, READOUT, SENSORS, W, X, Y, Z, value};
use crate::panel::{Panel, REGISTERS};
use crate::second_master::Signs;

/// Maximum age of a reading since its request, and of a position.
const MAX_AGE: Duration = Duration::from_secs(3);
const MAX_AGE_OF_POSITION: Duration = Duration::from_millis(500);
/// Tolerance for the last clock sample, in a runtime with millisecond resolution.
const LOOK: Duration = Duration::from_millis(2);
/// Maximum step in counts of 0.1 µm.
const STEP: i64 = 10;
/// Maximum counts by which a change may increase the distance to the target of the temperatures. It covers the
/// deadband, half a count of rounding, the change of the target within `MAX_AGE`, and one count that avoids a sum of
/// zero.
const AWAY: f64 = 3.5;
/// Time after sending during which a value cannot be an operator's edit.
const REMEMBERED: Duration = Duration::from_secs(330);

/// A register that is checked.
#[derive(Clone, Debug)]
pub(crate) struct Register {
    pub(crate) name: &'static str,
    pub(crate) line: usize,
    pub(crate) at: u16,
    limit: i64,
    /// Current register value.
    pub(crate) value: i64,
    /// Operator offset; 0 in a register that only the gateway writes to.
    pub(crate) his: i64,
    /// Time and value of the last read by the gateway.
    shown: Option<(Duration, i64)>,
    /// Time of the last change by another client than the gateway.
    pub(crate) moved_at: Option<Duration>,
    /// Operator offset before a restart of the control that the gateway has not read yet. A write restores it.
    lost: Option<i64>,
    /// Whether another client has changed the register, or another gateway has started, since a gateway last read it.
    is_news: bool,
    /// Whether the next write was decided before a change by another client. Its result is then not checked.
    is_excused: bool,
    /// Recently sent values with their times.
    sent: Vec<(Duration, i64)>,
    /// Last sent value that differed from the last read value.
    changed_to: Option<i64>,
    /// Sensor that the axis depends on.
    channel: usize,
}

/// True state of the machine, and the state of the checks.
#[derive(Clone, Debug)]
pub(crate) struct Laws {
    pub(crate) registers: [Register; REGISTERS],
    /// Time of the last request to each sensor whose reply arrived.
    read_at: [Option<Duration>; 2],
    /// Time of the last such request for a value with other settings that no check could have detected yet.
    misread_at: [Option<Duration>; 2],
    pub(crate) panel: Panel,
    /// Signs of another master on the line of the module.
    pub(crate) signs: Signs,
    /// Positions that the gateway has read, the latest last, µm.
    positions: Vec<(Duration, i64)>,
    /// Last correction of a position, in units of 0.1 µm.
    pub(crate) corrected: Option<i64>,
    /// Time at which this gateway last read a change that it had not made. It does not include the time in which the
    /// computer slept.
    pub(crate) news_at: Duration,
    /// Last set that the PLC has taken; `None` after it was cleared.
    taken: Option<[i64; 2]>,
    pub(crate) taken_count: u64,
    pub(crate) changes: u64,
    /// First violation.
    pub(crate) broken: Option<String>,
}

/// Reads on which a write under way depends.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rests {
    /// Time of the last read of the register before the write was sent.
    shown_at: Option<Duration>,
}

impl Laws {
    pub(crate) fn new(his: i64) -> Laws {
        let register = |name, line, at, limit, his, channel| Register {
            name,
            line,
            at,
            limit,
            value: his,
            his,
            shown: None,
            moved_at: None,
            lost: None,
            is_news: true,
            is_excused: false,
            sent: Vec::new(),
            changed_to: None,
            channel,
        };
        Laws {
            registers: [
                register("x", CNC, X, 80, 0, 0),
                register("y", CNC, Y, 200, his, 1),
                register("z", PLC, Z, 200, 0, 0),
                register("w", PLC, W, 200, 0, 1),
            ],
            read_at: [None; 2],
            misread_at: [None; 2],
            panel: Panel::default(),
            signs: Signs::default(),
            positions: Vec::new(),
            corrected: None,
            news_at: Duration::ZERO,
            taken: None,
            taken_count: 0,
            changes: 0,
            broken: None,
        }
    }

    /// Register values at the start.
    pub(crate) fn standing(&self) -> Vec<(usize, u16, i64)> {
        self.registers.iter().map(|register| (register.line, register.at, register.value)).collect()
    }

    fn breaks(&mut self, why: String) {
        self.broken.get_or_insert(why);
    }

    /// Records a valid reading of a sensor, whose request was sent at this time.
    pub(crate) fn read(&mut self, channel: usize, asked: Duration) {
        self.read_at[channel] = self.read_at[channel].max(Some(asked));
    }

    /// Records a reading while the module has other settings.
    pub(crate) fn misread(&mut self, channel: usize, asked: Duration) {
        if self.panel.is_hidden() {
            self.misread_at[channel] = self.misread_at[channel].max(Some(asked));
        }
    }

    /// Records a reply with the type code of the module, which had this code at `seen_at`.
    pub(crate) fn checks(&mut self, is_expected: bool, seen_at: Duration, now: Duration) {
        let ours = self.ours();
        match is_expected {
            true => {
                let seen = self.registers.each_ref().map(|register| !register.is_news);
                self.panel.passes(std::array::from_fn(|place| (ours[place], seen[place])), seen_at, now);
            }
            false => self.panel.fails(self.registers.each_ref().map(|register| register.line), ours),
        }
    }

    /// Records a change of the module's settings.
    pub(crate) fn settings_change(&mut self, now: Duration) {
        self.panel.changes(self.ours(), now);
    }

    /// Records a new connection to the module.
    pub(crate) fn connects(&mut self, line: usize) {
        if line == SENSORS {
            self.panel.breaks();
            self.signs.connects();
        }
    }

    /// Records that axes are armed that were off.
    pub(crate) fn arms(&mut self, was_off: impl Fn(&str) -> bool) {
        for (place, ours) in self.ours().into_iter().enumerate() {
            if was_off(self.registers[place].name) {
                self.panel.arms(place, ours);
            }
        }
    }

    /// Records a request on a line. `is_fair` is whether nothing fails on this line.
    pub(crate) fn asks(&mut self, line: usize, now: Duration, is_fair: bool) {
        self.panel.asks(line, now, is_fair);
        for (place, ours) in self.ours().into_iter().enumerate() {
            if self.registers[place].line == line
                && let Some(away) = self.panel.is_late(place, line, ours)
            {
                let name = self.registers[place].name;
                self.breaks(format!("panel: {name} has not gone back, {away} counts are left"));
            }
        }
    }

    /// Gateway shares in the registers, in counts.
    fn ours(&self) -> [i64; REGISTERS] {
        self.registers.each_ref().map(|register| register.value - register.his)
    }

    pub(crate) fn saw_position(&mut self, asked: Duration, position: i64) {
        self.positions.push((asked, position));
        if self.positions.len() > 8 {
            self.positions.remove(0);
        }
    }

    /// Records a read reply with these registers, which the device sent at `at`.
    pub(crate) fn shows(&mut self, line: usize, from: u16, words: &[u8], at: Duration, awake: Duration) {
        let mut is_news = false;
        for register in self.registers.iter_mut().filter(|register| register.line == line) {
            let Some(place) = register.at.checked_sub(from).map(usize::from) else { continue };
            if let Some(two) = words.get(2 * place..2 * place + 2) {
                register.lost = None;
                is_news |= std::mem::take(&mut register.is_news);
                register.shown = Some((at, value(u16::from_be_bytes([two[0], two[1]]))));
            }
        }
        if is_news {
            self.news_at = awake;
        }
    }

    /// Records the start of another gateway. It does not know the last correction of the readout, and finds values that
    /// its predecessor may have sent.
    pub(crate) fn begins(&mut self) {
        self.corrected = None;
        self.panel.begins();
        self.signs.begins();
        self.registers.iter_mut().for_each(|register| register.is_news = true);
    }

    /// Checks a write that the gateway sends. `wanted` are the targets of the axes in µm by the temperatures.
    pub(crate) fn leaves(&mut self, line: usize, asked: Question, wanted: [f64; 5], now: Duration) -> Rests {
        if line == SENSORS {
            self.signs.asks(asked, now);
        }
        let Question::Write { function, at, count, words } = asked else { return Rests::default() };
        let mut rests = Rests::default();
        if function == 5 {
            return rests;
        }
        let mut broken = None;
        let rested_on = (self.read_at, self.misread_at);
        // The gateway cannot have detected the other master yet.
        let is_mistaken = is_recent(self.signs.mistaken_at(), now);
        for (index, register) in self.registers.iter_mut().enumerate() {
            let place = register.at.checked_sub(at).filter(|place| register.line == line && *place < count);
            let Some(sent) = place.map(|place| value(words[usize::from(place)])) else { continue };
            rests.shown_at = register.shown.map(|(at, _)| at);
            let is_change = register.shown.is_none_or(|(_, shown)| shown != sent);
            register.sent.retain(|(at, _)| now.saturating_sub(*at) < REMEMBERED);
            if register.shown.is_none() {
                broken = Some(format!("{}: {sent} is sent before the register was ever read", register.name));
            }
            if is_change {
                self.changes += 1;
                let why = register.forbids(sent, rested_on, (&self.panel, index), wanted[index], now);
                broken = why.filter(|_| !is_mistaken).or(broken);
                register.changed_to = Some(sent);
            }
            register.sent.push((now, sent));
        }
        if line == READOUT && at == CORRECTED {
            broken = broken.or_else(|| self.corrects(words, now));
        }
        if let Some(why) = broken {
            self.breaks(why);
        }
        rests
    }

    /// Checks a corrected position: it must be based on a recent position, and Cz may change by at most a step.
    fn corrects(&mut self, words: [u16; 8], now: Duration) -> Option<String> {
        let shown = i64::from(words[0]) << 16 | i64::from(words[1]);
        let recent = |asked: &Duration| now.saturating_sub(*asked) <= MAX_AGE_OF_POSITION + LOOK;
        let mut recent = self.positions.iter().rev().filter(|(asked, _)| recent(asked)).peekable();
        if recent.peek().is_none() {
            return Some(format!("R3: {shown} is shown without a position"));
        }
        // Tolerance of 0.1 µm for rounding.
        let fits =
            |cz: &i64| self.corrected.is_none_or(|last| (cz - last).abs() <= STEP + 1) && cz.abs() <= 201;
        let found = recent.map(|(_, position)| shown - 10 * position).find(fits);
        if found.is_none() {
            return Some(format!(
                "the readout's Cz jumps from {:?}: {shown} after {:?}",
                self.corrected, self.positions
            ));
        }
        self.corrected = found;
        None
    }

    /// Records the reads on which the next write on this line depends.
    pub(crate) fn rests_on(&mut self, line: usize, rests: Rests) {
        for register in self.registers.iter_mut().filter(|register| register.line == line) {
            register.is_excused =
                register.moved_at.is_some_and(|moved| rests.shown_at.is_none_or(|shown| shown < moved));
        }
    }

    /// Checks a value of the gateway that arrives in a register.
    pub(crate) fn arrives(&mut self, line: usize, at: u16, value: i64) {
        let mut broken = None;
        for register in
            self.registers.iter_mut().filter(|register| register.line == line && register.at == at)
        {
            let before = std::mem::replace(&mut register.value, value);
            let jump = (value - before).abs();
            register.his = register.lost.take().unwrap_or(register.his);
            if register.is_excused {
                // The gateway finds this value, and the PLC takes it with the next set.
                if line == PLC {
                    self.taken = None;
                }
                continue;
            }
            if jump > STEP {
                broken = Some(format!("R1: {} jumps from {before} to {value}", register.name));
            }
            let distance = |sum: i64| (sum - register.his).abs();
            if distance(value) > register.limit && distance(value) > distance(before) {
                let (name, his) = (register.name, register.his);
                broken = Some(format!("R6: {name} holds {value}, of which {his} are the operator's"));
            }
        }
        if let Some(why) = broken {
            self.breaks(why);
        }
    }

    /// Checks the set that the PLC takes from its block.
    pub(crate) fn takes(&mut self, set: [i64; 2]) {
        self.taken_count += 1;
        let before = self.taken.replace(set).unwrap_or(set);
        let jump = before.iter().zip(set).map(|(before, now)| (now - before).abs()).max().unwrap_or_default();
        if jump > STEP {
            self.breaks(format!("R1: the PLC takes {set:?} after {before:?}"));
        }
    }

    /// Records that the control on this line has lost its register values.
    pub(crate) fn cleared(&mut self, line: usize, now: Duration) {
        for (place, register) in self.registers.iter_mut().enumerate() {
            if register.line != line {
                continue;
            }
            self.panel.touched(place);
            register.lost = register.lost.or((register.his != 0).then_some(register.his));
            (register.value, register.his, register.moved_at) = (0, 0, Some(now));
            register.is_news = true;
        }
        if line == PLC {
            self.taken = None;
        }
    }

    /// Records a write by another client.
    pub(crate) fn moved(&mut self, line: usize, at: u16, value: i64, now: Duration) {
        for (place, register) in self.registers.iter_mut().enumerate() {
            if (register.line, register.at) == (line, at) {
                self.panel.touched(place);
                (register.value, register.moved_at, register.is_news) = (value, Some(now), true);
            }
        }
        if line == PLC {
            self.taken = None;
        }
    }
}

impl Register {
    /// Returns the violation by a change to this value, if any. A change may be based on a recent reading, or on a
    /// value with other settings that no check could have detected yet. The return from such values needs no reading.
    fn forbids(
        &self,
        sent: i64,
        (read_at, misread_at): ([Option<Duration>; 2], [Option<Duration>; 2]),
        (panel, index): (&Panel, usize),
        wanted: f64,
        now: Duration,
    ) -> Option<String> {
        let name = self.name;
        let age = |asked: Option<Duration>| Some(now.saturating_sub(asked?));
        let is_recent = |age: Option<Duration>| age.is_some_and(|age| age <= MAX_AGE + LOOK);
        let (age, misread) = (age(read_at[self.channel]), age(misread_at[self.channel]));
        // Gateway share in counts, if the gateway can know the operator offset.
        let his = (self.is_known() && self.lost.is_none()).then_some(self.his);
        let ours = self.shown.zip(his).map(|((_, shown), his)| (shown - his, sent - his));
        if is_recent(misread) {
            let (_, sent) = ours?;
            let moved = panel.too_far(index, sent, now)?;
            return Some(format!("panel: {name} moves by {moved} counts on values in other settings"));
        }
        let may_go_back = panel.may_go_back(index, now);
        if may_go_back && ours.is_none_or(|(shown, sent)| panel.leads_back(index, shown, sent)) {
            return None;
        }
        if !is_recent(age) {
            let since = panel.changed_for(now);
            let since = since.map(|since| format!(", {since:?} after the settings were changed"));
            let since = since.unwrap_or_default();
            return Some(format!("R3: {name} is changed to {sent} on readings {age:?} old{since}"));
        }
        // If a control has refused a change while the axis keeps its value, the same value may be sent again. Meanwhile
        // the current register value may be sent too.
        let is_repeated = self.changed_to == Some(sent);
        let (shown, sent) = ours.filter(|_| !is_repeated)?;
        let off = |ours: i64| (ours as f64 - 10.0 * wanted).abs();
        let leads_away = off(sent) > off(shown) + AWAY;
        leads_away
            .then(|| format!("R11: {name} is changed from {shown} to {sent}, and {wanted} µm are required"))
    }

    /// Returns whether the gateway has read the last change by another client.
    pub(crate) fn is_known(&self) -> bool {
        self.moved_at.is_none_or(|moved| self.shown.is_some_and(|(at, _)| at > moved))
    }

    /// Returns whether the gateway has read the present value.
    pub(crate) fn is_shown(&self) -> bool {
        self.shown.is_some_and(|(_, shown)| shown == self.value)
    }

    /// Returns whether the gateway has recently sent this value. An operator does not enter it.
    pub(crate) fn was_sent(&self, value: i64, now: Duration) -> bool {
        let expired = self.sent.iter().filter(|(at, _)| now.saturating_sub(*at) < REMEMBERED);
        expired.map(|(_, sent)| *sent).any(|sent| sent == value)
    }
}

/// Returns whether the reply to a request at this time may still be used.
fn is_recent(asked: Option<Duration>, now: Duration) -> bool {
    asked.is_some_and(|asked| now.saturating_sub(asked) <= MAX_AGE + LOOK)
}
