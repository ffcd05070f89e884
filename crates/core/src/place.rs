//! Places of outputs and signals: the address of a value, and the size of its count. The gateway stores the places of
//! each run. [`compare`] compares the stored places with the places in the profile. [`FormerPlace::after`] determines
//! which axes wait for the operator.
//!
//! A name does not identify a place. The register of an output, its scale, or the channel of a sensor can change under
//! the same name.
//!
//! | stored under a name | in the profile | result |
//! |---|---|---|
//! | this place | this place | [`PlaceComparison::Same`] |
//! | nothing | this place, which a removed name had | [`PlaceComparison::Renamed`] |
//! | nothing | another place | [`PlaceComparison::Unknown`] |
//! | another place | this place | [`PlaceComparison::Moved`] |
//! | a place | nothing | [`PlaceComparison::Removed`] |

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};
use std::fmt;

use serde::{Deserialize, Serialize};

mod release;

pub use release::{Bounds, Obstacle, Release, Stage};

/// Smallest absolute value of Cz (the compensation value) that does not count as zero, µm.
const NOTHING_UM: f64 = 0.05;

/// Part of a place. The parts are in order: a change of the first part is the most serious.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Part {
    /// Address of the bus to which the device is connected.
    Bus,
    /// Modbus unit address or CANopen node number of the device.
    Unit,
    /// Register, CANopen object, CAN frame or OPC UA node.
    Address,
    /// Type and byte order of the value in the registers.
    Type,
    /// Units per count of the register.
    Scale,
    /// Number that is added to the raw count before it is sent.
    Bias,
    /// Engineering value of a raw count of zero.
    Offset,
    /// Owner of the register: the gateway or the operator.
    Share,
    /// Quantity that the output writes, for example an offset.
    Writes,
    /// Axis whose Cz the output writes.
    Axis,
    /// Whether the written value is a diameter, which contains twice Cz.
    Diameter,
}

impl Part {
    /// Returns whether an output that writes a position plus Cz can continue in steps of Cz after this part
    /// of its place has changed. True for the axis and the diameter: the register and the units per count are
    /// then unchanged.
    pub fn is_bridged_by_steps(self) -> bool {
        matches!(self, Part::Axis | Part::Diameter)
    }
}

/// Place of an output or signal that can be compared part by part.
pub trait Place: PartialEq {
    /// Returns the parts in the order of [`Part`], each with its value as text. Two places are equal if all parts are
    /// equal.
    fn parts(&self) -> Vec<(Part, String)>;
}

/// Owner of the register of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Owner {
    /// The gateway owns the whole register.
    Whole,
    /// The operator owns the register. The gateway adds its own offset (gateway share) to the value, and stores the
    /// share in the register ledger on disk.
    Ledger,
}

/// Place of an output: the register that the gateway writes, and the meaning of its counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputPlace {
    /// Address of the bus to which the device is connected.
    pub bus: String,
    /// Modbus unit address or CANopen node number of the device.
    pub unit: u8,
    /// Register, CANopen object, CAN frame or OPC UA node.
    pub address: String,
    /// Type and byte order of the value in the registers.
    #[serde(rename = "type")]
    pub layout: String,
    /// Units of the value per count of the register.
    pub scale: f64,
    /// Number that is added to the raw count before it is sent.
    pub bias: i64,
    /// Owner of the register: the gateway or the operator.
    pub share: Owner,
    /// Quantity that the output writes, for example an offset.
    pub writes: String,
    /// Axis whose Cz the output writes.
    pub axis: String,
    /// Whether the written value is a diameter, which contains twice Cz.
    pub diameter: bool,
}

/// Place of a signal: the address that the gateway reads, and the meaning of its counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignalPlace {
    /// Address of the bus to which the device is connected.
    pub bus: String,
    /// Modbus unit address or CANopen node number of the device.
    pub unit: u8,
    /// Register, CANopen object, CAN frame, OPC UA node, or sensor of this computer.
    pub address: String,
    /// Type and byte order of the value in the registers.
    #[serde(rename = "type")]
    pub layout: String,
    /// Units of the value per count of the register.
    pub scale: f64,
    /// Engineering value of a raw count of zero.
    pub offset: f64,
}

