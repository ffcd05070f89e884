//! A beam that carries something along a travel: it grows by what its walls grow on the average, and bows away from the
//! warmer side. Bernoulli's beam: with the coefficient α, a section of area A and second moment I, and walls of area a
//! that lie z from its neutral axis,
//!
//! ```text
//! strain     ε = α·Σ a·ΔT / A           along:   ∫ ε ds + arm·∫ κ ds
//! curvature  κ = α·Σ a·z·ΔT / I         across:  ∫ (h − s)·κ ds           from the foot to the position h
//! ```

use serde::Deserialize;

use super::super::{Shape, Stretch};
use super::displacement::Displacements;

/// A beam with its foot at 0 mm of the position.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BeamFile {
    position: String,
    /// The axis along the beam.
    along: String,
    /// The axis across it, positive from the side of positive offsets to the other.
    across: String,
    coefficient: f64,
    area_mm2: f64,
    inertia_mm4: f64,
    /// How far before the neutral axis that is whose place counts, on the side of positive offsets.
    arm_mm: f64,
    wall: Vec<WallFile>,
}

/// A part of its wall.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WallFile {
    node: String,
    from_mm: f64,
    to_mm: f64,
    area_mm2: f64,
    /// How far its centre lies from the neutral axis.
    offset_mm: f64,
}

impl Displacements<'_> {
    pub(super) fn beam(&mut self, file: &BeamFile) {
        let place = "beam";
        self.finite(place, "every number", &[file.coefficient, file.arm_mm]);
        self.check.demand(file.area_mm2 > 0.0 && file.inertia_mm4 > 0.0, || {
            format!("{place}: area_mm2 and inertia_mm4 must be more than 0")
        });
        for wall in &file.wall {
            let place = format!("beam.wall of {}", wall.node);
            self.finite(&place, "every number", &[wall.from_mm, wall.to_mm, wall.area_mm2, wall.offset_mm]);
            self.check.demand(0.0 <= wall.from_mm && wall.from_mm < wall.to_mm, || {
                format!("{place}: from_mm must lie below to_mm, and neither below the foot at 0")
            });
            let point = self.check.point(&place, &wall.node);
            let strain = 1000.0 * file.coefficient * wall.area_mm2 / file.area_mm2;
            let curvature = 1000.0 * file.coefficient * wall.area_mm2 * wall.offset_mm / file.inertia_mm4;
            let stretch = |shape, gain| Stretch {
                position: 0,
                shape,
                reference: 0.0,
                from: wall.from_mm,
                to: wall.to_mm,
                gains: vec![(point, gain)],
            };
            let grows = stretch(Shape::Straight, strain + file.arm_mm * curvature);
            self.along(&place, &file.along, &file.position, grows);
            self.along(&place, &file.across, &file.position, stretch(Shape::Bowed, curvature));
        }
    }
}
