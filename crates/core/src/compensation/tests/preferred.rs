//! Tests of learned models: adoption, return and restart. At a change of the model, Cz stays the same.

use proptest::prelude::*;

use super::super::model::envelope::Identified;
use super::super::model::{Envelope, Outside};
use super::super::settings::{Filter, LearnedSlot, OnWorse, ProbeSettings};
use super::probes::{near, probe, probed_axis, zeroing_machine};
use super::*;
use crate::quantity::of;

/// Index of the learned model (the slot) in the models of the axis.
const SLOT: usize = 2;
const LAG: f64 = 600.0;

/// Settings of an axis that learns: the models `2.4 (A − B)` and a fallback, and a slot for the learned model. The slot
/// has a term for the rise of each signal, and a lagged term for one of them.
fn learning_axis() -> AxisSettings {
    let lag = Some(seconds(LAG));
    let start = Reference::Start;
    let slot = linear(
        "learned",
        0.0,
        &[term(BED, 0.0, start), lagged(BED, 0.0, start, lag), term(WHEELHEAD, 0.0, start)],
    );
    let AxisSettings { mut models, .. } = probed_axis(probe());
    models.push(slot);
    let learned = Some(LearnedSlot { model: SLOT, own: "own".to_owned() });
    AxisSettings { models, learned, ..probed_axis(probe()) }
}

fn model(name: &str, gains: [f64; 3]) -> LearnedModel {
    let [bed, late, wheelhead] = gains;
    let term = |signal: SignalId, lag: Option<f64>, gain| LearnedTerm {
        signal: signal.0,
        lag: lag.map(seconds),
        squared: false,
        gain,
    };
    let terms = vec![term(BED, None, bed), term(BED, Some(LAG), late), term(WHEELHEAD, None, wheelhead)];
    LearnedModel { name: name.to_owned(), terms }
}

fn change(to: Preferred, when: When) -> Option<Change> {
    Some(Change { to, when, own: "own".to_owned() })
}

fn learned(name: &str, gains: [f64; 3]) -> Preferred {
    Preferred::Learned(model(name, gains))
}

/// Rig whose axis follows its own first model, an hour after the start.
fn warm(settings: AxisSettings) -> Rig {
    let mut rig = Rig::with(zeroing_machine(), settings);
    rig.step();
    rig.run(60.0);
    rig.show(29.0, 25.0).run(3600.0);
    rig
}

impl Rig {
    fn prefer(&mut self, change: Option<Change>) -> Result<(), Unfit> {
        self.compensation.prefer(0, change)
    }

    fn preferred(&self) -> Option<String> {
        self.compensation.preference(0).unwrap().preferred().name().map(str::to_owned)
    }
}

#[test]
fn the_slot_is_never_chosen_before_an_adoption() {
    let mut rig = warm(learning_axis());
    assert_eq!((rig.after(10.0).model, rig.preferred()), (Some(0), None));
    // Even a slot with all its signals is no fallback for a lost sensor.
    let decision = rig.show(29.0, f64::NAN).after(10.0);
    assert_eq!((decision.model, decision.state), (Some(1), AxisState::Degraded));
    assert_eq!(rig.show(f64::NAN, f64::NAN).after(10.0).model, None);
    assert_eq!(Rig::new(probed_axis(probe())).compensation.preference(0), None);
}

#[test]
fn nothing_moves_at_an_adoption_and_at_the_return() {
    let mut rig = warm(learning_axis());
    let before = rig.after(10.0);
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    let adopted = rig.after(1.0);
    assert_eq!((adopted.model, rig.preferred()), (Some(SLOT), Some("a".to_owned())));
    assert_eq!(adopted.state, AxisState::Active, "the learned model is the preferred one");
    assert_eq!(adopted.cz, before.cz);
    near(adopted.raw.unwrap().get(), before.raw.unwrap().get());
    // The gains of the learned model act from now on.
    let warmer = rig.show(30.0, 25.0).run(7200.0).last().copied().unwrap();
    let rise = warmer.raw.unwrap().get() - adopted.raw.unwrap().get();
    assert!((rise - 3.0).abs() < 0.02, "3 µm/°C in the steady state: {rise}");
    rig.prefer(change(Preferred::Profile, When::Now)).unwrap();
    let back = rig.after(1.0);
    assert_eq!((back.model, rig.preferred()), (Some(0), None));
    assert_eq!(back.cz, warmer.cz);
    assert!((back.raw.unwrap().get() - warmer.raw.unwrap().get()).abs() < 1e-6);
    let preference = rig.compensation.preference(0).unwrap();
    assert_eq!(preference.before().and_then(Preferred::name), Some("a"));
}

