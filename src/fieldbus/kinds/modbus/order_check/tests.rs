use super::*;
use isotherm_core::codec::{Register, Table};

const BED: Request<'static> = read(Table::Input, 0, 1);
const OIL: Request<'static> = read(Table::Input, 100, 1);
const BLOCK: Request<'static> = read(Table::Input, 5, 4);
const KIND: Request<'static> = read(Table::Holding, 90, 1);
const WRITE: Request<'static> = Request::Modbus(ModbusRequest::WriteSingle { at: 1, value: 2 });

const LENGTH: Result<(), Fault> = Err(Fault::Peer(PeerFault::Length));
const MISSED: Result<(), Fault> = Err(Fault::Exception(11));
const REFUSED: Result<(), Fault> = Err(Fault::Exception(4));

const fn read(table: Table, offset: u16, count: u16) -> Request<'static> {
    Request::read_registers(Register { table, offset }, count)
}

impl OrderCheck {
    /// Records a result. A wrong answer has the form of the answer to `received`.
    fn ends(&mut self, request: Request<'_>, outcome: Result<(), Fault>, received: Request<'_>) -> bool {
        self.assess(request, outcome, Some(ReplySignature::of(received)), false)
    }

    fn answers(&mut self, request: Request<'_>) {
        assert!(!self.ends(request, Ok(()), request));
    }

    fn misses(&mut self, request: Request<'_>) {
        assert!(!self.assess(request, MISSED, None, false));
    }

