//! Names and properties of the identification methods.

use std::fmt;

/// Identification method. [`Method::ALL`] contains the description of each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Method {
    /// Mean of a ridge regression and an elastic net on whitened log rows (rows from which their slow random drift is
    /// removed).
    #[default]
    Whitened,
    /// Mean of a forward search and an elastic net on pairs of sensor and lag.
    SparseLag,
    /// Ridge regression on all sensors, each with every lag.
    RidgeLag,
    /// Stepwise regression: terms are added and removed by partial F tests.
    Stepwise,
    /// Ordinary least squares on the rises of all sensors, without lags.
    Ols,
    /// Sum of lagged terms, each with a fitted time constant.
    Lag,
    /// Terms of Cz (the compensation value) and of its slope over a position.
    Position,
    /// Two sources of heat, which are identified one after the other.
    TwoSource,
    /// Difference of two sensors, multiplied by one gain.
    Difference,
    /// Network of radial basis functions, which are Gaussian functions around centres.
    Rbf,
    /// Network with one layer of neurons, trained by back-propagation.
    Network,
    /// No model: results of the uncompensated machine, or of a probe alone.
    None,
}

impl Method {
    /// All methods. Each item is the method, its name on the command line and in JSON, and its description.
    pub const ALL: [(Method, &'static str, &'static str); 12] = [
        (
            Method::Whitened,
            "whitened",
            "Mean of a ridge regression and an elastic net on log rows from which the slow random drift is \
             removed",
        ),
        (
            Method::SparseLag,
            "sparse-lag",
            "Mean of a forward search and an elastic net over pairs of sensor and lag, tuned on held-out \
             runs. With --terms N, only the forward search is used, with at most N pairs",
        ),
        (Method::RidgeLag, "ridge-lag", "Ridge regression on every sensor through every lag"),
        (
            Method::Stepwise,
            "stepwise",
            "Stepwise regression: partial F tests add and remove pairs of sensor and lag",
        ),
        (Method::Ols, "ols", "Ordinary least squares on the rises of all sensors, without lags"),
        (
            Method::Lag,
            "lag",
            "A few sensors, each with one fitted gain and one fitted time constant (Janeczko 1989)",
        ),
        (
            Method::Position,
            "position",
            "Terms of a constant part and of a slope over the axis position --position, chosen on held-out \
             runs (Li et al. 1998)",
        ),
        (
            Method::TwoSource,
            "two-source",
            "Two sources of heat. The sensors after --first are fitted to the runs after --waiting, those \
             after --second to the residual error of the other runs (Tachiya et al. 2013)",
        ),
        (
            Method::Difference,
            "difference",
            "One gain for the temperature difference of two sensors. If one sensor fails, the other sensor is \
             used with the time since machine start (JP H07-61598 B2)",
        ),
        (
            Method::Rbf,
            "rbf",
            "Radial basis functions around points that k-means finds; --centres sets their number",
        ),
        (
            Method::Network,
            "network",
            "Network with one layer of neurons (their number is --neurons), trained by back-propagation until \
             the error of held-out days is smallest",
        ),
        (
            Method::None,
            "none",
            "No model: shows the error of the uncompensated machine, or the error with a probe alone",
        ),
    ];

    /// Returns the name of the method on the command line and in JSON.
    pub fn name(self) -> &'static str {
        Method::ALL.iter().find(|(method, ..)| *method == self).map_or("", |(_, name, _)| *name)
    }

    /// Returns whether the method fits gains with a penalty. No formula gives the standard errors of such
    /// gains. They are calculated from the spread of the gains between fits.
    pub(crate) fn is_penalized(self) -> bool {
        matches!(self, Method::Whitened | Method::SparseLag | Method::RidgeLag | Method::Position)
    }

    /// Returns the method that identifies the fallback model for a lost sensor. For the network methods `rbf`
    /// and `network`, the result is the linear method `whitened`, because a network is less reliable on
    /// unknown days. For every other method, the result is the same method.
    pub(crate) fn stand_in(self) -> Method {
        match self {
            Method::Rbf | Method::Network => Method::Whitened,
            own => own,
        }
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
