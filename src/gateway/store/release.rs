//! Releases: registers that outputs no longer use return to their base value, which is the value without the gateway's
//! offset. Each register is the output of an additional axis.
//!
//! The profile in memory gets an axis and an output. The target of the axis is a Cz of 0, with the limit, step and
//! rate of the former axis. The output uses the former register. Therefore the register is read, written and verified
//! like the register of any other output. The profile file does not change.
//!
//! A release belongs to one run. If the gateway ends before the release is over, the next run reports the register
//! again.
//!
//! A release is not possible under one of these conditions:
//!
//! - The saved state does not contain limit, step and rate of the former axis.
//! - The profile writes to the register, or no longer has its device.
//! - The output was part of a set, was not an offset, was not read back, or was not on Modbus.

use std::collections::BTreeSet;
use std::time::Duration;

use isotherm_core::codec::{DataType, Encoding, Register, Scale, Table, WordOrder};
use isotherm_core::compensation::model::{Condition, Kind, Linear, Model};
use isotherm_core::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, OnFault};
use isotherm_core::explained::Explained;
use isotherm_core::output::SavedOutput;
use isotherm_core::place::{Bounds, FormerPlace, Obstacle, OutputPlace, Owner, Release};
use isotherm_core::quantity::{Counts, Micron, MicronPerSecond};
use isotherm_core::reading::SignalId;
use isotherm_profile::{
    Axis, AxisId, BusId, Device, DeviceId, Display, Output, OutputId, Profile, Purpose, Share, Verify, Writes,
};

use super::documents::Entry;
use crate::gateway::line_names;
use crate::gateway::state::arming::Attempt;

/// Hint about a register that the gateway cannot release.
pub(super) const BY_HAND: &str =
    "set that register to zero at the control unless the operator needs the value, then arm the axis";
/// First part of the names of additional axes that release a register.
pub(super) const AXIS: &str = "release_";
/// Name of the only model of an axis that releases a register.
const MODEL: &str = "base";
/// Resolution of a floating-point register during a release, as a fraction of the axis's step.
const GRAIN_OF_A_STEP: f64 = 1e-3;

/// Former registers that are released (returned to their base values) in this run, or that can be released.
#[derive(Clone, Debug, Default)]
pub(in crate::gateway) struct Releases {
    /// Former registers, each with the obstacle to its release (return to the base value). `None` if the register can
    /// be released.
    obstacles: Vec<(OutputPlace, Option<Explained>)>,
    /// Registers that the gateway is returning to their base values in this run.
    pub(in crate::gateway) returning: Vec<ReturningRegister>,
    /// Registers whose release has failed while a write of the gateway could still arrive.
    pub(in crate::gateway) given_up: Vec<ReturningRegister>,
    /// Operator offsets of shared registers whose release has failed, in the unit of the register. An operator offset
    /// is the part of the register value that the operator entered.
    pub(in crate::gateway) parts: Vec<(OutputPlace, f64)>,
}

/// Former register that is returning to its base value.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::gateway) struct ReturningRegister {
    pub(in crate::gateway) axis: AxisId,
    pub(in crate::gateway) output: OutputId,
    pub(in crate::gateway) release: Release,
    /// Accepted difference of Cz, µm: half a count of an integer register, or one count of a floating-point
    /// register.
    pub(in crate::gateway) grain_um: f64,
    /// Axes that may not be armed until the release has ended: axes of the output with the same name, and
    /// axes that the changed register keeps off. The former and the present address may belong to the same
    /// register of the control.
    pub(in crate::gateway) waits: Vec<AxisId>,
}

/// Access to a former register: its device, its encoding and its interlock.
#[derive(Debug)]
struct FormerRegister {
    device: DeviceId,
    register: Register,
    encoding: Encoding,
    when: Option<Condition>,
}

impl Releases {
    /// Determines which former registers can be released (returned to their base values) with this profile.
    pub(in crate::gateway) fn of(profile: &Profile, former: &[FormerPlace], kept: &[Entry]) -> Releases {
        if former.is_empty() {
            return Releases::default();
        }
        let written = WrittenPlaces::of(profile);
        let obstacle =
            |former: &FormerPlace| (former.place.clone(), why_not(profile, former, kept, &written).err());
        Releases { obstacles: former.iter().map(obstacle).collect(), ..Releases::default() }
    }

