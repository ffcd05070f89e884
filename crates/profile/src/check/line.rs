//! Axes whose control applies the slope itself: `ΔK = K0(T) + tanβ(T)·(P − P0)`, as a SINUMERIK does.

use super::Check;
use crate::place::{child, element};
use crate::{Axis, Output, Writes};
use isotherm_core::compensation::model::{Kind, Slope};
use isotherm_core::compensation::settings::InterceptSlope;
use isotherm_core::quantity::Millimetre;

impl Check<'_> {
    /// Where an axis's outputs write the parts of a line, the axis is told how far its slope reaches.
    pub(super) fn lines(&mut self, axes: &mut [Option<Axis>], outputs: &[Option<Output>]) {
        for (place, axis) in axes.iter_mut().enumerate() {
            let Some(axis) = axis else { continue };
            let of_axis: Vec<&Output> =
                outputs.iter().flatten().filter(|output| output.axis.0 == place).collect();
            if of_axis.iter().any(|output| output.writes.is_apart()) {
                axis.settings.intercept_slope = self.line(axis, &of_axis);
            }
        }
    }

    fn line(&mut self, axis: &Axis, outputs: &[&Output]) -> Option<InterceptSlope> {
        let name = &axis.settings.name;
        let path = child("axis", name);
        if axis.diameter {
            let help = "remove `diameter` and write the gains for the diameter";
            self.wrong_key(&child(&path, "diameter"), "a control applies its own line to the radius", help);
        }
        for output in outputs.iter().filter(|output| !output.writes.is_apart()) {
            let message = "the slope would act twice: in this value and in the control";
            let help = format!("give axis `{name}` either intercept, slope and reference, or this output");
            self.wrong(&child(&child("output", &output.name), "writes"), message, help);
        }
        for (writes, what) in [(Writes::Intercept, "K0"), (Writes::Slope, "tanβ"), (Writes::Reference, "P0")]
        {
            if !outputs.iter().any(|output| output.writes == writes) {
                let word = writes.name();
                let message =
                    format!("no output of `{name}` writes its {word} ({what}): a line needs all three");
                let help = format!("add an output with axis = \"{name}\" and writes = \"{word}\"");
                self.errors.push(self.places.at_key(&path, message, Some(help)));
            }
        }
        self.reach(axis, &child(&path, "model"))
    }

    /// The slopes of all models have one reference position, and a travel that bounds what they come to.
    fn reach(&mut self, axis: &Axis, list: &str) -> Option<InterceptSlope> {
        let mut line: Option<InterceptSlope> = None;
        for (place, model) in axis.settings.models.iter().enumerate() {
            let Kind::Linear(linear) = &model.kind else { continue };
            let Some(Slope { reference, travel, .. }) = linear.slope else { continue };
            let path = child(&element(list, place), "slope");
            let Some((from, to)) = travel else {
                let message = "`travel` is missing: it bounds what a slope that is written comes to";
                self.missing(
                    &path,
                    "travel",
                    message,
                    "write the ends of the axis's travel in mm, as [-300.0, 0.0]",
                );
                return None;
            };
            let reach = longer((from - reference).abs(), (to - reference).abs());
            match &mut line {
                None => line = Some(InterceptSlope { reference, reach, count: None }),
                Some(first) if first.reference != reference => {
                    let message =
                        format!("another model's slope is measured from {} mm", first.reference.get());
                    let help = "the control knows one reference position: give both slopes the same";
                    self.wrong(&child(&path, "reference"), message, help);
                }
                Some(first) => first.reach = longer(first.reach, reach),
            }
        }
        if line.is_none() && !axis.settings.models.is_empty() {
            let message = format!("no model of `{}` has a slope", axis.settings.name);
            let help = "write slope = { … } in a model, or writes = \"offset\" at the output";
            self.wrong(list, message, help);
        }
        line
    }
}

fn longer(one: Millimetre, other: Millimetre) -> Millimetre {
    if other > one { other } else { one }
}
