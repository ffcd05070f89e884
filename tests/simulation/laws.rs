//! The laws, held against what is on the wire and what is true. Nothing of the gateway is asked.

use std::time::Duration;

use crate::machine::{CNC, CORRECTED, PLC, Question, READOUT, SENSORS, W, X, Y, Z, value};
use crate::panel::{Panel, REGISTERS};
use crate::second_master::Signs;

/// A reading is used for so long after its question; a position.
const MAX_AGE: Duration = Duration::from_secs(3);
const MAX_AGE_OF_POSITION: Duration = Duration::from_millis(500);
/// A last look at the clock, in a runtime that counts milliseconds.
const LOOK: Duration = Duration::from_millis(2);
/// Counts of a step, in tenths of a micrometre.
const STEP: i64 = 10;
/// Counts by which a change may lead away from what the temperatures require: the deadband, half a count, what they change by within
/// `MAX_AGE`, and one count beside a sum that must not be zero.
const AWAY: f64 = 3.5;
/// How long a value that was sent is no value for an operator.
const REMEMBERED: Duration = Duration::from_secs(330);

/// One register that is held to the laws.
#[derive(Clone, Debug)]
pub(crate) struct Register {
    pub(crate) name: &'static str,
    pub(crate) line: usize,
    pub(crate) at: u16,
    limit: i64,
    /// What stands there.
    pub(crate) value: i64,
    /// The operator's part; nothing in a register that is ours alone.
    pub(crate) his: i64,
    /// When the gateway was last shown what stands there, and what that was.
    shown: Option<(Duration, i64)>,
    /// When somebody else than the gateway last changed it.
    pub(crate) moved_at: Option<Duration>,
    /// His part before a restart of the control that the gateway was not shown yet: a write brings it back.
    lost: Option<i64>,
    /// Somebody has changed it, or another gateway has begun, since a gateway was last shown it.
    is_news: bool,
    /// What arrives next rests on what somebody has changed since: nobody can promise where it takes the register.
    is_excused: bool,
    /// What was sent there lately.
    sent: Vec<(Duration, i64)>,
    /// The last of them that was another value than the register was known to hold.
    changed_to: Option<i64>,
    /// The temperature that its axis follows.
    channel: usize,
}

/// All that is known of the truth.
#[derive(Clone, Debug)]
pub(crate) struct Laws {
    pub(crate) registers: [Register; REGISTERS],
    /// When each sensor was last asked for what it then said.
    read_at: [Option<Duration>; 2],
    /// The same for values in other settings that no check could have shown yet.
    misread_at: [Option<Duration>; 2],
    pub(crate) panel: Panel,
    /// Signs of another master on the line of the module.
    pub(crate) signs: Signs,
    /// Positions that the gateway was shown, the newest last, µm.
    positions: Vec<(Duration, i64)>,
    /// What was last added to a position, in tenths of a micrometre.
    pub(crate) corrected: Option<i64>,
    /// When this gateway was last shown something that it has not done, without the time that the computer slept.
    pub(crate) news_at: Duration,
    /// What the PLC took last, if nothing has cleared it since.
    taken: Option<[i64; 2]>,
    pub(crate) taken_count: u64,
    pub(crate) changes: u64,
    /// The first breach.
    pub(crate) broken: Option<String>,
}

