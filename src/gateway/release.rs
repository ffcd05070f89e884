//! Releases: registers that are no output's any more and go back to their base, each as the output of one more axis.
//!
//! The profile in memory gets an axis whose Cz is always 0, with the bounds that the output had, and an output at its former place. So
//! the register is read, written and verified as every other. The file of the profile stays as it is.
//!
//! Each of these keeps a register from being released: nothing says how it was moved, the profile writes to it, its line cannot be
//! opened, or its control does not take it by itself.

use std::time::Duration;

use isotherm_core::codec::{Address, DataType, Encoding, Register, Scale, Table, WordOrder};
use isotherm_core::compensation::model::{Condition, Kind, Linear, Model};
use isotherm_core::compensation::settings::{AxisSettings, Datum, GuardSettings, Levels, OnFault};
use isotherm_core::explained::Explained;
use isotherm_core::place::{Bounds, Former, Line, Obstacle, OutputPlace, Owner, Release};
use isotherm_core::quantity::{Micron, MicronPerSecond};
use isotherm_core::reading::SignalId;
use isotherm_profile::{
    Axis, AxisId, Bus, BusId, Device, DeviceId, Display, Functions, Output, OutputId, Profile, Purpose,
    Quirks, ReadBy, Share, Transport, Verify, Writes,
};

use super::arming::Attempt;
use super::store::Entry;

/// What a person can do about a register that cannot be released.
pub(super) const BY_HAND: &str =
    "set that register to zero at the control unless the operator needs the value, then arm the axis";
/// Timeout and poll period of a line or device that the profile does not have any more.
const TIMEOUT: Duration = Duration::from_millis(500);
const EVERY: Duration = Duration::from_secs(1);
/// Name of the only model of an axis that takes a register back.
const MODEL: &str = "base";
/// What no count of a floating-point register is smaller than, in steps.
const GRAIN_OF_A_STEP: f64 = 1e-3;

/// Releases of a run.
#[derive(Clone, Debug, Default)]
pub(super) struct Releases {
    /// Former places, each with what keeps it from being released.
    obstacles: Vec<(OutputPlace, Option<Explained>)>,
    /// Registers on their way back.
    pub(super) returning: Vec<Returning>,
    /// Registers whose release was given up while a value of ours could still arrive.
    pub(super) given_up: Vec<Returning>,
}

/// Register on its way back.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Returning {
    pub(super) axis: AxisId,
    pub(super) output: OutputId,
    pub(super) release: Release,
    /// Half a count of the register, µm.
    pub(super) grain_um: f64,
}

/// Way to the register of a former place.
#[derive(Debug)]
struct Way {
    device: Target,
    register: Register,
    encoding: Encoding,
    when: Option<Condition>,
}

/// Device of a former place.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Target {
    /// The profile has it.
    Known(DeviceId),
    /// The profile has its line.
    OnLine(BusId),
    /// The profile does not have its line either.
    Elsewhere(Transport),
}

impl Releases {
    /// Finds out which former places of a profile can be released.
    pub(super) fn of(profile: &Profile, former: &[Former], kept: &[Entry]) -> Releases {
        let obstacle = |former: &Former| (former.place.clone(), why_not(profile, former, kept));
        Releases { obstacles: former.iter().map(obstacle).collect(), ..Releases::default() }
    }

    /// Returns what keeps a former place from being released. `None` if nothing does.
    pub(super) fn obstacle(&self, place: &OutputPlace) -> Option<Explained> {
        let known = self.obstacles.iter().find(|(known, _)| known == place);
        known.map_or_else(|| Some(unknown()), |(_, why)| why.clone())
    }

    /// Refuses the attempt to arm an axis that takes a register back, if the register holds a value that no person has seen.
    pub(super) fn judge(&self, axis: usize, attempt: Attempt) -> Attempt {
        let returning = self.returning.iter().find(|one| one.axis.0 == axis);
        let (Some(Returning { release, grain_um, .. }), Attempt::From(found, _)) = (returning, &attempt)
        else {
            return attempt;
        };
        if release.may_move_from(found.get(), *grain_um) {
            return attempt;
        }
        Attempt::Refused(Explained::new(
            format!(
                "{} holds {found}, and {:.1} µm of ours were expected in it",
                release.place, release.from_um
            ),
            "compare the register at the control; if the value is to go, release it again",
        ))
    }
}

