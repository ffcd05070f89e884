//! Another master on the line of the thermocouple module, and its signs for the gateway.
//!
//! The other master reads other registers of the same unit, with the same function and length as the gateway. The
//! gateway receives its replies, and on some days its requests. The line carries one request and its reply at a time. A
//! request of the gateway that begins meanwhile is destroyed, or is answered later.
//!
//! Law: no register moves on a value of the other registers, except before the first sign of the other master.
//! [`Signs`] determines from the frames that a gateway has read whether there was a sign. By `docs/serial.md`, these
//! are signs:
//!
//! - A request that this gateway did not send.
//! - The second of two replies within ten minutes for which the gateway had no open request. Replies between two
//!   requests count as one. No reply counts if the module has recently not answered a request in time.
//!
//! Before such a sign, a reply of the other master may arrive for an open request of the same form. It may move
//! registers as long as a reading is used. A sign that a gateway reads while it waits for late replies does not count,
//! because the gateway discards them.

use std::time::Duration;

use rand::RngExt;
use rand_pcg::Pcg32;

use crate::machine::{OTHERS, Question};

const SECOND: Duration = Duration::from_secs(1);
const MILLI: Duration = Duration::from_millis(1);

/// Rate limit for the signals of the module, K/s. They change by at most 0.012 K/s. The other registers differ by 13 K,
/// which the limit allows after 217 s.
pub(crate) const MAX_RATE: f64 = 0.06;

/// Request of the other master.
pub(crate) const QUESTION: Question = Question::Read { function: 4, at: OTHERS, count: 2 };
/// Time between a reply and the next one that had to wait for it.
const GAP: Duration = Duration::from_millis(5);
/// Age beyond which exchanges are skipped: no gateway ran, or its computer slept.
const LEFT_OUT: Duration = Duration::from_secs(3);
/// Maximum time for which the other master is synchronous with the gateway, and the absence that it requires. Over a
/// longer time, 30 of its replies in a row become likely, and the gateway uses them.
const LONGEST_IN_STEP: Duration = Duration::from_secs(60);
const AWAY: Duration = Duration::from_secs(120);

/// Behaviour of the other master during one visit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Habit {
    pub(crate) turns: Turns,
    pub(crate) carried: Carried,
}

/// Times at which the other master sends requests.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Turns {
    /// At intervals of a few hundred milliseconds.
    #[default]
    Free,
    /// Together with each request of the gateway, because both have the same period. Most requests of the gateway are
    /// destroyed.
    InStep,
}

/// Frames of the other master that the gateway receives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Carried {
    /// Replies, as from a serial server with two clients.
    #[default]
    Answers,
    /// Requests and replies, as on the wires of the line.
    Both,
}

/// Another master on the line.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OtherMaster {
    habit: Habit,
    until: Duration,
    next_at: Duration,
    /// Time until which an exchange occupies the line.
    busy_until: Duration,
}

/// A request of the other master and its reply.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OtherExchange {
    pub(crate) asked: Duration,
    pub(crate) answered: Duration,
    carried: Carried,
}

/// Effect of another master on a request of the gateway.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    /// Exchange that the other master begins at the same time.
    pub(crate) exchange: Option<OtherExchange>,
    /// Whether the exchange on the line has destroyed the request.
    pub(crate) is_destroyed: bool,
    /// Time at which the reply begins, if the module needs no time.
    pub(crate) from: Duration,
}

/// Content of a frame that the gateway receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// Reply to the gateway.
    Answer,
    /// Exception for the gateway.
    Exception,
    OtherQuestion,
    OtherAnswer,
}

impl Content {
    /// Content of a message from the module to the gateway.
    pub(crate) fn of(message: &[u8]) -> Content {
        let is_exception = message.first().is_some_and(|function| function & 0x80 != 0);
        if is_exception { Content::Exception } else { Content::Answer }
    }
}

impl OtherMaster {
    /// Begins a visit of the other master. It is synchronous with the gateway for at most [`LONGEST_IN_STEP`], and only
    /// after an absence of [`AWAY`].
    pub(crate) fn comes(&mut self, habit: Habit, now: Duration, span: Duration) {
        let was_away = self.until.is_zero() || now.saturating_sub(self.until) >= AWAY;
        let (turns, span) = match habit.turns {
            Turns::InStep if was_away => (Turns::InStep, span.min(LONGEST_IN_STEP)),
            _ => (Turns::Free, span),
        };
        (self.habit, self.until, self.next_at) = (Habit { turns, ..habit }, now + span, now);
    }

