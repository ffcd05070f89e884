//! Options of the identification methods.

use std::time::Duration;

use super::Method;

/// Options of the identification methods. If an option applies to one method only, its comment names that method.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Method by which the model is identified.
    pub method: Method,
    /// Time constants of the lags that the method tries; empty for the default of the method.
    pub lags: Vec<Option<Duration>>,
    /// Maximum number of terms in the model; `None` for the default limit of the method.
    pub terms: Option<usize>,
    /// Method `whitened`: maximum number of sensors; `None` for no limit.
    pub sensors: Option<usize>,
    /// Method `whitened`: terms of an existing model (prior), towards which the gains shrink. `None` shrinks them
    /// towards zero.
    pub prior: Option<Vec<PriorTerm>>,
    /// Method `two-source`: names of the runs in which only the first source of heat is active.
    pub waiting: Vec<String>,
    /// Method `two-source`: names of the sensors for the first source of heat.
    pub first: Vec<String>,
    /// Method `two-source`: names of the sensors for the second source of heat.
    pub second: Vec<String>,
    /// Minimum time between rows that count as independent samples. Partial F tests count one sample per this time,
    /// because closer rows depend on each other.
    pub independent: Duration,
    /// Method `rbf`: number of radial basis functions.
    pub centres: usize,
    /// Method `network`: number of neurons.
    pub neurons: usize,
    /// Methods `rbf` and `network`: seed of the random numbers. The same seed gives the same model.
    pub seed: u64,
}

/// Term of an existing model (prior).
#[derive(Clone, Debug, PartialEq)]
pub struct PriorTerm {
    /// Name of the signal.
    pub signal: String,
    /// Time constant of the lag; `None` for no lag.
    pub lag: Option<Duration>,
    /// Whether the input of the term is the square of the signal.
    pub squared: bool,
    /// Gain: contribution of the term to Cz (the compensation value), in µm per unit of the input.
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
                "--sensors selects sensors, but the model of --prior already has its own sensors: use only \
                 one of these options"
                    .to_owned(),
            );
        }
        Ok(())
    }
}
