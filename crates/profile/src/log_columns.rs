//! Names of the columns of a log. A signal or an axis must not have such a name. Otherwise a log would
//! contain two columns with the same name, and no program could read that log.

use std::collections::BTreeMap;

use isotherm_core::quantity::TimeColumns;

/// First column of every log.
pub const TIME: &str = "time";

/// Permission of the axis to decide and write its Cz (compensation value): off, armed, unverified, held or
/// stopping.
pub const PERMIT: &str = "permit";
/// Cz in the register, from which the axis resumed at this row, µm.
pub const FROM: &str = "from_um";
/// Cz that the model requests, µm.
pub const RAW: &str = "raw_um";
/// Cz of the axis, µm.
pub const CZ: &str = "cz_um";
/// Model in use.
pub const MODEL: &str = "model";
/// State of the axis.
pub const STATE: &str = "state";
/// Limits that changed the Cz, for example `step`.
pub const ACTED: &str = "acted";
/// Target of Cz while the sign of the axis is checked with a dial gauge, µm.
pub const SIGN: &str = "sign_um";
/// Verified Cz of the output register that differs most from the decided Cz, µm.
pub const BEHIND: &str = "behind_um";
/// Cz to which an axis on hold returns because the settings of a sensor were changed, µm.
pub const RETURN: &str = "return_um";
/// Slope to which an axis on hold returns because the settings of a sensor were changed; unit as for
/// [`SLOPE`]. Only for a slope that the control applies.
pub const RETURN_SLOPE: &str = "return_slope_um";
/// Slope in the register, from which the axis resumed; unit as for [`SLOPE`]. Only for a slope that the
/// control applies.
pub const SLOPE_FROM: &str = "slope_from_um";
/// Decided slope, as its effect at the axis's largest distance from the reference position, µm. Only for a
/// slope that the control applies.
pub const SLOPE: &str = "slope_um";
/// Error that a probe has measured, µm. Only for an axis with a probe, like the next four columns.
pub const MEASURED: &str = "measured_um";
/// Cz that acted during the measurement, µm.
pub const ACTING: &str = "acting_um";
/// 1 if the correction from measured errors was discarded.
pub const FORGET: &str = "forget";
/// 1 while probings show that the axis is worse with its model than without compensation.
pub const WORSE: &str = "worse";
/// Correction that the measured errors add to the Cz of the model, µm.
pub const CORRECTION: &str = "correction_um";
/// Expected residual error as one standard deviation, µm. Only for a model that calculates it.
pub const EXPECTED: &str = "expected_um";
/// Sensor of the model in use whose reading is replaced by a stand-in (an estimate from other sensors). Only
/// for an axis whose models have stand-ins.
pub const STOOD_IN: &str = "stood_in";
/// 1 if the operator has disarmed the axis, so that its sensors are accepted again. Only for an axis whose models have
/// stand-ins.
pub const TRUST: &str = "trust";
/// Request to change the preferred model, as JSON. Only for an axis that learns a model.
pub const PREFERRED: &str = "preferred";

/// Columns of the decision of an axis, in their order.
pub const DECIDED: [&str; 5] = [RAW, CZ, MODEL, STATE, ACTED];

/// Name endings of the columns of an axis. For example, `z_cz_um` is the Cz of axis `z`. A log has some of
/// these columns only if the axis has certain keys. The list does not contain `error_um`, the measured error
/// in a log of another program, because a signal that measures the error may have its name.
pub const OF_AXIS: [&str; 22] = [
    PERMIT,
    FROM,
    RAW,
    CZ,
    MODEL,
    STATE,
    ACTED,
    SIGN,
    BEHIND,
    RETURN,
    RETURN_SLOPE,
    SLOPE_FROM,
    SLOPE,
    MEASURED,
    ACTING,
    FORGET,
    WORSE,
    CORRECTION,
    EXPECTED,
    STOOD_IN,
    TRUST,
    PREFERRED,
];

/// Saved state with which the run or the file begins, as JSON. Later rows have it only after a start of the gateway.
pub const MEMORY: &str = "machine_memory";
/// Times of the zero commands since the row before, separated by semicolons. If a command concerns one axis only, the
/// name of the axis follows its time.
pub const ZERO: &str = "machine_zero";
/// Correction of the computer's clock. It is filled only in the first row of a file that begins after a correction.
pub const CLOCK: &str = "machine_clock";
/// 1 in each row. Only the log of a dry run has this column.
pub const DRY_RUN: &str = "machine_dry_run";