/// Bounds of an output, as they are saved.
pub(super) fn bounds_of(profile: &Profile, output: &Output) -> Bounds {
    let axis = &profile.axis(output.axis).settings;
    let device = profile.device(output.device);
    let bus = profile.bus(device.bus);
    let line = match bus.transport {
        Transport::Tcp if bus.tls.is_none() => Line::ModbusTcp,
        Transport::RtuOverTcp => Line::ModbusRtuOverTcp,
        _ => Line::Other,
    };
    let obstacle = match &output.address {
        _ if output.set.is_some() => Some(Obstacle::Set),
        _ if output.writes != Writes::Offset => Some(Obstacle::Writes),
        Address::Modbus(_) if output.verify == Verify::ReadBack => None,
        Address::Modbus(_) => Some(Obstacle::Unread),
        _ => Some(Obstacle::Address),
    };
    Bounds {
        limit_um: axis.guard.limit.get(),
        step_um: axis.guard.step.get(),
        rate_um_per_s: axis.guard.rate.get(),
        every_s: axis.every.as_secs_f64(),
        line,
        when: output.when.as_ref().map(|when| when.text.clone()),
        obstacle,
    }
}

/// Type and order of the bytes.
pub(super) fn layout(encoding: &Encoding) -> String {
    let name = encoding.data_type.name();
    let order = match encoding.data_type.registers() {
        1 => String::new(),
        _ => format!(" {}", encoding.word_order),
    };
    format!("{name}{order}{}", if encoding.byte_swap { " byte-swapped" } else { "" })
}

fn unknown() -> Explained {
    let cause = "the saved state does not say how it was moved: an earlier version of the program wrote it";
    Explained::new(cause, BY_HAND)
}

/// Returns what keeps a former place from being released. `None` if nothing does.
fn why_not(profile: &Profile, former: &Former, kept: &[Entry]) -> Option<Explained> {
    let by_hand = |cause: String| Some(Explained::new(cause, BY_HAND));
    let Some(bounds) = &former.bounds else { return Some(unknown()) };
    if former.place.share == Owner::Ledger {
        let entry = kept.iter().find(|entry| entry.lies_at(&former.place));
        let account = entry.and_then(|entry| entry.kept.account);
        match account {
            None => {
                return by_hand("the saved state does not say which part of it is the operator's".to_owned());
            }
            Some(account) if account.doubt.is_some() => {
                return by_hand("which part of it is the operator's is in doubt".to_owned());
            }
            Some(_) => {}
        }
    }
    let held = former.found_um.or(former.held_um).unwrap_or_default();
    if held.abs() > bounds.limit_um + bounds.step_um * GRAIN_OF_A_STEP {
        return by_hand(format!(
            "{held:.1} µm is more than the limit of ±{} µm that it had",
            bounds.limit_um
        ));
    }
    way(profile, &former.place, bounds).err()
}

/// Finds the way to the register of a former place.
fn way(profile: &Profile, place: &OutputPlace, bounds: &Bounds) -> Result<Way, Explained> {
    let by_hand = |cause: String| Explained::new(cause, BY_HAND);
    if !bounds.are_sound() {
        return Err(unknown());
    }
    if let Some(obstacle) = bounds.obstacle {
        return Err(by_hand(obstacle.cause().to_owned()));
    }
    let (register, encoding) = register(place)
        .ok_or_else(|| by_hand(format!("no register is read as {} {}", place.address, place.layout)))?;
    let count = encoding.data_type.registers();
    let buses = profile.buses.iter().enumerate().filter(|(_, bus)| bus.address == place.bus);
    let buses: Vec<(BusId, &Bus)> = buses.map(|(id, bus)| (BusId(id), bus)).collect();
    let is_written = |bus: BusId| {
        let written = profile.written_on(bus);
        (0..count).any(|more| {
            let offset = register.offset.saturating_add(more);
            written.contains(&format!("unit {} {}:{offset}", place.unit, register.table.name()))
        })
    };
    if buses.iter().any(|(bus, _)| is_written(*bus)) {
        return Err(Explained::new("the profile writes to it", "arm the axis of that output"));
    }
    let device = target(profile, place, bounds.line, &buses)?;
    if let Target::Known(id) = device {
        let device = profile.device(id);
        if device.functions.writes(count).is_none() || !device.functions.reads(Table::Holding) {
            return Err(by_hand(format!(
                "`functions` of device {} do not allow it to be read and written",
                device.name
            )));
        }
    }
    let signal = |name: &str| profile.signals.iter().position(|signal| signal.name == name).map(SignalId);
    let when = bounds.when.as_ref().map(|text| {
        Condition::parse(text, &signal).map_err(|_| {
            by_hand(format!("its interlock, {text}, has a signal that the profile does not have any more"))
        })
    });
    Ok(Way { device, register, encoding, when: when.transpose()? })
}

