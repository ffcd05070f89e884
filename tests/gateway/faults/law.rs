//! Invariants I1, I2, I3, I5 and I9 ("no burst"), checked with the requests on the wire and the readings on the board.

use std::collections::HashMap;
use std::time::Duration;

use isotherm::virtual_machine::SeenRequest;
use isotherm_core::codec::{Register, Table};
use isotherm_core::quantity::{Moment, time};
use isotherm_profile::{Output, Profile, Share, Signal, Writes};

use crate::faults::rig::Trace;

/// Rounding of arithmetic, µm.
const EPSILON: f64 = 1e-6;

/// Checks every invariant of a run that can be seen from outside.
pub(crate) fn holds(trace: &Trace) {
    let mut last_correction = HashMap::new();
    for (place, seen) in trace.wire.iter().enumerate().filter(|(_, seen)| seen.is_write()) {
        is_in_the_write_list(&trace.profile, seen);
        for output in &trace.profile.outputs {
            if let Some(seen) = of_output(seen, output) {
                is_inside(trace, place, &seen, output, &mut last_correction);
            }
        }
    }
    grows_only_while_active(trace);
    readings_are_measured(trace);
    nothing_comes_in_bursts(trace);
}

/// Part of a write that belongs to one output. `None` if it does not contain the whole output.
pub(crate) fn of_output(seen: &SeenRequest, output: &Output) -> Option<SeenRequest> {
    if !seen.is_write()
        || seen.device != output.device
        || seen.address.register().unwrap().table != output.address.register().unwrap().table
    {
        return None;
    }
    let from = usize::from(
        output.address.register().unwrap().offset.checked_sub(seen.address.register().unwrap().offset)?,
    );
    let part = from..from + usize::from(output.encoding.data_type.registers());
    let wanted = seen.wanted.get(part.clone())?.to_vec();
    let cut = |words: &[u16]| words.get(part.clone()).unwrap_or_default().to_vec();
    let (before, after) = (cut(&seen.before), cut(&seen.after));
    Some(SeenRequest { address: output.address.clone(), before, after, wanted, ..seen.clone() })
}

/// I1: every cell of a write belongs to an output, a set, the heartbeat or a capture command, and no value is torn.
fn is_in_the_write_list(profile: &Profile, seen: &SeenRequest) {
    let mut known = vec![false; seen.wanted.len()];
    let first = seen.address.register().unwrap();
    let mut mark = |address: Register, count: usize| {
        let from = address.offset.checked_sub(first.offset).map(usize::from);
        if address.table == first.table
            && let Some(cells) = from.and_then(|from| known.get_mut(from..from + count))
        {
            cells.fill(true);
        }
    };
    for output in profile.outputs.iter().filter(|output| output.device == seen.device) {
        mark(output.address.register().unwrap(), usize::from(output.encoding.data_type.registers()));
    }
    for set in profile.sets.iter().filter(|set| set.device == seen.device) {
        let strobe = set.handshake.as_ref().and_then(|handshake| handshake.strobe.address().register());
        set.own_registers().chain(strobe).for_each(|address| mark(address, 1));
        let longest = profile.device(set.device).longest_request();
        for stretch in set.stretches(set.members(profile), longest).iter().filter(|_| set.zeros) {
            mark(Register { table: Table::Holding, offset: stretch.from }, usize::from(stretch.count));
        }
    }
    for output in profile.outputs.iter().filter(|output| output.device == seen.device) {
        output.display.registers().for_each(|address| mark(address, 1));
    }
    let heartbeat = profile.heartbeat.iter().filter(|beat| beat.device == seen.device);
    heartbeat.for_each(|beat| mark(beat.address.register().unwrap(), 1));
    let signals = profile.signals.iter().filter(|signal| signal.device == seen.device);
    signals.filter_map(|signal| signal.capture).for_each(|capture| mark(capture.address, 1));
    assert!(!known.is_empty() && known.iter().all(|known| *known), "I1: {seen:?}");
}