#[test]
fn a_fallback_of_the_profile_stays_one_after_an_adoption() {
    let mut rig = warm(learning_axis());
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    rig.after(1.0);
    let decision = rig.show(29.0, f64::NAN).after(10.0);
    assert_eq!((decision.model, decision.state), (Some(1), AxisState::Degraded));
    assert!(decision.lacks.is_some());
}

#[test]
fn an_adoption_beyond_the_limit_of_the_probe_waits_for_the_datum() {
    let mut rig = warm(learning_axis());
    let before = rig.after(10.0);
    rig.prefer(change(learned("far", [30.0, 0.0, 0.0]), When::Now)).unwrap();
    let decision = rig.after(1.0);
    assert_eq!((decision.model, decision.cz, rig.preferred()), (Some(0), before.cz, None));
    assert!(rig.compensation.preference(0).unwrap().waiting().is_some());
    rig.prefer(None).unwrap();
    let preference = rig.compensation.preference(0).unwrap();
    assert_eq!(
        (preference.waiting(), preference.is_taken_back("far")),
        (None, false),
        "replaced by no change"
    );
}

#[test]
fn a_model_whose_adoption_was_withdrawn_is_taken_back_over_a_restart() {
    let mut rig = warm(learning_axis());
    rig.prefer(change(learned("far", [30.0, 0.0, 0.0]), When::Now)).unwrap();
    rig.compensation.withdraw(0);
    rig.restart(learning_axis());
    // A withdrawal without a change that waits changes nothing.
    rig.compensation.withdraw(0);
    let preference = rig.compensation.preference(0).unwrap();
    assert_eq!((preference.waiting(), preference.before()), (None, None));
    assert!(preference.is_taken_back("far") && !preference.is_taken_back("near"));
}

#[test]
fn a_change_at_a_datum_waits_for_it() {
    // With the datum "zero", the references of the machine start stay.
    let mut rig = warm(AxisSettings { datum: Datum::Zero, ..learning_axis() });
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::AtDatum)).unwrap();
    rig.run(1200.0);
    assert_eq!(rig.preferred(), None);
    rig.compensation.zero(rig.now);
    let before = rig.after(10.0);
    assert_eq!((before.model, rig.preferred()), (Some(0), None), "the capture of the datum is running");
    let adopted = rig.after(30.0);
    assert_eq!((adopted.model, rig.preferred()), (Some(SLOT), Some("a".to_owned())));
    near(adopted.raw.unwrap().get(), 0.0);
    // The zero point of the learned model is not limited by the probe.
    rig.prefer(change(learned("far", [30.0, 0.0, 0.0]), When::Now)).unwrap();
    let far = rig.after(10.0);
    assert_eq!(rig.preferred(), Some("far".to_owned()));
    assert!((far.raw.unwrap().get() - adopted.raw.unwrap().get()).abs() < 1e-3);
}

#[test]
fn a_machine_start_is_a_datum_unless_zero_commands_set_it() {
    for (datum, adopted) in [(Datum::Model, Some("a".to_owned())), (Datum::Zero, None)] {
        let settings = AxisSettings { datum, ..learning_axis() };
        let mut rig = Rig::with(MachineSettings { on: Some(ON), ..zeroing_machine() }, settings);
        rig.values[2] = 1.0;
        rig.step();
        rig.run(60.0);
        rig.show(29.0, 25.0).run(3600.0);
        rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::AtDatum)).unwrap();
        rig.values[2] = 0.0;
        rig.run(600.0);
        assert_eq!(rig.preferred(), None, "{datum:?}");
        rig.values[2] = 1.0;
        rig.run(120.0);
        assert_eq!(rig.preferred(), adopted, "{datum:?}");
    }
}

