//! Model `δ = P·ΔT`: the displacement of a guideway at the position of the axis. The blocks are parts of the
//! structure with one temperature each, and ΔT are their temperature rises. The project calls this model M11.
//! Its source is JP 6507619 B2 (JTEKT).
//!
//! P comes from a finite-element model of the structure. The matrix here contains only the component that acts on the
//! axis, as gains of Cz. Between two points of the guideway, Cz is interpolated linearly. Beyond an end, Cz keeps its
//! value at the end, and [`Evaluate::coverage`] reports this.

use super::{
    Beyond, Coverage, Evaluate, Extrapolation, Input, Inputs, Lag, Outputs, Outside, Rises, Unusable,
};
use crate::compensation::Snapshot;
use crate::quantity::{MicronPerCelsius, Millimetre};
use crate::reading::SignalId;

/// Model of a guideway: a gain of Cz for each point of the guideway and each block of the structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrix {
    source: String,
    inputs: Vec<Input>,
    position: SignalId,
    guide: Vec<Millimetre>,
    gains: Vec<MicronPerCelsius>,
}

impl Matrix {
    /// Creates a matrix. `inputs`: temperature rises of the blocks, parts of the structure with one temperature each.
    /// `position`: signal of the axis position in mm. `guide`: points of the guideway, ascending. `gains`: one gain of
    /// Cz for each block at the first point, then at the second, and so on. `source`: name of the file, for display.
    ///
    /// # Errors
    /// Returns a message if points or blocks are missing, if the points do not ascend, or if the number of gains is
    /// wrong.
    pub fn new(
        source: impl Into<String>,
        inputs: Vec<Input>,
        position: SignalId,
        guide: Vec<Millimetre>,
        gains: Vec<MicronPerCelsius>,
    ) -> Result<Matrix, String> {
        if guide.is_empty() || inputs.is_empty() {
            return Err("a matrix needs at least one block and one point of the guideway".to_owned());
        }
        if let Some(pair) = guide.windows(2).find(|pair| pair[0].partial_cmp(&pair[1]) != Some(ASCENDING)) {
            return Err(format!(
                "the points of the guideway must ascend, but {} mm is followed by {} mm",
                pair[0].get(),
                pair[1].get()
            ));
        }
        if gains.len() != guide.len() * inputs.len() {
            return Err(format!(
                "there are {} gains, but each of the {} points needs one gain for each of the {} blocks",
                gains.len(),
                guide.len(),
                inputs.len()
            ));
        }
        Ok(Matrix { source: source.into(), inputs, position, guide, gains })
    }

    /// Returns the name of the file with the matrix.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Returns the temperature rise of each block of the structure.
    pub fn blocks(&self) -> &[Input] {
        &self.inputs
    }

    /// Returns the signal of the axis position, mm.
    pub fn position(&self) -> SignalId {
        self.position
    }

    /// Returns the first and last point of the guideway.
    pub fn ends(&self) -> (Millimetre, Millimetre) {
        (self.guide.first().copied().unwrap_or_default(), self.guide.last().copied().unwrap_or_default())
    }

    /// Returns the gain of each block at a position, interpolated between the points of the guideway.
    pub fn gains_at(&self, position: Millimetre) -> impl Iterator<Item = MicronPerCelsius> + '_ {
        let after = self.guide.partition_point(|point| *point <= position);
        let (low, high) = (after.saturating_sub(1), after.min(self.guide.len() - 1));
        let span = (self.guide[high] - self.guide[low]).get();
        let share = if span > 0.0 { (position - self.guide[low]).get() / span } else { 0.0 };
        let blocks = self.inputs.len();
        let row = |point: usize| &self.gains[point * blocks..(point + 1) * blocks];
        let between = move |(low, high): (&MicronPerCelsius, &MicronPerCelsius)| {
            MicronPerCelsius::new(low.get() + share * (high.get() - low.get())).unwrap_or(*low)
        };
        row(low).iter().zip(row(high)).map(between)
    }
}

const ASCENDING: std::cmp::Ordering = std::cmp::Ordering::Less;

impl Evaluate for Matrix {
    fn evaluate(&self, inputs: &Inputs<'_>) -> Result<Outputs, Unusable> {
        let position = inputs.snapshot.position(self.position).ok_or(Unusable::Signal(self.position))?;
        let mut cz = 0.0;
        let mut lags = inputs.lags.iter();
        for (input, gain) in self.inputs.iter().zip(self.gains_at(position)) {
            cz += gain * input.rise(inputs, lags.next().unwrap_or(&Lag::NONE))?;
        }
        Outputs::of(cz, 0.0)
    }

    fn signals(&self) -> Vec<SignalId> {
        self.inputs.iter().map(|input| input.signal).chain([self.position]).collect()
    }

    fn lagging(&self) -> Rises<'_> {
        Rises { inputs: &self.inputs, ..Rises::default() }
    }

    /// Returns the position of the axis relative to the ends of the guideway; `None` if the position is
    /// unknown.
    fn coverage(&self, snapshot: &Snapshot<'_>) -> Option<Coverage> {
        let position = snapshot.value(self.position)?;
        let (first, last) = (self.ends().0.get(), self.ends().1.get());
        let by = position - position.clamp(first, last);
        let found = Extrapolation {
            distance: None,
            farthest: Some(Beyond { signal: self.position, by }),
            outside: Outside::Warn,
            gain: 1.0,
            apart: None,
        };
        // A guideway with a single point has no length. Its length is taken as 1 mm.
        let length = if last > first { last - first } else { 1.0 };
        let excess = ((first - position).max(position - last) / length).min(f64::MAX);
        Some(Coverage { excess, extrapolating: (by.abs() > 0.0).then_some(found) })
    }
}

#[cfg(test)]
mod tests;
