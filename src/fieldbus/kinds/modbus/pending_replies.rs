//! Late answers of units whose answers have no reliable transaction number, and the requests that may be sent before
//! they arrive. Such units are on an RTU line, or behind a Modbus gateway (from TCP to a serial line). A Modbus gateway
//! may send a late answer with the transaction number of a later request.
//!
//! After a timeout, the missing answer may still arrive late. Until then:
//! - A request is sent at once if its answer has another function or length. The late answer is then recognized and
//!   discarded when it arrives ([`ReplySignature`]).
//! - A request of the same form waits until the late answer can no longer arrive.
//! - **The same read** may be repeated earlier to a unit that is known to be prompt: its last `PROOF` answers
//!   arrived in time. Before the repetition, the line must have been silent for `FACTOR` times the longest of
//!   these answer times. The next answer may then belong to either request. Its age therefore counts from the
//!   first request, and it is accepted only within the same span. The next repetition requires another
//!   silence of this length.
//!
//! A unit that answered late, or without a request, is no longer prompt. After each of its missing answers,
//! the line waits until the late answer can no longer arrive. The unit is prompt again after `PROOF` further
//! answers in time.

use std::time::Duration;

use super::order_check::OrderCheck;
use super::reply_signature::ReplySignature;
use super::request::ModbusRequest;
use crate::clock::Silence;
use crate::fieldbus::request::Request;
use isotherm_core::quantity::Moment;

/// Number of consecutive answers in time after which a unit counts as prompt (usually fast).
const PROOF: u32 = 100;
/// Factor between the longest answer time of a prompt unit and the time within which its answers are expected.
const FACTOR: u32 = 3;
/// Minimum answer time for calculations. Shorter measured times are not reliable, because this computer may be late in
/// receiving an answer.
const SHORTEST: Duration = Duration::from_millis(5);
/// Additional time in which the second answer arrives, if a unit answers twice.
const LATER: Duration = Duration::from_millis(50);
/// Number of consecutive requests without an answer after which even a prompt unit gets no request until late
/// answers can no longer arrive.
const MISSES: u32 = 3;

/// Late answers of the units of a line, by unit number. The list is short enough for a linear search.
pub(in crate::fieldbus) struct UnitReplies(Vec<(u8, PendingReplies)>);

/// Answers of one unit that may still arrive late, and its usual answer time.
#[derive(Debug)]
pub(in crate::fieldbus) struct PendingReplies {
    /// Start of the wait during which any late answer of the unit may arrive; `None` if no such wait is necessary.
    anything: Option<Silence>,
    late: Vec<MissingReply>,
    /// Number of answers in time since the last late answer. `longest`: longest answer time among the last `PROOF`
    /// answers, and among the `PROOF` answers before them.
    in_time: u32,
    longest: [Duration; 2],
    /// Number of consecutive requests without an answer in time.
    misses: u32,
    /// State of the check that the answers of the unit belong to their requests; used if the unit is behind a Modbus
    /// gateway.
    pub(in crate::fieldbus) order: OrderCheck,
}

/// Answer that had not arrived at the timeout, and may still arrive late.
#[derive(Clone, Copy, Debug)]
struct MissingReply {
    mark: ReplySignature,
    from: u16,
    count: u16,
    is_read: bool,
    asked: Moment,
    missed: Moment,
    since: Silence,
    /// Whether a later repetition of the same request was answered. The age of a reading then no longer counts from the
    /// first request.
    is_answered: bool,
}

/// Timeout of a line, and the additional time for which the line expects late answers.
#[derive(Clone, Copy, Debug)]
pub(in crate::fieldbus) struct Spans {
    /// Timeout of the line: longest time from a request to the beginning of its answer.
    pub(in crate::fieldbus) timeout: Duration,
    /// Time after the timeout during which a late answer may arrive.
    pub(in crate::fieldbus) grace: Duration,
}

impl UnitReplies {
    /// Returns the state of the units with these numbers, before their first request.
    pub(in crate::fieldbus) fn of_units(numbers: impl Iterator<Item = u8>) -> UnitReplies {
        let mut unit_replies = UnitReplies(Vec::new());
        for number in numbers {
            unit_replies.of(number);
        }
        unit_replies
    }

    pub(in crate::fieldbus) fn get(&self, number: u8) -> Option<&PendingReplies> {
        self.0.iter().find(|(unit, _)| *unit == number).map(|(_, pending)| pending)
    }

