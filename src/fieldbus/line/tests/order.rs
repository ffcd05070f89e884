//! Tests of units behind a gateway that keeps a late answer until the next request, and of reads that are sent together
//! with another request.

use super::*;
use crate::fieldbus::kinds::modbus::tcp::ModbusTcp;
use isotherm_profile::Gateway;
use tokio::io::{AsyncReadExt, AsyncWriteExt};

/// Read of another register, with an answer of the same form as that of `READ`.
const OIL: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 100 }, 1);
/// Read with an answer of another form.
const LONG: Request<'static> = Request::read_registers(Register { table: Table::Holding, offset: 100 }, 2);
const OUT_OF_ORDER: Result<Answer, Fault> = Err(Fault::Peer(PeerFault::OutOfOrder));
const GIVEN_UP: Fault = Fault::Exception(11);

/// First register and number of registers of a read.
type Extent = (u16, u16);

/// Gateway that keeps at most one answer of its unit.
#[derive(Debug, Default)]
struct Keeper {
    kept: Option<Result<Extent, Fault>>,
    /// Reactions to the next requests; `Delivers` to all later ones.
    next: VecDeque<Reaction>,
    asked: Vec<Extent>,
}

/// Reaction of the gateway, or of its unit, to one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Reaction {
    /// Sends the kept answer and keeps the next one, or sends the answer.
    Delivers,
    /// Sends the kept answer, and loses the next one.
    Loses,
    /// Gives up, and keeps the answer.
    GivesUp,
    /// The unit refuses the request.
    Refuses,
    /// Nothing is sent or kept.
    Silent,
}

impl Keeper {
    /// Returns the answer to a read; `None` if there is none.
    fn pass(&mut self, read: Extent) -> Option<Result<Extent, Fault>> {
        self.asked.push(read);
        let reaction = self.next.pop_front().unwrap_or(Reaction::Delivers);
        let own = if reaction == Reaction::Refuses { Err(Fault::Exception(4)) } else { Ok(read) };
        let before = self.kept.take();
        match reaction {
            Reaction::Silent => None,
            Reaction::GivesUp => {
                self.kept = Some(own);
                Some(Err(GIVEN_UP))
            }
            Reaction::Loses => Some(before.unwrap_or(own)),
            Reaction::Delivers | Reaction::Refuses => {
                self.kept = before.map(|_| own);
                Some(before.unwrap_or(own))
            }
        }
    }
}

/// Connection to the gateway. Each register holds its own number.
struct Kept {
    keeper: Arc<Mutex<Keeper>>,
    form: Option<ReplySignature>,
}

impl Dial for Kept {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let wire = Kept { keeper: self.keeper.clone(), form: None };
        Box::pin(std::future::ready(Ok(Connection::Modbus(Box::new(wire)))))
    }
}

impl Wire for Kept {
    fn exchange<'a>(
        &'a mut self,
        _: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        Box::pin(async move {
            send_guard.leave()?;
            let Request::Modbus(ModbusRequest::Read { from, count }) = request else {
                return Ok(Answer::Done);
            };
            self.form = None;
            let passed = self.keeper.lock().unwrap().pass((from.offset, count));
            let Some(answer) = passed else { return std::future::pending().await };
            let (offset, received) = answer?;
            let of = Request::read_registers(Register { table: from.table, offset }, received);
            self.form = Some(ReplySignature::of(of));
            if received == count { data(of) } else { Err(Fault::Peer(PeerFault::Length)) }
        })
    }
}

impl ModbusWire for Kept {
    fn received_form(&self) -> Option<ReplySignature> {
        self.form
    }
}

/// Returns the answer to a read.
fn data(read: Request<'_>) -> Result<Answer, Fault> {
    let Request::Modbus(ModbusRequest::Read { from, count }) = read else { return Ok(Answer::Done) };
    Ok(Answer::Registers(vec![from.offset; usize::from(count)]))
}

/// Returns a line with timeouts of 300 ms, whose unit has answered reads of two forms, and has missed `READ`.
async fn missed(reaction: Reaction, fault: Fault) -> (Rig, Arc<Mutex<Keeper>>) {
    let (mut line, _) = line(|device| device.quirks.gateway = Gateway::ByUnits);
    let keeper = Arc::new(Mutex::new(Keeper::default()));
    line.line.dial = Box::new(Kept { keeper: keeper.clone(), form: None });
    for read in [READ, LONG] {
        assert_eq!(line.ask(0, read, 0).await, data(read));
    }
    react(&keeper, &[reaction]);
    assert_eq!(line.ask(0, READ, 0).await, Err(fault));
    keeper.lock().unwrap().asked.clear();
    (line, keeper)
}