    /// Returns the reason why a former register cannot be released. `None` if it can be released.
    pub(in crate::gateway) fn obstacle(&self, place: &OutputPlace) -> Option<Explained> {
        let known = self.obstacles.iter().find(|(known, _)| known == place);
        known.map_or_else(|| Some(unknown()), |(_, why)| why.clone())
    }

    /// Records that a former register is not released (returned to its base value) in this run, for the reason `why`.
    pub(in crate::gateway) fn refuse(&mut self, place: &OutputPlace, why: &Explained) {
        let known = self.obstacles.iter_mut().filter(|(known, _)| known == place);
        known.for_each(|(_, obstacle)| *obstacle = Some(why.clone()));
    }

    /// Checks an attempt to arm an axis. The axis of a release is refused if its register does not hold the value
    /// that an operator has seen. An axis whose output was moved is refused until its former register is released.
    pub(in crate::gateway) fn assess(
        &self,
        axis: AxisId,
        attempt: Attempt,
        shares: impl Fn(OutputId) -> Option<(f64, f64)>,
    ) -> Attempt {
        let Attempt::From(found, _) = &attempt else { return attempt };
        if let Some(one) = self.returning.iter().find(|one| one.waits.contains(&axis)) {
            return Attempt::Refused(Explained::new(
                format!(
                    "the former register of the output, {}, is still returning to its base value",
                    one.release.place
                ),
                "arm the axis when the release has ended: `isotherm status` shows its progress, and \
                 `isotherm disarm` of the release axis ends it",
            ));
        }
        let of_axis = self.returning.iter().find(|one| one.axis == axis);
        match of_axis.map(|one| one.admit(*found, shares(one.output))) {
            Some(Err(why)) => Attempt::Refused(why),
            Some(Ok(())) | None => attempt,
        }
    }

    /// Checks whether an axis may continue from the Cz that was read in the register of `output`. Only the axis of a
    /// release can be refused.
    ///
    /// # Errors
    /// The register does not hold the value that an operator has seen.
    pub(in crate::gateway) fn admit(
        &self,
        output: OutputId,
        found: Micron,
        shares: Option<(f64, f64)>,
    ) -> Result<(), Explained> {
        let returning = self.returning.iter().find(|one| one.output == output);
        returning.map_or(Ok(()), |one| one.admit(found, shares))
    }
}

impl ReturningRegister {
    /// Checks whether the axis may continue from the Cz that was read in its register. `shares` contains the two
    /// parts of a shared register's value: operator offset and gateway share.
    ///
    /// # Errors
    /// The register does not hold the value that an operator has seen.
    pub(in crate::gateway) fn admit(
        &self,
        found: Micron,
        shares: Option<(f64, f64)>,
    ) -> Result<(), Explained> {
        let Release { place, .. } = &self.release;
        let ours = self.release.known_um();
        let compare = "compare the register at the control; if the value must be removed, release it again";
        if !self.release.may_move_from(found.get(), self.grain_um) {
            let cause =
                format!("{place} holds {found}, but {ours:.1} µm from the gateway were expected in it");
            return Err(Explained::new(cause, compare));
        }
        match (self.release.operator, shares) {
            (None, _) if place.share == Owner::Whole => Ok(()),
            (Some(was), Some((is, _))) if (is - was).abs() <= self.grain_um => Ok(()),
            (Some(was), Some((is, _))) => Err(Explained::new(
                format!(
                    "{place} holds {is:.1} µm besides the {ours:.1} µm of the gateway, but the operator offset was \
                     {was:.1} µm. Perhaps the gateway share was removed by hand"
                ),
                compare,
            )),
            (None, _) | (_, None) => Err(Explained::new(
                format!("it is not certain which part of the value in {place} the operator has entered"),
                compare,
            )),
        }
    }
}

