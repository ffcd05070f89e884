//! Gram products (X'X, X'y, y'y) of runs, stored in files. A fleet is a group of machines of the same type. The
//! products of all runs of a fleet are added, and a model is identified from the sums, without the records (logs).
//!
//! ```text
//! machine 1:  records ── RunProducts::of ── file ──┐
//! machine 2:  records ── RunProducts::of ── file ──┴── add ── learn ── FleetModel ── block
//! ```
//! The method `whitened` needs only the sums of products of a run's columns: less than 100 kB for sixteen sensors,
//! whatever the length of the run. The sums depend only on the run. Therefore a model from stored products is exactly
//! equal to a model from the records. The only exception is a faulty sensor that was repaired with data from other
//! runs.
//!
//! Products do not contain the values of individual rows. Therefore no range of the error, no envelope (valid
//! range of the inputs), and no stand-ins for lost sensors can be calculated.

use std::time::Duration;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::bank::{Bank, Candidate};
use crate::gram::Gram;
use crate::identified::TermFound;
use crate::method::whitened::{Fitted, fit, usual_lags};
use crate::method::{Method, PriorTerm, Settings};
use crate::products::Products;
use crate::setup::Ready;
use crate::written;
use isotherm_profile::duration_text;
use isotherm_profile::sha256;

const FORMAT: &str = "isotherm-products";
/// Comment in the TOML text of a model that was identified from products. It names the missing parts of the model.
pub(crate) const NO_VALUES: &str =
    "# No envelope and no stand-ins: products do not contain the values of the inputs.\n";
const VERSION: u64 = 1;

/// Gram products (X'X, X'y, y'y) of the runs of one or more machines, with the settings under which they were
/// calculated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunProducts {
    axis: String,
    /// Averaging time of the references, s. A reference is a value that is subtracted from a signal.
    settle_s: f64,
    /// Time over which log rows were averaged, s.
    resample_s: f64,
    columns: Vec<Column>,
    runs: Vec<Run>,
}

/// Column of the matrix X of the products: a signal with a lag, or the square of such a signal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Column {
    signal: String,
    unit: String,
    lag_s: f64,
    squared: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Run {
    machine: String,
    run: String,
    plain: Sums,
    white: Sums,
}

/// Gram products over the rows of a run: the lower triangle of X'X row by row, X'y, y'y, and the number of rows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sums {
    square: Vec<f64>,
    cross: Vec<f64>,
    power: f64,
    rows: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u64,
    /// SHA-256 of `products` as JSON without spaces.
    sha256: String,
    products: RunProducts,
}

/// First keys of a products file, which identify the file format. They are decoded before the other keys, because a
/// file of another version may have different keys.
#[derive(Deserialize)]
struct Head {
    format: Option<String>,
    version: Option<u64>,
}

/// Model that was identified from several runs. Its Cz (compensation value) is the sum of its terms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetModel {
    /// Name of the axis in the profiles.
    pub axis: String,
    /// Terms of the model, in the order of the columns of the products.
    pub terms: Vec<FleetTerm>,
    /// Number of runs from which the model was identified.
    pub from_runs: usize,
    /// Error of each run with models that were identified without this run; empty if no run was held out.
    pub runs: Vec<RunLeft>,
    settle_s: f64,
}

/// One term of a [`FleetModel`]: its input and its gain.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FleetTerm {
    /// Name of the signal in the profiles.
    pub signal: String,
    /// Unit of the signal. The gain is in µm per this unit, or per the square of this unit if `squared` is true.
    pub unit: String,
    /// Time constant, s; 0 means no lag.
    pub lag_s: f64,
    /// Whether the input is the square of the signal.
    pub squared: bool,
    /// Gain of the term: its contribution to Cz, in µm per unit of the input. Cz is the negative error.
    pub gain: f64,
    /// Gains of the two models whose mean is `gain`: the ridge regression, and the elastic net. `None` if there are
    /// only one or two runs, because then the model is a ridge regression alone.
    pub halves: Option<[f64; 2]>,
}

/// Error of a run without compensation, and with models that were identified without this run. All errors are root mean
/// squares in µm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunLeft {
    /// Name of the machine.
    pub machine: String,
    /// Name of the run.
    pub run: String,
    /// Error of the run without compensation.
    pub uncompensated_rms_um: f64,
    /// Error of the run with a model from all other runs; `None` if there are no other runs.
    pub rms_um: Option<f64>,
    /// Error of the run with a model from the runs of the other machines; `None` if there are no other machines.
    pub other_machines_rms_um: Option<f64>,
}