    pub(in crate::fieldbus) fn of(&mut self, number: u8) -> &mut PendingReplies {
        let place = self.0.iter().position(|(unit, _)| *unit == number).unwrap_or_else(|| {
            self.0.push((number, PendingReplies::unknown()));
            self.0.len() - 1
        });
        &mut self.0[place].1
    }

    pub(in crate::fieldbus) fn each(&mut self) -> impl Iterator<Item = &mut PendingReplies> {
        self.0.iter_mut().map(|(_, pending)| pending)
    }

    /// Returns the forms (function and length) of all answers that may still arrive late, each with its unit number.
    pub(in crate::fieldbus) fn marks(&self) -> impl Iterator<Item = (u8, ReplySignature)> {
        self.0.iter().flat_map(|(unit, pending)| pending.marks().map(|mark| (*unit, mark)))
    }
}

impl PendingReplies {
    /// Returns the state of a unit before its first request. Answers to an earlier process of isotherm may still
    /// arrive.
    pub(in crate::fieldbus) fn unknown() -> PendingReplies {
        PendingReplies {
            anything: Some(Silence::begin()),
            late: Vec::new(),
            in_time: 0,
            longest: [Duration::ZERO; 2],
            misses: 0,
            order: OrderCheck::unknown(),
        }
    }

    /// Records that a late answer to any earlier request may arrive from now on, for example because the connection was
    /// dropped.
    pub(in crate::fieldbus) fn anything(&mut self) {
        self.anything = Some(Silence::begin());
    }

    /// Returns how much longer the line must wait because any answer of the unit may arrive; `None` if no such wait is
    /// necessary.
    pub(in crate::fieldbus) fn remaining_for_any(&self, spans: Spans) -> Option<Duration> {
        self.anything.map(|since| since.left_of(spans.grace))
    }

    /// Returns whether a late answer of the unit may still arrive.
    pub(in crate::fieldbus) fn has_pending(&self) -> bool {
        self.anything.is_some() || !self.late.is_empty()
    }

    /// Records that the line has waited until late answers can no longer arrive. Reports this to the order check,
    /// because a Modbus gateway may still keep a late answer.
    pub(in crate::fieldbus) fn is_quiet(&mut self) {
        self.anything = None;
        self.late.drain(..).filter(|late| late.is_read).for_each(|late| self.order.suspect(late.mark));
    }

    /// Records that the unit answered late, or without a request. It then no longer counts as prompt (usually fast).
    pub(in crate::fieldbus) fn reset_timing(&mut self) {
        (self.in_time, self.longest) = (0, [Duration::ZERO; 2]);
    }

    fn is_prompt(&self) -> bool {
        self.in_time >= PROOF
    }

    /// Returns the time within which a prompt unit (one that usually answers fast) answers: `FACTOR` times its longest
    /// answer time.
    fn prompt_span(&self) -> Duration {
        self.longest[0].max(self.longest[1]).max(SHORTEST) * FACTOR
    }

    /// Returns the time within which the second of two answers arrives, after a repeated request. `under_way` is the
    /// transmission time of a request and its answer.
    pub(in crate::fieldbus) fn second_within(&self, timeout: Duration, under_way: Duration) -> Duration {
        let span = self.longest[0].max(self.longest[1]).max(under_way) + LATER;
        let prompt = if self.is_prompt() { self.prompt_span() } else { span };
        span.min(prompt).min(timeout + under_way)
    }

