//! Axes whose control (for example a SINUMERIK) calculates the correction itself: `ΔK = K0(T) + tanβ(T)·(P − P0)`. The
//! outputs of such an axis write K0 (intercept), tanβ (slope) and P0 (reference position).

use super::Axis;
use crate::tables::output::Output;
use crate::tables::output::writes::Writes;
use crate::tables::{Check, KeyContext};
use isotherm_core::compensation::model::{Kind, Slope};
use isotherm_core::compensation::settings::InterceptSlope;
use isotherm_core::quantity::Millimetre;

/// Completes each axis whose outputs write K0, tanβ and P0: stores P0, and the largest distance from P0 within the
/// travel. Reports axes for which only some of the three outputs exist.
pub(in crate::tables) fn resolve(check: &mut Check<'_>) {
    let outputs = check.outputs.by_owner(|output| Some(output.axis.0));
    let line = |(place, axis): (usize, &Option<Axis>)| {
        let of_axis: Vec<&Output> =
            outputs.of(place).filter_map(|output| check.outputs.get(output)).collect();
        let is_apart = of_axis.iter().any(|output| output.writes.is_apart());
        axis.as_ref().filter(|_| is_apart).and_then(|axis| of_control(check, axis, &of_axis))
    };
    let lines: Vec<Option<InterceptSlope>> = check.axes.resolved.iter().enumerate().map(line).collect();
    for (axis, line) in check.axes.resolved.iter_mut().zip(lines) {
        if let Some(axis) = axis {
            axis.settings.intercept_slope = line;
        }
    }
}

/// Checks that the outputs of an axis write all of K0, tanβ and P0. Returns the reference position P0, and the largest
/// distance from P0 within the travel. `None` if no model of the axis has a valid slope.
fn of_control(check: &Check<'_>, axis: &Axis, outputs: &[&Output]) -> Option<InterceptSlope> {
    let name = &axis.settings.name;
    let at = check.at("axis").key(name);
    if axis.diameter {
        let help = "remove `diameter`, and keep the gains: they apply to the radius already";
        at.key("diameter")
            .wrong_key("a control that calculates K0 + tanβ·(P − P0) applies the result to the radius", help);
    }
    for output in outputs.iter().filter(|output| !output.writes.is_apart()) {
        let message = "the slope would act twice: in this value and in the control";
        let help = format!(
            "for axis `{name}`, keep either the outputs for intercept, slope and reference, or this output"
        );
        check.at("output").key(&output.name).key("writes").invalid(message, help);
    }
    for (writes, what) in [(Writes::Intercept, "K0"), (Writes::Slope, "tanβ"), (Writes::Reference, "P0")] {
        if !outputs.iter().any(|output| output.writes == writes) {
            let word = writes.name();
            let message = format!(
                "no output of `{name}` writes the {word} ({what}): the control needs K0, tanβ and P0"
            );
            let help = format!("add an output with axis = \"{name}\" and writes = \"{word}\"");
            at.wrong_key(message, help);
        }
    }
    reach(axis, &at.key("model"))
}

/// Returns the reference position P0, at which the slope has no effect, and the largest distance from P0 within the
/// travel. All slopes of the axis must have the same P0. `None` if no model has a valid slope.
fn reach(axis: &Axis, list: &KeyContext<'_>) -> Option<InterceptSlope> {
    let mut line: Option<InterceptSlope> = None;
    for (place, model) in axis.settings.models.iter().enumerate() {
        let Kind::Linear(linear) = &model.kind else { continue };
        let Some(Slope { reference, travel, .. }) = linear.slope else { continue };
        let at = list.item(place).key("slope");
        let message = "`travel` is missing: the travel limits the effect of the written slope";
        at.key("travel").missing(message, "write the ends of the axis's travel in mm, as [-300.0, 0.0]");
        let (from, to) = travel?;
        let reach = longer((from - reference).abs(), (to - reference).abs());
        match &mut line {
            None => line = Some(InterceptSlope { reference, reach, count: None }),
            Some(first) if first.reference != reference => {
                let message =
                    format!("the slope of another model has the reference {} mm", first.reference.get());
                let help =
                    "the control has one reference position: write the same `reference` in both slopes";
                at.key("reference").invalid(message, help);
            }
            Some(first) => first.reach = longer(first.reach, reach),
        }
    }
    if line.is_none() && !axis.settings.models.is_empty() {
        let help = "write slope = { … } in a model, or writes = \"offset\" at the output";
        list.invalid(format!("no model of `{}` has a slope", axis.settings.name), help);
    }
    line
}

fn longer(one: Millimetre, other: Millimetre) -> Millimetre {
    if other > one { other } else { one }
}