/// What a write that is on its way rests on.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rests {
    /// When its register was last shown before it left.
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

    /// What stands in the registers at the beginning.
    pub(crate) fn standing(&self) -> Vec<(usize, u16, i64)> {
        self.registers.iter().map(|register| (register.line, register.at, register.value)).collect()
    }

    fn breaks(&mut self, why: String) {
        self.broken.get_or_insert(why);
    }

    /// A sensor was asked at this moment, and its answer was handed over in time.
    pub(crate) fn read(&mut self, channel: usize, asked: Duration) {
        self.read_at[channel] = self.read_at[channel].max(Some(asked));
    }

    /// The same while the module is set otherwise.
    pub(crate) fn misread(&mut self, channel: usize, asked: Duration) {
        if self.panel.is_hidden() {
            self.misread_at[channel] = self.misread_at[channel].max(Some(asked));
        }
    }

    /// Returns whether both sensors were read, and nothing else was taken for their values.
    pub(crate) fn has_readings(&self, now: Duration) -> bool {
        self.read_at.iter().all(|asked| is_recent(*asked, now)) && self.signs.has_no_mistake(now)
    }

    /// The gateway was given the type code of the module, which that had at this time.
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

    /// The module is set otherwise from now on.
    pub(crate) fn settings_change(&mut self, now: Duration) {
        self.panel.changes(self.ours(), now);
    }

    /// A connection to the module is made.
    pub(crate) fn connects(&mut self, line: usize) {
        if line == SENSORS {
            self.panel.breaks();
            self.signs.connects();
        }
    }

    /// Axes are armed that were off.
    pub(crate) fn arms(&mut self, was_off: impl Fn(&str) -> bool) {
        for (place, ours) in self.ours().into_iter().enumerate() {
            if was_off(self.registers[place].name) {
                self.panel.arms(place, ours);
            }
        }
    }

    /// A question leaves on a line, on which nothing fails if it is fair.
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

    /// Counts of the gateway in the registers, without the operator's.
    fn ours(&self) -> [i64; REGISTERS] {
        self.registers.each_ref().map(|register| register.value - register.his)
    }

    pub(crate) fn saw_position(&mut self, asked: Duration, position: i64) {
        self.positions.push((asked, position));
        if self.positions.len() > 8 {
            self.positions.remove(0);
        }
    }

    /// The gateway was shown these registers, as they were when the device answered.
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

    /// Another gateway begins: it knows nothing of the readout, and finds what the one before it may have been told.
    pub(crate) fn begins(&mut self) {
        self.corrected = None;
        self.panel.begins();
        self.signs.begins();
        self.registers.iter_mut().for_each(|register| register.is_news = true);
    }

    /// A write leaves the gateway, while the temperatures require this of the axes, µm.
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
        // The gateway cannot know yet that there is another master.
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

    /// A readout gets a position that was measured lately, and a Cz that is at most a step from the one before.
    fn corrects(&mut self, words: [u16; 8], now: Duration) -> Option<String> {
        let shown = i64::from(words[0]) << 16 | i64::from(words[1]);
        let recent = |asked: &Duration| now.saturating_sub(*asked) <= MAX_AGE_OF_POSITION + LOOK;
        let mut recent = self.positions.iter().rev().filter(|(asked, _)| recent(asked)).peekable();
        if recent.peek().is_none() {
            return Some(format!("R3: {shown} is shown without a position"));
        }
        // A tenth of a micrometre for what is rounded.
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

    /// What arrives next on this line rests on this.
    pub(crate) fn rests_on(&mut self, line: usize, rests: Rests) {
        for register in self.registers.iter_mut().filter(|register| register.line == line) {
            register.is_excused =
                register.moved_at.is_some_and(|moved| rests.shown_at.is_none_or(|shown| shown < moved));
        }
    }

    /// A value of ours comes to stand in a register.
    pub(crate) fn arrives(&mut self, line: usize, at: u16, value: i64) {
        let mut broken = None;
        for register in
            self.registers.iter_mut().filter(|register| register.line == line && register.at == at)
        {
            let before = std::mem::replace(&mut register.value, value);
            let jump = (value - before).abs();
            register.his = register.lost.take().unwrap_or(register.his);
            if register.is_excused {
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

    /// The PLC takes what stands in its block.
    pub(crate) fn takes(&mut self, set: [i64; 2]) {
        self.taken_count += 1;
        let before = self.taken.replace(set).unwrap_or(set);
        let jump = before.iter().zip(set).map(|(before, now)| (now - before).abs()).max().unwrap_or_default();
        if jump > STEP {
            self.breaks(format!("R1: the PLC takes {set:?} after {before:?}"));
        }
    }

    /// The control on this line has nothing in its registers any more.
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

    /// Somebody else puts this there.
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
    /// Returns why a change to this value is against the laws, if it is. It may rest on a reading, on a value in other settings that no
    /// check could have shown yet, or on nothing if it is the way back from such values.
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
        // Counts of ours, if the gateway knows what the operator's are.
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
        // A control that refused it is sent the same again, while its axis keeps its value. In between it may be sent what it holds.
        let is_repeated = self.changed_to == Some(sent);
        let (shown, sent) = ours.filter(|_| !is_repeated)?;
        let off = |ours: i64| (ours as f64 - 10.0 * wanted).abs();
        let leads_away = off(sent) > off(shown) + AWAY;
        leads_away
            .then(|| format!("R11: {name} is changed from {shown} to {sent}, and {wanted} µm are required"))
    }

    /// The gateway was shown what somebody else did last.
    pub(crate) fn is_known(&self) -> bool {
        self.moved_at.is_none_or(|moved| self.shown.is_some_and(|(at, _)| at > moved))
    }

    /// Nobody types what was sent there lately, or is very near to it.
    pub(crate) fn was_sent(&self, value: i64, now: Duration) -> bool {
        let lately = self.sent.iter().filter(|(at, _)| now.saturating_sub(*at) < REMEMBERED);
        lately.map(|(_, sent)| *sent).any(|sent| sent == value)
    }
}

/// Returns whether what was asked for at this time may still be used.
fn is_recent(asked: Option<Duration>, now: Duration) -> bool {
    asked.is_some_and(|asked| now.saturating_sub(asked) <= MAX_AGE + LOOK)
}
