//! Formatter for the rows of the decision log. It reuses one buffer, and does not access files.

use std::io::Write;

use crate::clock::Correction;
use isotherm_core::compensation::{Change, Control, Decision, Remembered, Snapshot};
use isotherm_core::quantity::{Moment, Shift, Shifted, time};
use isotherm_profile::log_columns::{
    ACTING, BEHIND, CLOCK, CORRECTION, DECIDED, DRY_RUN, EXPECTED, FORGET, FROM, MEASURED, MEMORY, OF_AXIS,
    PERMIT, PREFERRED, RETURN, RETURN_SLOPE, SIGN, SLOPE, SLOPE_FROM, STOOD_IN, TIME, TRUST, WORSE, ZERO,
};
use isotherm_profile::{Axis, Profile};

/// Converter from the steps of the axes (calculations of their Cz) to rows of the decision log.
#[derive(Clone, Debug)]
pub struct Recorder {
    /// Names of the models of each axis, as CSV cells.
    models: Vec<Vec<String>>,
    /// Whether the log has columns for a slope that the control applies, for each axis.
    apart: Vec<bool>,
    /// Whether errors of each axis are measured: the profile has a probe for the axis.
    probed: Vec<bool>,
    /// Whether a model of each axis calculates its expected error.
    expected: Vec<bool>,
    /// Whether the models of each axis may use stand-ins for frozen sensors.
    watched: Vec<bool>,
    /// Column of each axis for requests to change the preferred model.
    preferred: Vec<PreferredColumn>,
    /// Names of the signals, as CSV cells.
    signals: Vec<String>,
    memory: Option<String>,
    axes: Vec<String>,
    zeroed: Vec<(Moment, Option<usize>)>,
    /// Difference between the times in the file and the monotonic time of this run.
    shift: Shift,
    correction: Option<Correction>,
    /// Whether this is the log of a dry run, which writes no decision to a device.
    dry_run: bool,
    line: Vec<u8>,
}

/// State of the column for requests to change the preferred model of an axis.
#[derive(Clone, Debug, PartialEq, Eq)]
enum PreferredColumn {
    /// The axis does not learn, and the log has no such column.
    Absent,
    /// The axis had no such request since the last row.
    Empty,
    /// The next row must contain this request, as a CSV cell.
    Request(String),
}

impl PreferredColumn {
    fn of(axis: &Axis) -> PreferredColumn {
        if axis.settings.learned.is_some() { PreferredColumn::Empty } else { PreferredColumn::Absent }
    }
}

impl Recorder {
    /// Creates a recorder for the signals and axes of this profile.
    pub fn new(profile: &Profile) -> Recorder {
        let names = |axis: &Axis| axis.settings.models.iter().map(|model| cell(&model.name)).collect();
        let models = recorded(profile).map(names).collect();
        let apart = recorded(profile).map(|axis| axis.settings.intercept_slope.is_some()).collect();
        let probed = recorded(profile).map(|axis| axis.settings.probe.is_some()).collect();
        Recorder {
            models,
            apart,
            probed,
            expected: recorded(profile).map(Axis::says_how_wrong).collect(),
            watched: recorded(profile).map(is_watched).collect(),
            preferred: recorded(profile).map(PreferredColumn::of).collect(),
            signals: profile.signals.iter().map(|signal| cell(&signal.name)).collect(),
            memory: None,
            axes: recorded(profile).map(|axis| axis.settings.name.clone()).collect(),
            zeroed: Vec::new(),
            shift: Shift::default(),
            correction: None,
            dry_run: false,
            line: Vec::with_capacity(512),
        }
    }

    /// Sets whether the rows belong to a dry run.
    #[must_use]
    pub(in crate::gateway) fn of_dry_run(self, dry_run: bool) -> Recorder {
        Recorder { dry_run, ..self }
    }

    /// Returns the header of a decision log, with its line break.
    pub fn header(profile: &Profile) -> String {
        let mut header = TIME.to_owned();
        for signal in &profile.signals {
            header += ",";
            header += &cell(&signal.name);
        }
        for axis in recorded(profile) {
            let slope = axis.settings.intercept_slope.map(|_| [RETURN_SLOPE, SLOPE_FROM, SLOPE]);
            let probe = axis.settings.probe.map(|_| [MEASURED, ACTING, FORGET, WORSE, CORRECTION]);
            let expected = axis.says_how_wrong().then_some(EXPECTED);
            let stood_in = is_watched(axis).then_some([STOOD_IN, TRUST]);
            let more = slope.into_iter().flatten().chain(probe.into_iter().flatten());
            let preferred = axis.settings.learned.as_ref().map(|_| PREFERRED);
            let more = more.chain(expected).chain(stood_in.into_iter().flatten()).chain(preferred);
            for column in [PERMIT, FROM].into_iter().chain(DECIDED).chain([SIGN, BEHIND, RETURN]).chain(more)
            {
                debug_assert!(OF_AXIS.contains(&column), "OF_AXIS lacks {column}");
                header += ",";
                header += &cell(&format!("{}_{column}", axis.settings.name));
            }
        }
        header + "," + MEMORY + "," + ZERO + "," + CLOCK + "\n"
    }

    /// Returns the header of a dry run's log. An additional column shows that no Cz of the log was written to
    /// a device.
    pub(in crate::gateway) fn dry_header(profile: &Profile) -> String {
        format!("{},{DRY_RUN}\n", Recorder::header(profile).trim_end())
    }

    /// Sets the shift from monotonic time to the times of the file that begins now, and the correction of the clock
    /// before this file.
    pub(in crate::gateway) fn stamp_by(&mut self, shift: Shift, correction: Option<Correction>) {
        (self.shift, self.correction) = (shift, correction);
    }