impl OutputPlace {
    /// Returns whether the other place is the same register, and its counts have the same size.
    pub fn is_same_register(&self, other: &OutputPlace) -> bool {
        let is_same_count = self.bias == other.bias && self.scale.total_cmp(&other.scale).is_eq();
        self.is_at(other) && self.layout == other.layout && is_same_count
    }

    /// Returns whether the other place is in the same register, even if the size of a count differs.
    pub fn is_at(&self, other: &OutputPlace) -> bool {
        (&self.bus, self.unit, &self.address) == (&other.bus, other.unit, &other.address)
    }

    /// Returns whether the output writes a corrected position: a position that was read, plus Cz. The output is written
    /// again for each new position.
    pub fn is_corrected_position(&self) -> bool {
        self.writes == "corrected"
    }
}

impl fmt::Display for OutputPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} of unit {} at {}", self.address, self.unit, self.bus)
    }
}

/// Returns the parts that outputs and signals have in common, each with its value as text.
fn register(bus: &str, unit: u8, address: &str, (layout, scale): (&str, f64)) -> [(Part, String); 5] {
    [
        (Part::Bus, format!("bus {bus}")),
        (Part::Unit, format!("unit {unit}")),
        (Part::Address, address.to_owned()),
        (Part::Type, format!("type {layout}")),
        (Part::Scale, format!("scale {scale}")),
    ]
}

impl Place for OutputPlace {
    fn parts(&self) -> Vec<(Part, String)> {
        let owner = match self.share {
            Owner::Whole => "whole",
            Owner::Ledger => "ledger",
        };
        let register = register(&self.bus, self.unit, &self.address, (&self.layout, self.scale)).into_iter();
        let more = [
            (Part::Bias, format!("bias {}", self.bias)),
            (Part::Share, format!("share {owner}")),
            (Part::Writes, format!("writes {}", self.writes)),
            (Part::Axis, format!("axis {}", self.axis)),
            (Part::Diameter, (if self.diameter { "diameter" } else { "radius" }).to_owned()),
        ];
        register.chain(more).collect()
    }
}

impl Place for SignalPlace {
    fn parts(&self) -> Vec<(Part, String)> {
        let register = register(&self.bus, self.unit, &self.address, (&self.layout, self.scale)).into_iter();
        let more = [(Part::Offset, format!("offset {}", self.offset))];
        register.chain(more).collect()
    }
}

/// Result of comparing the stored place of one name with its place in the profile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PlaceComparison {
    /// The place in the profile equals the stored place.
    Same,
    /// The place was stored under this other name, which the profile no longer contains.
    Renamed(String),
    /// No place is stored under this name.
    Unknown,
    /// The place stored under this name differs from the place in the profile.
    Moved(MovedPlace),
    /// The profile no longer contains the name.
    Removed,
}

/// Difference between the saved place of an output or signal and its place in the profile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MovedPlace {
    /// Most serious part that differs, in the order of [`Part`].
    pub what: Part,
    /// Former values of all parts that differ.
    pub was: String,
    /// Present values of all parts that differ.
    pub is: String,
}

impl MovedPlace {
    /// Compares a former place with the present place. Returns `None` if the two are equal.
    pub fn between(was: &impl Place, is: &impl Place) -> Option<MovedPlace> {
        let (was, is) = (was.parts(), is.parts());
        let changed = || was.iter().zip(&is).filter(|(was, is)| was != is);
        let text = |parts: Vec<&str>| parts.join(", ");
        Some(MovedPlace {
            what: changed().next()?.0.0,
            was: text(changed().map(|(was, _)| was.1.as_str()).collect()),
            is: text(changed().map(|(_, is)| is.1.as_str()).collect()),
        })
    }
}

/// Compares the stored places with the places in the profile, by name.
pub fn compare<P: Place>(
    remembered: &BTreeMap<String, P>,
    profile: &BTreeMap<String, P>,
) -> BTreeMap<String, PlaceComparison> {
    // Names that the profile no longer contains, by their places.
    let mut gone: HashMap<Vec<(Part, String)>, VecDeque<&String>> = HashMap::new();
    for (name, was) in remembered.iter().filter(|(name, _)| !profile.contains_key(*name)) {
        gone.entry(was.parts()).or_default().push_back(name);
    }
    let mut found = BTreeMap::new();
    for (name, is) in profile {
        let result = match remembered.get(name) {
            Some(was) if was == is => PlaceComparison::Same,
            Some(was) => MovedPlace::between(was, is).map_or(PlaceComparison::Same, PlaceComparison::Moved),
            None => match gone.get_mut(&is.parts()).and_then(VecDeque::pop_front) {
                Some(former) => PlaceComparison::Renamed(former.clone()),
                None => PlaceComparison::Unknown,
            },
        };
        found.insert(name.clone(), result);
    }
    found.extend(gone.into_values().flatten().map(|name| (name.clone(), PlaceComparison::Removed)));
    found
}

