//! Another master on the line of the module with the thermocouples, and what the gateway can know of it.
//!
//! It reads other registers of the same unit, with the function and the length of the gateway's read. The gateway receives its answers,
//! and on some days its questions. The line carries one question and its answer at a time. A question of the gateway that begins
//! meanwhile is destroyed or is answered after that.
//!
//! Law: no register moves on a value of the other registers, except before the first sign of the other master. [`Signs`] knows from the
//! frames that a gateway has read whether there was a sign. By `docs/serial.md` these are signs:
//!
//! - A question that this gateway did not send.
//! - The second of two answers within ten minutes that no question of this gateway was open for. Those that are read between two
//!   questions count as one. No answer counts if the module has not answered a question in time shortly before.
//!
//! An answer of the other master that comes to an open question of its form before such a sign may move registers for as long as a
//! reading is used. A sign that a gateway reads while it waits for late answers does not count, because it discards them.
//!
//! Two limits of the gateway are not in the law, and the scene keeps away from them, see [`OtherMaster::comes`]:
//!
//! - Two answers of the other master in a row agree with each other. Only the last good reading speaks against them, by `max_rate`. A
//!   gateway that has no reading, or an old one, uses them.
//! - An answer that was used before the first sign is the last good reading for `max_rate`. Until that allows the difference, true
//!   readings are rejected, and two more answers of the other master in a row are used.

use std::time::Duration;

use rand::RngExt;
use rand_pcg::Pcg32;

use crate::machine::{OTHERS, Question};

const SECOND: Duration = Duration::from_secs(1);
const MILLI: Duration = Duration::from_millis(1);

/// Limit for the signals of the module, K/s. They change by 0.012 at most. The other registers differ by 13 K, which this allows after
/// 217 s.
pub(crate) const MAX_RATE: f64 = 0.06;

/// The other master reads this.
pub(crate) const QUESTION: Question = Question::Read { function: 4, at: OTHERS, count: 2 };
/// Time between an answer and the next one that had to wait for it.
const GAP: Duration = Duration::from_millis(5);
/// Exchanges before this are left out: no gateway ran, or its computer slept.
const LEFT_OUT: Duration = Duration::from_secs(3);
/// The other master is in step with the gateway for no longer than this, and only if it was away for so long.
const LONGEST_IN_STEP: Duration = Duration::from_secs(60);
const AWAY: Duration = Duration::from_secs(120);
/// A mistake is forgotten after this: `max_rate` has allowed the true readings again.
const RECOVERED: Duration = Duration::from_secs(600);

/// Habits of the other master during one visit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Habit {
    pub(crate) turns: Turns,
    pub(crate) carried: Carried,
}

/// Moments at which the other master asks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Turns {
    /// Every few hundred milliseconds.
    #[default]
    Free,
    /// With each question of the gateway: both have the same period. Most of the gateway's questions are destroyed.
    InStep,
}

/// Frames of the other master that the gateway receives.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Carried {
    /// Answers, as from a serial server with two clients.
    #[default]
    Answers,
    /// Questions and answers, as on the wires of the line.
    Both,
}

/// Another master on the line.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct OtherMaster {
    habit: Habit,
    until: Duration,
    next_at: Duration,
    /// The line carries an exchange until then.
    busy_until: Duration,
}

/// A question of the other master and its answer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OtherExchange {
    pub(crate) asked: Duration,
    pub(crate) answered: Duration,
    carried: Carried,
}

/// Result of a question of the gateway on a line with another master.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Meeting {
    /// Exchange that the other master begins at the same time.
    pub(crate) exchange: Option<OtherExchange>,
    /// The exchange on the line has destroyed the question.
    pub(crate) is_destroyed: bool,
    /// When the answer begins, if the module needs no time.
    pub(crate) from: Duration,
}

/// Content of a frame that the gateway receives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content {
    /// An answer to the gateway.
    Answer,
    /// An exception for the gateway.
    Exception,
    OtherQuestion,
    OtherAnswer,
}

impl Content {
    /// Content of a message of the module to the gateway.
    pub(crate) fn of(message: &[u8]) -> Content {
        let is_exception = message.first().is_some_and(|function| function & 0x80 != 0);
        if is_exception { Content::Exception } else { Content::Answer }
    }
}

impl OtherMaster {
    /// The other master comes for so long. It is in step with the gateway only if the gateway has used a good reading shortly before:
    /// `has_reading` says that the readings are recent and that none was mistaken.
    pub(crate) fn comes(&mut self, habit: Habit, has_reading: bool, now: Duration, span: Duration) {
        let was_away = self.until.is_zero() || now.saturating_sub(self.until) >= AWAY;
        let (turns, span) = match habit.turns {
            Turns::InStep if was_away && has_reading => (Turns::InStep, span.min(LONGEST_IN_STEP)),
            _ => (Turns::Free, span),
        };
        (self.habit, self.until, self.next_at) = (Habit { turns, ..habit }, now + span, now);
    }

