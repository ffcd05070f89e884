//! What a unit may still say whose answers do not name their question, and what it may be asked meanwhile. Such units are
//! those on a line of RTU frames, and those behind a gateway that stamps a late answer with the transaction that is open.
//!
//! After a miss its answer may still come. Until then
//! - a question whose answer is told apart from that one, by function or length, need not wait: what is owed is passed
//!   over when it comes ([`Mark`]);
//! - another question of the same form waits until the late answer has had its time;
//! - **the same read** may be repeated as soon as the line has been silent for `FACTOR` times the longest answer of
//!   that unit, if it is known to be prompt: its last `PROOF` answers all came in time. What comes may answer either
//!   question, so that it counts from the first, and must come as soon as its answers do; the unit is asked that once
//!   more only when it has been silent again for so long.
//!
//! A unit that was heard late, or out of turn, is not prompt any more: all its misses are waited out, until it has
//! answered `PROOF` times again.

use std::time::Duration;

use super::line::order::Order;
use super::request::Request;
use crate::clock::Silence;
use isotherm_core::quantity::Moment;

/// So many answers in time show that a unit is prompt.
const PROOF: u32 = 100;
/// A prompt unit has never taken longer than the longest of its answers, times this.
const FACTOR: u32 = 3;
/// No answer is expected sooner than this: a computer is not always at once there to hear it.
const SHORTEST: Duration = Duration::from_millis(5);
/// The second of two answers is later than one alone by no more than this.
const LATER: Duration = Duration::from_millis(50);
/// Misses in a row after which even a prompt unit is left alone.
const MISSES: u32 = 3;

/// What tells the answer to one question from that to another: its function, and its length, or what a write repeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mark {
    function: u8,
    form: [u16; 2],
}

/// What the units of a line owe, by their numbers: few enough to be looked through.
pub(super) struct Debts(Vec<(u8, Owed)>);

/// What has not been heard of one unit.
#[derive(Debug)]
pub(super) struct Owed {
    /// Since when it may owe anything at all.
    anything: Option<Silence>,
    late: Vec<Late>,
    /// Answers in time since it was last heard late, and the longest of the last `PROOF` and of those before.
    in_time: u32,
    longest: [Duration; 2],
    /// Misses in a row.
    misses: u32,
    /// Order of its questions and answers, if it is behind a gateway.
    pub(super) order: Order,
}

/// One answer that has not come.
#[derive(Clone, Copy, Debug)]
struct Late {
    mark: Mark,
    from: u16,
    count: u16,
    is_read: bool,
    asked: Moment,
    missed: Moment,
    since: Silence,
    /// One of the questions it belongs to has been answered since: what it counts from is settled.
    is_answered: bool,
}

/// How long a late answer is waited for.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spans {
    /// For an answer to begin.
    pub(super) timeout: Duration,
    /// How long the latest answer is waited for beyond that.
    pub(super) grace: Duration,
}

impl Mark {
    /// That of the answer to this.
    pub(super) fn of(request: Request<'_>) -> Mark {
        let form = match request {
            Request::Read { from, count } if from.table.is_bits() => [count.div_ceil(8), 0],
            Request::Read { count, .. } => [2 * count, 0],
            Request::WriteCoil { at, value } => [at, if value { 0xff00 } else { 0 }],
            Request::WriteSingle { at, value } => [at, value],
            Request::WriteMultiple { at, values } => [at, u16::try_from(values.len()).unwrap_or(u16::MAX)],
            Request::Can(_) | Request::Nodes(_) | Request::Sensors(_) => [0, 0],
        };
        Mark { function: request.function(), form }
    }

    /// That of this answer to a read; `None` of any other message.
    pub(super) fn of_answer(pdu: &[u8]) -> Option<Mark> {
        match *pdu {
            [function @ 1..=4, bytes, ..] => Some(Mark { function, form: [u16::from(bytes), 0] }),
            _ => None,
        }
    }

    /// That of the answer to this question of a read; `None` of any other message.
    pub(super) fn of_question(pdu: &[u8]) -> Option<Mark> {
        let [function @ 1..=4, _, _, high, low] = *pdu else { return None };
        let count = u16::from_be_bytes([high, low]);
        let (most, bytes) = match function {
            1 | 2 => (2000, count.div_ceil(8)),
            _ => (125, 2 * count.min(125)),
        };
        (1..=most).contains(&count).then_some(Mark { function, form: [bytes, 0] })
    }