fn react(keeper: &Mutex<Keeper>, reactions: &[Reaction]) {
    keeper.lock().unwrap().next.extend(reactions);
}

fn asked(keeper: &Mutex<Keeper>) -> Vec<Extent> {
    std::mem::take(&mut keeper.lock().unwrap().asked)
}

#[tokio::test(start_paused = true)]
async fn a_gateway_that_is_one_answer_behind_is_found_before_a_read_that_it_could_answer_wrongly() {
    for reaction in [Reaction::Delivers, Reaction::Loses, Reaction::Refuses] {
        let (mut line, keeper) = missed(Reaction::GivesUp, GIVEN_UP).await;
        react(&keeper, &[reaction]);
        assert_eq!(line.ask(0, OIL, 5000).await, OUT_OF_ORDER, "{reaction:?}");
        assert_eq!(asked(&keeper), [(100, 2)], "only the control question");
        assert!(line.is_backing_off(0, 5700));
        // The gateway was restarted.
        keeper.lock().unwrap().kept = None;
        assert_eq!(line.ask(0, OIL, 60_000).await, data(OIL));
        assert_eq!(asked(&keeper), [(100, 2), (100, 1)]);
        assert_eq!(line.ask(0, READ, 60_001).await, data(READ));
        assert_eq!(asked(&keeper), [(1, 1)]);
    }
}

#[tokio::test(start_paused = true)]
async fn a_read_of_another_form_is_its_own_control_question_and_names_the_cause() {
    let (mut line, keeper) = missed(Reaction::GivesUp, GIVEN_UP).await;
    assert_eq!(line.ask(0, LONG, 5000).await, OUT_OF_ORDER);
    assert_eq!(asked(&keeper), [(100, 2)]);
    let (mut line, keeper) = missed(Reaction::Silent, Fault::Timeout).await;
    for (at, read) in [(5000, LONG), (5001, OIL)] {
        assert_eq!(line.ask(0, read, at).await, data(read));
    }
    assert_eq!(asked(&keeper), [(100, 2), (100, 1)], "no other request");
}

#[tokio::test(start_paused = true)]
async fn a_read_is_used_though_the_control_question_is_refused_and_after_one_that_is_not_answered() {
    let (mut line, keeper) = missed(Reaction::Silent, Fault::Timeout).await;
    react(&keeper, &[Reaction::Refuses]);
    assert_eq!(line.ask(0, OIL, 5000).await, data(OIL));
    assert_eq!(asked(&keeper), [(100, 2), (100, 1)]);
    let (mut line, keeper) = missed(Reaction::Silent, Fault::Timeout).await;
    react(&keeper, &[Reaction::Silent]);
    assert_eq!(line.ask(0, OIL, 5000).await, Err(Fault::Timeout));
    assert_eq!(asked(&keeper), [(100, 2)], "a dead unit gets one request");
    for at in [20_000, 20_001] {
        assert_eq!(line.ask(0, OIL, at).await, data(OIL));
    }
    assert_eq!(asked(&keeper), [(100, 1), (100, 2), (100, 1)], "a single lost answer is chance");
}

/// A prompt unit gets the same read again at once. The answer to the first attempt is that of the second one.
#[tokio::test(start_paused = true)]
async fn a_prompt_unit_gets_a_control_question_too() {
    let (mut line, keeper) = missed(Reaction::Silent, Fault::Timeout).await;
    for _ in 0..100 {
        assert_eq!(line.ask(0, READ, 5000).await, data(READ));
    }
    assert_eq!(line.ask(0, LONG, 5000).await, data(LONG));
    react(&keeper, &[Reaction::GivesUp]);
    assert_eq!(line.ask(0, READ, 5000).await, Err(GIVEN_UP));
    assert_eq!(line.ask(0, READ, 5001).await, data(READ));
    asked(&keeper);
    assert_eq!(line.ask(0, OIL, 5002).await, OUT_OF_ORDER);
    assert_eq!(asked(&keeper), [(100, 2)]);
}

/// Observer that records the number of registers of each read, and its fault.
#[derive(Default)]
struct Counted(Mutex<Vec<(u16, Option<Fault>)>>);

impl RequestObserver for Counted {
    fn note(&self, _: DeviceId, request: Request<'_>, outcome: Result<(), Fault>, _: (u32, Fault)) {
        if let Request::Modbus(ModbusRequest::Read { count, .. }) = request {
            self.0.lock().unwrap().push((count, outcome.err()));
        }
    }
}