    /// Another gateway begins, whose period has another phase.
    pub(crate) fn loses_step(&mut self) {
        self.habit.turns = Turns::Free;
    }

    /// When the other master asks next, if it does so by itself.
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

    /// A question of the gateway comes to the line.
    pub(crate) fn meets(&mut self, now: Duration, random: &mut Pcg32) -> Meeting {
        let is_there = now < self.until;
        let is_in_step = is_there && self.habit.turns == Turns::InStep;
        let begins = is_in_step && now >= self.busy_until;
        let exchange = begins.then(|| self.begins(now, random));
        let is_busy = now < self.busy_until;
        // Of ten.
        let destroyed = if is_in_step { 7 } else { 3 };
        let is_destroyed = is_busy && is_there && random.random_range(0..10u32) < destroyed;
        let from = if is_busy { self.busy_until + GAP } else { now };
        Meeting { exchange, is_destroyed, from }
    }

    /// The line carries an answer to the gateway at this time.
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

/// An answer that comes later after its question is none.
const IN_TIME: Duration = Duration::from_millis(202);
/// No answer counts so soon after a question that was not answered in time.
const OWING: Duration = Duration::from_secs(2);
/// A sign counts for so long: ten minutes, less what the gateway and this clock differ by.
const REMEMBERED: Duration = Duration::from_secs(590);
/// The alarm is there within this after the first sign, and until `REMEMBERED` is nearly over.
const REPORTED: Duration = Duration::from_secs(10);

/// Signs of another master that the present gateway has received.
#[derive(Clone, Debug, Default)]
pub(crate) struct Signs {
    exchange: Exchange,
    /// When a question was found to be unanswered.
    missed_at: Option<Duration>,
    notice: Notice,
    /// Question to which an answer of the other master came before the first sign.
    mistaken_at: Option<Duration>,
    /// How often another master was noticed that was not known.
    pub(crate) noticed: u64,
}

/// The last question of the gateway on the line.
#[derive(Clone, Copy, Debug, Default)]
enum Exchange {
    /// None yet on this connection, or the gateway waits for late answers.
    #[default]
    Unknown,
    Open {
        question: Question,
        asked_at: Duration,
        /// A question of the other master came after it.
        has_overheard: bool,
    },
    /// An answer of its form came in time.
    Answered,
}

/// Signs, as far as they add up.
#[derive(Clone, Copy, Debug, Default)]
enum Notice {
    #[default]
    None,
    /// One answer without a question.
    Suspected(Duration),
    Noticed {
        since: Duration,
        last: Duration,
    },
}

impl Signs {
    /// A gateway begins, which knows nothing.
    pub(crate) fn begins(&mut self) {
        *self = Signs { noticed: self.noticed, ..Signs::default() };
    }

    /// A connection to the module is made.
    pub(crate) fn connects(&mut self) {
        self.exchange = Exchange::Unknown;
    }

    /// The gateway asks the module.
    pub(crate) fn asks(&mut self, question: Question, now: Duration) {
        if matches!(self.exchange, Exchange::Open { .. }) {
            self.missed_at = Some(now);
        }
        self.exchange = Exchange::Open { question, asked_at: now, has_overheard: false };
    }

    /// The gateway reads a frame from its connection, which belongs to the question `of`. Returns whether an answer of the other master
    /// comes to an open question of its form.
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
                // The gateway may wait for late answers from now on.
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

    /// Returns whether an alarm must say that there is another master.
    pub(crate) fn must_be_reported(&self, now: Duration) -> bool {
        let Notice::Noticed { since, last } = self.notice else { return false };
        now.saturating_sub(since) >= REPORTED && now.saturating_sub(last) + REPORTED < REMEMBERED
    }

    /// When the gateway asked the last question to which an answer of the other master came before the first sign.
    pub(crate) fn mistaken_at(&self) -> Option<Duration> {
        self.mistaken_at
    }

    /// Returns whether no answer of the other master was taken for a reading recently.
    pub(crate) fn has_no_mistake(&self, now: Duration) -> bool {
        self.mistaken_at.is_none_or(|at| now.saturating_sub(at) > RECOVERED)
    }
}

/// Function and length of a read, by which its answer is distinguished from others.
fn form(question: Question) -> Option<(u8, u16)> {
    match question {
        Question::Read { function, count, .. } => Some((function, count)),
        Question::Write { .. } | Question::Nonsense => None,
    }
}

/// Draws the habit of a visit, and how long it lasts.
pub(crate) fn draw(random: &mut Pcg32) -> (Habit, Duration) {
    let turns = [Turns::InStep, Turns::InStep, Turns::Free][random.random_range(0..3)];
    let carried = [Carried::Both, Carried::Both, Carried::Answers][random.random_range(0..3)];
    (Habit { turns, carried }, SECOND * random.random_range(1..=90))
}