    /// Whether the content of a frame bears it.
    pub(super) fn is_on(self, pdu: &[u8]) -> bool {
        let word = |at: usize| Some(u16::from_be_bytes([*pdu.get(at)?, *pdu.get(at + 1)?]));
        let form = match self.function {
            1..=4 => pdu.get(1).map(|bytes| [u16::from(*bytes), 0]),
            _ => word(1).zip(word(3)).map(|(at, what)| [at, what]),
        };
        pdu.first() == Some(&self.function) && form == Some(self.form)
    }

    /// Whether the content of a frame refuses a question with such an answer.
    pub(super) fn is_refused_by(self, pdu: &[u8]) -> bool {
        pdu.len() == 2 && pdu[0] == self.function | 0x80
    }
}

impl Debts {
    /// Of units that nobody has asked yet.
    pub(super) fn of_units(numbers: impl Iterator<Item = u8>) -> Debts {
        let mut debts = Debts(Vec::new());
        for number in numbers {
            debts.of(number);
        }
        debts
    }

    pub(super) fn get(&self, number: u8) -> Option<&Owed> {
        self.0.iter().find(|(unit, _)| *unit == number).map(|(_, owed)| owed)
    }

    pub(super) fn of(&mut self, number: u8) -> &mut Owed {
        let place = self.0.iter().position(|(unit, _)| *unit == number).unwrap_or_else(|| {
            self.0.push((number, Owed::unknown()));
            self.0.len() - 1
        });
        &mut self.0[place].1
    }

    pub(super) fn each(&mut self) -> impl Iterator<Item = &mut Owed> {
        self.0.iter_mut().map(|(_, owed)| owed)
    }

    /// What may still come, and of which unit.
    pub(super) fn marks(&self) -> impl Iterator<Item = (u8, Mark)> {
        self.0.iter().flat_map(|(unit, owed)| owed.marks().map(|mark| (*unit, mark)))
    }
}

impl Owed {
    /// Of a unit that nobody has asked yet: what a gateway asked it that ended a moment ago may be under way.
    pub(super) fn unknown() -> Owed {
        Owed {
            anything: Some(Silence::begin()),
            late: Vec::new(),
            in_time: 0,
            longest: [Duration::ZERO; 2],
            misses: 0,
            order: Order::unknown(),
        }
    }

    /// Anything may come of it from now on.
    pub(super) fn anything(&mut self) {
        self.anything = Some(Silence::begin());
    }

    /// How much longer anything may; `None` where it was listened to.
    pub(super) fn left_of_anything(&self, spans: Spans) -> Option<Duration> {
        self.anything.map(|since| since.left_of(spans.grace))
    }

    /// Returns whether an answer of it may still come.
    pub(super) fn is_owing(&self) -> bool {
        self.anything.is_some() || !self.late.is_empty()
    }

    /// It was listened to until nothing is owed any more.
    pub(super) fn is_quiet(&mut self) {
        self.anything = None;
        self.late.clear();
    }

    /// It was heard late, or out of turn.
    pub(super) fn distrust(&mut self) {
        (self.in_time, self.longest) = (0, [Duration::ZERO; 2]);
    }

    fn is_prompt(&self) -> bool {
        self.in_time >= PROOF
    }

    /// An answer of a prompt unit comes within this.
    fn prompt_span(&self) -> Duration {
        self.longest[0].max(self.longest[1]).max(SHORTEST) * FACTOR
    }

    /// Returns within what time a second answer of it comes, if it has been asked twice. Question and answer take `under_way` on
    /// the line.
    pub(super) fn second_within(&self, timeout: Duration, under_way: Duration) -> Duration {
        let span = self.longest[0].max(self.longest[1]).max(under_way) + LATER;
        let prompt = if self.is_prompt() { self.prompt_span() } else { span };
        span.min(prompt).min(timeout + under_way)
    }

    /// It has answered, after so long; or within what it takes as often, where a question had to be repeated.
    pub(super) fn answers(&mut self, request: Request<'_>, took: Duration) {
        self.misses = 0;
        let mut is_repeated = false;
        for late in self.late.iter_mut().filter(|late| late.is_same(request) && !late.is_answered) {
            (late.is_answered, late.since, is_repeated) = (true, Silence::begin(), true);
        }
        if is_repeated {
            return;
        }
        if self.in_time.is_multiple_of(PROOF) {
            self.longest = [Duration::ZERO, self.longest[0]];
        }
        self.longest[0] = self.longest[0].max(took);
        self.in_time = self.in_time.saturating_add(1);
    }

