//! Effects of warm machine parts on the error of an axis: keys of the plant file, and their conversion to gains.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::super::{Displacement, Position, Stretch};
use super::check::Check;
use crate::virtual_machine::plant::structure::Point;

/// Part of the machine whose expansion displaces an axis: coefficient (1/K) × length × temperature rise of the node.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ExpansionFile {
    axis: String,
    node: String,
    coefficient: f64,
    length_mm: f64,
    sign: f64,
}

/// Part of the machine that bends if its two sides, the nodes `warm` and `cold`, have different temperature rises.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BendingFile {
    axis: String,
    warm: String,
    cold: String,
    um_per_kelvin: f64,
}

/// Part of the machine along the travel of an axis. Only its length between the reference and the current position
/// displaces the axis.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StretchFile {
    axis: String,
    node: String,
    coefficient: f64,
    position: String,
    reference_mm: f64,
    /// Start of the part, mm; without `from_mm` and `to_mm`, the part is as long as the travel.
    from_mm: Option<f64>,
    to_mm: Option<f64>,
    sign: f64,
}

/// Bending that tilts the axis. The error grows with the distance of the position from a reference.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TiltFile {
    axis: String,
    warm: String,
    cold: String,
    um_per_mm_kelvin: f64,
    position: String,
    reference_mm: f64,
}

/// Effects on each axis, collected while the file is converted.
pub(super) struct Displacements<'a> {
    positions: &'a [Position],
    check: &'a mut Check,
    axes: BTreeMap<String, Displacement>,
}

impl<'a> Displacements<'a> {
    pub(super) fn new(positions: &'a [Position], check: &'a mut Check) -> Displacements<'a> {
        Displacements { positions, check, axes: BTreeMap::new() }
    }

    pub(super) fn all(self) -> Vec<Displacement> {
        self.axes.into_values().collect()
    }

    pub(super) fn expansion(&mut self, file: &ExpansionFile) {
        let place = format!("expansion of axis {} by {}", file.axis, file.node);
        self.sign(&place, file.sign);
        self.finite(&place, "coefficient and length_mm", &[file.coefficient, file.length_mm]);
        let gain = file.sign * file.coefficient * file.length_mm * 1000.0;
        let point = self.check.point(&place, &file.node);
        self.axis(&file.axis).gains.push((point, gain));
    }

    pub(super) fn bending(&mut self, file: &BendingFile) {
        let place = format!("bending of axis {} by {} and {}", file.axis, file.warm, file.cold);
        self.finite(&place, "um_per_kelvin", &[file.um_per_kelvin]);
        let gains = self.pair(&place, &file.warm, &file.cold, file.um_per_kelvin);
        self.axis(&file.axis).gains.extend(gains);
    }

    pub(super) fn stretch(&mut self, file: &StretchFile) {
        let place = format!("stretch of axis {} by {}", file.axis, file.node);
        self.sign(&place, file.sign);
        let (from, to) = (file.from_mm.unwrap_or(f64::MIN), file.to_mm.unwrap_or(f64::MAX));
        self.finite(&place, "every number", &[file.coefficient, file.reference_mm, from, to]);
        self.check.demand(from < to, || format!("{place}: from_mm must be less than to_mm"));
        let point = self.check.point(&place, &file.node);
        let gains = vec![(point, file.sign * file.coefficient * 1000.0)];
        let stretch = Stretch { position: 0, reference: file.reference_mm, from, to, gains };
        self.along(&place, &file.axis, &file.position, stretch);
    }

    pub(super) fn tilt(&mut self, file: &TiltFile) {
        let place = format!("tilt of axis {} by {} and {}", file.axis, file.warm, file.cold);
        self.finite(&place, "every number", &[file.um_per_mm_kelvin, file.reference_mm]);
        let gains = self.pair(&place, &file.warm, &file.cold, file.um_per_mm_kelvin).to_vec();
        let everywhere =
            Stretch { position: 0, reference: file.reference_mm, from: f64::MIN, to: f64::MAX, gains };
        self.along(&place, &file.axis, &file.position, everywhere);
    }

    /// Adds to an axis a part along a travel. `position` is the name of the signal with the position on that travel.
    fn along(&mut self, place: &str, axis: &str, position: &str, stretch: Stretch) {
        let Some(position) = self.positions.iter().position(|known| known.signal == position) else {
            self.check.demand(false, || format!("{place}: there is no position `{position}`"));
            return;
        };
        self.axis(axis).stretches.push(Stretch { position, ..stretch });
    }

    /// Records that the axis follows the displacement of the structure's guideway in this direction.
    pub(super) fn guided(&mut self, axis: &str, direction: usize) {
        self.axis(axis).guided = Some(direction);
    }

    fn axis(&mut self, name: &str) -> &mut Displacement {
        let new = || Displacement { axis: name.to_owned(), ..Displacement::default() };
        self.axes.entry(name.to_owned()).or_insert_with(new)
    }

    fn pair(&mut self, place: &str, warm: &str, cold: &str, gain: f64) -> [(Point, f64); 2] {
        [(self.check.point(place, warm), gain), (self.check.point(place, cold), -gain)]
    }

    fn sign(&mut self, place: &str, sign: f64) {
        self.check.demand((sign.abs() - 1.0).abs() < f64::EPSILON, || {
            format!("{place}: sign {sign} must be 1 or -1")
        });
    }

    fn finite(&mut self, place: &str, what: &str, values: &[f64]) {
        self.check.demand(values.iter().all(|value| value.is_finite()), || {
            format!("{place}: {what} must be finite")
        });
    }
}