impl RunProducts {
    /// Calculates the Gram products of each run of a campaign. `machine` is the name of the machine, which
    /// distinguishes its runs from the runs of other machines.
    ///
    /// # Errors
    /// Returns a message if a run has no complete row, or if `settings` is not supported. The method must be
    /// `whitened`, without a limit on the number of sensors, and without a prior (existing model).
    pub fn of(ready: &Ready<'_>, machine: &str, settings: &Settings) -> Result<RunProducts, String> {
        settings.check()?;
        if settings.method != Method::Whitened || settings.sensors.is_some() || settings.prior.is_some() {
            return Err(
                "products can only be calculated for the method whitened, without --sensors and without \
                 --prior: leave these options out"
                    .to_owned(),
            );
        }
        let lags = if settings.lags.is_empty() { usual_lags() } else { settings.lags.clone() };
        let campaign = &ready.campaign;
        let bank = Bank::with_speeds(campaign, &lags, std::iter::empty());
        bank.check_rows("every sensor", "the sensor")?;
        let column = |candidate: &Candidate| {
            let input = &campaign.inputs[candidate.input];
            Column {
                signal: input.name.clone(),
                unit: input.unit.0.to_owned(),
                lag_s: candidate.lag.map_or(0.0, |lag| lag.as_secs_f64()),
                squared: candidate.squared,
            }
        };
        let products = Products::of(&bank);
        let runs = products.each().zip(&bank.runs).map(|((plain, white), run)| Run {
            machine: machine.to_owned(),
            run: run.name.clone(),
            plain: Sums::of(plain),
            white: Sums::of(white),
        });
        Ok(RunProducts {
            axis: ready.axis.clone(),
            settle_s: campaign.machine.settle.as_secs_f64(),
            resample_s: campaign.resample.as_secs_f64(),
            columns: bank.candidates.iter().map(column).collect(),
            runs: runs.collect(),
        })
    }

    /// Returns the content of a products file: JSON, with a SHA-256 hash of the products.
    ///
    /// # Errors
    /// Returns a message if a number cannot be written as JSON.
    pub fn to_json(&self) -> Result<String, String> {
        let file = File {
            format: FORMAT.to_owned(),
            version: VERSION,
            sha256: self.seal()?,
            products: self.clone(),
        };
        serde_json::to_string(&file).map_err(|why| why.to_string())
    }

    /// Reads the content of a products file.
    ///
    /// # Errors
    /// Returns a message if the file is invalid or was changed.
    pub fn from_json(bytes: &[u8]) -> Result<RunProducts, String> {
        let head: Head = serde_json::from_slice(bytes).map_err(|why| {
            format!(
                "the file does not contain run products (Gram products of runs, format \"{FORMAT}\"): {why}"
            )
        })?;
        if head.format.as_deref() != Some(FORMAT) {
            return Err(format!(
                "the file does not contain run products (Gram products of runs): its format is not \"{FORMAT}\""
            ));
        }
        if head.version != Some(VERSION) {
            return Err(format!(
                "the file was written by another version of isotherm: this program can only read run products of \
                 version {VERSION}. Create the file again"
            ));
        }
        let file: File = serde_json::from_slice(bytes).map_err(|why| {
            format!(
                "the file does not contain run products (Gram products of runs, format \"{FORMAT}\"): {why}"
            )
        })?;
        if file.sha256 != file.products.seal()? {
            return Err(
                "the checksum is wrong: the file was changed or damaged; make the products from the records \
                 again"
                    .to_owned(),
            );
        }
        let width = file.products.columns.len();
        let is_right = |run: &Run| run.plain.has(width) && run.white.has(width);
        match file.products.runs.iter().find(|run| !is_right(run)) {
            Some(run) => Err(format!(
                "the products of run {} have a wrong number of columns: make the products from the records \
                 again",
                run.run
            )),
            None => Ok(file.products),
        }
    }

    fn seal(&self) -> Result<String, String> {
        serde_json::to_vec(self).map(|bytes| sha256(&bytes)).map_err(|why| why.to_string())
    }

    /// Returns the machine and the name of each run.
    pub fn runs(&self) -> impl ExactSizeIterator<Item = (&str, &str)> {
        self.runs.iter().map(|run| (run.machine.as_str(), run.run.as_str()))
    }