    /// It has answered before.
    pub(super) fn has_answered(&self) -> bool {
        self.in_time > 0
    }

    /// No answer in time to what was asked at this moment. Whether it may be asked again at once, or soon; else it is to
    /// be left alone.
    pub(super) fn misses(&mut self, request: Request<'_>, asked: Moment, now: Moment) -> bool {
        self.misses = self.misses.saturating_add(1);
        if !self.is_prompt() || self.misses >= MISSES {
            return false;
        }
        let (from, count) = match request {
            Request::Read { from, count } => (from.offset, count),
            _ => (0, 0),
        };
        self.late.push(Late {
            mark: Mark::of(request),
            from,
            count,
            is_read: request.is_read(),
            asked,
            missed: now,
            since: Silence::begin(),
            is_answered: false,
        });
        true
    }

    /// Misses in a row.
    pub(super) fn missed(&self) -> u32 {
        self.misses
    }

    /// How long it must have been silent since a miss before this is asked.
    fn span(&self, late: &Late, request: Request<'_>, spans: Spans) -> Duration {
        if late.mark != Mark::of(request) {
            Duration::ZERO
        } else if late.is_answered && self.is_prompt() {
            self.prompt_span().min(spans.grace)
        } else if late.is_same(request) && self.is_prompt() {
            // The timeout has passed in silence already.
            self.prompt_span().saturating_sub(spans.timeout).min(spans.grace)
        } else {
            spans.grace
        }
    }

    /// How much longer it must be silent before this is asked.
    pub(super) fn left(&self, request: Request<'_>, spans: Spans) -> Duration {
        let left = self.late.iter().map(|late| late.since.left_of(self.span(late, request, spans)));
        left.max().unwrap_or_default()
    }

    /// Until when it must not be asked this, by the caller's moments.
    pub(super) fn not_before(&self, request: Request<'_>, spans: Spans) -> Option<Moment> {
        let waiting = self.late.iter().filter(|late| !late.is_answered);
        waiting.map(|late| late.missed.after(self.span(late, request, spans))).max()
    }

    /// Until when what was missed must not be asked again, by the caller's moments.
    pub(super) fn again_at(&self, spans: Spans) -> Option<Moment> {
        let last = self.late.last().filter(|late| !late.is_answered)?;
        let passed = if self.is_prompt() && last.is_read {
            self.prompt_span().saturating_sub(spans.timeout).min(spans.grace)
        } else {
            spans.grace
        };
        Some(last.missed.after(passed))
    }

    /// Where this is asked for the second time: when it first was.
    pub(super) fn first_asked(&self, request: Request<'_>) -> Option<Moment> {
        let same = self.late.iter().filter(|late| late.is_same(request) && !late.is_answered);
        same.map(|late| late.asked).min()
    }

    /// Whether the answer to a repeated question comes when this unit's do: else it is the one that was late.
    pub(super) fn is_likely_after(&self, took: Duration) -> bool {
        took <= self.prompt_span()
    }

    /// What may still come, what has just had its time included: it may lie there and wait.
    pub(super) fn marks(&self) -> impl Iterator<Item = Mark> {
        self.late.iter().map(|late| late.mark)
    }

    /// What has had its time, and was not found when the line was looked at, does not come any more.
    pub(super) fn forget(&mut self, spans: Spans) {
        self.late.retain(|late| !late.since.left_of(spans.grace).is_zero());
    }
}

impl Late {
    fn is_same(&self, request: Request<'_>) -> bool {
        self.is_read
            && self.mark == Mark::of(request)
            && matches!(request, Request::Read { from, count } if (from.offset, count) == (self.from, self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{Register, Table};

    #[test]
    fn a_second_answer_is_waited_for_by_the_longest_answer_and_not_for_a_whole_timeout() {
        let read = Request::Read { from: Register { table: Table::Input, offset: 0 }, count: 1 };
        let ms = Duration::from_millis;
        for (answers, took, timeout, under_way, span) in [
            (0, 0, 500, 0, 50),
            (0, 0, 500, 20, 70),
            (1, 30, 500, 20, 80),
            (1, 200, 500, 20, 250),
            (1, 30, 40, 0, 40),
            (1, 30, 40, 15, 55),
            (100, 5, 500, 0, 15),
            (100, 200, 500, 0, 250),
        ] {
            let mut owed = Owed::unknown();
            for _ in 0..answers {
                owed.answers(read, ms(took));
            }
            assert_eq!(owed.second_within(ms(timeout), ms(under_way)), ms(span), "{answers} of {took} ms");
        }
    }
}
