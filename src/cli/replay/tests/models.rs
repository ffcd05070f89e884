use super::*;
use crate::compensation::model::{Kind, Linear, Model, Reference, Slope, Term};
use crate::compensation::settings::Apart;
use crate::reading::SignalId;

const ABSOLUTE: Reference = Reference::Fixed(0.0);

/// The sample machine whose axis z follows this sum; its four signals take what the log says.
fn following(offset: f64, terms: &[(usize, f64, Reference)], slope: Option<Slope>) -> Profile {
    let mut profile = sample::profile();
    for signal in &mut profile.signals {
        signal.range = None;
    }
    let terms = terms.iter().map(|(place, gain, reference)| Term {
        signal: SignalId(*place),
        gain: *gain,
        reference: *reference,
        lag: None,
    });
    let kind = Kind::Linear(Linear { offset, terms: terms.collect(), slope });
    profile.axes[0].settings.models = vec![Model { name: "sum".to_owned(), kind, envelope: None }];
    profile
}

/// 0.007 µm/mm for each degree of the bed over 20 °C, about P0 = 0; the position is the last signal.
fn inclined() -> Slope {
    let term = Term { signal: SignalId(0), gain: 0.007, reference: Reference::Fixed(20.0), lag: None };
    Slope { position: SignalId(3), reference: 0.0, travel: Some((-300.0, 0.0)), terms: vec![term] }
}

fn raw(profile: &Profile, values: &str) -> f64 {
    let log = format!("time,bed,wheelhead,hydraulics_on,zero_button\n0,{values}\n10,{values}\n");
    numbers(&replayed(profile, &log).1, "z_raw_um")[1]
}

#[test]
fn sums_and_slopes_give_the_values_of_their_sources() {
    let (a, b) = ((-0.632, -1.772, 3.066), (1.20, -0.99));
    let terms =
        [(0, a.0, ABSOLUTE), (1, a.1, ABSOLUTE), (2, a.2, ABSOLUTE), (3, b.0, ABSOLUTE), (2, b.1, ABSOLUTE)];
    for (name, profile, values, wanted) in [
        ("M1", following(0.0, &[(0, 2.4, ABSOLUTE), (1, -2.4, ABSOLUTE)], None), "27.5,24,0,0", 8.4),
        ("M3", following(80.0, &[(0, -4.0, ABSOLUTE)], None), "23.5,0,0,0", -14.0),
        ("M5", following(0.0, &[], Some(inclined())), "25,0,0,-300", -10.5),
        ("M7", following(0.0, &terms, None), "9.5,3,2.5,9.5", 5.270),
        ("M13", following(0.0, &[(1, 1.0, ABSOLUTE)], Some(inclined())), "25,5,0,-300", -5.5),
    ] {
        let found = raw(&profile, values);
        assert!((found - wanted).abs() < 1e-9, "{name}: {found} {wanted}");
    }
}

fn apart() -> Profile {
    let mut profile = following(0.0, &[(1, 1.0, ABSOLUTE)], Some(inclined()));
    profile.axes[0].settings.apart = Some(Apart { reference: 0.0, reach: 300.0, count: Micron::new(0.3) });
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
