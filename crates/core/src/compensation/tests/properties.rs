use crate::quantity::of;
use proptest::prelude::*;

use super::*;
use crate::compensation::model::Lag;
use crate::compensation::stand_in::StartEstimate;

fn any_value() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -50.0..120.0,
        1 => Just(f64::NAN),
        1 => prop_oneof![Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(f64::MAX), Just(f64::MIN)],
    ]
}

fn any_permit() -> impl Strategy<Value = Permit> {
    prop_oneof![
        5 => Just(Permit::Armed), 1 => Just(Permit::Off), 1 => Just(Permit::Unverified), 1 => Just(Permit::Stopping)
    ]
}

/// Length of a step in nanoseconds: normal, zero, negative (time goes back), or very long.
fn any_jump() -> impl Strategy<Value = i64> {
    prop_oneof![
        6 => 0..30_000_000_000i64,
        1 => Just(0i64),
        1 => -7_200_000_000_000..0i64,
        1 => 0..90_000_000_000_000i64,
    ]
}

fn any_axis() -> impl Strategy<Value = AxisSettings> {
    let count = prop_oneof![Just(None), (0.01..3.0).prop_map(Some), Just(Some(0.1))];
    let on_fault = prop_oneof![
        Just(OnFault::Hold),
        Just(OnFault::Zero),
        (0u64..120).prop_map(|after| OnFault::Ramp { after: Duration::from_secs(after) })
    ];
    let lag = (1u64..20_000).prop_map(|lag| Some(Duration::from_secs(lag)));
    let line = prop::option::weighted(0.3, prop::option::of(0.01..3.0f64)).prop_map(|line| {
        line.map(|count| InterceptSlope { reference: of(0.0), reach: of(300.0), count: count.map(um) })
    });
    let inclined = (lag, line, any::<bool>());
    ((0.1..100.0, 0.001..20.0, 1e-4..50.0, 0.0..1.0, count), on_fault, 1u64..600_000, inclined).prop_map(
        |((limit, step, rate, deadband, count), on_fault, every, (lag, intercept_slope, zero))| {
            AxisSettings {
                levels: Levels { warn: None, error: zero.then(|| um(3.0 * limit)) },
                datum: if zero { Datum::Zero } else { Datum::Model },
                intercept_slope,
                guard: GuardSettings {
                    limit: um(limit),
                    step: um(step),
                    rate: of(rate),
                    deadband: um(deadband),
                    count: count.map(um),
                },
                every: Duration::from_millis(every),
                on_fault,
                ..axis(vec![
                    Model::new(
                        "rise".to_owned(),
                        Kind::Linear(Linear {
                            offset: Micron::ZERO,
                            terms: vec![
                                lagged(BED, 2.0, Reference::Start, lag),
                                lagged(WHEELHEAD, -1.0, Reference::Zero, lag),
                            ],
                            slope: Some(Slope {
                                position: ON,
                                reference: of(0.0),
                                travel: None,
                                terms: vec![lagged(BED, 0.01, Reference::Fixed(of(20.0)), lag)],
                            }),
                        }),
                    ),
                    difference(),
                    bed_only(),
                ])
            }
        },
    )
}

type Look = (i64, [f64; 4], Permit, Option<f64>);

