//! Detection of other masters on a line without transaction numbers.
//!
//! A second master on a serial line, or a second client of a serial server, sends requests to the same units. An answer
//! to that master may have the same unit, function and length as an answer to the gateway. The gateway cannot
//! distinguish the two. Frames that belong to no request of the gateway show another master: one request, or two
//! answers within [`AFTER`]. A single answer may be noise or a part of another frame. For [`AFTER`] after the last such
//! frame, answers with the unit and form of an answer to the other master are [`Attribution::Ambiguous`]. The gateway
//! uses an ambiguous answer only if further reads agree with it. For registers of outputs, a second read must be equal.
//!
//! If both masters send a request at once, two answers of this form follow each other. After an ambiguous answer the
//! line therefore listens until a second one could have arrived. If a second one arrives, the gateway uses neither
//! ([`Attribution::Contested`]).

use std::time::Duration;

use super::{Attribution, CheckedAnswer, DeviceLine};
use crate::fieldbus::connection::Connection;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::kinds::modbus::pending_replies::PendingReplies;
use crate::fieldbus::kinds::modbus::reply_signature::ReplySignature;
use crate::fieldbus::kinds::modbus::wire::ForeignFrame;
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::Request;
use isotherm_core::quantity::Moment;
use isotherm_profile::DeviceId;

/// Time without a frame of another master, after which that master counts as gone.
const AFTER: Duration = Duration::from_secs(600);
/// Maximum number of stored pairs of unit and form (function and length). Once this number is reached, every answer to
/// a read is ambiguous.
const MOST_FORMS: usize = 64;

/// Maximum number of further reads to confirm an ambiguous answer.
const CONFIRMATIONS: u32 = 3;

/// State of the detection: whether another master was detected on the line.
#[derive(Debug, Default)]
pub(super) enum OtherMasters {
    #[default]
    None,
    /// The line received one answer without a request of the gateway, at this time. This single answer may be noise.
    Suspected(ForeignFrame, Moment),
    Noticed(ForeignTraffic),
}

#[derive(Debug)]
pub(super) struct ForeignTraffic {
    since: Moment,
    last: Moment,
    frames: u64,
    /// Unit number, and form (function and length), of each observed answer to another master.
    forms: Vec<(u8, ReplySignature)>,
}

impl OtherMasters {
    /// Records a frame that belongs to no request of the gateway. Returns whether the other master, or the form
    /// (function and length) of its answers, was not known before.
    fn note(&mut self, heard: ForeignFrame, now: Moment) -> bool {
        let (first, since) = match self {
            OtherMasters::Noticed(noticed) => return noticed.note(heard, now),
            OtherMasters::Suspected(first, since) if now.since(*since) < AFTER => (Some(*first), *since),
            OtherMasters::None | OtherMasters::Suspected(..) => (None, now),
        };
        if first.is_none() && !heard.is_question {
            *self = OtherMasters::Suspected(heard, now);
            return false;
        }
        let mut noticed = ForeignTraffic { since, last: now, frames: 0, forms: Vec::new() };
        for frame in first.into_iter().chain([heard]) {
            noticed.note(frame, now);
        }
        *self = OtherMasters::Noticed(noticed);
        true
    }

    /// Ends the detection of the other masters if none has sent a frame for [`AFTER`]. Returns the number of
    /// their frames, and the time from the first frame to the last. Returns `None` if the detection does not
    /// end now.
    fn end(&mut self, now: Moment) -> Option<(u64, Duration)> {
        let OtherMasters::Noticed(ForeignTraffic { since, last, frames, .. }) = self else { return None };
        let ended = (now.since(*last) >= AFTER).then(|| (*frames, last.since(*since)))?;
        *self = OtherMasters::None;
        Some(ended)
    }