    fn asks(&self, request: Request<'_>) -> Option<Request<'static>> {
        self.control(request, |_| true)
    }
}

/// Returns the order check of a unit that has answered these reads.
fn after(answered: &[Request<'static>]) -> OrderCheck {
    let mut order = OrderCheck::unknown();
    answered.iter().for_each(|read| order.answers(*read));
    order
}

#[test]
fn a_control_question_asks_for_nothing_that_the_unit_has_not_answered() {
    for (answered, missed, request, control) in [
        (&[][..], &[BED][..], BED, None),
        (&[BLOCK], &[BLOCK], BLOCK, None),
        (&[BED, OIL], &[BED], OIL, None),
        (&[BLOCK, BED, OIL], &[BED], BED, Some(BLOCK)),
        (&[KIND, BED, OIL], &[BED], OIL, Some(KIND)),
        (&[BED, KIND, BLOCK], &[BLOCK], BLOCK, Some(KIND)),
        (&[BLOCK, BED], &[BED], WRITE, None),
    ] {
        let mut order = after(answered);
        missed.iter().for_each(|read| order.misses(*read));
        assert_eq!(order.asks(request), control, "{request:?} after {answered:?} and without {missed:?}");
    }
}

#[test]
fn a_control_question_that_is_not_allowed_is_not_asked() {
    let mut order = after(&[KIND, BLOCK]);
    order.misses(BED);
    assert_eq!(order.control(BED, |read| read == KIND), Some(KIND));
    assert_eq!(order.control(BED, |_| false), None);
}

#[test]
fn only_a_read_that_could_be_answered_by_a_kept_answer_needs_a_control_question() {
    let mut order = after(&[BED, BLOCK]);
    for _ in 0..2 {
        assert_eq!((order.asks(BED), order.is_in_doubt()), (None, false));
        order.misses(BED);
        assert_eq!((order.asks(OIL), order.asks(BLOCK)), (Some(BLOCK), None));
        order.answers(BLOCK);
    }
}

#[test]
fn a_control_question_has_another_form_than_each_missing_answer_if_there_is_one() {
    let mut order = after(&[BED, KIND, BLOCK]);
    order.misses(BED);
    order.misses(BLOCK);
    assert_eq!(order.asks(BED), Some(KIND), "three forms");
    let mut order = after(&[BED, BLOCK]);
    order.misses(BED);
    order.misses(BLOCK);
    assert_eq!(order.asks(BED), Some(BLOCK), "two forms");
    order.answers(BLOCK);
    assert!(order.is_in_doubt(), "it may be the missing answer");
    assert_eq!(order.asks(BED), None, "that of the control question has another form");
    order.answers(BED);
    assert!(!order.is_in_doubt());
}

#[test]
fn after_a_start_the_second_form_shows_order_without_another_request() {
    let mut order = OrderCheck::unknown();
    for read in [BED, OIL, BED] {
        assert_eq!(order.asks(read), None);
        order.answers(read);
        assert!(order.is_in_doubt());
    }
    order.answers(BLOCK);
    assert!(!order.is_in_doubt());
}

#[test]
fn the_echo_of_a_write_shows_order_too_and_a_missing_one_opens_the_doubt() {
    let mut order = after(&[BED, BLOCK]);
    order.misses(BED);
    order.answers(WRITE);
    assert!(!order.is_in_doubt());
    for value in 0..9 {
        order.misses(Request::Modbus(ModbusRequest::WriteSingle { at: 1, value }));
    }
    assert!(order.is_in_doubt());
    assert_eq!(
        order.doubt,
        AnswerUse::Kept(vec![ReplySignature::of(Request::Modbus(ModbusRequest::WriteSingle {
            at: 1,
            value: 0
        }))])
    );
    assert_eq!(order.asks(BED), None, "an echo is no answer to a read");
}

#[test]
fn an_answer_of_the_form_of_a_kept_one_shows_that_order_is_lost() {
    let foreign = Err(Fault::Peer(PeerFault::Foreign));
    for (received, outcome, is_lost) in [
        (BED, LENGTH, true),
        (BED, Err(Fault::Peer(PeerFault::Function)), true),
        (KIND, LENGTH, false),
        (BED, foreign, false),
        (BED, Err(Fault::Timeout), false),
        (BED, REFUSED, false),
    ] {
        let mut order = after(&[BED, BLOCK]);
        order.misses(BED);
        assert_eq!(order.ends(BLOCK, outcome, received), is_lost, "{outcome:?} like {received:?}");
        assert!(order.is_in_doubt());
    }
}

#[test]
fn an_answer_of_a_wrong_length_is_only_that_without_a_doubt_or_if_the_read_was_never_answered() {
    let mut order = after(&[BED, BLOCK]);
    assert!(!order.ends(BED, LENGTH, BLOCK), "nothing was missing");
    let mut order = after(&[BED]);
    assert!(!order.ends(BLOCK, LENGTH, BED), "it may be wrong in the profile");
}

#[test]
fn the_pause_does_not_grow_if_the_wrong_answer_may_be_a_late_one() {
    let mut order = after(&[BED, BLOCK]);
    order.misses(BED);
    assert!(order.assess(BLOCK, LENGTH, Some(ReplySignature::of(BED)), true));
    assert_eq!(order.lost, 0);
    assert!(order.ends(BLOCK, LENGTH, BED));
    assert_eq!(order.lost, 1);
}

#[test]
fn a_control_question_that_fails_twice_is_left_out_if_the_reads_are_answered() {
    for fault in [Fault::Timeout, Fault::Exception(11), Fault::Exception(2)] {
        for is_alive in [false, true] {
            let mut order = after(&[BED, BLOCK]);
            order.misses(BED);
            order.ends(BLOCK, Err(fault), BLOCK);
            order.record_failed_control(BLOCK, fault);
            assert_eq!(order.asks(BED), None, "{fault:?}");
            order.ends(BED, if is_alive { Ok(()) } else { Err(Fault::Timeout) }, BED);
            assert_eq!(order.asks(OIL), Some(BLOCK), "a single failure is chance: {fault:?}");
            order.ends(BLOCK, Err(fault), BLOCK);
            order.record_failed_control(BLOCK, fault);
            order.ends(OIL, if is_alive { Ok(()) } else { Err(Fault::Timeout) }, OIL);
            assert_eq!(order.asks(BED), (!is_alive).then_some(BLOCK), "{fault:?}");
            order.answers(BLOCK);
            order.misses(BED);
            assert_eq!(order.asks(OIL), Some(BLOCK), "answered as an ordinary read");
        }
    }
}

/// Gateway that keeps at most one answer of its unit: the register and the form of a read, or a refusal.
#[derive(Debug, Default)]
struct Gateway {
    kept: Option<Own>,
    is_refusing: bool,
    requests: u32,
}

/// Answer of the unit to this read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Own {
    Data(Request<'static>),
    Refusal(Request<'static>),
}

/// Reaction of the gateway to one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    /// Sends the kept answer and keeps the next one, or sends the answer.
    Delivers,
    /// Sends the kept answer and loses the next one, or sends the answer.
    Loses,
    /// Gives up, and keeps the answer.
    GivesUp,
}

impl Gateway {
    /// Returns the answer to a request; `None` if it gives up.
    fn pass(&mut self, request: Request<'static>, turn: Turn) -> Option<Own> {
        self.requests += 1;
        let own = if self.is_refusing { Own::Refusal(request) } else { Own::Data(request) };
        match (self.kept.take(), turn) {
            (Some(kept), Turn::Loses) => Some(kept),
            (Some(kept), _) => {
                self.kept = Some(own);
                Some(kept)
            }
            (None, Turn::GivesUp) => {
                self.kept = Some(own);
                None
            }
            (None, _) => Some(own),
        }
    }
}

/// Sends one request, and records its result. Returns the read whose data the answer has.
fn exchange(
    order: &mut OrderCheck,
    gateway: &mut Gateway,
    request: Request<'static>,
    turn: Turn,
) -> Result<Request<'static>, Fault> {
    let answer = gateway.pass(request, turn);
    let (outcome, received) = match answer {
        None => (Err(Fault::Exception(11)), None),
        Some(Own::Data(of)) if ReplySignature::of(of) == ReplySignature::of(request) => {
            (Ok(of), Some(ReplySignature::of(of)))
        }
        Some(Own::Data(of)) if of.function() == request.function() => {
            (Err(Fault::Peer(PeerFault::Length)), Some(ReplySignature::of(of)))
        }
        Some(Own::Refusal(of)) if of.function() == request.function() => (Err(Fault::Exception(4)), None),
        Some(Own::Data(of)) => (Err(Fault::Peer(PeerFault::Function)), Some(ReplySignature::of(of))),
        Some(Own::Refusal(_)) => (Err(Fault::Peer(PeerFault::Function)), None),
    };
    let is_lost = order.assess(request, outcome.map(|_| ()), received, false);
    if is_lost { Err(Fault::Peer(PeerFault::OutOfOrder)) } else { outcome }
}

/// Sends a read as a line does, after a control question if it needs one. Returns the read whose data are used.
fn asked(
    order: &mut OrderCheck,
    gateway: &mut Gateway,
    request: Request<'static>,
    mut turn: impl FnMut(&OrderCheck) -> Turn,
) -> Result<Request<'static>, Fault> {
    if let Some(control) = order.asks(request) {
        let reaction = turn(order);
        if let Err(fault) = exchange(order, gateway, control, reaction) {
            order.record_failed_control(control, fault);
            if fault != Fault::Exception(4) {
                return Err(fault);
            }
        }
    }
    let reaction = turn(order);
    exchange(order, gateway, request, reaction)
}