/// Finds the device of a former place, on one of the lines at its address.
fn target(
    profile: &Profile,
    place: &OutputPlace,
    line: Line,
    buses: &[(BusId, &Bus)],
) -> Result<Target, Explained> {
    let is_modbus =
        |bus: &Bus| matches!(bus.transport, Transport::Tcp | Transport::RtuOverTcp | Transport::Serial(_));
    let mut lines = buses.iter().filter(|(_, bus)| is_modbus(bus)).map(|(id, _)| *id);
    let known = lines.clone().find_map(|bus| {
        let mut devices = profile.devices_on(bus);
        devices.find(|(_, device)| device.unit == place.unit).map(|(id, _)| id)
    });
    match (known, lines.next(), line) {
        (Some(device), ..) => Ok(Target::Known(device)),
        (None, Some(bus), _) => Ok(Target::OnLine(bus)),
        (None, None, Line::ModbusTcp) => Ok(Target::Elsewhere(Transport::Tcp)),
        (None, None, Line::ModbusRtuOverTcp) => Ok(Target::Elsewhere(Transport::RtuOverTcp)),
        (None, None, Line::Other) => Err(Explained::new(
            format!("the profile does not have its line, {}, any more", place.bus),
            "put the line into the profile again and restart with `isotherm restart --keep`, or set that register to zero at the \
             control unless the operator needs the value",
        )),
    }
}

/// Register and encoding of a former place. `None` if it is no holding register, or has a type that no version writes.
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

/// Adds an axis and an output for each release, and the line and device if the profile does not have them. Returns those that the
/// profile still allows.
pub(super) fn extend(profile: &mut Profile, releases: &[Release]) -> Vec<Returning> {
    let mut returning = Vec::new();
    for release in releases {
        let way = way(profile, &release.place, &release.bounds).ok();
        returning.extend(way.and_then(|way| add(profile, release, way)));
    }
    returning
}

fn add(profile: &mut Profile, release: &Release, way: Way) -> Option<Returning> {
    let Release { output, place, bounds, .. } = release;
    let Way { device, register, encoding, when } = way;
    let factor = if place.diameter { 2.0 } else { 1.0 };
    let is_whole = encoding.data_type.integer_range().is_some();
    let count = is_whole.then(|| Micron::new(place.scale.abs() / factor)).flatten();
    let guard = GuardSettings {
        limit: Micron::new(bounds.limit_um)?,
        step: Micron::new(bounds.step_um)?,
        rate: MicronPerSecond::new(bounds.rate_um_per_s)?,
        deadband: Micron::ZERO,
        count,
    };
    let every = Duration::try_from_secs_f64(bounds.every_s).ok()?;
    let axes: Vec<&str> = profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
    let name = free(format!("release_{output}"), &axes);
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
    };
    let outputs: Vec<&str> = profile.outputs.iter().map(|output| output.name.as_str()).collect();
    let name = match outputs.contains(&output.as_str()) {
        true => free(format!("{output}_released"), &outputs),
        false => output.clone(),
    };
    let device = match device {
        Target::Known(device) => device,
        Target::OnLine(bus) => add_device(profile, bus, place.unit),
        Target::Elsewhere(transport) => {
            let bus = add_bus(profile, &place.bus, transport);
            add_device(profile, bus, place.unit)
        }
    };
    let (axis, id) = (AxisId(profile.axes.len()), OutputId(profile.outputs.len()));
    let (label, diameter) = (String::new(), place.diameter);
    profile.axes.push(Axis { settings, label, diameter, probe_input: None, purpose: Purpose::Release });
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
    Some(Returning { axis, output: id, release: release.clone(), grain_um })
}

fn add_bus(profile: &mut Profile, address: &str, transport: Transport) -> BusId {
    let names: Vec<&str> = profile.buses.iter().map(|bus| bus.name.as_str()).collect();
    let name = free("release".to_owned(), &names);
    profile.buses.push(Bus {
        name,
        transport,
        address: address.to_owned(),
        tls: None,
        opcua: None,
        timeout: TIMEOUT,
        late: transport.late(TIMEOUT),
        pipeline: 1,
        quirks: Quirks::default(),
        sync: None,
    });
    BusId(profile.buses.len() - 1)
}

fn add_device(profile: &mut Profile, bus: BusId, unit: u8) -> DeviceId {
    let names: Vec<&str> = profile.devices.iter().map(|device| device.name.as_str()).collect();
    let (name, quirks) = (free("release".to_owned(), &names), profile.bus(bus).quirks);
    profile.devices.push(Device {
        name,
        label: String::new(),
        bus,
        unit,
        every: EVERY,
        functions: Functions::ALL,
        quirks,
        verify: Vec::new(),
        template: None,
        can: None,
        source_time: None,
        read: ReadBy::default(),
        is_pc: false,
    });
    DeviceId(profile.devices.len() - 1)
}

/// This name, or with a number one that nothing else has.
fn free(name: String, taken: &[&str]) -> String {
    let numbered = |number: u32| if number == 1 { name.clone() } else { format!("{name}_{number}") };
    // An endless series has a free one.
    (1..).map(numbered).find(|name| !taken.contains(&name.as_str())).unwrap_or(name.clone())
}

#[cfg(test)]
mod tests;