/// Columns of the whole machine.
pub const OF_MACHINE: [&str; 4] = [MEMORY, ZERO, CLOCK, DRY_RUN];

/// Name of a signal or an axis that would give the log two columns of the same name, or a column of the wrong meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Clash {
    /// The signal has the name of the first column, or of a column of the whole machine.
    OfMachine { signal: String },
    /// The signal has the name of a column of an axis.
    OfAxis { signal: String, axis: String },
    /// The signal has a name, such as `datum`, that a reader of logs takes for a column of dates.
    OfDates { signal: String },
    /// The axis has a column with the same name as a column of an earlier axis.
    Axes { axis: String, other: String, column: String },
}

/// Finds the names of signals and axes that clash with the names of other columns. Clashes of signals come first.
pub(crate) fn clashes(signals: &[String], axes: &[String]) -> Vec<Clash> {
    let mut owners: BTreeMap<String, &String> = BTreeMap::new();
    let mut between = Vec::new();
    for axis in axes {
        let mut reported = false;
        for end in OF_AXIS {
            let column = format!("{axis}_{end}");
            match owners.get(&column) {
                Some(other) if !reported => {
                    reported = true;
                    let (axis, other) = (axis.clone(), (*other).clone());
                    between.push(Clash::Axes { axis, other, column });
                }
                Some(_) => {}
                None => {
                    owners.insert(column, axis);
                }
            }
        }
    }
    let of_signal = |signal: &String| {
        if signal == TIME || OF_MACHINE.contains(&signal.as_str()) {
            return Some(Clash::OfMachine { signal: signal.clone() });
        }
        match owners.get(signal) {
            Some(axis) => Some(Clash::OfAxis { signal: signal.clone(), axis: (*axis).clone() }),
            None => is_of_dates(signal).then(|| Clash::OfDates { signal: signal.clone() }),
        }
    };
    signals.iter().filter_map(of_signal).chain(between).collect()
}

/// Returns whether a reader of logs takes a column with this name, such as `datum`, for a column of dates.
fn is_of_dates(name: &str) -> bool {
    TimeColumns::find(&[TIME.to_owned(), name.to_owned()], None).is_some_and(|found| found.date.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(signals: &[&str], axes: &[&str]) -> Vec<Clash> {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        clashes(&owned(signals), &owned(axes))
    }

    #[test]
    fn each_column_of_a_log_is_refused_as_the_name_of_a_signal() {
        for column in [TIME].into_iter().chain(OF_MACHINE) {
            assert_eq!(found(&["bed", column], &["z"]), [Clash::OfMachine { signal: column.to_owned() }]);
        }
        for end in OF_AXIS {
            let signal = format!("z_{end}");
            let clash = Clash::OfAxis { signal: signal.clone(), axis: "z".to_owned() };
            assert_eq!(found(&["bed", &signal], &["x", "z"]), [clash]);
        }
    }

    #[test]
    fn a_column_of_dates_is_refused_as_the_name_of_a_signal() {
        for signal in ["date", "Date", "datum", "fecha"] {
            let clash = Clash::OfDates { signal: signal.to_owned() };
            assert_eq!(found(&["bed", signal], &["z"]), [clash]);
        }
        assert_eq!(found(&["datum_face", "time_s", "timestamp", "update"], &["z"]), []);
    }

    #[test]
    fn other_names_are_free() {
        let signals = ["bed", "machine_on", "bed_state", "z", "cz_um", "z_error_um", "Z_state", "z_state_2"];
        assert_eq!(found(&signals, &["x", "z"]), []);
        assert_eq!(found(&["z_state"], &[]), []);
    }

    #[test]
    fn two_axes_with_one_column_are_reported_once() {
        let clash = Clash::Axes {
            axis: "z_return".to_owned(),
            other: "z".to_owned(),
            column: "z_return_slope_um".to_owned(),
        };
        assert_eq!(found(&[], &["z", "z_return"]), [clash]);
    }
}