/// Registers and nodes that a profile writes, and the canonical names of its buses.
struct WrittenPlaces {
    /// Registers and nodes that the profile writes, for each bus.
    places: Vec<BTreeSet<String>>,
    /// Canonical names of each bus.
    names: Vec<Vec<String>>,
}

impl WrittenPlaces {
    fn of(profile: &Profile) -> WrittenPlaces {
        let buses: Vec<_> = profile.buses.iter().collect();
        WrittenPlaces { places: profile.written_places(), names: line_names::of_each(&buses) }
    }

    /// Returns whether the profile writes one of these registers on the bus `bus`. Another bus of the profile with
    /// the same address, in any spelling, also counts.
    fn contain(&self, bus: BusId, places: &[String]) -> bool {
        let own = &self.names[bus.0];
        let is_same = |names: &[String]| names.iter().any(|name| own.contains(name));
        let mut same = self.places.iter().zip(&self.names).filter(|(_, names)| is_same(names));
        same.any(|(written, _)| places.iter().any(|place| written.contains(place)))
    }
}

/// Returns limit, step, rate and interlock of an output in the form that is saved.
pub(super) fn bounds_of(profile: &Profile, output: &Output) -> Bounds {
    let axis = &profile.axis(output.axis).settings;
    let obstacle = if output.set.is_some() {
        Some(Obstacle::Set)
    } else if output.writes != Writes::Offset {
        Some(Obstacle::Writes)
    } else if output.address.register().is_none() {
        Some(Obstacle::Address)
    } else if output.verify != Verify::ReadBack {
        Some(Obstacle::Unread)
    } else {
        None
    };
    Bounds {
        limit_um: axis.guard.limit.get(),
        step_um: axis.guard.step.get(),
        rate_um_per_s: axis.guard.rate.get(),
        every_s: axis.every.as_secs_f64(),
        when: output.when.as_ref().map(|when| when.text.clone()),
        obstacle,
    }
}

/// Formats data type and byte order of an encoding as text.
pub(super) fn layout(encoding: &Encoding) -> String {
    let name = match encoding.data_type {
        DataType::Part(part) => format!("{} bits {part}", part.type_name()),
        data_type => data_type.name().to_owned(),
    };
    let order = match encoding.data_type.registers() {
        1 => String::new(),
        _ => format!(" {}", encoding.word_order),
    };
    format!("{name}{order}{}", if encoding.byte_swap { " byte-swapped" } else { "" })
}

/// Returns the obstacle to the release of a shared register whose entry in the register ledger is uncertain.
pub(in crate::gateway) fn in_doubt() -> Explained {
    Explained::new("it is not certain which part of this register's value the operator has entered", BY_HAND)
}

fn unknown() -> Explained {
    let cause = "the saved state does not contain a valid limit, step and rate for this register; an \
                 earlier version of the program may have written it";
    Explained::new(cause, BY_HAND)
}

/// Checks that a former register can be released.
///
/// # Errors
/// The register cannot be released. The error contains the reason and a hint.
fn why_not(
    profile: &Profile,
    former: &FormerPlace,
    kept: &[Entry],
    written: &WrittenPlaces,
) -> Result<(), Explained> {
    let by_hand = |cause: String| Err(Explained::new(cause, BY_HAND));
    let Some(bounds) = &former.bounds else { return Err(unknown()) };
    way(profile, &former.place, bounds, written)?;
    if former.place.share == Owner::Ledger {
        let entry = kept.iter().find(|entry| entry.lies_at(&former.place));
        match entry.and_then(|entry| entry.kept.account) {
            None => {
                return by_hand(
                    "the saved state does not show which part of this register's value the operator has \
                     entered"
                        .to_owned(),
                );
            }
            Some(account) if account.doubt.is_some() => return Err(in_doubt()),
            Some(_) => {}
        }
    }
    let held = former.found_um.or(former.held_um).unwrap_or_default();
    if held.abs() > bounds.limit_um + bounds.step_um * GRAIN_OF_A_STEP {
        return by_hand(format!("{held:.1} µm is more than the former limit of ±{} µm", bounds.limit_um));
    }
    Ok(())
}