    /// Adds the runs of another file. The order of its columns does not matter.
    ///
    /// # Errors
    /// Returns a message if the columns differ, or if a run is in both files. In that case, nothing is added.
    pub fn add(&mut self, other: &RunProducts) -> Result<(), String> {
        self.fits(other)?;
        let place = |column: &Column| other.columns.iter().position(|own| own == column);
        let places: Vec<usize> = self.columns.iter().filter_map(place).collect();
        let in_order = |sums: &Sums| Sums::of(&sums.gram().of_columns(&places));
        self.runs.extend(other.runs.iter().map(|run| Run {
            plain: in_order(&run.plain),
            white: in_order(&run.white),
            ..run.clone()
        }));
        Ok(())
    }

    /// Checks that the sums of the two files can be added. Axis, averaging times and columns must be equal, and no run
    /// may be in both files.
    fn fits(&self, other: &RunProducts) -> Result<(), String> {
        let (own, others) = (self.machines(), other.machines());
        if self.axis != other.axis {
            return Err(format!(
                "the products of {own} belong to axis {}, but those of {others} to axis {}. Use only products \
                 of one axis, because a model compensates one axis",
                self.axis, other.axis
            ));
        }
        for (what, own_s, other_s) in [
            ("the averaging time of the references (machine.settle) is", self.settle_s, other.settle_s),
            ("the averaging time of the rows (--resample) is", self.resample_s, other.resample_s),
        ] {
            if own_s.to_bits() != other_s.to_bits() {
                return Err(format!(
                    "{what} {own_s} s in the products of {own}, but {other_s} s in the products of {others}: \
                     make all products with the same time"
                ));
            }
        }
        for ((one, columns), (another, theirs)) in [
            ((&own, &self.columns), (&others, &other.columns)),
            ((&others, &other.columns), (&own, &self.columns)),
        ] {
            let lacking = columns.iter().filter(|column| !theirs.contains(column));
            let lacking: Vec<String> = lacking.map(Column::shown).collect();
            if let Some(first) = lacking.first() {
                let more = match lacking.len() {
                    1 => String::new(),
                    all => format!(" and {} more", all - 1),
                };
                return Err(format!(
                    "the products of {one} have the column {first}{more}, but those of {another} do not. All \
                     machines of a fleet need the same signals, units and lags"
                ));
            }
        }
        let twice = other.runs().find(|run| self.runs().any(|own| own == *run));
        match twice {
            Some((machine, run)) => {
                Err(format!("run {run} of {machine} is in both files: a run may occur only once"))
            }
            None => Ok(()),
        }
    }

    fn machines(&self) -> String {
        let mut names: Vec<&str> = self.runs().map(|(machine, _)| machine).collect();
        names.dedup();
        names.join(", ")
    }

    /// Returns the Gram products of all runs: of their plain rows, and of their whitened rows (without slow random
    /// drift).
    fn products(&self) -> Products {
        let grams = |of: fn(&Run) -> &Sums| self.runs.iter().map(|run| of(run).gram()).collect();
        Products::kept(grams(|run| &run.plain), grams(|run| &run.white))
    }

    /// Identifies a model from all runs by the method `whitened`. The last run has the weight 1. Each earlier run has
    /// `forgetting` times the weight of the run after it. No run is held out, so the result contains no residual
    /// errors.
    ///
    /// In the choice of a penalty, each held-out run counts with the mean of its squared residuals. A run with eight
    /// touches therefore counts as much as a run with five hundred rows.
    pub(crate) fn learn_recent(&self, forgetting: f64) -> FleetModel {
        let newest = self.runs.len().saturating_sub(1);
        let weight = |run: usize| {
            let age = i32::try_from(newest.saturating_sub(run)).unwrap_or(i32::MAX);
            forgetting.powi(age)
        };
        let runs = || self.runs.iter().enumerate();
        let plain =
            runs().map(|(place, run)| run.plain.gram().faded(weight(place) / run.plain.rows.max(1.0)));
        let white = runs().map(|(place, run)| run.white.gram().faded(weight(place)));
        let products = Products::kept(plain.collect(), white.collect());
        let (all, every) =
            ((0..self.runs.len()).collect::<Vec<_>>(), (0..self.columns.len()).collect::<Vec<_>>());
        self.model(fit(&products, &all, &every, &self.bank()), Vec::new())
    }

    /// Returns whether the two products were calculated for the same axis, with the same columns and averaging times.
    pub(crate) fn is_like(&self, other: &RunProducts) -> bool {
        self.axis == other.axis
            && self.columns == other.columns
            && self.settle_s.to_bits() == other.settle_s.to_bits()
            && self.resample_s.to_bits() == other.resample_s.to_bits()
    }