    /// Returns whether an answer of this unit to a request may be an answer to another master.
    pub(super) fn attribute(&self, unit: u8, request: Request<'_>) -> Attribution {
        let OtherMasters::Noticed(ForeignTraffic { forms, .. }) = self else { return Attribution::Ours };
        let is_known = forms.len() >= MOST_FORMS || forms.contains(&(unit, ReplySignature::of(request)));
        if request.is_read() && is_known { Attribution::Ambiguous } else { Attribution::Ours }
    }
}

impl ForeignTraffic {
    /// Records one more frame of another master. Returns whether the form (function and length) of the answers to that
    /// master was not known before.
    fn note(&mut self, heard: ForeignFrame, now: Moment) -> bool {
        self.last = now;
        self.frames += 1;
        let form = heard.form.map(|form| (heard.unit, form)).filter(|form| !self.forms.contains(form));
        let has_room = self.forms.len() < MOST_FORMS;
        self.forms.extend(form.filter(|_| has_room));
        form.is_some() && has_room
    }
}

impl DeviceLine {
    /// Sends a read like [`DeviceLine::request`]. If the answer may belong to another master, reads again until two
    /// successive answers are equal. The age then counts from the first of these two.
    ///
    /// # Errors
    /// Same as for [`DeviceLine::request`]. If no two successive answers are equal, the fault is
    /// [`PeerFault::Foreign`].
    pub async fn read_confirmed(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
    ) -> Result<CheckedAnswer, Fault> {
        self.confirm(device, request, false).await
    }

    /// Sends a read like [`DeviceLine::read_confirmed`], even if the checks of the device have not passed.
    ///
    /// # Errors
    /// Same as for [`DeviceLine::read_confirmed`].
    pub async fn read_unverified(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
    ) -> Result<CheckedAnswer, Fault> {
        self.confirm(device, request, true).await
    }

    async fn confirm(
        &mut self,
        device: DeviceId,
        request: Request<'_>,
        may_be_unverified: bool,
    ) -> Result<CheckedAnswer, Fault> {
        let mut last = self.ask(device, request, SendDeadline::None, may_be_unverified).await?;
        for _ in 0..CONFIRMATIONS {
            if last.attribution == Attribution::Ours {
                return Ok(last);
            }
            let next = self.ask(device, request, SendDeadline::None, may_be_unverified).await?;
            let is_confirmed = next.attribution == Attribution::Ambiguous && next.answer == last.answer;
            if is_confirmed && last.attribution == Attribution::Ambiguous {
                return Ok(CheckedAnswer { asked: last.asked, ..next });
            }
            last = next;
        }
        Err(Fault::Peer(PeerFault::Foreign))
    }

    /// Listens after an ambiguous answer, and returns whether another answer of the unit follows. After a repeated
    /// request, the second answer may also belong to the gateway.
    pub(super) async fn is_followed_by_another(
        &mut self,
        number: u8,
        request: Request<'_>,
        is_repeated: bool,
        now: Moment,
    ) -> bool {
        if self.others.attribute(number, request) == Attribution::Ours {
            return false;
        }
        let Some(connection) = &mut self.wire else { return false };
        let under_way = connection.wire().time_under_way(request);
        let Some(modbus) = connection.modbus() else { return false };
        let pending = self.units.pending.of(number);
        let may_be_late = is_repeated || pending.has_pending();
        let span = pending.second_within(self.timeout, under_way);
        self.send_guard.away_for(span + self.timeout);
        // The next request detects a connection that is lost meanwhile.
        let heard = modbus.listen(number, span, Duration::ZERO).await;
        self.send_guard.sample();
        let late = modbus.received_late();
        late.iter()
            .filter(|unit| **unit != number)
            .for_each(|unit| self.units.pending.of(*unit).reset_timing());
        let is_followed = heard.is_err() || late.contains(&number);
        if is_followed && !may_be_late {
            let form = Some(ReplySignature::of(request));
            self.others.note(ForeignFrame { unit: number, form, is_question: false }, now);
        }
        is_followed
    }

