//! Options of the identification methods.

use std::time::Duration;

use super::Method;

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
    /// Whether the input of the term is the square of the reading.
    pub squared: bool,
    /// Gain of the term for Cz, in µm per unit of the input.
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
