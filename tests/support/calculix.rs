//! References of CalculiX for tests: its stored figures, and the program itself if it is installed. Some Debian
//! releases do not have it. The script `tests/calculix/ccx` returns the stored figures, and describes how to write them
//! again.

use std::process::Command;

use crate::support::tell;

/// Relative tolerance. CalculiX prints seven digits.
pub(crate) const AGREED: f64 = 1e-6;

const KEPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/calculix/ccx");
const MADE_BY: &str = include_str!("../calculix/figures/made-by");

/// Source of reference figures, and the program that returns them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Referee {
    pub(crate) name: &'static str,
    pub(crate) program: &'static str,
}

/// Stored figures, and CalculiX if it is installed. If it is not, a line with the question is printed.
pub(crate) fn referees(question: &str) -> Vec<Referee> {
    let kept = Referee { name: "the kept figures of CalculiX", program: KEPT };
    let live = Referee { name: "CalculiX", program: "ccx" };
    if Command::new(live.program).arg("-v").output().is_ok() {
        return vec![kept, live];
    }
    tell(&format!("CalculiX is not here: {question}: compared with KEPT figures ({})", MADE_BY.trim()));
    vec![kept]
}

/// Answer of each source. Fails if CalculiX gives other figures than the stored ones.
pub(crate) fn answers(question: &str, ask: impl Fn(Referee) -> Vec<f64>) -> Vec<(&'static str, Vec<f64>)> {
    let answers: Vec<_> =
        referees(question).into_iter().map(|referee| (referee.name, ask(referee))).collect();
    if let [(_, kept), (_, live)] = &answers[..] {
        let apart = relative(kept, live);
        let made_by = MADE_BY.trim();
        assert!(
            apart < AGREED,
            "{question}: the kept figures ({made_by}) are {apart:e} apart from what CalculiX gives here: {KEPT} says how to write them anew"
        );
    }
    answers
}

/// Relative difference of two lists, with respect to the first.
pub(crate) fn relative(own: &[f64], other: &[f64]) -> f64 {
    assert_eq!(own.len(), other.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
    let apart = square(&mut own.iter().zip(other).map(|(own, other)| own - other));
    (apart / square(&mut own.iter().copied())).sqrt()
}
