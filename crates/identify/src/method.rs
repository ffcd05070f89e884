//! Identification methods. Each method identifies a [`Learned`] model from some runs of a campaign.

use std::fmt;
use std::time::Duration;

use crate::bank::{Bank, Candidate, usual_lags};
use crate::campaign::Campaign;
use crate::gram::Gram;
use crate::learn::{Learned, Learner};
use trained::{Shape, Trained};

mod difference;
mod forward;
mod lag;
mod least_squares;
mod position;
mod ridge;
mod sparse;
pub(crate) mod stepwise;
mod trained;
mod two_source;
pub(crate) mod whitened;

/// Identification method. [`Method::ALL`] contains the description of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Mean of a ridge regression and an elastic net on whitened rows.
    #[default]
    Whitened,
    /// Mean of a forward search and an elastic net.
    SparseLag,
    /// Ridge regression with lags.
    RidgeLag,
    /// Stepwise regression by partial F tests.
    Stepwise,
    /// Ordinary least squares on the rises of all sensors, without lags.
    Ols,
    /// Sum of lagged terms, each with a fitted time constant.
    Lag,
    /// A constant part and a slope over a position.
    Position,
    /// Two sources of heat, identified one after the other.
    TwoSource,
    /// Difference of two sensors.
    Difference,
    /// Network of radial basis functions.
    Rbf,
    /// Network trained by back-propagation.
    Network,
    /// No model: the uncompensated machine, or a probe alone.
    None,
}

/// Options of the methods.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Method that identifies the model.
    pub method: Method,
    /// Time constants to try; empty for the default of the method.
    pub lags: Vec<Option<Duration>>,
    /// Maximum number of terms; `None` for the limit of the method.
    pub terms: Option<usize>,
    /// whitened: maximum number of sensors; `None` for no limit.
    pub sensors: Option<usize>,
    /// whitened: terms of an existing model, towards which the gains shrink (prior). `None` shrinks them towards zero.
    pub prior: Option<Vec<PriorTerm>>,
    /// two-source: runs in which only the first source of heat is active.
    pub waiting: Vec<String>,
    /// two-source: inputs of the first source of heat.
    pub first: Vec<String>,
    /// two-source: inputs of the second source of heat.
    pub second: Vec<String>,
    /// Time between independent samples. Partial F tests count one sample per this time, because closer rows are not
    /// independent.
    pub independent: Duration,
    /// rbf: number of radial basis functions.
    pub centres: usize,
    /// network: number of neurons.
    pub neurons: usize,
    /// rbf, network: seed of the random numbers. The same seed gives the same model.
    pub seed: u64,
}

/// Term of an existing model.
#[derive(Clone, Debug, PartialEq)]
pub struct PriorTerm {
    /// Name of the signal.
    pub signal: String,
    /// Time constant of the lag; `None` for no lag.
    pub lag: Option<Duration>,
    /// Whether the term uses the square of the reading.
    pub squared: bool,
    /// Gain in µm per unit, for Cz.
    pub gain: f64,
}

impl Default for Settings {
    fn default() -> Settings {
        Settings {
            method: Method::default(),
            lags: Vec::new(),
            terms: None,
            sensors: None,
            prior: None,
            waiting: Vec::new(),
            first: Vec::new(),
            second: Vec::new(),
            independent: Duration::from_secs(1800),
            centres: 20,
            neurons: 8,
            seed: 1,
        }
    }
}