    /// Records the start of another gateway, whose period has another phase.
    pub(crate) fn loses_step(&mut self) {
        self.habit.turns = Turns::Free;
    }

    /// Time of the next request, if it does not depend on the gateway.
    pub(crate) fn next_at(&self) -> Option<Duration> {
        let next = self.next_at.max(self.busy_until);
        (self.habit.turns == Turns::Free && next < self.until).then_some(next)
    }

    /// Returns the next exchange that begins by this time.
    pub(crate) fn asks_by(&mut self, now: Duration, random: &mut Pcg32) -> Option<OtherExchange> {
        let next = self.next_at().filter(|next| *next <= now)?;
        let begin = if now.saturating_sub(next) > LEFT_OUT { now } else { next };
        self.next_at = begin + MILLI * random.random_range(300..1200);
        (begin < self.until).then(|| self.begins(begin, random))
    }

    fn begins(&mut self, asked: Duration, random: &mut Pcg32) -> OtherExchange {
        let answered = asked + MILLI * random.random_range(5..40);
        self.busy_until = answered;
        OtherExchange { asked, answered, carried: self.habit.carried }
    }

    /// Determines the effect on a request of the gateway.
    pub(crate) fn meets(&mut self, now: Duration, random: &mut Pcg32) -> Meeting {
        let is_there = now < self.until;
        let is_in_step = is_there && self.habit.turns == Turns::InStep;
        let begins = is_in_step && now >= self.busy_until;
        let exchange = begins.then(|| self.begins(now, random));
        let is_busy = now < self.busy_until;
        // Probability in tenths.
        let destroyed = if is_in_step { 7 } else { 3 };
        let is_destroyed = is_busy && is_there && random.random_range(0..10u32) < destroyed;
        let from = if is_busy { self.busy_until + GAP } else { now };
        Meeting { exchange, is_destroyed, from }
    }

    /// Records that the line carries a reply to the gateway until this time.
    pub(crate) fn waits_for(&mut self, answered: Duration) {
        self.busy_until = self.busy_until.max(answered);
    }
}

impl OtherExchange {
    /// Returns the frames that the gateway receives: content, time and message.
    pub(crate) fn frames(self, answer: Vec<u8>) -> impl Iterator<Item = (Content, Duration, Vec<u8>)> {
        let question = || [&[4][..], &OTHERS.to_be_bytes(), &[0, 2]].concat();
        let is_carried = self.carried == Carried::Both;
        let asks = is_carried.then(|| (Content::OtherQuestion, self.asked, question()));
        asks.into_iter().chain([(Content::OtherAnswer, self.answered, answer)])
    }
}

/// Maximum time between a request and its reply.
const IN_TIME: Duration = Duration::from_millis(202);
/// Time after an unanswered request in which no reply counts.
const OWING: Duration = Duration::from_secs(2);
/// Time for which a sign counts: ten minutes, minus the difference between the clocks.
const REMEMBERED: Duration = Duration::from_secs(590);
/// Maximum delay of the alarm after the first sign. The alarm may also end this much earlier than `REMEMBERED`.
const REPORTED: Duration = Duration::from_secs(10);

/// Signs of another master that the current gateway has received.
#[derive(Clone, Debug, Default)]
pub(crate) struct Signs {
    exchange: Exchange,
    /// Time at which a request was found to be unanswered.
    missed_at: Option<Duration>,
    notice: Notice,
    /// Time of the last request that was answered by the other master before the first sign.
    mistaken_at: Option<Duration>,
    /// How often another master was detected that was unknown before.
    pub(crate) noticed: u64,
}

/// Last request of the gateway on the line.
#[derive(Clone, Copy, Debug, Default)]
enum Exchange {
    /// No request yet on this connection, or the gateway waits for late replies.
    #[default]
    Unknown,
    Open {
        question: Question,
        asked_at: Duration,
        /// Whether a request of the other master came after it.
        has_overheard: bool,
    },
    /// A reply of its form came in time.
    Answered,
}

/// State of the detection.
#[derive(Clone, Copy, Debug, Default)]
enum Notice {
    #[default]
    None,
    /// One reply without a request.
    Suspected(Duration),
    Noticed {
        since: Duration,
        last: Duration,
    },
}