#[test]
fn an_axis_at_zero_because_its_model_was_worse_stays_there_at_an_adoption() {
    let settings = ProbeSettings { worse: OnWorse::Ramp, ..probe() };
    let mut rig = warm(AxisSettings { probe: Some(settings), ..learning_axis() });
    for _ in 0..2 {
        // The machine has no error without compensation.
        let acting = rig.compensation.decision(0).unwrap().cz.get();
        rig.probe(acting, acting);
        rig.run(600.0);
    }
    let before = rig.after(10.0);
    assert_eq!((before.cz, before.state, before.model), (Micron::ZERO, AxisState::Zeroed, Some(0)));
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    let adopted = rig.after(1.0);
    assert_eq!((adopted.model, adopted.state, adopted.worse), (Some(SLOT), AxisState::Active, None));
    near(adopted.raw.unwrap().get(), 0.0);
    assert!(rig.run(600.0).iter().all(|decision| decision.cz.abs() <= um(0.1)), "Cz does not move");
}

#[test]
fn an_adoption_waits_while_the_envelope_of_the_model_in_use_keeps_cz() {
    let settings = learning_axis();
    let (mut models, fixed) = (settings.models.clone(), Reference::Fixed(of(0.0)));
    let known = Identified { input: Input::of(BED, fixed, None), mean: 24.0, range: (20.0, 28.0) };
    models[0].envelope = Envelope::new(vec![known], &[vec![9.0]], Some(3.0), Outside::Hold).ok();
    let mut rig = warm(AxisSettings { models, ..settings });
    let kept = rig.after(10.0);
    assert!(matches!(kept.state, AxisState::Holding(_)), "{kept:?}");
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    // Outside, and inside but not clearly.
    for bed in [29.0, 27.95] {
        let decision = rig.show(bed, 25.0).after(10.0);
        assert_eq!((rig.preferred(), decision.cz), (None, kept.cz), "{bed}: {decision:?}");
    }
    rig.show(26.0, 25.0).run(60.0);
    assert_eq!(rig.preferred(), Some("a".to_owned()));
}

#[test]
fn an_axis_without_a_model_adopts_its_first_one_at_a_zero_and_begins_at_zero() {
    let AxisSettings { models, .. } = learning_axis();
    let learned_slot = Some(LearnedSlot { model: 0, own: "own".to_owned() });
    let models = models.into_iter().skip(SLOT).collect();
    let settings = AxisSettings { models, learned: learned_slot, datum: Datum::Zero, ..learning_axis() };
    let mut rig = Rig::with(zeroing_machine(), settings);
    rig.step();
    rig.run(60.0);
    rig.show(29.0, 25.0).run(3600.0);
    rig.prefer(change(learned("a", [1.0, 0.0, 0.0]), When::AtDatum)).unwrap();
    rig.compensation.zero(rig.now);
    assert_eq!(rig.after(10.0).model, None, "the capture of the datum is running");
    let adopted = rig.after(30.0);
    assert_eq!((adopted.model, rig.preferred()), (Some(0), Some("a".to_owned())));
    near(adopted.raw.unwrap().get(), 0.0);
    near(rig.show(30.0, 25.0).after(10.0).raw.unwrap().get(), 1.0);
}

#[test]
fn a_change_of_another_profile_or_with_another_input_is_rejected() {
    let mut rig = warm(learning_axis());
    let to = || learned("a", [1.0, 2.0, -0.5]);
    let other = Change { to: to(), when: When::Now, own: "other".to_owned() };
    assert_eq!(rig.prefer(Some(other)), Err(Unfit::OtherProfile));
    let mut model = model("b", [1.0, 2.0, 3.0]);
    model.terms[0].squared = true;
    assert_eq!(rig.prefer(change(Preferred::Learned(model), When::Now)), Err(Unfit::UnknownInput));
    let infinite = learned("c", [f64::INFINITY, 0.0, 0.0]);
    assert_eq!(rig.prefer(change(infinite, When::Now)), Err(Unfit::UnknownInput));
    assert_eq!(Rig::new(probed_axis(probe())).prefer(None), Err(Unfit::NoSlot));
}