    /// Returns whether the two products were calculated from the same rows, even if the names of the runs differ.
    pub(crate) fn has_same_rows(&self, other: &RunProducts) -> bool {
        let own = self.runs.iter().map(|run| (&run.plain, &run.white));
        self.is_like(other) && own.eq(other.runs.iter().map(|run| (&run.plain, &run.white)))
    }

    /// Returns the sum of squared residuals of a model over the rows of all these runs, µm².
    pub(crate) fn left(&self, model: &FleetModel) -> f64 {
        let gain = |column: &Column| {
            let same = |term: &&FleetTerm| {
                term.signal == column.signal
                    && term.lag_s.to_bits() == column.lag_s.to_bits()
                    && term.squared == column.squared
            };
            model.terms.iter().find(same).map_or(0.0, |term| term.gain)
        };
        let gains = DVector::from_iterator(self.columns.len(), self.columns.iter().map(gain));
        self.runs.iter().map(|run| run.plain.gram().left(&gains)).sum()
    }

    /// Identifies a model from all runs by the method `whitened`. Penalties are chosen on held-out runs. The result
    /// also contains the error of each run with models that were identified without this run.
    pub fn learn(&self) -> FleetModel {
        let products = self.products();
        let bank = self.bank();
        let every: Vec<usize> = (0..self.columns.len()).collect();
        let learnt = |runs: &[usize]| fit(&products, runs, &every, &bank);
        let all: Vec<usize> = (0..self.runs.len()).collect();
        let left = |out: usize| {
            let run = &self.runs[out];
            let rms = |power: f64| (power / run.plain.rows.max(1.0)).sqrt();
            let left = |learns: &dyn Fn(usize) -> bool| {
                let from: Vec<usize> = all.iter().copied().filter(|run| learns(*run)).collect();
                let gains = (!from.is_empty()).then(|| learnt(&from).gains)?;
                Some(rms(products.plain(&[out]).left(&DVector::from_vec(gains))))
            };
            RunLeft {
                machine: run.machine.clone(),
                run: run.run.clone(),
                uncompensated_rms_um: rms(run.plain.power),
                rms_um: left(&|other| other != out),
                other_machines_rms_um: left(&|other| self.runs[other].machine != run.machine),
            }
        };
        self.model(learnt(&all), all.iter().map(|run| left(*run)).collect())
    }

    fn model(&self, fitted: Fitted, runs: Vec<RunLeft>) -> FleetModel {
        let Fitted { gains, halves } = fitted;
        let term = |(place, (column, gain)): (usize, (&Column, f64))| FleetTerm {
            signal: column.signal.clone(),
            unit: column.unit.clone(),
            lag_s: column.lag_s,
            squared: column.squared,
            gain,
            halves: halves.as_ref().and_then(|halves| halves.get(place).copied()),
        };
        FleetModel {
            axis: self.axis.clone(),
            terms: self.columns.iter().zip(gains).enumerate().map(term).collect(),
            from_runs: self.runs.len(),
            runs,
            settle_s: self.settle_s,
        }
    }

    /// Returns a matrix of candidate terms with the columns of the products, but without any rows.
    fn bank(&self) -> Bank {
        let mut signals: Vec<&str> = Vec::new();
        let mut is_speed = Vec::new();
        let mut candidates = Vec::new();
        for column in &self.columns {
            let known = signals.iter().position(|name| *name == column.signal);
            let input = known.unwrap_or(signals.len());
            if known.is_none() {
                signals.push(&column.signal);
                is_speed.push(column.is_speed());
            }
            let lag = Duration::try_from_secs_f64(column.lag_s).ok().filter(|lag| !lag.is_zero());
            candidates.push(Candidate { squared: column.squared, ..Candidate::new(input, lag) });
        }
        Bank { candidates, is_speed, runs: Vec::new() }
    }
}

impl Column {
    fn is_speed(&self) -> bool {
        self.unit == "rpm"
    }

    fn shown(&self) -> String {
        let square = if self.squared { "²" } else { "" };
        let lag = Duration::try_from_secs_f64(self.lag_s).unwrap_or_default();
        let lag = match lag.is_zero() {
            true => "without lag".to_owned(),
            false => format!("with a lag of {}", duration_text(lag)),
        };
        format!("{}{square} ({}) {lag}", self.signal, self.unit)
    }
}