impl Settings {
    /// Checks that the method supports each option that is set.
    ///
    /// # Errors
    /// Returns a message that names the option and the method.
    pub(crate) fn check(&self) -> Result<(), String> {
        use Method::{Lag, Network, Position, Rbf, RidgeLag, SparseLag, Stepwise, TwoSource, Whitened};
        let sources = [&self.waiting, &self.first, &self.second];
        let options: [(&str, bool, &[Method]); 5] = [
            ("--terms", self.terms.is_some(), &[SparseLag, Stepwise, Lag, Position]),
            ("--sensors", self.sensors.is_some(), &[Whitened]),
            ("--prior", self.prior.is_some(), &[Whitened]),
            (
                "--lags",
                !self.lags.is_empty(),
                &[Whitened, SparseLag, RidgeLag, Stepwise, Lag, Position, Rbf, Network],
            ),
            ("--waiting, --first, --second", sources.iter().any(|names| !names.is_empty()), &[TwoSource]),
        ];
        if let Some((option, _, takers)) =
            options.iter().find(|(_, asked, takers)| *asked && !takers.contains(&self.method))
        {
            let takers: Vec<&str> = takers.iter().map(|method| method.name()).collect();
            return Err(format!(
                "--method {} does not use {option}: leave this option out, or use {}",
                self.method,
                takers.join(", ")
            ));
        }
        if self.sensors.is_some() && self.prior.is_some() {
            return Err(
                "--sensors chooses sensors, but the model of --prior has its own: use only one of these \
                 options"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

impl Method {
    /// Every method, with its name on the command line and in JSON, and a description.
    pub const ALL: [(Method, &'static str, &'static str); 12] = [
        (
            Method::Whitened,
            "whitened",
            "The mean of a ridge and an elastic net on rows without their slow random drift",
        ),
        (
            Method::SparseLag,
            "sparse-lag",
            "Mean of a forward search and an elastic net on pairs of sensor and lag, tuned on held-out runs. \
             With --terms N, the forward search alone, with at most N pairs",
        ),
        (Method::RidgeLag, "ridge-lag", "Ridge regression on every sensor through every lag"),
        (
            Method::Stepwise,
            "stepwise",
            "Pairs of sensor and lag, added and removed stepwise by partial F tests",
        ),
        (Method::Ols, "ols", "Least squares on the rises of all sensors, without lags"),
        (Method::Lag, "lag", "One time constant for each of a few sensors, fitted (Janeczko 1989)"),
        (
            Method::Position,
            "position",
            "Terms of Cz and of its slope over --position, chosen on held-out runs (Li et al. 1998)",
        ),
        (
            Method::TwoSource,
            "two-source",
            "--first sensors from the --waiting runs, --second sensors from the residual error of the others \
             (Tachiya et al. 2013)",
        ),
        (
            Method::Difference,
            "difference",
            "One gain for the difference of two sensors, and each of them alone with the time since machine start (JP H07-61598 B2)",
        ),
        (Method::Rbf, "rbf", "Radial basis functions around --centres points that k-means finds"),
        (
            Method::Network,
            "network",
            "A network of --neurons in one layer, trained by back-propagation until the error of held-out days \
             is smallest",
        ),
        (Method::None, "none", "No model: the uncompensated machine, or a probe alone"),
    ];

    /// Returns the name on the command line and in JSON.
    pub fn name(self) -> &'static str {
        Method::ALL.iter().find(|(method, ..)| *method == self).map_or("", |(_, name, _)| *name)
    }

    /// Returns whether the method shrinks or selects gains. The standard errors of the gains then follow from their
    /// spread between fits, because no formula gives them.
    pub(super) fn is_penalized(self) -> bool {
        matches!(self, Method::Whitened | Method::SparseLag | Method::RidgeLag | Method::Position)
    }

    /// Returns the method of the fallback model for a lost sensor: this method, used without that sensor. For a
    /// network, it is a linear method, because a network is least reliable on unknown days.
    pub(super) fn stand_in(self) -> Method {
        match self {
            Method::Rbf | Method::Network => Method::Whitened,
            own => own,
        }
    }

    /// Combines the method with the data.
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

/// Columns of the bank, with their gains.
type Gains = Vec<(usize, f64)>;

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Linear method that needs only the Gram products of each run, not its rows. The arguments are the products by run,
/// the training runs, and the columns that the method may use.
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
