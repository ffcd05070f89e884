//! The machines of the sources: each one's coefficients are those of its calibration day, and hold on twenty others.

use super::CALIBRATION;
use super::hold::Line;
use super::rig::Rig;

/// What a machine is held to.
struct Held {
    rig: Rig,
    hours: u64,
    /// For each axis, in the order of their names: the least range without compensation, the largest with it, µm.
    figures: &'static [(&'static str, f64, f64)],
}

macro_rules! rig {
    ($name:literal) => {
        Rig::new(
            $name,
            include_str!(concat!("../../../profiles/", $name, ".toml")),
            include_str!(concat!("../../../profiles/", $name, ".plant.toml")),
        )
    };
}

fn lathe() -> Held {
    Held { rig: rig!("xc100-lathe"), hours: 8, figures: &[("x", 15.0, 3.0)] }
}

fn parts() -> Held {
    Held { rig: rig!("parts-vmc"), hours: 12, figures: &[("y", 50.0, 8.0)] }
}

fn spindle() -> Held {
    Held { rig: rig!("spindle-hmc"), hours: 12, figures: &[("z", 75.0, 5.0)] }
}

fn ram() -> Held {
    Held { rig: rig!("ram-mc"), hours: 12, figures: &[("x", 8.0, 4.0), ("y", 50.0, 8.0), ("z", 150.0, 8.0)] }
}

fn jcs() -> Held {
    Held { rig: rig!("jcs018a-vmc"), hours: 8, figures: &[("z", 7.0, 2.0)] }
}

fn screw() -> Held {
    Held { rig: rig!("screw-axis"), hours: 8, figures: &[("x", 90.0, 9.5)] }
}

impl Held {
    fn twenty_days(&self) {
        for seed in 1..=20 {
            let day = self.rig.day(seed, self.hours);
            assert_eq!(day.len(), self.figures.len());
            for ((axis, extents), (name, least, most)) in day.iter().zip(self.figures) {
                let (without, with) = extents.ranges();
                println!("{} {axis} seed {seed}: {without:.2} -> {with:.2} um", self.rig.name);
                assert_eq!(axis, name);
                assert!(without >= *least, "{axis}, seed {seed}: {without} um without");
                assert!((0.3..=*most).contains(&with), "{axis}, seed {seed}: {with} um with");
            }
        }
    }

    /// Gains and offset within two per cent, or within what turns to less than a tenth of a micron.
    fn calibration(&self) {
        let shipped = self.rig.lines();
        for found in self.rig.identify(&shipped, CALIBRATION, self.hours) {
            let (axis, fit) = (&found.axis, &found.fit);
            println!(
                "{} {axis}: range {:.2}, rms {:.2}, {:?}",
                self.rig.name, fit.range, fit.rms, found.line
            );
            let line = &shipped.iter().find(|(name, _)| name == axis).unwrap().1;
            assert!((line.offset - found.line.offset).abs() < 0.05, "{axis}: offset {}", found.line.offset);
            for (term, found) in line.all().zip(found.line.all()) {
                let apart = (term.gain - found.gain).abs();
                assert!(
                    apart <= 0.02 * found.gain.abs(),
                    "{axis}, {}: {} {}",
                    term.signal,
                    term.gain,
                    found.gain
                );
            }
        }
    }

    /// No lag a quarter shorter or longer fits the day better.
    fn lags(&self) {
        let shipped = self.rig.lines();
        let rms = |lines: &[(String, Line)]| self.rig.identify(lines, CALIBRATION, self.hours)[0].fit.rms;
        let best = rms(&shipped);
        for place in 0..shipped[0].1.all().count() {
            for factor in [0.75, 1.25] {
                let mut other = shipped.clone();
                let line = &mut other[0].1;
                let slope = line.slope.iter_mut().flat_map(|slope| &mut slope.terms);
                let term = line.terms.iter_mut().chain(slope).nth(place).unwrap();
                if term.lag > 0.0 {
                    term.lag *= factor;
                    let rms = rms(&other);
                    assert!(rms >= best, "{} x {factor}: {rms} against {best}", shipped[0].0);
                }
            }
        }
    }
}

#[test]
fn the_lathes_coefficients_are_those_of_its_calibration_day() {
    lathe().calibration();
}

#[test]
fn the_parts_machines_gain_and_lag_are_those_of_its_calibration_day() {
    parts().calibration();
    parts().lags();
}

#[test]
fn the_boring_mills_gains_and_lags_are_those_of_its_calibration_day() {
    spindle().calibration();
    spindle().lags();
}

#[test]
fn the_rams_coefficients_are_those_of_its_calibration_day() {
    ram().calibration();
}

#[test]
fn the_jcs018as_coefficients_are_those_of_its_calibration_day() {
    jcs().calibration();
}

#[test]
fn the_screws_slope_and_lag_are_those_of_its_calibration_day() {
    screw().calibration();
    screw().lags();
}

#[test]
fn one_days_coefficients_hold_the_lathe_on_twenty_other_days() {
    lathe().twenty_days();
}

#[test]
fn one_days_coefficients_hold_the_parts_machine_on_twenty_other_days() {
    parts().twenty_days();
}

#[test]
fn one_days_coefficients_hold_the_boring_mill_on_twenty_other_days() {
    spindle().twenty_days();
}

#[test]
fn one_days_coefficients_hold_the_ram_on_twenty_other_days() {
    ram().twenty_days();
}

#[test]
fn one_days_coefficients_hold_the_jcs018a_on_twenty_other_days() {
    jcs().twenty_days();
}

#[test]
fn one_days_coefficients_hold_the_screw_on_twenty_other_days() {
    screw().twenty_days();
}
