//! `two-source`: Cz = Cw + Ch, Tachiya et al. 2013. The compensation value Cz is the sum of the effects of
//! two sources of heat. In some runs only the first source is active, because the spindle does not turn. Cw
//! is identified from these runs and the sensors of the first source. Ch is identified from the residual of
//! Cw in the other runs and the sensors of the second source.

use super::Settings;
use crate::campaign::Campaign;
use crate::gram::{Gains, Gram};
use crate::solve::ridge;

pub(super) struct TwoSource {
    waiting: Vec<usize>,
    first: Vec<usize>,
    second: Vec<usize>,
}

impl TwoSource {
    /// Finds the runs and the inputs whose names are in the settings. The index of an input is also the index of its
    /// column in the matrix of candidate terms, because this method uses no lags.
    pub(super) fn new(campaign: &Campaign<'_>, settings: &Settings) -> Result<TwoSource, String> {
        let runs: Vec<&str> = campaign.dataset.runs.iter().map(|run| run.name.as_str()).collect();
        let inputs: Vec<&str> = campaign.inputs.iter().map(|input| input.name.as_str()).collect();
        let waiting = places("--waiting", "run", &settings.waiting, &runs)?;
        if waiting.len() < 2 || waiting.len() == runs.len() {
            return Err(format!(
                "the method two-source needs at least two runs in which the spindle does not turn, and others in \
                 which it turns. Write the names of the runs without a turning spindle after --waiting, \
                 separated by commas. The runs are {}",
                runs.join(", ")
            ));
        }
        Ok(TwoSource {
            waiting,
            first: places("--first", "input", &settings.first, &inputs)?,
            second: places("--second", "input", &settings.second, &inputs)?,
        })
    }

    pub(super) fn fit(&self, grams: &[Gram], runs: &[usize], columns: &[usize]) -> Result<Gains, String> {
        let may = |list: &[usize]| -> Vec<usize> {
            list.iter().copied().filter(|column| columns.contains(column)).collect()
        };
        let (first, second) = (may(&self.first), may(&self.second));
        let (waiting, working): (Vec<usize>, Vec<usize>) =
            runs.iter().copied().partition(|run| self.waiting.contains(run));
        if waiting.is_empty() || working.is_empty() {
            return Err(
                "the method two-source needs at least two runs with a turning spindle and two without, because each \
                 run is held out in turn"
                    .to_owned(),
            );
        }
        let by_first = ridge(&Gram::sum(grams, &waiting), &first, 0.0);
        let mut rest = Gram::sum(grams, &working);
        let mut gains: Vec<(usize, f64)> = first.iter().copied().zip(by_first.iter().copied()).collect();
        for (column, gain) in &gains {
            let taken = rest.square.column(*column).into_owned();
            rest.cross.axpy(-gain, &taken, 1.0);
        }
        for (column, gain) in second.iter().zip(ridge(&rest, &second, 0.0).iter()) {
            match gains.iter_mut().find(|(known, _)| known == column) {
                // A sensor of both sources has one term with the sum.
                Some((_, sum)) => *sum += gain,
                None => gains.push((*column, *gain)),
            }
        }
        Ok(gains)
    }
}

fn places(option: &str, what: &str, names: &[String], known: &[&str]) -> Result<Vec<usize>, String> {
    if names.is_empty() {
        return Err(format!(
            "the method two-source needs the option {option} with at least one {what} of {}",
            known.join(", ")
        ));
    }
    let place = |name: &String| {
        let found = known.iter().position(|other| other == name);
        found.ok_or_else(|| format!("{option}: there is no {what} `{name}`; there are {}", known.join(", ")))
    };
    names.iter().map(place).collect()
}
