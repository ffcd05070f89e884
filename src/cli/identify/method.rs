//! The methods as the command line names and explains them.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use isotherm_identify::method::Method;

#[derive(Clone, Copy, Debug)]
pub(super) struct MethodWord(pub(super) Method);

impl ValueEnum for MethodWord {
    fn value_variants<'a>() -> &'a [MethodWord] {
        const ALL: [MethodWord; 11] = [
            MethodWord(Method::SparseLag),
            MethodWord(Method::RidgeLag),
            MethodWord(Method::Stepwise),
            MethodWord(Method::Ols),
            MethodWord(Method::Lag),
            MethodWord(Method::Position),
            MethodWord(Method::TwoSource),
            MethodWord(Method::Difference),
            MethodWord(Method::Rbf),
            MethodWord(Method::Network),
            MethodWord(Method::None),
        ];
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let help = match self.0 {
            Method::SparseLag => {
                "Some of (sensor, lag), chosen on runs that were left out; with --terms N at most so many"
            }
            Method::RidgeLag => "Ridge regression on every sensor through every lag",
            Method::Stepwise => "Stepwise over (sensor, lag) by partial F tests, in and out",
            Method::Ols => "Least squares on the rises of all sensors, without lags",
            Method::Lag => "One time constant for each of a few sensors, fitted (Janeczko 1989)",
            Method::Position => {
                "Terms of Cz and of its slope over --position, chosen on runs that were left out (Li et al. 1998)"
            }
            Method::TwoSource => {
                "--first sensors from the --waiting runs, --second sensors from what is left on the others (Tachiya et al. 2013)"
            }
            Method::Difference => {
                "One gain for the difference of two sensors, and each of them alone with machine-on time (JP H07-61598 B2)"
            }
            Method::Rbf => "Radial basis functions about --centres that k-means finds",
            Method::Network => {
                "A network of --neurons in one layer, by back-propagation that stops where days left out say so"
            }
            Method::None => "No model: the bare machine, or a probe alone",
        };
        Some(PossibleValue::new(self.0.name()).help(help))
    }
}