/// Returns the saved operator offset of a shared register (part of the value that the operator entered), in the unit
/// of the register. `None` if the register is not shared, or if the offset is not known.
pub(in crate::gateway) fn operators_part(
    place: &OutputPlace,
    bounds: &Bounds,
    kept: Option<&SavedOutput>,
) -> Option<f64> {
    let account = kept?.account.filter(|_| place.share == Owner::Ledger)?;
    let (_, encoding) = register(place)?;
    if encoding.data_type.integer_range().is_some() {
        return Some(encoding.value_of(account.base - Counts(place.bias)));
    }
    #[allow(clippy::cast_precision_loss, reason = "no register holds 2^53 counts")]
    let counts = account.base.0 as f64;
    Some(counts * bounds.step_um * factor(place) * GRAIN_OF_A_STEP)
}

/// Returns the factor from Cz to the written value: 2 for a diameter, otherwise 1.
fn factor(place: &OutputPlace) -> f64 {
    if place.diameter { 2.0 } else { 1.0 }
}

/// Finds device, encoding and interlock of a former register. The error is the reason why the register cannot be
/// released.
fn way(
    profile: &Profile,
    place: &OutputPlace,
    bounds: &Bounds,
    written: &WrittenPlaces,
) -> Result<FormerRegister, Explained> {
    let by_hand = |cause: String| Explained::new(cause, BY_HAND);
    if !bounds.are_sound() {
        return Err(unknown());
    }
    if let Some(obstacle) = bounds.obstacle {
        return Err(by_hand(obstacle.cause().to_owned()));
    }
    let (register, encoding) = register(place).ok_or_else(|| {
        by_hand(format!("the program cannot read a register {} of type {}", place.address, place.layout))
    })?;
    let device = device_at(profile, place).ok_or_else(|| {
        Explained::new(
            format!(
                "the profile no longer has the device of this register, unit {} at {}",
                place.unit, place.bus
            ),
            "put that bus and device into the profile again and restart with `isotherm restart --keep`. Or \
             set that register to zero at the control, unless the operator needs the value",
        )
    })?;
    let count = encoding.data_type.registers();
    let offsets = (0..count).map(|more| register.offset.saturating_add(more));
    let registers = offsets.map(|offset| format!("unit {} {}:{offset}", place.unit, register.table.name()));
    if written.contain(profile.device(device).bus, &registers.collect::<Vec<_>>()) {
        return Err(Explained::new(
            "an output of the profile writes to this register",
            "arm the axis of that output",
        ));
    }
    let settings = profile.device(device);
    if settings.functions.writes(count).is_none() || !settings.functions.reads(Table::Holding) {
        return Err(by_hand(format!(
            "`functions` of device {} do not allow reading and writing of this register",
            settings.name
        )));
    }
    let signal = |name: &str| profile.signals.iter().position(|signal| signal.name == name).map(SignalId);
    let when = bounds.when.as_ref().map(|text| {
        Condition::parse(text, &signal).map_err(|_| {
            by_hand(format!(
                "the interlock {text} of this register has a signal that is no longer in the profile"
            ))
        })
    });
    Ok(FormerRegister { device, register, encoding, when: when.transpose()? })
}

/// Finds the device of a former register in the profile, which defines checks, bus and timeouts.
fn device_at(profile: &Profile, place: &OutputPlace) -> Option<DeviceId> {
    let is_at = |device: &Device| device.unit == place.unit && profile.bus(device.bus).address == place.bus;
    profile.devices.iter().position(is_at).map(DeviceId)
}