impl Signs {
    /// Resets the signs, because a new gateway starts.
    pub(crate) fn begins(&mut self) {
        *self = Signs { noticed: self.noticed, ..Signs::default() };
    }

    /// Records a new connection to the module.
    pub(crate) fn connects(&mut self) {
        self.exchange = Exchange::Unknown;
    }

    /// Records a request of the gateway to the module.
    pub(crate) fn asks(&mut self, question: Question, now: Duration) {
        if matches!(self.exchange, Exchange::Open { .. }) {
            self.missed_at = Some(now);
        }
        self.exchange = Exchange::Open { question, asked_at: now, has_overheard: false };
    }

    /// Evaluates a frame that the gateway reads from its connection, and that belongs to the request `of`. Returns
    /// whether it is a reply of the other master to an open request of its form.
    pub(crate) fn receives(&mut self, content: Content, of: Question, now: Duration) -> bool {
        if let Exchange::Open { asked_at, .. } = self.exchange
            && now.saturating_sub(asked_at) > IN_TIME
        {
            (self.exchange, self.missed_at) = (Exchange::Unknown, Some(now));
        }
        let is_owing = self.missed_at.is_some_and(|missed| now.saturating_sub(missed) < OWING);
        match (content, self.exchange) {
            (_, Exchange::Unknown) => false,
            (Content::OtherQuestion, Exchange::Open { question, asked_at, .. }) => {
                self.exchange = Exchange::Open { question, asked_at, has_overheard: true };
                false
            }
            (Content::OtherQuestion, Exchange::Answered) => {
                if !is_owing {
                    self.notices(now);
                }
                false
            }
            (_, Exchange::Open { question, asked_at, has_overheard }) => {
                if has_overheard {
                    self.notices(now);
                }
                let has_its_form = form(question) == form(of);
                self.exchange = if has_its_form { Exchange::Answered } else { Exchange::Unknown };
                let is_of_other = content == Content::OtherAnswer && has_its_form;
                if is_of_other && !self.is_noticed(now) {
                    self.mistaken_at = Some(asked_at);
                }
                is_of_other
            }
            (_, Exchange::Answered) => {
                // The gateway may wait for late replies from now on.
                self.exchange = Exchange::Unknown;
                if content != Content::Exception && !is_owing {
                    self.suspects(now);
                }
                false
            }
        }
    }

    fn suspects(&mut self, now: Duration) {
        match self.notice {
            Notice::Suspected(since) if now.saturating_sub(since) < REMEMBERED => self.notices(now),
            Notice::Noticed { .. } if self.is_noticed(now) => self.notices(now),
            _ => self.notice = Notice::Suspected(now),
        }
    }

    fn notices(&mut self, now: Duration) {
        let since = match self.notice {
            Notice::Noticed { since, .. } if self.is_noticed(now) => since,
            _ => {
                self.noticed += 1;
                now
            }
        };
        self.notice = Notice::Noticed { since, last: now };
    }

    fn is_noticed(&self, now: Duration) -> bool {
        matches!(self.notice, Notice::Noticed { last, .. } if now.saturating_sub(last) < REMEMBERED)
    }

    /// Returns whether an alarm must report another master.
    pub(crate) fn must_be_reported(&self, now: Duration) -> bool {
        let Notice::Noticed { since, last } = self.notice else { return false };
        now.saturating_sub(since) >= REPORTED && now.saturating_sub(last) + REPORTED < REMEMBERED
    }

    /// Time of the last request that was answered by the other master before the first sign.
    pub(crate) fn mistaken_at(&self) -> Option<Duration> {
        self.mistaken_at
    }
}

/// Function and length of a read request, which distinguish its reply from others.
fn form(question: Question) -> Option<(u8, u16)> {
    match question {
        Question::Read { function, count, .. } => Some((function, count)),
        Question::Write { .. } | Question::Nonsense => None,
    }
}

/// Draws the behaviour and the duration of a visit.
pub(crate) fn draw(random: &mut Pcg32) -> (Habit, Duration) {
    let turns = [Turns::InStep, Turns::InStep, Turns::Free][random.random_range(0..3)];
    let carried = [Carried::Both, Carried::Both, Carried::Answers][random.random_range(0..3)];
    (Habit { turns, carried }, SECOND * random.random_range(1..=90))
}