    /// Records the frames of other masters that the line received during an exchange. An answer is not recorded if it
    /// may be a late answer of its unit to the gateway.
    pub(super) fn note_others(&mut self, now: Moment) {
        let Some(modbus) = self.wire.as_mut().and_then(Connection::modbus) else { return };
        let mut is_news = false;
        for heard in modbus.overheard() {
            let may_be_late = !heard.is_question
                && (self.units.pending.get(heard.unit).is_some_and(PendingReplies::has_pending)
                    || self.units.has_timed_out(heard.unit));
            is_news |= !may_be_late && self.others.note(heard, now);
        }
        let Some(observer) = &self.observer else { return };
        if is_news {
            let others = &self.others;
            observer.shares_line(&|unit, request| others.attribute(unit, request));
        }
        if let Some((frames, within)) = self.others.end(now) {
            observer.has_line_alone(frames, within);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fieldbus::wire::ModbusRequest;
    use isotherm_core::codec::{Register, Table};

    fn at(seconds: u64) -> Moment {
        Moment::default().after(Duration::from_secs(1000 + seconds))
    }

    fn read(offset: u16, count: u16) -> Request<'static> {
        Request::read_registers(Register { table: Table::Input, offset }, count)
    }

    fn heard(unit: u8, count: u16) -> ForeignFrame {
        ForeignFrame { unit, form: Some(ReplySignature::of(read(0, count))), is_question: true }
    }

    #[test]
    fn another_master_is_noticed_with_each_new_form_and_gone_ten_minutes_after_its_last_frame() {
        let mut others = OtherMasters::default();
        assert_eq!(others.end(at(0)), None);
        assert!(others.note(heard(1, 1), at(0)));
        assert!(!others.note(heard(1, 1), at(1)), "known");
        assert!(others.note(heard(1, 2), at(2)), "another length");
        assert!(others.note(heard(2, 1), at(3)), "another unit");
        assert!(!others.note(ForeignFrame { unit: 1, form: None, is_question: false }, at(5)));
        assert_eq!(others.end(at(604)), None);
        assert_eq!(others.end(at(605)), Some((5, Duration::from_secs(5))));
        assert_eq!(others.end(at(1300)), None);
        assert!(others.note(heard(1, 1), at(1300)), "again");
    }

    #[test]
    fn one_answer_is_no_other_master_and_two_within_ten_minutes_are() {
        let answer = |unit| ForeignFrame { is_question: false, ..heard(unit, 1) };
        let mut others = OtherMasters::default();
        assert!(!others.note(answer(1), at(0)));
        assert_eq!(others.attribute(1, read(0, 1)), Attribution::Ours);
        assert!(!others.note(answer(2), at(600)), "ten minutes later it is the first again");
        assert!(others.note(answer(3), at(1199)));
        assert_eq!(others.attribute(1, read(0, 1)), Attribution::Ours);
        for unit in [2, 3] {
            assert_eq!(others.attribute(unit, read(0, 1)), Attribution::Ambiguous, "{unit}");
        }
        assert_eq!(others.end(at(1799)), Some((2, Duration::from_secs(599))));
        assert!(!others.note(answer(1), at(1800)));
        assert!(others.note(heard(1, 1), at(1801)), "a question");
    }

    #[test]
    fn an_answer_is_ambiguous_if_its_unit_function_and_length_are_those_of_the_other() {
        let mut others = OtherMasters::default();
        assert_eq!(others.attribute(1, read(0, 1)), Attribution::Ours);
        others.note(heard(1, 1), at(0));
        assert_eq!(others.attribute(1, read(100, 1)), Attribution::Ambiguous);
        assert_eq!(others.attribute(1, read(100, 2)), Attribution::Ours);
        assert_eq!(others.attribute(2, read(100, 1)), Attribution::Ours);
        let write = Request::Modbus(ModbusRequest::WriteSingle { at: 100, value: 1 });
        assert_eq!(others.attribute(1, write), Attribution::Ours);
        for count in 2..=65 {
            others.note(heard(3, count), at(1));
        }
        assert_eq!(
            others.attribute(2, read(100, 1)),
            Attribution::Ambiguous,
            "more forms than are remembered"
        );
    }
}
