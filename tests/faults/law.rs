//! I1, I2, I3, I5 and "no burst" on what was really on the wire and on the board.

use std::collections::HashMap;
use std::time::Duration;

use isotherm::compensation::model::Evaluate;
use isotherm::profile::{Output, Profile, Share, Signal, Writes};
use isotherm::quantity::Moment;
use isotherm::virtual_machine::Seen;

use crate::rig::Trace;

/// Rounding of arithmetic, µm.
const EPSILON: f64 = 1e-6;

/// Holds a run to every invariant that can be seen from outside.
pub(crate) fn holds(trace: &Trace) {
    let mut last_correction = HashMap::new();
    for (place, seen) in trace.wire.iter().enumerate() {
        if seen.is_write() {
            match written(&trace.profile, seen) {
                Some(output) => is_inside(trace, place, output, &mut last_correction),
                None => assert!(is_heartbeat(&trace.profile, seen), "I1: {seen:?}"),
            }
        }
    }
    grows_only_while_active(trace);
    readings_are_measured(trace);
    nothing_comes_in_bursts(trace);
}

fn written<'a>(profile: &'a Profile, seen: &Seen) -> Option<&'a Output> {
    profile.outputs.iter().find(|output| {
        output.device == seen.device
            && output.address == seen.address
            && usize::from(output.encoding.data_type.registers()) == seen.wanted.len()
    })
}

fn is_heartbeat(profile: &Profile, seen: &Seen) -> bool {
    profile.heartbeat.as_ref().is_some_and(|beat| {
        beat.device == seen.device && beat.address == seen.address && seen.wanted.len() == 1
    })
}

/// I2, and what a corrected position is made of.
fn is_inside(trace: &Trace, place: usize, output: &Output, corrections: &mut HashMap<String, (Moment, f64)>) {
    let seen = &trace.wire[place];
    let axis = trace.profile.axis(output.axis);
    let guard = &axis.settings.guard;
    let factor = match (output.writes, axis.settings.apart) {
        (Writes::Slope, Some(apart)) => 1.0 / apart.reach,
        _ if axis.diameter => 2.0,
        _ => 1.0,
    };
    let (limit, step) = (guard.limit.get(), guard.step.get());
    let wanted = output.encoding.decode(&seen.wanted).unwrap();
    match output.writes {
        Writes::Offset | Writes::Intercept | Writes::Slope => {
            let (before, wanted) = (output.encoding.decode(&seen.before).unwrap() / factor, wanted / factor);
            // The limit of a share is held to where the operator's part is known.
            let whole = output.share == Share::Whole;
            assert!(!whole || wanted.abs() <= limit + EPSILON, "I2, limit: {wanted} µm, {seen:?}");
            assert!(
                (wanted - before).abs() <= step + EPSILON,
                "I2, step: {before} → {wanted} µm at {:.1} s, {seen:?}\n{}",
                trace.seconds(seen.at),
                trace.lines()
            );
        }
        Writes::Reference => {
            let reference = axis.settings.apart.unwrap().reference;
            let count = output.encoding.scale.abs();
            assert!((wanted - reference).abs() <= 0.501 * count, "P0: {wanted} mm, {seen:?}");
        }
        Writes::Corrected { position } => {
            let signal = trace.profile.signal(position);
            let count = 1000.0 * output.encoding.scale / factor;
            let last = corrections.get(&output.name).copied();
            let shown = recent(trace, place, signal, signal.max_age);
            let share = |position: &f64| 1000.0 * (wanted - position) / factor;
            assert!(!shown.is_empty(), "I3: corrected without a position: {seen:?}");
            let last = last.filter(|(since, _)| !was_off(trace, output, *since, seen.at));
            // The latest position; where its answer was lost, one before it, as long as that is fresh.
            let fits = |cz: &f64| {
                cz.abs() <= limit + count + EPSILON
                    && last.is_none_or(|(_, last)| (cz - last).abs() <= step + count + EPSILON)
            };
            let cz = shown.iter().map(share).find(fits);
            let cz = cz.unwrap_or_else(|| {
                panic!(
                    "I2: D' − D = {} µm after {last:?} at {:.1} s\n{}",
                    share(&shown[0]),
                    trace.seconds(seen.at),
                    trace.lines()
                )
            });
            corrections.insert(output.name.clone(), (seen.at, cz));
        }
    }
}

fn was_off(trace: &Trace, output: &Output, from: Moment, to: Moment) -> bool {
    let between = trace.samples.iter().filter(|sample| sample.at >= from && sample.at <= to);
    between.into_iter().any(|sample| sample.status.axes[output.axis.0].state == "off")
}