fn any_look() -> impl Strategy<Value = Look> {
    let level = prop_oneof![Just(0.0), Just(1.0), any_value()];
    let values =
        (any_value(), any_value(), level.clone(), level).prop_map(|(a, b, on, zero)| [a, b, on, zero]);
    (any_jump(), values, any_permit(), prop::option::weighted(0.1, -300.0..300.0))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn whatever_happens_the_offset_stays_inside_its_bounds(
        axis in any_axis(),
        by_signals: bool,
        settle in 0u64..300,
        looks in prop::collection::vec(any_look(), 1..80),
    ) {
        let guard = axis.guard;
        let settings = MachineSettings {
            on: by_signals.then_some(ON),
            zero: by_signals.then_some(BUTTON),
            settle: Duration::from_secs(settle),
            signals: 4,
        };
        let slope_count = axis.intercept_slope.and_then(|line| line.count);
        let mut rig = Rig::with(settings, axis);
        let (mut last, mut last_slope) = (Micron::ZERO, Micron::ZERO);
        let mut nanos = 1_700_000_000_000_000_000u64;
        for (jump, values, permit, found) in looks {
            nanos = nanos.saturating_add_signed(jump);
            rig.now = Moment::from_nanos(nanos);
            rig.values = values;
            let found_slope = found.filter(|_| rig.compensation.axes[0].settings.intercept_slope.is_some());
            let take_over_slope = found_slope.map(|found| um(found / 2.0));
            rig.control = Control { permit, take_over: found.map(um), take_over_slope, ..Control::default() };
            let before = rig.compensation.decision(0).unwrap().at;
            let decision = rig.step();
            if let Some(found) = found {
                let grain = guard.count.map_or(0.0, Micron::get);
                last = um(found).clamp_to(guard.limit);
                prop_assert!((decision.cz - last).abs().get() <= guard.step.get() + grain + 1e-9);
            } else {
                prop_assert!((decision.cz - last).abs().get() <= guard.step.get() + 1e-9, "{last:?} to {decision:?}");
            }
            prop_assert!(decision.cz.abs() <= guard.limit, "{:?}", decision);
            let grain = slope_count.filter(|_| take_over_slope.is_some()).map_or(0.0, Micron::get);
            last_slope = take_over_slope.map_or(last_slope, |found| found.clamp_to(guard.limit));
            prop_assert!((decision.slope - last_slope).abs().get() <= guard.step.get() + grain + 1e-9, "{decision:?}");
            prop_assert!(decision.slope.abs() <= guard.limit, "{:?}", decision);
            last_slope = decision.slope;
            if let Some(count) = guard.count {
                let counts = decision.cz.get() / count.get();
                prop_assert!((counts - counts.round()).abs() < 1e-6, "{:?}", decision);
            }
            if decision.at != before && permit != Permit::Armed {
                prop_assert!(!decision.state.is_following());
            }
            prop_assert!(rig.compensation.next_due().is_some_and(|due| due > rig.now), "no burst");
            last = decision.cz;
        }
    }

    #[test]
    fn the_same_looks_give_the_same_decisions(axis in any_axis(), looks in prop::collection::vec(any_look(), 1..40)) {
        let mut decisions = [Vec::new(), Vec::new()];
        for decisions in &mut decisions {
            let mut rig = Rig::new(axis.clone());
            for (jump, values, permit, found) in &looks {
                rig.now = Moment::from_nanos(rig.now.as_nanos().saturating_add_signed(*jump));
                rig.values = *values;
                rig.control = Control { permit: *permit, take_over: found.map(um), ..Control::default() };
                decisions.push(rig.step());
            }
        }
        prop_assert_eq!(&decisions[0], &decisions[1]);
    }

    #[test]
    fn a_lag_that_knows_its_reference_goes_as_one_that_looks_it_up(
        moments in prop::collection::vec(any_moment(), 1..60),
        settle in 0u64..40,
        squared in any::<bool>(),
    ) {
        let settings = MachineSettings {
            on: Some(ON), zero: Some(BUTTON), settle: Duration::from_secs(settle), signals: 4
        };
        let references = [Reference::Fixed(of(20.0)), Reference::Start, Reference::Zero];
        let inputs = references.map(|reference| Input { squared, ..Input::of(BED, reference, Some(seconds(900.0))) });
        let mut machine = reference::Machine::default();
        let (mut knows, mut looks_up) = ([Lag::default(); 3], [Lag::default(); 3]);
        let mut now = Moment::from_nanos(0);
        for (jump, bed, (on, button, begins)) in moments {
            now = Moment::from_nanos(now.as_nanos().saturating_add_signed(jump));
            let values = [bed, 20.0, f64::from(u8::from(on)), f64::from(u8::from(button))];
            let readings = values.map(|value| Reading::good(value, now));
            let snapshot = Snapshot::new(now, &readings);
            machine.observe(&settings, &snapshot);
            for ((input, knows), looks_up) in inputs.iter().zip(&mut knows).zip(&mut looks_up) {
                *looks_up = looks_up.kept().into();
                looks_up.follow(input, &snapshot, &machine);
                knows.follow(input, &snapshot, &machine);
                prop_assert_eq!(knows.kept(), looks_up.kept());
                prop_assert!(knows.kept().is_none_or(|kept| kept.is_finite()));
            }
            if begins {
                machine.begins(BED, StartEstimate { value: bed, rejected_since: Moment::default() });
            }
        }
    }
}

/// Random moment: length of the step, reading of the bed, and three flags. The flags say whether the machine runs,
/// whether its zero button is pressed, and whether its start becomes known later.
fn any_moment() -> impl Strategy<Value = (i64, f64, (bool, bool, bool))> {
    let rarely = || prop::bool::weighted(0.1);
    (any_jump(), any_value(), (prop::bool::weighted(0.8), rarely(), rarely()))
}
