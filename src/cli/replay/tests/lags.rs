use super::*;
use isotherm_core::compensation::model::envelope::Identified;
use isotherm_core::compensation::model::network::{Activation, Layer, Layers, Net, Scaling};
use isotherm_core::compensation::model::{
    Envelope, Input, Kind, Linear, Matrix, Model, Network, Outside, Reference, Term,
};
use isotherm_core::compensation::settings::Datum;
use isotherm_core::reading::SignalId;
use sample::of;

/// Janeczko's example on axis z: K = 11.5e-6 1/K, L = 300 mm, C = 1800 s, measured from 20 °C.
fn lagging() -> Profile {
    let mut profile = sample::profile();
    profile.axes[0].settings.models = vec![model(Reference::Fixed(of(20.0)))];
    profile
}

fn model(reference: Reference) -> Model {
    let (gain, lag) = (11.5e-6 * 300.0 * 1000.0, Some(Duration::from_secs(1800)));
    let terms = vec![Term { input: Input::of(SignalId(0), reference, lag), gain: of(gain) }];
    Model::new("bearing".to_owned(), Kind::Linear(Linear { offset: of(0.0), terms, slope: None }))
}

const STEPS: [&[f64]; 4] = [&[1.0], &[10.0], &[60.0], &[0.3, 9.7, 47.0, 1e-3, 120.0]];

/// Replays a log with these time steps, and returns the value of the model at each moment of `moments`.
fn at(moments: &[f64], begin: &str, steps: &[f64], bed: impl Fn(f64) -> f64) -> Vec<f64> {
    let (mut log, mut time, mut steps) = (format!("time,bed\n{begin}"), 0.0, steps.iter().cycle());
    for moment in moments {
        while time < *moment {
            let step: f64 = steps.next().unwrap().min(moment - time);
            time = if moment - time - step < 1e-9 { *moment } else { time + step };
            log += &format!("{time},{}\n", bed(time));
        }
    }
    let (_, table) = replayed(&lagging(), &log);
    let (times, raw) = (numbers(&table, "time"), numbers(&table, "z_raw_um"));
    let find = |moment: &f64| times.iter().rposition(|time| (time - moment).abs() < 1e-9).unwrap();
    moments.iter().map(|moment| raw[find(moment)]).collect()
}

const MOMENTS: [f64; 3] = [600.0, 1800.0, 3600.0];

#[test]
fn m4_the_step_is_reproduced_whatever_the_logs_time_step() {
    // Between two rows, a temperature changes linearly. A log must therefore show that its step takes no time. The log
    // may begin warm, because a term begins at its reference. It may also have two rows at one time, or two rows with a
    // very short time between them.
    for begin in ["0,25\n", "0,20\n0,25\n", "0,20\n1e-6,25\n"] {
        for steps in STEPS {
            let found = at(&MOMENTS, begin, steps, |_| 25.0);
            for (found, wanted) in found.iter().zip([4.889835, 10.904080, 14.915466]) {
                assert!((found - wanted).abs() < 1e-6, "{begin:?} {steps:?}: {found} {wanted}");
            }
        }
    }
    let rest = at(&[90_000.0], "0,25\n", &[60.0], |_| 25.0);
    assert!((rest[0] - 17.25).abs() < 1e-6);
}

#[test]
fn m4_the_ramp_is_reproduced_whatever_the_logs_time_step() {
    for steps in STEPS {
        let found = at(&MOMENTS, "0,20\n", steps, |time| 20.0 + 0.001 * time);
        for (found, wanted) in found.iter().zip([0.309659, 2.284531, 7.050432]) {
            assert!((found - wanted).abs() < 1e-6, "{steps:?}: {found} {wanted}");
        }
    }
}

/// The lagging model as a matrix along the last signal of axis z, and as a network.
fn lagging_files(reference: Reference) -> [Model; 2] {
    let gain = 11.5e-6 * 300.0 * 1000.0;
    let input = Input::of(SignalId(0), reference, Some(Duration::from_secs(1800)));
    let other = Input::of(SignalId(1), Reference::Fixed(of(0.0)), None);
    let layer = Layer { weights: vec![vec![0.0, gain]], bias: vec![0.0], activation: Activation::Linear };
    let layers = Layers::new(Scaling::new(&[0.0; 2], &[1.0; 2]).unwrap(), vec![layer], (0.0, 1.0)).unwrap();
    let network = Network::new("n.json", Net::Layers(layers), vec![other, input]).unwrap();
    let matrix =
        Matrix::new("m.json", vec![input], SignalId(3), vec![of(0.0), of(1.0)], vec![of(gain), of(gain)])
            .unwrap();
    // Outside its envelope, an axis also follows its last step. The wide region has a wide edge.
    let known = Identified { input: Input { lag: None, ..input }, mean: 0.0, range: (-100.0, 6.0) };
    let envelope = Envelope::new(vec![known], &[vec![900.0]], None, Outside::Hold).unwrap();
    [("matrix", Kind::Matrix(matrix)), ("network", Kind::Network(network))]
        .map(|(name, kind)| Model { envelope: Some(envelope.clone()), ..Model::new(name.to_owned(), kind) })
}

#[test]
fn m4_an_input_that_lags_is_reproduced_whatever_the_logs_time_step() {
    for model in lagging_files(Reference::Fixed(of(20.0))) {
        let mut profile = sample::profile();
        profile.axes[0].settings.models = vec![model];
        for step in [1, 10, 60] {
            let log = (0..=3600 / step)
                .fold("time,bed,wheelhead,hydraulics_on,zero_button\n".to_owned(), |log, row| {
                    log + &format!("{},25,24,1,0\n", row * step)
                });
            let (_, table) = replayed(&profile, &log);
            let raw = numbers(&table, "z_raw_um");
            for (moment, wanted) in [(600, 4.889835), (1800, 10.904080), (3600, 14.915466)] {
                let found = raw[moment / step];
                assert!((found - wanted).abs() < 1e-6, "{step} s: {found} {wanted}");
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_files_of_lags_and_a_datum_replayed_alone_are_their_days_bit_for_bit(
        days in prop::collection::vec(any_event(), 1..150),
    ) {
        let mut profile = lagging();
        profile.axes[0].settings.datum = Datum::Zero;
        profile.axes[0].settings.models.push(sample::profile().axes[0].settings.models[0].clone());
        let zeroed = Model { name: "zeroed".to_owned(), ..model(Reference::Zero) };
        profile.axes[1].settings.models = vec![zeroed, model(Reference::Start)];
        come_out_again(&profile, &days, &[])?;
    }

    #[test]
    fn the_files_of_lagging_inputs_replayed_alone_are_their_days_bit_for_bit(
        days in prop::collection::vec(any_event(), 1..150),
    ) {
        let mut profile = sample::profile();
        profile.axes[0].settings.models = lagging_files(Reference::Start).into();
        profile.axes[1].settings.models = lagging_files(Reference::Zero).into();
        profile.axes[1].settings.models.reverse();
        come_out_again(&profile, &days, &[])?;
    }
}
