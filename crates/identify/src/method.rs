//! Identification methods. Each method identifies a [`Learned`] model from some runs of a campaign.

use crate::bank::{Bank, Candidate, usual_lags};
use crate::campaign::Campaign;
use crate::gram::{Gains, Gram};
use crate::learn::{Learned, Learner};
use trained::{Shape, Trained};

mod difference;
mod forward;
mod kind;
mod lag;
mod least_squares;
mod position;
mod ridge;
mod settings;
mod sparse;
pub(crate) mod stepwise;
mod trained;
mod two_source;
pub(crate) mod whitened;

pub use kind::Method;
pub use settings::{PriorTerm, Settings};

impl Method {
    /// Combines the method with the data of a campaign (logged runs), from which the method identifies
    /// models.
    ///
    /// # Errors
    /// Returns a message if the campaign or the settings do not fit the method.
    pub(crate) fn prepare<'a>(
        self,
        campaign: &'a Campaign<'a>,
        settings: &Settings,
    ) -> Result<Box<dyn Learner + 'a>, String> {
        let Settings { terms, centres, neurons, .. } = *settings;
        let rows_per_sample = campaign.rows_per_sample(settings.independent);
        let lags = match settings.lags.as_slice() {
            [] if self == Method::Whitened => whitened::usual_lags(),
            [] => usual_lags(),
            named => named.to_vec(),
        };
        let lagged = || Bank::of(campaign, &lags);
        let plain = || Bank::of(campaign, &[None]);
        let trained = |shape| Trained::new(campaign, settings, shape);
        let (bank, rule): (Bank, Rule) = match self {
            Method::Lag => return Ok(Box::new(lag::Lagging::new(campaign, lagged(), terms))),
            Method::Whitened => {
                return Ok(Box::new(whitened::Whitening::new(campaign, &lags, settings)?));
            }
            Method::Rbf => return Ok(Box::new(trained(Shape::Radial(centres))?)),
            Method::Network => return Ok(Box::new(trained(Shape::Neurons(neurons))?)),
            Method::SparseLag => {
                (lagged(), Box::new(move |grams, runs, may| Ok(sparse::fit(grams, runs, may, terms))))
            }
            Method::RidgeLag => (lagged(), Box::new(|grams, runs, may| Ok(ridge::fit(grams, runs, may)))),
            Method::Stepwise => {
                let most = terms.unwrap_or(usize::MAX);
                let rule = move |grams: &[Gram], runs: &[usize], may: &[usize]| {
                    Ok(stepwise::fit(&Gram::sum(grams, runs), rows_per_sample, may, most))
                };
                (lagged(), Box::new(rule))
            }
            Method::Position => (
                position::bank(campaign, &lags)?,
                Box::new(move |grams, runs, may| Ok(position::fit(grams, runs, may, terms))),
            ),
            Method::Ols => {
                (plain(), Box::new(|grams, runs, may| least_squares::fit(&Gram::sum(grams, runs), may)))
            }
            Method::Difference => {
                (plain(), Box::new(|grams, runs, may| difference::fit(&Gram::sum(grams, runs), may)))
            }
            Method::TwoSource => {
                let sources = two_source::TwoSource::new(campaign, settings)?;
                (plain(), Box::new(move |grams, runs, may| sources.fit(grams, runs, may)))
            }
            Method::None => (plain(), Box::new(|_, _, _| Ok(Gains::new()))),
        };
        Ok(Box::new(OnBank { grams: bank.grams(), bank, rule }))
    }
}

/// Linear method that needs only the Gram products of each run, not its rows. The arguments are the products of all
/// runs, the indices of the training runs, and the columns that the method may use.
type Rule = Box<dyn Fn(&[Gram], &[usize], &[usize]) -> Result<Gains, String> + Sync>;

struct OnBank {
    bank: Bank,
    grams: Vec<Gram>,
    rule: Rule,
}

impl Learner for OnBank {
    fn bank(&self) -> &Bank {
        &self.bank
    }

    fn learn(&self, runs: &[usize], without: &[usize]) -> Result<Learned, String> {
        let may = |(_, candidate): &(usize, &Candidate)| !without.contains(&candidate.input);
        let columns: Vec<usize> =
            self.bank.candidates.iter().enumerate().filter(may).map(|(place, _)| place).collect();
        let gains = (self.rule)(&self.grams, runs, &columns)?;
        let gains = gains.into_iter().map(|(column, gain)| (self.bank.candidates[column], gain));
        Ok(Learned::Sum(gains.collect()))
    }
}
