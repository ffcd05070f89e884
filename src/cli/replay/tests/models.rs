//! The reference values of the models' sources, from logs with different time steps. M4, the lag, is in `lags`. M6, M8
//! and M12 identify models and place sensors, so that a replay does not use them.

use super::*;
use isotherm_core::compensation::model::network::{Activation, Layer, Layers, Net, Node, Radial, Scaling};
use isotherm_core::compensation::model::{
    Expression, Formula, Input, Kind, Linear, Matrix, Model, Network, Reference, Slope, Symbol, Term,
};
use isotherm_core::compensation::settings::InterceptSlope;
use isotherm_core::quantity::Celsius;
use isotherm_core::reading::SignalId;
use isotherm_profile::Axis;
use sample::of;

const ABSOLUTE: Reference = Reference::Fixed(Celsius::ZERO);

/// The sample machine with this sum as the model of axis z. Its four signals accept all values of the log.
fn following(offset: f64, terms: &[(usize, f64, Reference)], slope: Option<Slope>) -> Profile {
    let mut profile = sample::profile();
    for signal in &mut profile.signals {
        signal.range = None;
    }
    let terms = terms.iter().map(|(place, gain, reference)| Term {
        input: Input::of(SignalId(*place), *reference, None),
        gain: of(*gain),
    });
    let kind = Kind::Linear(Linear { offset: of(offset), terms: terms.collect(), slope });
    profile.axes[0].settings.models = vec![Model::new("sum".to_owned(), kind)];
    profile
}

/// 0.007 µm/mm for each degree of the bed above 20 °C, with P0 = 0. The last signal is the position.
fn inclined() -> Slope {
    let term = Term { input: Input::of(SignalId(0), Reference::Fixed(of(20.0)), None), gain: of(0.007) };
    Slope {
        position: SignalId(3),
        reference: of(0.0),
        travel: Some((of(-300.0), of(0.0))),
        terms: vec![term],
    }
}

/// Time steps of a log, s.
const STEPS: [&[f64]; 4] = [&[1.0], &[10.0], &[60.0], &[0.3, 9.7, 47.0, 1e-3, 120.0]];

/// Target of each axis's model at the end of a log with constant values over `span` seconds, with these time steps.
fn raws(profile: &Profile, values: &str, span: f64, steps: &[f64]) -> Vec<f64> {
    let mut log = format!("time,bed,wheelhead,hydraulics_on,zero_button\n0,{values}\n");
    let (mut time, mut steps) = (0.0, steps.iter().cycle());
    while time < span {
        time = (time + steps.next().unwrap()).min(span);
        log += &format!("{time},{values}\n");
    }
    let (_, table) = replayed(profile, &log);
    let last = |axis: &Axis| *numbers(&table, &format!("{}_raw_um", axis.settings.name)).last().unwrap();
    profile.axes.iter().map(last).collect()
}

/// Asserts that the model of the first axis gives this value with all time steps.
fn gives(name: &str, profile: &Profile, values: &str, span: f64, wanted: f64) {
    let mut alone = profile.clone();
    alone.axes.truncate(1);
    for steps in STEPS {
        let found = raws(&alone, values, span, steps)[0];
        assert!((found - wanted).abs() < 1e-6, "{name}, {steps:?}: {found} {wanted}");
    }
}

fn one(kind: Kind) -> Profile {
    let mut profile = following(0.0, &[], None);
    profile.axes[0].settings.models = vec![Model::new("one".to_owned(), kind)];
    profile
}

fn rises(places: &[usize], reference: f64) -> Vec<Input> {
    let input = |place: &usize| Input::of(SignalId(*place), Reference::Fixed(of(reference)), None);
    places.iter().map(input).collect()
}

#[test]
fn m1_m3_m5_m7_m13_sums_and_slopes_give_the_values_of_their_sources() {
    let (a, b) = ((-0.632, -1.772, 3.066), (1.20, -0.99));
    let cw = [(0, a.0, ABSOLUTE), (1, a.1, ABSOLUTE), (2, a.2, ABSOLUTE)];
    let ch = [(3, b.0, ABSOLUTE), (2, b.1, ABSOLUTE)];
    let both = [&cw[..], &ch].concat();
    for (name, profile, values, wanted) in [
        ("M1", following(0.0, &[(0, 2.4, ABSOLUTE), (1, -2.4, ABSOLUTE)], None), "27.5,24,0,0", 8.4),
        ("M3", following(80.0, &[(0, -4.0, ABSOLUTE)], None), "23.5,0,0,0", -14.0),
        ("M5", following(0.0, &[], Some(inclined())), "25,0,0,-300", -10.5),
        ("M7 Cw", following(0.0, &cw, None), "9.5,3,2.5,9.5", -3.655),
        ("M7 Ch", following(0.0, &ch, None), "9.5,3,2.5,9.5", 8.925),
        ("M7 C", following(0.0, &both, None), "9.5,3,2.5,9.5", 5.270),
        ("M13", following(0.0, &[(1, 1.0, ABSOLUTE)], Some(inclined())), "25,5,0,-300", -5.5),
    ] {
        gives(name, &profile, values, 200.0, wanted);
    }
}

