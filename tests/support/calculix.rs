//! CalculiX as tests ask it: by the figures that it once gave, kept beside this file, and the program itself where it is there. Debian
//! does not have it in every release. `ccx` in this folder says how the figures are written anew.

use std::process::Command;

use crate::support::tell;

/// It prints seven digits.
pub(crate) const AGREED: f64 = 1e-6;

const KEPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/calculix/ccx");
const MADE_BY: &str = include_str!("../calculix/figures/made-by");

/// Who answers for CalculiX, and the program that does.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Referee {
    pub(crate) name: &'static str,
    pub(crate) program: &'static str,
}

/// The kept figures, and CalculiX where it is there. Where it is not, that is told to whoever reads on, with the question.
pub(crate) fn referees(question: &str) -> Vec<Referee> {
    let kept = Referee { name: "the kept figures of CalculiX", program: KEPT };
    let live = Referee { name: "CalculiX", program: "ccx" };
    if Command::new(live.program).arg("-v").output().is_ok() {
        return vec![kept, live];
    }
    tell(&format!("CalculiX is not here: {question}: compared with KEPT figures ({})", MADE_BY.trim()));
    vec![kept]
}

/// What each referee answers. Where CalculiX no longer gives what is kept of it, this fails.
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

/// How far apart two lists are, as a part of the first.
pub(crate) fn relative(own: &[f64], other: &[f64]) -> f64 {
    assert_eq!(own.len(), other.len());
    let square = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
    let apart = square(&mut own.iter().zip(other).map(|(own, other)| own - other));
    (apart / square(&mut own.iter().copied())).sqrt()
}
