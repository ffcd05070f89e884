use std::time::Duration;

use super::*;
use crate::gateway::state::arming::ArmingState;
use crate::gateway::state::output::OutputState;
use crate::gateway::store::log::sample;
use isotherm_core::output::Who;
use isotherm_core::reading::{Reason, SignalId};
use isotherm_profile::Output;

const RESULT: SignalId = SignalId(0);
const TRIGGER: SignalId = SignalId(1);
const STANDS: Option<Micron> = Some(Micron::ZERO);

/// Bench that reads a result and then its trigger, and returns the detected results.
struct Bench {
    profile: Profile,
    board: SignalTable,
    probing: Probing,
    input: ProbeInput,
    now: Moment,
}

impl Bench {
    fn new(trigger: Option<SignalId>) -> Bench {
        let profile = sample::profile();
        let input = ProbeInput { signal: RESULT, trigger, micron: 1000.0 };
        let now = Moment::from_nanos(1_000_000_000_000);
        Bench {
            board: SignalTable::new(&profile.clone().into()),
            profile,
            probing: Probing::default(),
            input,
            now,
        }
    }

    fn read(&mut self, id: SignalId, value: Result<f64, Reason>) -> &mut Bench {
        self.board.store(id, value, self.now, 0);
        self
    }

    fn after(&mut self, seconds: u64) -> &mut Bench {
        self.now = self.now.after(Duration::from_secs(seconds));
        self
    }

    fn check(&mut self) -> Option<Result<f64, MissReason>> {
        let Bench { profile, board, probing, input, now } = self;
        let received = probing.check(profile, input, board, *now, STANDS)?;
        Some(received.map(|measured| measured.error.get()))
    }

    /// Reads result and trigger in one request.
    fn both(&mut self, result: f64, trigger: f64) -> Option<Result<f64, MissReason>> {
        self.after(1).read(RESULT, Ok(result)).read(TRIGGER, Ok(trigger)).check()
    }
}

#[test]
fn a_counter_tells_each_probing_once_even_with_the_same_result() {
    let mut bench = Bench::new(Some(TRIGGER));
    assert_eq!(bench.both(0.003, 7.0), None, "where it stands at first is no news");
    assert_eq!(bench.both(0.003, 7.0), None);
    assert_eq!(bench.both(0.003, 8.0), Some(Ok(3.0)), "in the signal's unit: mm");
    assert_eq!(bench.both(0.005, 8.0), None, "the result alone says nothing");
    assert_eq!(bench.both(0.005, 0.0), None, "the control was restarted");
    assert_eq!(bench.both(0.004, 1.0), Some(Ok(4.0)));
}

#[test]
fn a_flag_tells_a_probing_when_it_rises() {
    let mut bench = Bench::new(Some(TRIGGER));
    for (flag, received) in [(1.0, None), (0.0, None), (1.0, Some(Ok(2.0))), (1.0, None), (0.0, None)] {
        assert_eq!(bench.both(0.002, flag), received);
    }
}

#[test]
fn without_a_trigger_each_change_is_a_probing() {
    let mut bench = Bench::new(None);
    for (result, received) in [(0.002, None), (0.002, None), (0.004, Some(Ok(4.0))), (0.0, Some(Ok(0.0)))] {
        assert_eq!(bench.both(result, 0.0), received);
    }
}

#[test]
fn a_result_read_before_its_trigger_is_the_old_one() {
    let mut bench = Bench::new(Some(TRIGGER));
    bench.both(0.003, 7.0);
    bench.after(1).read(RESULT, Ok(0.003)).after(1).read(TRIGGER, Ok(8.0));
    assert_eq!(bench.check(), None);
    assert_eq!(bench.after(1).read(RESULT, Ok(0.009)).check(), Some(Ok(9.0)));
    assert_eq!(bench.check(), None);
}