    /// Records an answer to `request` that took the time `took`. After a repeated request the answer time is unknown,
    /// and the answer to the other attempt may still arrive.
    pub(in crate::fieldbus) fn answers(&mut self, request: Request<'_>, took: Duration) {
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

    /// Returns whether the unit has answered in time since its last late answer.
    pub(in crate::fieldbus) fn has_answered(&self) -> bool {
        self.in_time > 0
    }

    /// Records that a request sent at `asked` was not answered in time. Returns true if the unit usually
    /// answers fast and may soon get requests again. Otherwise the unit must get no request until the late
    /// answer can no longer arrive.
    pub(in crate::fieldbus) fn misses(&mut self, request: Request<'_>, asked: Moment, now: Moment) -> bool {
        self.misses = self.misses.saturating_add(1);
        if !self.is_prompt() || self.misses >= MISSES {
            return false;
        }
        let (from, count) = match request {
            Request::Modbus(ModbusRequest::Read { from, count }) => (from.offset, count),
            _ => (0, 0),
        };
        self.late.push(MissingReply {
            mark: ReplySignature::of(request),
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

    /// Returns the number of consecutive requests without an answer in time.
    pub(in crate::fieldbus) fn missed(&self) -> u32 {
        self.misses
    }

    /// Returns how long the line must be silent after the unanswered request `late`, before `request` may be sent.
    fn span(&self, late: &MissingReply, request: Request<'_>, spans: Spans) -> Duration {
        if late.mark != ReplySignature::of(request) {
            Duration::ZERO
        } else if late.is_answered && self.is_prompt() {
            self.prompt_span().min(spans.grace)
        } else if late.is_same(request) && self.is_prompt() {
            // The timeout was already a part of the silence.
            self.prompt_span().saturating_sub(spans.timeout).min(spans.grace)
        } else {
            spans.grace
        }
    }

    /// Returns how much longer the line must be silent before `request` may be sent, because late answers may still
    /// arrive.
    pub(in crate::fieldbus) fn left(&self, request: Request<'_>, spans: Spans) -> Duration {
        let left = self.late.iter().map(|late| late.since.left_of(self.span(late, request, spans)));
        left.max().unwrap_or_default()
    }

    /// Returns the earliest time at which `request` may be sent, because late answers may still arrive before; `None`
    /// if it may be sent now.
    pub(in crate::fieldbus) fn not_before(&self, request: Request<'_>, spans: Spans) -> Option<Moment> {
        let waiting = self.late.iter().filter(|late| !late.is_answered);
        waiting.map(|late| late.missed.after(self.span(late, request, spans))).max()
    }

    /// Returns the earliest time at which the last unanswered request may be repeated; `None` if the last request was
    /// answered.
    pub(in crate::fieldbus) fn again_at(&self, spans: Spans) -> Option<Moment> {
        let last = self.late.last().filter(|late| !late.is_answered)?;
        let passed = if self.is_prompt() && last.is_read {
            self.prompt_span().saturating_sub(spans.timeout).min(spans.grace)
        } else {
            spans.grace
        };
        Some(last.missed.after(passed))
    }

    /// Returns the time of the first attempt, if this request repeats an unanswered request; otherwise `None`.
    pub(in crate::fieldbus) fn first_asked(&self, request: Request<'_>) -> Option<Moment> {
        let same = self.late.iter().filter(|late| late.is_same(request) && !late.is_answered);
        same.map(|late| late.asked).min()
    }

    /// Returns whether an answer with the answer time `took` is accepted for a repeated request. A slower answer is
    /// assumed to belong to the first attempt.
    pub(in crate::fieldbus) fn is_likely_after(&self, took: Duration) -> bool {
        took <= self.prompt_span()
    }

    /// Returns the forms (function and length) of answers that may still arrive late. Answers whose waiting time has
    /// just ended are included, because such an answer may be in the receive buffer.
    pub(in crate::fieldbus) fn marks(&self) -> impl Iterator<Item = ReplySignature> {
        self.late.iter().map(|late| late.mark)
    }

    /// Removes missing answers that can no longer arrive, and reports them to the order check: a Modbus gateway may
    /// still keep the answer to a read.
    pub(in crate::fieldbus) fn forget(&mut self, spans: Spans) {
        let order = &mut self.order;
        self.late.retain(|late| {
            let is_over = late.since.left_of(spans.grace).is_zero();
            if is_over && late.is_read {
                order.suspect(late.mark);
            }
            !is_over
        });
    }
}

impl MissingReply {
    fn is_same(&self, request: Request<'_>) -> bool {
        let Request::Modbus(ModbusRequest::Read { from, count }) = request else { return false };
        self.is_read
            && self.mark == ReplySignature::of(request)
            && (from.offset, count) == (self.from, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_core::codec::{Register, Table};

    #[test]
    fn a_second_answer_is_waited_for_by_the_longest_answer_and_not_for_a_whole_timeout() {
        let read = Request::read_registers(Register { table: Table::Input, offset: 0 }, 1);
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
            let mut pending = PendingReplies::unknown();
            for _ in 0..answers {
                pending.answers(read, ms(took));
            }
            assert_eq!(pending.second_within(ms(timeout), ms(under_way)), ms(span), "{answers} of {took} ms");
        }
    }
}