#[tokio::test(start_paused = true)]
async fn each_request_that_was_sent_is_counted_control_questions_too() {
    let (mut line, keeper) = missed(Reaction::Silent, Fault::Timeout).await;
    let counted = Arc::new(Counted::default());
    let observer: Arc<dyn RequestObserver> = counted.clone();
    line.line.observer = Some(observer);
    let taken = || std::mem::take(&mut *counted.0.lock().unwrap());
    react(&keeper, &[Reaction::Silent]);
    assert_eq!(line.ask(0, OIL, 5000).await, Err(Fault::Timeout));
    assert_eq!(taken(), [(2, Some(Fault::Timeout))], "the read was not sent");
    for (at, read) in [(20_000, OIL), (20_001, LONG)] {
        assert_eq!(line.ask(0, read, at).await, data(read));
    }
    assert_eq!(taken(), [(1, None), (2, None)]);
    react(&keeper, &[Reaction::Silent]);
    assert_eq!(line.ask(0, READ, 21_000).await, Err(Fault::Timeout));
    assert_eq!(line.ask(0, OIL, 60_000).await, data(OIL));
    assert_eq!(taken(), [(1, Some(Fault::Timeout)), (2, None), (1, None)]);
}

/// Device that confirms each write, and answers no read.
struct Mute;

impl Dial for Mute {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        let (ours, mut theirs) = tokio::io::duplex(512);
        tokio::spawn(async move {
            let mut frame = [0; 12];
            while theirs.read_exact(&mut frame).await.is_ok() {
                // The answer to function 06 repeats its request.
                if frame[7] == 6 && theirs.write_all(&frame).await.is_err() {
                    break;
                }
            }
        });
        Box::pin(std::future::ready(Ok(Connection::ModbusTcp(ModbusTcp::new(ours, tap)))))
    }
}

/// Returns a line whose first unit got a write and a read together, and has confirmed the write.
async fn sent_together() -> Rig {
    let (mut line, _) = line(|device| device.quirks.gateway = Gateway::ByUnits);
    line.line.dial = Box::new(Mute);
    line.line.pipeline = Pipeline::new(true);
    // Two different echoes show that order is kept.
    for (value, behind) in [(9, None), (10, Some((DeviceId(0), READ)))] {
        line.line.set_follow_up(behind);
        let write = Request::Modbus(ModbusRequest::WriteSingle { at: 1, value });
        assert_eq!(line.ask(0, write, 0).await, Ok(Answer::Done));
    }
    let connection = line.line.wire.as_mut().unwrap();
    let unanswered = connection.modbus().unwrap().unanswered_behind();
    assert_eq!(unanswered.map(|(unit, read, _)| (unit, read)), Some((1, READ)));
    line
}

/// A unit with reads of one form only has no control question, so that waiting would not help it.
#[tokio::test(start_paused = true)]
async fn a_unit_without_a_control_question_may_be_read_together_with_another_request() {
    let (mut line, _) = line(|device| device.quirks.gateway = Gateway::ByUnits);
    line.line.dial = Box::new(Kept { keeper: Arc::default(), form: None });
    line.line.pipeline = Pipeline::new(true);
    for _ in 0..3 {
        assert_eq!(line.ask(0, READ, 0).await, data(READ));
    }
    assert!(line.line.units.pending.get(1).unwrap().order.is_in_doubt());
    line.line.set_follow_up(Some((DeviceId(0), READ)));
    assert!(line.line.pipeline.take().is_some());
    assert_eq!(line.ask(0, LONG, 0).await, data(LONG));
    assert_eq!(line.ask(0, READ, 0).await, data(READ));
    line.line.units.pending(0).order.suspect(ReplySignature::of(READ));
    line.line.set_follow_up(Some((DeviceId(0), READ)));
    assert!(line.line.pipeline.take().is_none(), "the control question comes first");
}

/// Returns whether a late answer of the first unit is awaited, and whether its order is in doubt.
fn doubts(line: &Rig) -> (bool, bool) {
    let pending = line.line.units.pending.get(1).unwrap();
    (pending.has_pending(), pending.order.is_in_doubt())
}

#[tokio::test(start_paused = true)]
async fn a_missing_answer_to_a_read_that_was_sent_together_with_another_request_is_one_like_any_other() {
    let mut line = sent_together().await;
    assert_eq!(doubts(&line), (false, false));
    assert_eq!(line.ask(0, READ, 0).await, Err(Fault::Timeout));
    assert_eq!(doubts(&line), (true, true));
    assert!(line.is_backing_off(0, 4 * 300 - 1));
}

#[tokio::test(start_paused = true)]
async fn a_read_that_was_sent_together_with_another_request_is_missing_if_the_connection_is_lost() {
    let mut line = sent_together().await;
    // This request waits for the other answer, and is not sent.
    assert_eq!(line.ask(1, READ, 0).await, Err(Fault::Timeout));
    assert_eq!(doubts(&line), (true, true));
    let mut line = sent_together().await;
    line.line.hang_up();
    assert_eq!(doubts(&line), (true, true));
}
