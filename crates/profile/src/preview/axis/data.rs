//! Models whose numbers are in a file, and envelopes, in words.

use super::{effect, figure, late, middle, reference};
use crate::Profile;
use isotherm_core::compensation::model::{Envelope, Input, Matrix, Network, Outside, Reference};
use isotherm_core::quantity::{Celsius, Millimetre};

/// What it computes, and what one unit more of each block's temperature does in the middle of the guideway.
pub(super) fn matrix(profile: &Profile, matrix: &Matrix) -> (String, Vec<String>) {
    let position = &profile.signal(matrix.position()).name;
    let (first, last) = (matrix.ends().0.get(), matrix.ends().1.get());
    let text = format!(
        "Cz = P·ΔT µm at {position}, P of {} from {first} to {last} mm (beyond them as at the end), over {}",
        matrix.source(),
        rises(profile, matrix.blocks())
    );
    let at = f64::midpoint(first, last);
    let place = format!(" (at {position} = {} mm)", figure(at));
    let blocks = matrix.blocks().iter().zip(matrix.gains_at(Millimetre::new(at).unwrap_or_default()));
    let effects = blocks
        .map(|(block, gain)| {
            effect(profile, block.signal, gain.get(), &late(profile, block.signal, block.lag, &place))
        })
        .collect();
    (text, effects)
}

/// What it computes, and what one unit more of each signal does, every signal in the middle of its range and every
/// captured reference where its signal is.
pub(super) fn network(profile: &Profile, network: &Network) -> (String, Vec<String>) {
    let reads = network.reads();
    let text =
        format!("Cz = {} of {} µm, over {}", network.net().what(), network.source(), rises(profile, reads));
    let rise = |input: &Input| match input.reference {
        Reference::Fixed(number) => middle(profile, input.signal) - number.get(),
        Reference::Start | Reference::Zero => 0.0,
    };
    let at: Vec<f64> = reads.iter().map(rise).collect();
    let before = network.net().output(&at);
    let one = |(place, input): (usize, &Input)| {
        let mut raised = at.clone();
        raised[place] += 1.0;
        let change = network.net().output(&raised) - before;
        let name = &profile.signal(input.signal).name;
        let from = figure(middle(profile, input.signal));
        if change.is_finite() {
            let place = format!(" (from {from})");
            effect(profile, input.signal, change, &late(profile, input.signal, input.lag, &place))
        } else {
            format!("at {name} = {from} the network has no value")
        }
    };
    (text, reads.iter().enumerate().map(one).collect())
}

/// The region in words, and what happens outside.
pub(super) fn envelope(profile: &Profile, envelope: &Envelope) -> String {
    let range = |known: &isotherm_core::compensation::model::envelope::Identified| {
        let signal = profile.signal(known.input.signal);
        let (min, max) = known.range;
        format!("{} {} … {} {}", rise(profile, &known.input), figure(min), figure(max), signal.unit)
    };
    let ranges: Vec<String> = envelope.inputs().iter().map(range).collect();
    let outside = match envelope.outside() {
        Outside::Warn => "outside it says so and goes on",
        Outside::Hold => "outside it keeps Cz",
        Outside::Shrink => "outside Cz is taken down, the more the farther",
    };
    format!(
        "identified on {}, within {:.2} Mahalanobis distances of their mean; {outside}",
        ranges.join(", "),
        envelope.reach()
    )
}

fn rises(profile: &Profile, inputs: &[Input]) -> String {
    inputs.iter().map(|input| rise(profile, input)).collect::<Vec<_>>().join(", ")
}

/// `bed`, or `(bed − 20)`, and by how much it lags.
fn rise(profile: &Profile, input: &Input) -> String {
    let name = &profile.signal(input.signal).name;
    let rise = match input.reference {
        Reference::Fixed(Celsius::ZERO) => name.clone(),
        other => format!("({name} − {})", reference(other)),
    };
    match input.lag {
        Some(lag) => format!("{rise} lagged by {}", humantime::format_duration(lag)),
        None => rise,
    }
}