/// State of an output at the end of the last run.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownOutput {
    /// Register that the output wrote, and the meaning of its counts.
    pub place: OutputPlace,
    /// Last verified Cz of the gateway in the register, µm. `None` if the Cz is unknown.
    pub held_um: Option<f64>,
    /// Whether the gateway may have written to the register. A register that was only read contains no Cz.
    pub was_driven: bool,
}

impl KnownOutput {
    /// Returns whether the operator shared the register with the gateway in the last run, and the gateway owns it in
    /// the profile (`is`).
    fn becomes_ours(&self, is: &OutputPlace) -> bool {
        (self.place.share, is.share) == (Owner::Ledger, Owner::Whole)
    }
}

/// Former place of an output, stored until the operator confirms the new place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FormerPlace {
    /// Name of the output, also if the profile no longer contains it.
    pub output: String,
    /// Place that the output had before the profile moved or removed it.
    pub place: OutputPlace,
    /// Last verified Cz of the gateway in the register, µm. `None` if the Cz is unknown.
    pub held_um: Option<f64>,
    /// Axes that stay off until the operator arms them.
    pub axes: BTreeSet<String>,
    /// Bounds within which the gateway changed the output. `None` if the state comes from an earlier version of the
    /// program.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Bounds>,
    /// Cz that a release (return of the register to its base value) found, µm, if it differed from the last verified
    /// Cz.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub found_um: Option<f64>,
}

impl FormerPlace {
    /// Creates a former place without axes, bounds and a found Cz.
    fn of(output: String, place: OutputPlace, held_um: Option<f64>) -> FormerPlace {
        FormerPlace { output, place, held_um, axes: BTreeSet::new(), bounds: None, found_um: None }
    }

    /// Replaces the name of the output if `names` contains a new name for it.
    pub fn renamed(self, names: &BTreeMap<String, String>) -> FormerPlace {
        let output = names.get(&self.output).cloned().unwrap_or(self.output);
        FormerPlace { output, ..self }
    }

    /// Returns the former places that the operator must confirm after a start, with the axes that wait for the
    /// operator. These are places that earlier starts found (`open`), and places that were changed or removed since the
    /// last run.
    pub fn after(
        open: Vec<FormerPlace>,
        remembered: &BTreeMap<String, KnownOutput>,
        profile: &BTreeMap<String, OutputPlace>,
    ) -> Vec<FormerPlace> {
        let places = remembered.iter().map(|(name, known)| (name.clone(), known.place.clone())).collect();
        let found = compare(&places, profile);
        // If the output is back in a former register, the value in that register is known. This does not hold for the
        // operator offset in a shared register.
        let is_back = |former: &&FormerPlace| {
            profile.get(&former.output).is_some_and(|is| MovedPlace::between(&former.place, is).is_none())
        };
        let back: BTreeSet<String> =
            open.iter().filter(is_back).map(|former| former.output.clone()).collect();
        let mut all = open;
        for (name, known) in remembered {
            let (output, KnownOutput { place, held_um, .. }) = (name.clone(), known.clone());
            let former = FormerPlace::of(output, place, held_um);
            let is_in_doubt = match found.get(name) {
                Some(PlaceComparison::Moved(_)) => profile.get(name).is_some_and(|is| {
                    let is_back = back.contains(name);
                    let leaves = former.keeps_something() && !is.is_at(&former.place);
                    // A value of the gateway may remain at the former place, or a value of the operator may be at the
                    // new place. The operator must confirm the change.
                    known.was_driven && (leaves || !is_back)
                        || known.becomes_ours(is) && (is.is_at(&former.place) || !is_back)
                }),
                Some(PlaceComparison::Removed) => {
                    known.was_driven && former.keeps_something() || former.becomes_whole(profile).is_some()
                }
                _ => false,
            };
            let is_known = all.iter().any(|known| known.output == *name && known.place == former.place);
            if is_in_doubt && !is_known {
                all.push(former);
            }
        }
        // The profile of an earlier start may have had neither the removed output nor the new one.
        all.iter_mut().for_each(|former| former.bar_new_outputs(&found, profile));
        all.retain_mut(|former| former.is_open(profile));
        all
    }