/// I2, and the parts of a corrected position.
fn is_inside(
    trace: &Trace,
    place: usize,
    seen: &SeenRequest,
    output: &Output,
    corrections: &mut HashMap<String, (Moment, f64)>,
) {
    let axis = trace.profile.axis(output.axis);
    let guard = &axis.settings.guard;
    let factor = match (output.writes, axis.settings.intercept_slope) {
        (Writes::Slope, Some(line)) => 1.0 / line.reach.get(),
        _ if axis.diameter => 2.0,
        _ => 1.0,
    };
    let (limit, step) = (guard.limit.get(), guard.step.get());
    let wanted = output.encoding.decode(&seen.wanted).unwrap();
    match output.writes {
        Writes::Offset | Writes::Intercept | Writes::Slope => {
            let (before, wanted) = (output.encoding.decode(&seen.before).unwrap() / factor, wanted / factor);
            // The limit of a share is checked elsewhere, with the operator offset.
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
            let reference = axis.settings.intercept_slope.unwrap().reference.get();
            let count = output.encoding.scale.get().abs();
            // A member of a set that is off is written with its present value.
            let is_theirs = seen.wanted == seen.before;
            assert!(is_theirs || (wanted - reference).abs() <= 0.501 * count, "P0: {wanted} mm, {seen:?}");
        }
        Writes::Corrected { position } => {
            let signal = trace.profile.signal(position);
            let count = 1000.0 * output.encoding.scale.get() / factor;
            let last = corrections.get(&output.name).copied();
            let shown = recent(trace, place, signal, signal.max_age);
            let share = |position: &f64| 1000.0 * (wanted - position) / factor;
            assert!(!shown.is_empty(), "I3: corrected without a position: {seen:?}");
            let last = last.filter(|(since, _)| !was_off(trace, output, *since, seen.at));
            // The latest position, or an earlier one that is still fresh if its answer was lost.
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
    between.into_iter().any(|sample| matches!(sample.status.axes[output.axis.0].state, "off" | "waiting"))
}

/// Values of a signal in the registers of its device when they were read, at most `age` before this request.
fn recent(trace: &Trace, place: usize, signal: &Signal, age: Duration) -> Vec<f64> {
    let now = trace.wire[place].at;
    trace.wire[..place]
        .iter()
        .rev()
        .take_while(|seen| now.since(seen.at) <= age)
        .filter_map(|seen| measured(seen, signal))
        .collect()
}

/// Value of a signal in the registers of a request. `None` if the request does not read them.
fn measured(seen: &SeenRequest, signal: &Signal) -> Option<f64> {
    if seen.is_write()
        || seen.device != signal.device
        || seen.address.register().unwrap().table != signal.address.register().unwrap().table
    {
        return None;
    }
    let from = usize::from(
        signal.address.register().unwrap().offset.checked_sub(seen.address.register().unwrap().offset)?,
    );
    let words = seen.after.get(from..from + usize::from(signal.encoding.data_type.registers()))?;
    if signal.address.register().unwrap().table.is_bits() {
        return signal.encoding.decode_bit(words[0] != 0).ok();
    }
    signal.encoding.decode(words).ok()
}

/// I3: an axis follows only good readings, and an offset moves away from zero only towards a value decided from them.
fn grows_only_while_active(trace: &Trace) {
    // If the clock was just set ahead, the previous decision is still valid.
    let steady = |sample: &&crate::faults::rig::Sample| sample.status.now == sample.at.to_string();
    for sample in trace.samples.iter().filter(steady) {
        for (axis, status) in trace.profile.axes.iter().zip(&sample.status.axes) {
            let Some(model) =
                axis.settings.models.iter().find(|model| Some(&model.name) == status.model.as_ref())
            else {
                assert!(!matches!(status.state, "active" | "degraded"), "I3: {status:?}");
                continue;
            };
            let fresh = Duration::from_secs(3) + axis.settings.every;
            for id in model.signals() {
                let signal = &sample.status.signals[id.0];
                let age = signal.age_s.unwrap_or(f64::INFINITY);
                let max_age = (trace.profile.signal(id).max_age + fresh).as_secs_f64();
                assert!(age <= max_age || status.state != "active", "I3: {status:?} on {signal:?}");
            }
        }
    }
    let offsets = trace.profile.outputs.iter();
    let offsets = offsets.filter(|output| output.writes == Writes::Offset && output.share == Share::Whole);
    let of_offsets = offsets.flat_map(|output| {
        trace.wire.iter().filter_map(move |seen| Some((of_output(seen, output)?, output)))
    });
    for (seen, output) in of_offsets {
        let value = |words: &[u16]| output.encoding.decode(words).unwrap().abs();
        if value(&seen.wanted) <= value(&seen.before) + EPSILON {
            continue;
        }
        let near = |at: Moment| at.since(seen.at) + seen.at.since(at) <= Duration::from_secs(6);
        let wanted = value(&seen.wanted);
        let factor = if trace.profile.axis(output.axis).diameter { 2.0 } else { 1.0 };
        let decided = trace.samples.iter().filter(|sample| near(sample.at));
        // A decision that was valid for less than a second is in no sample. The tolerance for it is two counts of
        // noise, or one step if the axis was stopped directly after it.
        let has_just_stopped = trace.events.iter().filter(|event| event.kind == "stopping").any(|event| {
            let at = time::parse(&event.at).unwrap();
            at <= seen.at && seen.at.since(at) < Duration::from_secs(1)
        });
        let unseen = match has_just_stopped {
            true => trace.profile.axis(output.axis).settings.guard.step.get() * factor,
            false => 2.0 * output.encoding.scale.get(),
        };
        let follows = decided.into_iter().map(|sample| &sample.status.axes[output.axis.0]).any(|axis| {
            matches!(axis.state, "active" | "degraded" | "holding")
                && axis.cz_um.abs() * factor + unseen + EPSILON >= wanted
        });
        assert!(
            follows,
            "I3: grew at {:.1} s without a good reading: {seen:?}\n{}",
            trace.seconds(seen.at),
            trace.lines()
        );
    }
}

/// I5: a good reading on the board is a value that the device measured recently.
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

/// I9: one request is sent only a few times at one moment, whatever the clock did.
fn nothing_comes_in_bursts(trace: &Trace) {
    let mut asked: HashMap<_, (Moment, u32)> = HashMap::new();
    for seen in &trace.wire {
        let question = (seen.device, seen.function, &seen.address, seen.count);
        let entry = asked.entry(question).or_insert((seen.at, 0));
        *entry = if entry.0 == seen.at { (seen.at, entry.1 + 1) } else { (seen.at, 1) };
        // A set is read before and after each beat and each change. These may coincide, and an answer may be lost.
        assert!(entry.1 <= 6, "I9: a burst at {:.1} s of {question:?}", trace.seconds(seen.at));
    }
}

/// I2 as the axes see it: the values that a control takes of a set differ by at most one step from the previous ones.
pub(crate) fn nothing_taken_jumps(trace: &Trace) {
    let profile = &trace.profile;
    for (place, set) in profile.sets.iter().enumerate() {
        let taken = trace.taken.iter().filter(|taken| taken.set.0 == place);
        let mut last: Option<Vec<f64>> = None;
        for taken in taken {
            let decoded = set.members(profile).zip(&taken.words).map(|(output, words)| {
                let axis = &profile.axis(output.axis).settings;
                let reach = axis.intercept_slope.map_or(1.0, |line| line.reach.get());
                let factor = if output.writes == Writes::Slope { reach } else { 1.0 };
                output.encoding.decode(words).unwrap() * factor
            });
            let values: Vec<f64> = decoded.collect();
            let zero = values.iter().all(|value| value.abs() < EPSILON);
            for ((output, value), before) in set.members(profile).zip(&values).zip(last.iter().flatten()) {
                let step = profile.axis(output.axis).settings.guard.step.get();
                let is_corrected = output.writes != Writes::Reference;
                assert!(
                    zero || !is_corrected || (value - before).abs() <= step + EPSILON,
                    "{} went from {before} to {value} at {:.2} s\n{}",
                    output.name,
                    trace.seconds(taken.at),
                    trace.lines()
                );
            }
            last = Some(values);
        }
    }
}