/// What a device had in a signal's registers when they were read, not longer ago than `age` before this request.
fn recent(trace: &Trace, place: usize, signal: &Signal, age: Duration) -> Vec<f64> {
    let now = trace.wire[place].at;
    trace.wire[..place]
        .iter()
        .rev()
        .take_while(|seen| now.since(seen.at) <= age)
        .filter_map(|seen| measured(seen, signal))
        .collect()
}

/// The value of a signal in the registers that a request speaks of.
fn measured(seen: &Seen, signal: &Signal) -> Option<f64> {
    if seen.is_write() || seen.device != signal.device || seen.address.table != signal.address.table {
        return None;
    }
    let from = usize::from(signal.address.offset.checked_sub(seen.address.offset)?);
    let words = seen.after.get(from..from + usize::from(signal.encoding.data_type.registers()))?;
    if signal.address.table.is_bits() {
        return Some(signal.encoding.decode_bit(words[0] != 0));
    }
    signal.encoding.decode(words).ok()
}

/// I3: an axis follows only good readings, and an offset moves away from zero only towards what was decided from them.
fn grows_only_while_active(trace: &Trace) {
    // Where the clock was just set ahead, the decision of before still stands.
    let steady = |sample: &&crate::rig::Sample| sample.status.now == sample.at.to_string();
    for sample in trace.samples.iter().filter(steady) {
        for (axis, status) in trace.profile.axes.iter().zip(&sample.status.axes) {
            let Some(model) =
                axis.settings.models.iter().find(|model| Some(&model.name) == status.model.as_ref())
            else {
                assert!(!matches!(status.state, "active" | "degraded"), "I3: {status:?}");
                continue;
            };
            let fresh = Duration::from_secs(3) + axis.settings.every;
            for id in model.inputs() {
                let signal = &sample.status.signals[id.0];
                let age = signal.age_s.unwrap_or(f64::INFINITY);
                let max_age = (trace.profile.signal(id).max_age + fresh).as_secs_f64();
                assert!(age <= max_age || status.state != "active", "I3: {status:?} on {signal:?}");
            }
        }
    }
    for seen in trace.wire.iter().filter(|seen| seen.is_write()) {
        let Some(output) = written(&trace.profile, seen)
            .filter(|output| output.writes == Writes::Offset && output.share == Share::Whole)
        else {
            continue;
        };
        let value = |words: &[u16]| output.encoding.decode(words).unwrap().abs();
        if value(&seen.wanted) <= value(&seen.before) + EPSILON {
            continue;
        }
        let near = |at: Moment| at.since(seen.at) + seen.at.since(at) <= Duration::from_secs(6);
        let wanted = value(&seen.wanted);
        let factor = if trace.profile.axis(output.axis).diameter { 2.0 } else { 1.0 };
        let decided = trace.samples.iter().filter(|sample| near(sample.at));
        let follows = decided.into_iter().map(|sample| &sample.status.axes[output.axis.0]).any(|axis| {
            matches!(axis.state, "active" | "degraded" | "holding")
                && axis.cz_um.abs() * factor + output.encoding.scale + EPSILON >= wanted
        });
        assert!(
            follows,
            "I3: grew at {:.1} s without a good reading: {seen:?}\n{}",
            trace.seconds(seen.at),
            trace.lines()
        );
    }
}

/// I5: what counts as good on the board is what the device measured, not long ago.
fn readings_are_measured(trace: &Trace) {
    let mut from = 0;
    for sample in &trace.samples {
        let longest = trace.profile.signals.iter().map(|signal| signal.max_age).max().unwrap_or_default();
        while trace.wire.get(from).is_some_and(|seen| sample.at.since(seen.at) > longest) {
            from += 1;
        }
        for (signal, status) in trace.profile.signals.iter().zip(&sample.status.signals) {
            let Some(value) = status.value else { continue };
            let is_from_there = trace.wire[from..]
                .iter()
                .take_while(|seen| seen.at <= sample.at)
                .filter_map(|seen| measured(seen, signal))
                .any(|measured| (measured - value).abs() < 1e-9);
            assert!(is_from_there, "I5: {} shows {value} at {:.1} s", signal.name, trace.seconds(sample.at));
        }
    }
}

/// I9: one question is asked a few times at most at one moment, whatever the clock did.
fn nothing_comes_in_bursts(trace: &Trace) {
    let mut asked: HashMap<_, (Moment, u32)> = HashMap::new();
    for seen in &trace.wire {
        let question = (seen.device, seen.function, seen.address, seen.count);
        let entry = asked.entry(question).or_insert((seen.at, 0));
        *entry = if entry.0 == seen.at { (seen.at, entry.1 + 1) } else { (seen.at, 1) };
        assert!(entry.1 <= 4, "I9: a burst at {:.1} s of {question:?}", trace.seconds(seen.at));
    }
}
