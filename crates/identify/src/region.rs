//! Envelope of a model: the region of the input values in the logs from which the model was identified. The gateway
//! checks whether the inputs are inside.

use nalgebra::{DMatrix, DVector};
use serde::{Serialize, Serializer};
use serde_json::{Value, json};

use crate::bank::{Bank, Candidate};
use crate::campaign::Campaign;
use crate::statistics::{count, least_and_most};
use isotherm_core::compensation::model::envelope::MOST;

/// Region of the rises of the inputs over all runs. A rise is the value of an input minus its reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Name, mean rise, smallest rise and largest rise of each input.
    pub inputs: Vec<(String, f64, f64, f64)>,
    covariance: DMatrix<f64>,
    /// Largest Mahalanobis distance of the rises from their mean in any row of the logs.
    reach: f64,
}

impl Serialize for Region {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.file().serialize(serializer)
    }
}

/// Share by which each variance is increased, so that the covariance matrix of two equal sensors has an inverse.
const LOOSENED: f64 = 1e-6;

impl Region {
    /// Calculates the region of these inputs. Speeds are not part of the region. `None` if there are no inputs, if
    /// there are too many for an envelope, or if one input is constant.
    pub(crate) fn of(campaign: &Campaign<'_>, bank: &Bank, inputs: &[usize]) -> Option<Region> {
        // Speeds are left out: a speed above the known range shows in the temperatures.
        let inputs: Vec<usize> =
            inputs.iter().copied().filter(|input| !campaign.inputs[*input].is_speed()).collect();
        if inputs.is_empty() || inputs.len() > MOST {
            return None;
        }
        let own;
        let bank = if inputs.iter().all(|input| bank.plain(*input).is_some()) {
            bank
        } else {
            // With `--lags`, the bank may not contain the rises without lag.
            own = Bank::new(campaign, inputs.iter().map(|input| Candidate::new(*input, None)).collect());
            &own
        };
        let columns = inputs.iter().map(|input: &usize| Some(bank.rises(bank.plain(*input)?)));
        let columns: Vec<Vec<f64>> = columns.collect::<Option<_>>()?;
        let row = |row: usize| DVector::from_fn(columns.len(), |place, _| columns[place][row]);
        let rows: Vec<DVector<f64>> = (0..columns[0].len()).map(row).collect();
        let total = count(rows.len());
        let mean = rows.iter().fold(DVector::zeros(inputs.len()), |sum, row| sum + row) / total.max(1.0);
        let mut covariance = rows.iter().fold(DMatrix::zeros(inputs.len(), inputs.len()), |sum, row| {
            let apart = row - &mean;
            sum + &apart * apart.transpose()
        }) / total.max(1.0);
        for place in 0..inputs.len() {
            covariance[(place, place)] *= 1.0 + LOOSENED;
        }
        let factors = covariance.clone().cholesky()?;
        let distance = |row: &DVector<f64>| {
            let apart = row - &mean;
            apart.dot(&factors.solve(&apart)).max(0.0).sqrt()
        };
        let reach = rows.iter().map(distance).fold(0.0, f64::max);
        let named = inputs.iter().zip(&columns).zip(mean.iter()).map(|((input, column), mean)| {
            let (low, high) = least_and_most(column).filter(|(low, high)| low < high)?;
            Some((campaign.inputs[*input].name.clone(), *mean, low, high))
        });
        Some(Region { inputs: named.collect::<Option<_>>()?, covariance, reach })
    }

    /// Returns the content of the envelope file in JSON.
    pub(crate) fn file(&self) -> Value {
        let inputs: Vec<Value> = (self.inputs.iter())
            .map(|(signal, mean, min, max)| {
                json!({ "signal": signal, "reference": "start", "mean": mean, "min": min, "max": max })
            })
            .collect();
        let rows: Vec<Vec<f64>> =
            self.covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
        // Slightly more than the distance of the farthest row, which was part of the identification.
        let reach = self.reach * (1.0 + 1e-9);
        json!({ "format": "isotherm-envelope", "version": 1, "reach": reach, "inputs": inputs, "covariance": rows })
    }
}