    /// Marks the next row as the first row of a run or of a file. The row then also contains `remembered`, the saved
    /// state at this time.
    pub fn begin(&mut self, remembered: &Remembered) {
        self.memory =
            serde_json::to_string(&remembered.clone().shifted(self.shift)).ok().map(|json| cell(&json));
    }

    /// Records a zero command for the next log row. `axis` is `None` if the command applies to all references.
    pub fn zeroed(&mut self, at: Moment, axis: Option<usize>) {
        self.zeroed.push((at, axis));
    }

    /// Records a request to change the preferred model of an axis, for the next log row. A later request replaces an
    /// earlier one.
    pub fn preferred(&mut self, axis: usize, change: Option<&Change>) {
        let column = self.preferred.get_mut(axis).filter(|column| **column != PreferredColumn::Absent);
        if let (Some(column), Ok(json)) = (column, serde_json::to_string(&change)) {
            *column = PreferredColumn::Request(cell(&json));
        }
    }

    /// Returns the log row of a step of the axes, with its line break. Controls and decisions are in the order of the
    /// profile's axes.
    pub fn row<'a>(
        &mut self,
        snapshot: &Snapshot<'_>,
        controls: &[Control],
        decisions: impl IntoIterator<Item = &'a Decision>,
    ) -> &[u8] {
        self.line.clear();
        time::write(&mut self.line, snapshot.now.shifted(self.shift));
        for reading in snapshot.readings {
            optional(&mut self.line, reading.usable());
        }
        let axes =
            self.models.iter().zip(&self.apart).zip(&self.probed).zip(&self.expected).zip(&self.watched);
        let axes = axes.zip(&mut self.preferred);
        for ((control, decision), (((((models, apart), probed), expected), watched), preferred)) in
            controls.iter().zip(decisions).zip(axes)
        {
            let model = decision.model.and_then(|place| models.get(place)).map_or("", String::as_str);
            let line = &mut self.line;
            text(line, control.permit.name());
            optional(line, control.take_over.map(|found| found.get()));
            optional(line, decision.raw.map(|raw| raw.get()));
            optional(line, Some(decision.cz.get()));
            text(line, model);
            text(line, decision.state.name());
            // Writing to a vector never fails.
            let _ = write!(line, ",{}", decision.acted);
            optional(line, control.sign.map(|place| place.get()));
            optional(line, control.behind.map(|verified| verified.get()));
            optional(line, control.return_to.map(|to| to.cz.get()));
            if *apart {
                optional(line, control.return_to.map(|to| to.slope.get()));
                optional(line, control.take_over_slope.map(|found| found.get()));
                optional(line, Some(decision.slope.get()));
            }
            if *probed {
                let acting = control.measured.and_then(|measured| measured.acting);
                optional(line, control.measured.map(|measured| measured.error.get()));
                optional(line, acting.map(|acting| acting.get()));
                text(line, if control.forget { "1" } else { "" });
                text(line, if decision.worse.is_some() { "1" } else { "" });
                optional(line, Some(decision.correction.get()));
            }
            if *expected {
                optional(line, decision.expected.map(|expected| expected.get()));
            }
            if *watched {
                let signal = decision.stood_in.and_then(|found| self.signals.get(found.signal.0));
                text(line, signal.map_or("", String::as_str));
                text(line, if control.trust { "1" } else { "" });
            }
            match preferred {
                PreferredColumn::Absent => {}
                PreferredColumn::Empty => text(line, ""),
                PreferredColumn::Request(json) => {
                    text(line, json);
                    *preferred = PreferredColumn::Empty;
                }
            }
        }
        text(&mut self.line, self.memory.take().as_deref().unwrap_or_default());
        text(&mut self.line, "");
        for (place, (at, axis)) in self.zeroed.drain(..).enumerate() {
            if place > 0 {
                self.line.push(b';');
            }
            time::write(&mut self.line, at.shifted(self.shift));
            if let Some(name) = axis.and_then(|axis| self.axes.get(axis)) {
                self.line.push(b' ');
                self.line.extend_from_slice(name.as_bytes());
            }
        }
        text(&mut self.line, "");
        if let Some(correction) = self.correction.take() {
            let _ = write!(self.line, "{correction}");
        }
        if self.dry_run {
            text(&mut self.line, "1");
        }
        self.line.push(b'\n');
        &self.line
    }
}

/// Returns the axes that have columns in the log: those of the profile file. The additional axes of releases are only
/// in the output log.
fn recorded(profile: &Profile) -> impl Iterator<Item = &Axis> {
    profile.axes.iter().take(profile.compensated())
}

/// Returns whether a model of the axis detects frozen sensors.
fn is_watched(axis: &Axis) -> bool {
    axis.settings.models.iter().any(|model| model.stand_ins.is_some())
}

fn text(line: &mut Vec<u8>, text: &str) {
    line.push(b',');
    line.extend_from_slice(text.as_bytes());
}

fn optional(line: &mut Vec<u8>, value: Option<f64>) {
    line.push(b',');
    if let Some(value) = value {
        number(line, value);
    }
}

/// Appends the shortest text that gives the same number when it is parsed.
pub fn number(line: &mut Vec<u8>, value: f64) {
    let size = value.abs();
    let plain = (1e-6..1e17).contains(&size) || size.to_bits() == 0;
    // Writing to a vector never fails.
    let _ = if plain { write!(line, "{value}") } else { write!(line, "{value:e}") };
}

/// Formats a text as a CSV cell, with quotation marks if CSV requires them.
pub(super) fn cell(text: &str) -> String {
    if has_to_be_quoted(text) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text.to_owned()
}

pub(super) fn has_to_be_quoted(text: &str) -> bool {
    text.contains(['"', ',', '\n', '\r'])
}