#[test]
fn a_result_that_does_not_come_is_missed_and_reported_once() {
    let mut bench = Bench::new(Some(TRIGGER));
    bench.both(0.003, 7.0);
    bench.after(1).read(RESULT, Err(Reason::Sentinel)).read(TRIGGER, Ok(8.0));
    assert_eq!(bench.check(), None);
    assert_eq!(bench.after(5).check(), None);
    assert_eq!(bench.after(1).check(), Some(Err(MissReason::NoResult)));
    assert_eq!(bench.both(0.002, 8.0), None);
}

#[test]
fn a_probing_whose_moment_is_not_known_does_not_count() {
    let mut bench = Bench::new(Some(TRIGGER));
    bench.both(0.003, 7.0);
    assert_eq!(bench.after(60).check(), None, "the trigger is stale");
    assert_eq!(bench.both(0.004, 8.0), None, "it may have happened at any time since");
    assert_eq!(bench.both(0.004, 9.0), Some(Ok(4.0)));
}

#[test]
fn what_acted_is_what_stood_there_when_the_trigger_came() {
    let mut bench = Bench::new(Some(TRIGGER));
    bench.both(0.003, 7.0);
    let look = |bench: &mut Bench, acting| {
        let Bench { profile, board, probing, input, now } = bench;
        probing.check(profile, input, board, *now, acting)
    };
    bench.after(1).read(TRIGGER, Ok(8.0));
    assert_eq!(look(&mut bench, Micron::new(12.0)), None);
    bench.after(1).read(RESULT, Ok(0.001));
    let measured = look(&mut bench, Micron::new(13.0)).unwrap().unwrap();
    assert_eq!(measured.acting, Micron::new(12.0));
    bench.after(1).read(TRIGGER, Ok(9.0)).read(RESULT, Ok(0.001));
    assert_eq!(look(&mut bench, None), Some(Err(MissReason::Acting)));
}

#[test]
fn only_a_value_that_is_certain_is_held_against_an_error() {
    let mut profile = sample::profile();
    let off = Arming::default();
    let none = Outputs::new(&profile.clone().into());
    assert_eq!(acting(0, &none, &off), Some(Micron::ZERO), "nothing is written, so nothing acts");
    profile.outputs = vec![output(isotherm_profile::Writes::Offset)];
    for (standing, wanted) in [
        (RegisterHealth::Unknown, None),
        (RegisterHealth::Unverified, None),
        (RegisterHealth::Verified, Micron::new(7.0)),
        (RegisterHealth::Interlocked, Micron::new(7.0)),
        (RegisterHealth::Foreign, Micron::new(7.0)),
    ] {
        let state = OutputState { standing, cz: Micron::new(7.0), ..OutputState::default() };
        assert_eq!(acting(0, &all(&profile, state), &off), wanted, "{standing:?}");
    }
    profile.outputs = vec![output(isotherm_profile::Writes::Corrected { position: RESULT })];
    let state =
        OutputState { standing: RegisterHealth::Verified, cz: Micron::new(7.0), ..OutputState::default() };
    assert_eq!(acting(0, &all(&profile, state), &off), None, "nobody corrects the position");
    let armed = Arming { state: ArmingState::Armed(Who::Person), ..Arming::default() };
    assert_eq!(acting(0, &all(&profile, state), &armed), Micron::new(7.0));
}

fn all(profile: &Profile, state: OutputState) -> Outputs {
    let mut outputs = Outputs::new(&profile.clone().into());
    outputs[0] = state;
    outputs
}

fn output(writes: isotherm_profile::Writes) -> Output {
    use isotherm_core::codec::{Address, Register, Table};
    use isotherm_profile::{AxisId, DeviceId, Share, Verify};
    let encoding = sample::profile().signals[0].encoding.clone();
    Output {
        name: "o".to_owned(),
        axis: AxisId(0),
        device: DeviceId(0),
        address: Address::Modbus(Register { table: Table::Holding, offset: 0 }),
        encoding,
        writes,
        verify: Verify::ReadBack,
        refresh: None,
        when: None,
        set: None,
        boot_counter: None,
        share: Share::Whole,
        applied: None,
        display: isotherm_profile::Display::default(),
        stated: None,
    }
}
