//! Table of ball touches, and its division into rounds. In a round, the probe touches each ball of the array.

use super::DIRECTIONS;
use crate::dataset::{BadLog, Dataset};
use isotherm_core::quantity::Moment;

/// One touch of a ball by the probe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Touch {
    pub(super) time: Moment,
    pub(super) ball: f64,
    pub(super) at_mm: [f64; 3],
    /// Stylus length, mm; NaN if the file of touches has no column for it.
    pub(super) stylus_mm: f64,
}

impl Touch {
    /// Returns whether the two touches have the same ball and the same stylus length.
    pub(super) fn is_like(&self, other: &Touch) -> bool {
        let same = |one: f64, other: f64| (one - other).abs() < 1e-6 || (one.is_nan() && other.is_nan());
        same(self.ball, other.ball) && same(self.stylus_mm, other.stylus_mm)
    }
}

/// Touches of one round. If the file of touches has no column `round`, no ball occurs twice with the same stylus
/// length.
pub(super) type Round = Vec<Touch>;

/// Returns the mean time of the touches of a round.
pub(super) fn time(round: &[Touch]) -> Moment {
    let nanos: u128 = round.iter().map(|touch| u128::from(touch.time.as_nanos())).sum();
    let mean = nanos / (round.len() as u128).max(1);
    Moment::from_nanos(u64::try_from(mean).unwrap_or(u64::MAX))
}

/// Divides the table into rounds. A new round begins when the column `round` changes. Without that column, a new round
/// begins when a ball occurs again with the same stylus length. Returns an error if a column is missing, or if a cell
/// of a touch is empty.
pub(super) fn rounds(dataset: &Dataset) -> Result<Vec<Round>, BadLog> {
    let mut wrong = Vec::new();
    let mut needed = |name: &str, what: &str| {
        let place = dataset.column(name);
        if place.is_none() {
            let names = dataset.names().join(", ");
            wrong.push(format!("there is no column `{name}` {what}; the columns with numbers are {names}"));
        }
        place
    };
    let ball = needed("ball", "with the number of the ball, 1, 2, 3 along the array");
    let axes = DIRECTIONS.map(|axis| needed(&format!("{axis}_mm"), "with the ball's coordinate in mm"));
    let (Some(ball), [Some(x), Some(y), Some(z)]) = (ball, axes) else { return Err(BadLog(wrong)) };
    let (stylus, number) = (dataset.column("stylus_mm"), dataset.column("round"));
    let mut rounds: Vec<(f64, Round)> = Vec::new();
    for run in &dataset.runs {
        for (row, time) in run.times.iter().enumerate() {
            let of = |column: usize| run.values[column].at(row);
            let at_mm = [x, y, z].map(of);
            let stylus_mm = stylus.map_or(f64::NAN, of);
            let touch = Touch { time: *time, ball: of(ball), at_mm, stylus_mm };
            if touch.ball.is_nan() || at_mm.iter().any(|place| place.is_nan()) {
                wrong.push(format!(
                    "{}, touch {}: a cell is empty; fill this cell, or delete the whole row",
                    run.file.display(),
                    row + 1
                ));
                continue;
            }
            let own = number.map_or(f64::NAN, of);
            let continues = |(before, round): &&mut (f64, Round)| match number {
                Some(_) => (*before - own).abs() < 1e-9,
                None => !round.iter().any(|other| other.is_like(&touch)),
            };
            match rounds.last_mut().filter(continues) {
                Some((_, round)) => round.push(touch),
                None => rounds.push((own, vec![touch])),
            }
        }
    }
    BadLog::unless(wrong, rounds.into_iter().map(|(_, round)| round).collect())
}