    /// Adds to `axes` each axis with a new output, if the removed output may have left a Cz in its former register. The
    /// former Cz and the Cz of the new output would act together. Does nothing if the profile still has the output.
    fn bar_new_outputs(
        &mut self,
        found: &BTreeMap<String, PlaceComparison>,
        profile: &BTreeMap<String, OutputPlace>,
    ) {
        let does_again = self.keeps_something() || self.becomes_whole(profile).is_some();
        if !profile.contains_key(&self.output) && does_again {
            self.axes.extend(axes_with_new_outputs(&self.place, found, profile));
        }
    }

    /// Returns whether a Cz of the gateway stays in effect in the register after the gateway has stopped writing it.
    /// Corrected positions do not count.
    fn keeps_something(&self) -> bool {
        is_something(self.held_um) && !self.place.is_corrected_position()
    }

    /// Returns the output that owns this register wholly in the profile, if the former output shared the register with
    /// the operator. `None` if there is no such output.
    pub fn becomes_whole<'a>(&self, profile: &'a BTreeMap<String, OutputPlace>) -> Option<&'a str> {
        let takes = |place: &OutputPlace| place.share == Owner::Whole && place.is_at(&self.place);
        let mut outputs = profile.iter().filter(|_| self.place.share == Owner::Ledger);
        outputs.find(|(_, place)| takes(place)).map(|(name, _)| name.as_str())
    }

    /// Updates the axes that wait for the operator, according to this profile. Returns whether the operator must still
    /// confirm the former place.
    fn is_open(&mut self, profile: &BTreeMap<String, OutputPlace>) -> bool {
        let Some(is) = profile.get(&self.output) else {
            self.axes.retain(|axis| profile.values().any(|place| place.axis == *axis));
            return is_something(self.held_um) || self.becomes_whole(profile).is_some();
        };
        let Some(MovedPlace { what, .. }) = MovedPlace::between(&self.place, is) else { return false };
        let is_bridged = is.is_corrected_position() && what.is_bridged_by_steps();
        self.axes = BTreeSet::from([is.axis.clone()]);
        !is_bridged
    }

    /// Returns whether a Cz of the gateway remains in a register that no longer belongs to an output.
    pub fn is_left_behind(&self, profile: &BTreeMap<String, OutputPlace>) -> bool {
        let is_ours = profile.values().any(|place| place.is_at(&self.place));
        !is_ours && self.keeps_something()
    }

    /// Records that the operator has armed `axis` after this former place was reported. Returns whether another axis
    /// must still be armed to confirm the place. If no axis waits, arming the output's own axis confirms the place. If
    /// that axis cannot be armed (`may_arm`), arming any axis confirms the place.
    pub fn confirm(&mut self, axis: &str, may_arm: impl Fn(&str) -> bool) -> bool {
        let is_of_it = self.axes.remove(axis) || self.place.axis == axis || !may_arm(&self.place.axis);
        !(is_of_it && self.axes.is_empty())
    }
}

/// Returns the axes whose new outputs could repeat the effect of the removed output. These are the axis of the removed
/// output, and axes with a new output in its register. If the profile no longer has the former axis, these are all axes
/// with a new output.
fn axes_with_new_outputs(
    removed: &OutputPlace,
    found: &BTreeMap<String, PlaceComparison>,
    profile: &BTreeMap<String, OutputPlace>,
) -> BTreeSet<String> {
    let has_its_axis = profile.values().any(|place| place.axis == removed.axis);
    let is_new =
        |name: &String| matches!(found.get(name), Some(PlaceComparison::Unknown | PlaceComparison::Moved(_)));
    let new = profile.iter().filter(|(name, _)| is_new(name));
    let repeats = |place: &&OutputPlace| !has_its_axis || place.axis == removed.axis || place.is_at(removed);
    new.map(|(_, place)| place).filter(repeats).map(|place| place.axis.clone()).collect()
}

fn is_something(um: Option<f64>) -> bool {
    um.is_some_and(|um| um.abs() >= NOTHING_UM)
}

#[cfg(test)]
mod tests;
