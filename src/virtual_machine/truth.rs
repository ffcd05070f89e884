//! What really happens to the tool: each axis's error, what is applied against it, and what is left.

use std::time::Duration;

use isotherm_core::quantity::Moment;

/// Samples begin this long after the run: the warm-up with its transient belongs to them, the setting up does not.
const FIRST_SAMPLE: Duration = Duration::from_secs(60);

/// One axis at one moment, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisTruth {
    /// Without compensation.
    pub error_um: f64,
    /// The Cz that stands in the machine.
    pub cz_um: f64,
}

/// All axes at one moment, in the order of [`Summary::axes`].
#[derive(Clone, Debug, PartialEq)]
pub struct TruthRow {
    /// When.
    pub at: Moment,
    /// One for each axis the plant knows the true error of.
    pub axes: Vec<AxisTruth>,
}

/// Smallest and largest value of a run, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Smallest.
    pub min_um: f64,
    /// Largest.
    pub max_um: f64,
}

/// The whole run of one axis. Both extents are over the same samples: one a second, from the first minute on.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSummary {
    /// Its name in the profile.
    pub axis: String,
    /// How many samples.
    pub samples: u64,
    /// The error alone.
    pub uncompensated: Extent,
    /// The error and what was applied against it.
    pub compensated: Extent,
}

/// The whole run.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// One for each axis the plant knows the true error of; none without a plant.
    pub axes: Vec<AxisSummary>,
}

impl AxisTruth {
    /// What is left: error + Cz.
    pub fn residual_um(self) -> f64 {
        self.error_um + self.cz_um
    }
}

impl Extent {
    const NOTHING: Extent = Extent { min_um: f64::INFINITY, max_um: f64::NEG_INFINITY };

    /// Largest minus smallest; zero before the first sample.
    pub fn range_um(self) -> f64 {
        (self.max_um - self.min_um).max(0.0)
    }

    fn take(&mut self, value: f64) {
        self.min_um = self.min_um.min(value);
        self.max_um = self.max_um.max(value);
    }
}

/// Gathers samples into a summary.
#[derive(Clone, Debug)]
pub(super) struct Observer {
    begin: Moment,
    pub(super) summary: Summary,
    pub(super) latest: Option<TruthRow>,
    /// Some of the rows, until somebody takes them.
    pub(super) course: Vec<TruthRow>,
}

/// The course has a row this often.
const ROW_EVERY: Duration = Duration::from_secs(10);
/// Nobody takes it where it is as long as this.
const LONGEST_COURSE: usize = 10_000;

impl Observer {
    pub(super) fn new<'a>(axes: impl IntoIterator<Item = &'a String>, begin: Moment) -> Observer {
        let axes = axes.into_iter().map(|axis| AxisSummary {
            axis: axis.clone(),
            samples: 0,
            uncompensated: Extent::NOTHING,
            compensated: Extent::NOTHING,
        });
        Observer { begin, summary: Summary { axes: axes.collect() }, latest: None, course: Vec::new() }
    }

    pub(super) fn sample(&mut self, row: TruthRow) {
        if row.at.since(self.begin) >= FIRST_SAMPLE {
            for (axis, truth) in self.summary.axes.iter_mut().zip(&row.axes) {
                axis.samples += 1;
                axis.uncompensated.take(truth.error_um);
                axis.compensated.take(truth.residual_um());
            }
        }
        let lasts = row.at.since(self.begin).as_secs();
        if lasts.is_multiple_of(ROW_EVERY.as_secs()) && self.course.len() < LONGEST_COURSE {
            self.course.push(row.clone());
        }
        self.latest = Some(row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_extents_are_over_the_same_samples_and_the_transient_is_among_them() {
        let begin = Moment::from_nanos(0);
        let mut observer = Observer::new([&"z".to_owned()], begin);
        for (second, error_um, cz_um) in
            [(59, 100.0, 0.0), (60, -4.0, 0.0), (61, -5.0, 4.5), (120, -20.0, 19.0)]
        {
            let axes = vec![AxisTruth { error_um, cz_um }];
            observer.sample(TruthRow { at: begin.after(Duration::from_secs(second)), axes });
        }
        let z = &observer.summary.axes[0];
        assert_eq!((z.axis.as_str(), z.samples), ("z", 3));
        assert_eq!(z.uncompensated, Extent { min_um: -20.0, max_um: -4.0 });
        assert_eq!(z.compensated, Extent { min_um: -4.0, max_um: -0.5 });
        assert!((z.compensated.range_um() - 3.5).abs() < 1e-12);
    }

    #[test]
    fn a_run_without_samples_has_no_range() {
        let observer = Observer::new([&"z".to_owned()], Moment::from_nanos(0));
        assert!(observer.summary.axes[0].compensated.range_um() < 1e-12);
    }
}
