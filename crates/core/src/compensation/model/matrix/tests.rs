use super::*;
use crate::compensation::model::Reference;
use crate::compensation::reference::Machine;
use crate::quantity::Moment;
use crate::quantity::of;
use crate::reading::{Reading, Reason};

const SCALE: SignalId = SignalId(2);

/// Matrix model of two blocks and three points, with gains of Cz in µm/K.
fn matrix() -> Matrix {
    let input = |place, reference| Input::of(SignalId(place), reference, None);
    let inputs = vec![input(0, Reference::Fixed(of(20.0))), input(1, Reference::Fixed(of(18.0)))];
    let guide = [0.0, 400.0, 1000.0].map(of).to_vec();
    let gains = [1.0, 0.5, 3.0, -1.0, 9.0, 2.0].map(of).to_vec();
    Matrix::new("m.json", inputs, SCALE, guide, gains).unwrap()
}

fn with<T>(values: [f64; 3], look: impl Fn(&Snapshot<'_>) -> T) -> T {
    let now = Moment::from_nanos(0);
    let readings = values.map(|value| match value.is_nan() {
        true => Reading::bad(now, Reason::Timeout),
        false => Reading::good(value, now),
    });
    look(&Snapshot::new(now, &readings))
}

fn cz(bed: f64, column: f64, at: f64) -> Result<f64, Unusable> {
    with([bed, column, at], |snapshot| {
        let machine = Machine::default();
        let known = Inputs { snapshot: *snapshot, machine: &machine, lags: &[], splits_slope: false };
        matrix().evaluate(&known).map(|outputs| outputs.cz.get())
    })
}

#[test]
fn m11_the_displacement_is_p_times_the_rises() {
    // ΔT = (2, 4): at 0 mm 1·2 + 0.5·4 = 4, at 400 mm 3·2 − 1·4 = 2, at 1000 mm 9·2 + 2·4 = 26 µm.
    for (at, expected) in [(0.0, 4.0), (400.0, 2.0), (1000.0, 26.0)] {
        assert!((cz(22.0, 22.0, at).unwrap() - expected).abs() < 1e-9, "{at} mm");
    }
}

#[test]
fn between_two_points_it_is_interpolated_linearly() {
    for (at, expected) in [(100.0, 3.5), (300.0, 2.5), (550.0, 8.0), (999.999, 25.99996)] {
        assert!((cz(22.0, 22.0, at).unwrap() - expected).abs() < 1e-9, "{at} mm");
    }
}

#[test]
fn beyond_the_ends_it_stays_and_says_so() {
    let beyond = |at| with([22.0, 22.0, at], |snapshot| matrix().coverage(snapshot).unwrap().extrapolating);
    for (at, expected, by) in [(-35.0, 4.0, -35.0_f64), (1250.0, 26.0, 250.0), (1e300, 26.0, 1e300)] {
        assert!((cz(22.0, 22.0, at).unwrap() - expected).abs() < 1e-9, "{at} mm");
        let farthest = beyond(at).unwrap().farthest.unwrap();
        assert_eq!(farthest.signal, SCALE);
        assert!((farthest.by - by).abs() <= 1e-9 * by.abs(), "{at} mm");
    }
    for at in [0.0, 400.0, 1000.0] {
        assert_eq!(beyond(at), None);
    }
}

#[test]
fn what_is_missing_is_named() {
    assert_eq!(cz(f64::NAN, 22.0, 0.0), Err(Unusable::Signal(SignalId(0))));
    assert_eq!(cz(22.0, 22.0, f64::NAN), Err(Unusable::Signal(SCALE)));
}

#[test]
fn a_matrix_that_is_none_is_refused() {
    let input = Input::of(SignalId(0), Reference::Fixed(of(0.0)), None);
    let new = |guide: &[f64], gains: &[f64]| {
        let (guide, gains) = (guide.iter().copied().map(of), gains.iter().copied().map(of));
        Matrix::new("m.json", vec![input], SCALE, guide.collect(), gains.collect()).unwrap_err()
    };
    for (guide, gains, words) in [
        (&[][..], &[][..], "at least one block and one point"),
        (&[1.0, 1.0], &[0.0, 0.0], "must ascend, but 1 mm is followed by 1 mm"),
        (
            &[0.0, 1.0],
            &[0.0],
            "there are 1 gains, but each of the 2 points needs one gain for each of the 1 blocks",
        ),
    ] {
        assert!(new(guide, gains).contains(words), "{}", new(guide, gains));
    }
}