/// Parses address and encoding of a former register. Returns `None` if it is not a holding register, or has a data
/// type that isotherm never writes.
fn register(place: &OutputPlace) -> Option<(Register, Encoding)> {
    let (text, _) = place.address.split_once(' ')?;
    let register: Register =
        text.parse().ok().filter(|register: &Register| register.table == Table::Holding)?;
    let orders = [WordOrder::MswFirst, WordOrder::LswFirst];
    let all = DataType::ALL.into_iter().flat_map(|data_type| {
        orders.into_iter().flat_map(move |order| [false, true].map(|byte_swap| (data_type, order, byte_swap)))
    });
    let encodings = all.map(|(data_type, word_order, byte_swap)| Encoding {
        data_type,
        word_order,
        byte_swap,
        scale: Scale::of(place.scale),
        offset: 0.0,
        bias: place.bias,
        bad: Vec::new(),
    });
    let mut encodings = encodings.filter(|encoding| encoding.data_type != DataType::Bool);
    let is_sound = place.scale.is_finite() && place.scale.abs() > 0.0;
    let encoding = encodings.find(|encoding| is_sound && layout(encoding) == place.layout)?;
    Some((register, encoding))
}

/// Adds an axis and an output to the profile for each release. Returns the releases that are possible with this
/// profile.
pub(in crate::gateway) fn extend(profile: &mut Profile, releases: &[Release]) -> Vec<ReturningRegister> {
    let mut returning = Vec::new();
    for release in releases {
        let way = way(profile, &release.place, &release.bounds, &WrittenPlaces::of(profile)).ok();
        returning.extend(way.and_then(|way| add(profile, release, way)));
    }
    returning
}

fn add(profile: &mut Profile, release: &Release, way: FormerRegister) -> Option<ReturningRegister> {
    let Release { output, place, bounds, .. } = release;
    let FormerRegister { device, register, encoding, when } = way;
    let is_whole = encoding.data_type.integer_range().is_some();
    let count = is_whole.then(|| Micron::new(place.scale.abs() / factor(place))).flatten();
    let guard = GuardSettings {
        limit: Micron::new(bounds.limit_um)?,
        step: Micron::new(bounds.step_um)?,
        rate: MicronPerSecond::new(bounds.rate_um_per_s)?,
        deadband: Micron::ZERO,
        count,
    };
    let every = Duration::try_from_secs_f64(bounds.every_s).ok()?;
    let axes: Vec<&str> = profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    let name = free(format!("{AXIS}{output}"), &axes);
    let kind = Kind::Linear(Linear { offset: Micron::ZERO, terms: Vec::new(), slope: None });
    let settings = AxisSettings {
        name,
        models: vec![Model::new(MODEL.to_owned(), kind)],
        guard,
        every,
        on_fault: OnFault::Hold,
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    };
    let outputs: Vec<&str> = profile.outputs.iter().map(|output| output.name.as_str()).collect();
    let name = match outputs.contains(&output.as_str()) {
        true => free(format!("{output}_released"), &outputs),
        false => output.clone(),
    };
    let same_name = profile.outputs.iter().filter(|known| known.name == *output);
    let waits = same_name.map(|known| known.axis).collect();
    let (axis, id) = (AxisId(profile.axes.len()), OutputId(profile.outputs.len()));
    let (label, diameter) = (String::new(), place.diameter);
    profile.axes.push(Axis {
        settings,
        label,
        diameter,
        probe_input: None,
        learning: None,
        purpose: Purpose::Release,
    });
    profile.outputs.push(Output {
        name,
        axis,
        device,
        address: register.into(),
        encoding,
        writes: Writes::Offset,
        verify: Verify::ReadBack,
        refresh: None,
        when,
        set: None,
        boot_counter: None,
        share: match place.share {
            Owner::Whole => Share::Whole,
            Owner::Ledger => Share::Ledger,
        },
        applied: None,
        display: Display::default(),
        stated: None,
    });
    let grain_um = count.map_or(bounds.step_um * GRAIN_OF_A_STEP, |count| count.get() * 0.501);
    Some(ReturningRegister { axis, output: id, release: release.clone(), grain_um, waits })
}

/// Returns `name` if no item in `taken` has this name. Otherwise, appends the smallest number that makes the
/// name unique.
fn free(name: String, taken: &[&str]) -> String {
    let numbered = |number: u32| if number == 1 { name.clone() } else { format!("{name}_{number}") };
    // An endless series contains a free name.
    (1..).map(numbered).find(|name| !taken.contains(&name.as_str())).unwrap_or(name.clone())
}

#[cfg(test)]
mod tests;
