//! True state of each axis of the virtual machine: the error, the applied Cz, and the residual error.

use std::time::Duration;

use isotherm_core::quantity::Moment;

/// Time from the start of the run to the first sample. The first minute of the run is left out, because the gateway is
/// still being set up.
const FIRST_SAMPLE: Duration = Duration::from_secs(60);

/// True error and applied Cz of one axis at one time, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisTruth {
    /// True error without compensation, µm.
    pub error_um: f64,
    /// Cz that acts in the machine, µm.
    pub cz_um: f64,
}

/// True errors and applied Cz of all axes at one time, in the order of [`Summary::axes`].
#[derive(Clone, Debug, PartialEq)]
pub struct TruthRow {
    /// Time of the sample.
    pub at: Moment,
    /// Values of each axis whose true error is known.
    pub axes: Vec<AxisTruth>,
}

/// Smallest and largest value of an error during a run, µm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Smallest value.
    pub min_um: f64,
    /// Largest value.
    pub max_um: f64,
}

/// Results of one axis over a whole run. Both extents use the same samples: one each second, from the first minute on.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisSummary {
    /// Name of the axis in the profile.
    pub axis: String,
    /// Number of samples in each of the two extents.
    pub samples: u64,
    /// Range of the error without compensation.
    pub uncompensated: Extent,
    /// Range of the residual error, that is, with compensation.
    pub compensated: Extent,
}

/// Summary of a run: the errors of each axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Summary of each axis whose true error is known; empty without a plant.
    pub axes: Vec<AxisSummary>,
}

impl AxisTruth {
    /// Returns the residual error, µm: error + Cz.
    pub fn residual_um(self) -> f64 {
        self.error_um + self.cz_um
    }
}

impl Extent {
    const NOTHING: Extent = Extent { min_um: f64::INFINITY, max_um: f64::NEG_INFINITY };

    /// Returns the largest minus the smallest value, µm; zero before the first sample.
    pub fn range_um(self) -> f64 {
        (self.max_um - self.min_um).max(0.0)
    }

    fn take(&mut self, value: f64) {
        self.min_um = self.min_um.min(value);
        self.max_um = self.max_um.max(value);
    }
}

/// Collector of the true errors during a run: for the summary, and as rows for the charts.
#[derive(Clone, Debug)]
pub(super) struct Observer {
    begin: Moment,
    pub(super) summary: Summary,
    pub(super) latest: Option<TruthRow>,
    /// True errors at intervals of ten seconds, until [`Window::take_course`](super::Window::take_course) removes them.
    pub(super) course: Vec<TruthRow>,
}

/// Interval of the rows in `course`.
const ROW_EVERY: Duration = Duration::from_secs(10);
/// Maximum number of rows in `course`, so that memory stays limited if no program reads the rows.
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
