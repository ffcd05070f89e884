//! The table of touches, and its rounds.

use super::{BadLog, DIRECTIONS, Dataset};
use isotherm_core::quantity::Moment;

/// One ball, touched once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Touch {
    pub(super) time: Moment,
    pub(super) ball: f64,
    pub(super) at_mm: [f64; 3],
    /// NaN where it is not told.
    pub(super) stylus_mm: f64,
}

impl Touch {
    /// The same ball with the same stylus.
    pub(super) fn is_like(&self, other: &Touch) -> bool {
        let same = |one: f64, other: f64| (one - other).abs() < 1e-6 || (one.is_nan() && other.is_nan());
        same(self.ball, other.ball) && same(self.stylus_mm, other.stylus_mm)
    }
}

/// Every ball once, or as often as the column `round` says.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Round {
    pub(super) touches: Vec<Touch>,
}

impl Round {
    /// The mean time of its touches.
    pub(super) fn time(&self) -> Moment {
        let nanos: u128 = self.touches.iter().map(|touch| u128::from(touch.time.as_nanos())).sum();
        let count = u128::try_from(self.touches.len()).unwrap_or(1).max(1);
        Moment::from_nanos(u64::try_from(nanos / count).unwrap_or(u64::MAX))
    }
}

/// A new round begins where `round` changes; without that column, where a ball comes up again.
pub(super) fn rounds(dataset: &Dataset) -> Result<Vec<Round>, BadLog> {
    let mut wrong = Vec::new();
    let mut needed = |name: &str, what: &str| {
        let place = dataset.column(name);
        if place.is_none() {
            let names: Vec<&str> = dataset.columns.iter().map(|column| column.name.as_str()).collect();
            wrong.push(format!(
                "there is no column `{name}` {what}; columns of numbers are {}",
                names.join(", ")
            ));
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
            let of = |column: usize| run.values[column][row];
            let touch = Touch {
                time: *time,
                ball: of(ball),
                at_mm: [of(x), of(y), of(z)],
                stylus_mm: stylus.map_or(f64::NAN, of),
            };
            if touch.ball.is_nan() || touch.at_mm.iter().any(|place| place.is_nan()) {
                wrong.push(format!(
                    "{}, touch {}: a cell is empty; leave out the whole touch, or fill it",
                    run.file.display(),
                    row + 1
                ));
                continue;
            }
            let own = number.map_or(f64::NAN, of);
            let goes_on = |(before, round): &&mut (f64, Round)| match number {
                Some(_) => (*before - own).abs() < 1e-9,
                None => !round.touches.iter().any(|other| other.is_like(&touch)),
            };
            match rounds.last_mut().filter(goes_on) {
                Some((_, round)) => round.touches.push(touch),
                None => rounds.push((own, Round { touches: vec![touch] })),
            }
        }
    }
    if wrong.is_empty() {
        Ok(rounds.into_iter().map(|(_, round)| round).collect())
    } else {
        Err(BadLog(wrong))
    }
}