impl Sums {
    fn of(gram: &Gram) -> Sums {
        let width = gram.cross.len();
        let square = (0..width).flat_map(|row| (0..=row).map(move |column| gram.square[(row, column)]));
        Sums {
            square: square.collect(),
            cross: gram.cross.as_slice().to_vec(),
            power: gram.power,
            rows: gram.rows,
        }
    }

    /// Returns whether the sums have the correct lengths for `width` columns (terms).
    fn has(&self, width: usize) -> bool {
        self.cross.len() == width && self.square.len() == width * (width + 1) / 2
    }

    fn gram(&self) -> Gram {
        let width = self.cross.len();
        let place = |row: usize, column: usize| {
            let (low, high) = (row.min(column), row.max(column));
            self.square.get(high * (high + 1) / 2 + low).copied().unwrap_or_default()
        };
        Gram {
            square: DMatrix::from_fn(width, width, place),
            cross: DVector::from_column_slice(&self.cross),
            power: self.power,
            rows: self.rows,
        }
    }
}

impl FleetModel {
    /// Returns the model as TOML text for a profile: an `[[axis.….model]]` table with comments.
    #[must_use]
    pub fn block(&self) -> String {
        let runs = self.from_runs;
        let head = format!("# Cz = −e, identified from the products of {runs} runs.\n{NO_VALUES}");
        self.block_of("fleet", &head, "")
    }

    /// Returns the terms of the model as a prior, towards which another model can be identified.
    pub(crate) fn prior(&self) -> Vec<PriorTerm> {
        let term = |term: &FleetTerm| PriorTerm {
            signal: term.signal.clone(),
            lag: Duration::try_from_secs_f64(term.lag_s).ok().filter(|lag| !lag.is_zero()),
            squared: term.squared,
            gain: term.gain,
        };
        self.terms.iter().map(term).collect()
    }

    /// Returns the model as TOML text for a profile. `name` is the name of the model, and `head` is the
    /// comment before the table. `keys` contains further keys at the end of the table.
    pub(crate) fn block_of(&self, name: &str, head: &str, keys: &str) -> String {
        let term = |term: &FleetTerm| TermFound {
            signal: term.signal.clone(),
            lag_s: term.lag_s,
            gain: term.gain,
            unit: String::new(),
            se: None,
            largest_um: 0.0,
            inflation: None,
            slope: false,
            squared: term.squared,
            is_speed: term.unit == "rpm",
        };
        let terms: Vec<TermFound> = self.terms.iter().map(term).collect();
        format!(
            "{head}# {}\n[[axis.{}.model]]\nname = \"{name}\"\n{}\n{}\n{keys}",
            written::zero_needs(&self.axis),
            self.axis,
            written::sum(&terms, None),
            written::identified_with(self.settle_s)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Run with one sensor. `rows`: number of rows of which the run consists, each of the same kind.
    fn run(name: &str, gain: f64, rows: f64) -> Run {
        let sums = |rows: f64| Sums {
            square: vec![rows, 0.3 * rows, 2.0 * rows],
            cross: vec![gain * rows, 0.3 * gain * rows],
            power: gain * gain * rows,
            rows,
        };
        // The whitened rows have the same number in each run, so that only the plain ones differ.
        Run { machine: "m".to_owned(), run: name.to_owned(), plain: sums(rows), white: sums(8.0) }
    }

    fn learned(rows: [f64; 4]) -> FleetModel {
        let column =
            |lag_s| Column { signal: "t1".to_owned(), unit: "degC".to_owned(), lag_s, squared: false };
        let gains = [1.0, 1.4, 0.7, 2.5];
        let runs = gains.iter().zip(rows).enumerate();
        let products = RunProducts {
            axis: "z".to_owned(),
            settle_s: 180.0,
            resample_s: 60.0,
            columns: vec![column(0.0), column(360.0)],
            runs: runs.map(|(place, (gain, rows))| run(&format!("r{place}"), *gain, rows)).collect(),
        };
        products.learn_recent(0.9)
    }

    #[test]
    fn a_held_out_run_counts_by_its_mean_square_whatever_its_number_of_rows() {
        let gains = |model: FleetModel| model.terms.iter().map(|term| term.gain).collect::<Vec<f64>>();
        let even = gains(learned([8.0; 4]));
        assert!(even.iter().any(|gain| gain.abs() > 0.1), "{even:?}");
        assert_eq!(even, gains(learned([512.0, 512.0, 512.0, 8.0])));
        assert_eq!(even, gains(learned([512.0, 64.0, 8.0, 8.0])));
    }
}
