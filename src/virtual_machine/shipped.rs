//! The shipped profiles against their plants, without sockets: the coefficients are those of one day, and they hold
//! on twenty others.

use crate::compensation::{Compensation, Control, Remembered};
use crate::reading::SignalId;

mod fit;
mod machines;
mod rig;

/// The day the coefficients were identified on.
const CALIBRATION: u64 = 100;

/// The grinder's calibration day as a person would record it, one row a minute.
struct Row {
    /// Machine-on time, s.
    t: f64,
    bed: f64,
    wheelhead: f64,
    /// Of both rises since machine start.
    difference: f64,
    error: f64,
}

fn recorded() -> Vec<Row> {
    let machine = machines::grinder();
    let profile = &machine.rig.profile;
    let place = |name: &str| SignalId(profile.signals.iter().position(|signal| signal.name == name).unwrap());
    let (bed, wheelhead) = (place("bed"), place("wheelhead"));
    let mut axis = profile.axes[0].settings.clone();
    axis.every = std::time::Duration::from_secs(1);
    let gain = machine.rig.lines()[0].1.terms[0].gain;
    let offset = machine.rig.lines()[0].1.offset;
    let mut core = Compensation::new(profile.machine.clone(), vec![axis], Remembered::default());
    let mut rows = Vec::new();
    machine.rig.day(CALIBRATION, machine.hours, |second, plant, snapshot| {
        core.step(snapshot, &[Control::default()]);
        // With equal gains of both signs the model is the difference of the rises.
        let Some((0, cz)) = core.model_value(0, snapshot).filter(|_| second % 60 == 0) else { return };
        rows.push(Row {
            t: core.machine().on_time(snapshot.now).unwrap().as_secs_f64(),
            bed: snapshot.value(bed).unwrap(),
            wheelhead: snapshot.value(wheelhead).unwrap(),
            difference: (cz.get() - offset) / gain,
            error: plant.true_error_um("z").unwrap(),
        });
    });
    rows
}

/// Slope, intercept, and what is left: range and root mean square.
fn line_through(points: &[(f64, f64)]) -> (f64, f64, f64, f64) {
    let rows: Vec<Vec<f64>> = points.iter().map(|point| vec![point.0, 1.0]).collect();
    let target: Vec<f64> = points.iter().map(|point| point.1).collect();
    let fit = fit::least_squares(&rows, &target);
    (fit.coefficients[0], fit.coefficients[1], fit.range, fit.rms)
}

fn assert_near(what: &str, shipped: f64, found: f64) {
    assert!((shipped - found).abs() <= 0.02 * found.abs(), "{what}: shipped {shipped}, found {found}");
}

/// A constant of one of the grinder's formulas, by the formula's place.
fn constant(place: usize, name: &str) -> f64 {
    let profile: toml::Table = include_str!("../../profiles/surface-grinder.toml").parse().unwrap();
    profile["axis"]["z"]["model"][place]["constants"][name].as_float().unwrap()
}

#[test]
fn the_grinders_coefficients_are_those_of_the_calibration_day() {
    let day = recorded();
    let line = machines::grinder().rig.lines().remove(0).1;
    let points: Vec<_> = day.iter().map(|row| (row.difference, -row.error)).collect();
    let (gain, offset, range, rms) = line_through(&points);
    println!("Cz = {gain:.4} (A - B) + {offset:.4}: range {range:.2}, rms {rms:.2}");
    assert_near("A", line.terms[0].gain, gain);
    assert_near("B", line.terms[1].gain, -gain);
    assert_near("offset", line.offset, offset);

    let late = || day.iter().filter(|row| row.t >= 9000.0);
    let points: Vec<_> = late().map(|row| (row.t, row.bed + row.error / gain)).collect();
    let (b, c, range, _) = line_through(&points);
    println!("B as {b:.4e} t + {c:.3}: range {:.2} um", range * gain);
    assert_near("Kz", constant(1, "Kz"), gain);
    assert_near("b", constant(1, "b"), b);
    assert_near("c", constant(1, "c"), c);

    let points: Vec<_> = late().map(|row| (row.t.sqrt(), -row.error + gain * row.wheelhead)).collect();
    let (k, c, range, _) = line_through(&points);
    println!("Kz A as {k:.4} sqrt(t) + {c:.3}: range {range:.2} um");
    assert_near("Kz", constant(2, "Kz"), gain);
    assert_near("k", constant(2, "k"), k);
    assert_near("c", constant(2, "c"), c);
}