/// Xorshift generator.
struct Chance(u64);

impl Chance {
    /// Returns whether an event of this percentage occurs.
    fn of(&mut self, percent: u64) -> bool {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 33) % 100 < percent
    }
}

#[test]
fn no_read_gets_the_answer_to_another_one_from_a_gateway_that_keeps_loses_and_refuses() {
    for reads in [&[BED, OIL, BLOCK][..], &[BED, OIL, KIND, BLOCK], &[BED, BLOCK, OIL, BED]] {
        for seed in 1..200_u64 {
            let (mut order, mut gateway) = (OrderCheck::unknown(), Gateway::default());
            let mut chance = Chance(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let (mut used, mut missed) = (0, 0);
            for request in reads.iter().copied().cycle().take(2000) {
                // The unit refuses everything for some time.
                gateway.is_refusing = chance.of(if gateway.is_refusing { 80 } else { 1 });
                let read = asked(&mut order, &mut gateway, request, |order| match order.is_in_doubt() {
                    // A second answer is only missing after order was confirmed.
                    false if chance.of(5) => {
                        missed += 1;
                        Turn::GivesUp
                    }
                    _ if chance.of(20) => Turn::Loses,
                    _ => Turn::Delivers,
                });
                if let Ok(read) = read {
                    assert_eq!(read, request, "seed {seed}, {reads:?}");
                    used += 1;
                }
            }
            assert!(used > 500 && missed > 5, "seed {seed}: {used} used, {missed} missed");
        }
    }
}

#[test]
fn a_miss_costs_one_control_question_at_most_if_order_is_not_lost() {
    let (mut order, mut gateway) = (OrderCheck::unknown(), Gateway::default());
    let mut sent = 0;
    for (place, request) in [BED, OIL, BLOCK].into_iter().cycle().take(300).enumerate() {
        let turn = if place % 10 == 9 { Turn::GivesUp } else { Turn::Delivers };
        let _ = asked(&mut order, &mut gateway, request, |_| turn);
        // The late answer is dropped.
        gateway.kept = None;
        sent += 1;
    }
    assert!(gateway.requests <= sent + 30, "{} requests for {sent} reads", gateway.requests);
}

#[test]
fn a_dead_unit_gets_one_request_for_each_attempt() {
    let mut order = after(&[BED, BLOCK]);
    for request in [BED, BLOCK].into_iter().cycle().take(21) {
        // An attempt that began with a control question ends with it.
        assert_eq!(order.asks(BED).unwrap_or(BED), request);
        order.ends(request, Err(Fault::Timeout), request);
        if request == BLOCK {
            order.record_failed_control(BLOCK, Fault::Timeout);
        }
    }
    assert_eq!(order.asks(BED), Some(BLOCK), "it answered both before");
}

#[test]
fn a_gateway_that_stays_one_answer_behind_is_found_each_time() {
    let mut order = after(&[BED, BLOCK]);
    let mut gateway = Gateway::default();
    assert_eq!(exchange(&mut order, &mut gateway, BED, Turn::GivesUp), Err(Fault::Exception(11)));
    for request in [OIL, BLOCK, BED].into_iter().cycle().take(99) {
        let read = asked(&mut order, &mut gateway, request, |_| Turn::Delivers);
        assert_eq!(read, Err(Fault::Peer(PeerFault::OutOfOrder)), "{request:?}");
    }
    assert_eq!(order.lost, LONGEST_PAUSE);
}