#[test]
fn an_adopted_model_survives_a_restart_unless_the_profile_changes() {
    let settings = ProbeSettings { filter: Filter::Share(0.5), ..probe() };
    let mut rig = warm(AxisSettings { probe: Some(settings), ..learning_axis() });
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    let before = rig.after(10.0);
    let kept = rig.compensation.remembered();
    assert_eq!(kept.superseded([&learning_axis()]).count(), 0);
    rig.restart(learning_axis());
    let after = rig.after(10.0);
    assert_eq!((after.model, rig.preferred()), (Some(SLOT), Some("a".to_owned())));
    assert!((after.raw.unwrap().get() - before.raw.unwrap().get()).abs() < 0.1, "lags and offset: {after:?}");

    let learned = Some(LearnedSlot { model: SLOT, own: "another".to_owned() });
    let changed = AxisSettings { learned, ..learning_axis() };
    assert_eq!(kept.superseded([&changed]).collect::<Vec<_>>(), [("z", "a")]);
    rig.restart(changed);
    assert_eq!((rig.after(10.0).model, rig.preferred()), (Some(0), None), "the profile wins");
}

#[test]
fn an_axis_without_a_model_adopts_its_first_one_at_once() {
    let AxisSettings { models, .. } = learning_axis();
    let learned_slot = Some(LearnedSlot { model: 0, own: "own".to_owned() });
    let slot = models.into_iter().skip(SLOT).collect();
    let mut rig =
        Rig::with(zeroing_machine(), AxisSettings { models: slot, learned: learned_slot, ..learning_axis() });
    rig.step();
    rig.run(60.0);
    assert_eq!(rig.show(29.0, 25.0).after(600.0).model, None);
    rig.prefer(change(learned("a", [1.0, 0.0, 0.0]), When::Now)).unwrap();
    let adopted = rig.after(10.0);
    assert_eq!(adopted.model, Some(0));
    near(adopted.raw.unwrap().get(), 1.5);
}

proptest! {
    #[test]
    fn whatever_is_adopted_cz_moves_by_no_more_than_a_step(
        gains in prop::array::uniform3(-20.0..20.0f64),
        temperatures in prop::collection::vec((24.0..34.0f64, 22.0..28.0f64), 5..40),
        at in 1_usize..30,
    ) {
        let mut rig = warm(learning_axis());
        let mut last = rig.after(10.0);
        for (place, (bed, wheelhead)) in temperatures.iter().enumerate() {
            if place == at {
                rig.prefer(change(learned("a", gains), When::Now)).unwrap();
            }
            let decision = rig.show(*bed, *wheelhead).after(10.0);
            prop_assert!((decision.cz - last.cz).abs().get() <= 1.0 + 1e-9);
            last = decision;
        }
    }
}

#[test]
fn a_saved_state_gives_the_same_decisions_after_an_adoption() {
    let mut rig = warm(learning_axis());
    rig.prefer(change(learned("a", [1.0, 2.0, -0.5]), When::Now)).unwrap();
    rig.after(10.0);
    let kept = serde_json::to_string(&rig.compensation.running()).unwrap();
    let mut other = Rig::with(zeroing_machine(), learning_axis());
    other.compensation =
        Compensation::new(zeroing_machine(), vec![learning_axis()], serde_json::from_str(&kept).unwrap());
    other.now = rig.now;
    for (bed, wheelhead) in [(29.5, 25.0), (30.0, 25.5), (30.25, 26.0)] {
        let [one, two] =
            [&mut rig, &mut other].map(|rig| rig.show(bed, wheelhead).run(100.0).last().copied().unwrap());
        assert_eq!(one, two);
    }
}