#[test]
fn m2_one_sensor_and_machine_on_time() {
    let mut profile = sample::profile();
    profile.axes[0].settings.models.remove(0);
    gives("M2", &profile, "27.5,24,1,0", 30_000.0, 8.4);
    // The opposite sign: Kz′ = −Kz, and A as K·√t, here 0.02 °C/√s over 24 °C.
    let resolve = |name: &str| match name {
        "B" => Some(Symbol::Signal(SignalId(1))),
        "t" => Some(Symbol::Time),
        _ => None,
    };
    let expression = Expression::parse("2.4 * (24 + 0.02*sqrt(t) - B)", &resolve).unwrap();
    profile.axes[0].settings.models[0].kind = Kind::Formula(Formula { expression });
    gives("M2, B", &profile, "27.5,24,1,0", 22_500.0, 7.2);
}

#[test]
fn m9_a_screw_by_its_nut_and_a_vector_of_three_axes_from_one_set_of_sensors() {
    let term = Term { input: Input::of(SignalId(0), Reference::Fixed(of(20.0)), None), gain: of(-0.012) };
    let slope = Slope { position: SignalId(3), reference: of(0.0), travel: None, terms: vec![term] };
    gives("screw", &following(0.0, &[], Some(slope)), "30,0,0,-1000", 200.0, 120.0);

    let mut ram = following(0.0, &[], None);
    let gains = [[-5.0, 5.0, 0.0], [1.5, 15.0, -15.0], [3.0, 1.0, 2.5]];
    ram.axes = ["x", "y", "z"]
        .into_iter()
        .zip(gains)
        .map(|(name, gains)| {
            let terms: Vec<_> = gains
                .into_iter()
                .enumerate()
                .map(|(place, gain)| (place, gain, Reference::Fixed(of(20.0))))
                .collect();
            let mut axis = following(0.0, &terms, None).axes.swap_remove(0);
            axis.settings.name = name.to_owned();
            axis
        })
        .collect();
    for steps in STEPS {
        // Rises of 4, 3 and 2 °C.
        for (found, wanted) in raws(&ram, "24,23,22,0", 200.0, steps).iter().zip([-5.0, 21.0, 20.0]) {
            assert!((found - wanted).abs() < 1e-6, "{steps:?}: {found} {wanted}");
        }
    }
}

#[test]
fn m10_networks_by_hand() {
    let scaling = || Scaling::new(&[20.0, 20.0], &[4.0, 4.0]).unwrap();
    let layer = Layer { weights: vec![vec![0.5, -0.5]], bias: vec![0.0], activation: Activation::Tanh };
    let layers = Layers::new(scaling(), vec![layer], (1.0, 10.0)).unwrap();
    let node = Node { centre: vec![1.0, 0.5], width: 2.0, weight: 3.0 };
    let radial = Radial::new(scaling(), vec![node], 0.25, (0.0, 4.0)).unwrap();
    let network = |net| one(Kind::Network(Network::new("n.json", net, rises(&[0, 1], 0.0)).unwrap()));
    // tanh 0.25 = 0.244918662404. A node gives its weight at its centre, and e^(−1/2) of it at a distance of one width.
    gives("back-propagation", &network(Net::Layers(layers)), "24,22,0,0", 200.0, 3.449_186_624);
    gives("radial basis, at its centre", &network(Net::Radial(radial.clone())), "24,22,0,0", 200.0, 13.0);
    let away = 1.0 + 12.0 * 0.606_530_659_713;
    gives("radial basis, a width away", &network(Net::Radial(radial)), "32,22,0,0", 200.0, away);
}

#[test]
fn m11_the_matrix_times_the_blocks_at_the_position() {
    // −P in µm/K: at 0 mm (−1, −2), at 400 mm (−3, −4), so at 100 mm (−1.5, −2.5); rises of 4 and 2 °C.
    let matrix = Matrix::new(
        "p.json",
        rises(&[0, 1], 20.0),
        SignalId(3),
        vec![of(0.0), of(400.0)],
        [-1.0, -2.0, -3.0, -4.0].map(of).to_vec(),
    );
    let profile = one(Kind::Matrix(matrix.unwrap()));
    for (position, wanted) in [("100", -11.0), ("0", -8.0), ("400", -20.0), ("900", -20.0)] {
        gives("M11", &profile, &format!("24,22,0,{position}"), 200.0, wanted);
    }
}

fn apart() -> Profile {
    let mut profile = following(0.0, &[(1, 1.0, ABSOLUTE)], Some(inclined()));
    profile.axes[0].settings.intercept_slope =
        Some(InterceptSlope { reference: of(0.0), reach: of(300.0), count: Micron::new(0.3) });
    profile
}

#[test]
fn m13_the_two_parts_stand_beside_each_other() {
    let mut log = "time,bed,wheelhead\n".to_owned();
    (0..60).for_each(|row| log += &format!("{},25,5\n", row * 10));
    let (_, table) = replayed(&apart(), &log);
    let (cz, slope) = (numbers(&table, "z_cz_um"), numbers(&table, "z_slope_um"));
    assert!(
        (cz[59] - 5.0).abs() < 1e-9 && (slope[59] / 300.0 - 0.035).abs() < 1e-9,
        "{} {}",
        cz[59],
        slope[59]
    );
    assert!(slope.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= 1.0 + 1e-9));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_files_of_a_line_replayed_alone_are_its_days_bit_for_bit(days in prop::collection::vec(any_event(), 1..100)) {
        let profile = apart();
        come_out_again(&profile, &days, &["z_cz_um".to_owned(), "z_slope_um".to_owned()])?;
    }
}
