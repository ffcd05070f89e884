//! Continuity of the devices: whether each device is still the device that has passed its checks (comparisons of
//! registers with the values in the profile). Also contains the devices of each axis. [`isotherm_core::continuity`]
//! decides, and the [`Inspector`](crate::gateway::line::inspector::Inspector) reads the checks.

use std::sync::Arc;

use super::arming::Arming;
use super::dirty_vec::DirtyVec;
use crate::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use isotherm_core::compensation::model::Model;
use isotherm_core::compensation::reference::Reference;
use isotherm_core::compensation::{Compensation, ReturnTo};
use isotherm_core::continuity::{Break, Continuity, DeviceContinuity, Difference, Identity, sentence};
use isotherm_core::quantity::Moment;
use isotherm_profile::{AxisId, BusId, Device, DeviceId, Members, Profile};

/// Continuity of all devices: whether each device is certain to be the device that has passed the checks. A break of
/// the continuity is an event after which another device or other settings are possible.
#[derive(Clone, Debug)]
pub(in crate::gateway) struct Devices {
    devices: Vec<DeviceContinuity>,
    /// Devices of each axis: the models of the axis read these devices, or its outputs write to them.
    of_axis: Members,
    /// Axes of each device: these axes read the device, or write to the device.
    axes_of: Members,
    /// For each device: the axes whose models read the device, and the Cz and slope of each axis before the
    /// last round of checks that passed.
    held: Vec<Vec<(usize, ReturnTo)>>,
    /// For each device: the axes whose models read the device, and the Cz and slope of each axis at the
    /// beginning of the present round of checks.
    held_in_round: Vec<Vec<(usize, ReturnTo)>>,
    /// For each device: the axes whose models read the device.
    read_by: Members,
    /// Namespaces that the profile refers to by index, for each bus that is an OPC UA server.
    namespaces: Vec<Option<NamespaceTable>>,
}

impl Devices {
    pub(in crate::gateway) fn new(profile: &Arc<Profile>, start: Moment) -> Devices {
        let continuity = |device: &Device| DeviceContinuity::new(identity(device), device.every, start);
        let devices = profile.devices.iter().map(continuity).collect();
        let read: Vec<(usize, usize)> = read_devices(profile).collect();
        let written = profile.outputs.iter().map(|output| (output.axis.0, output.device.0));
        let used: Vec<(usize, usize)> = read.iter().copied().chain(written).collect();
        let reversed =
            |pairs: &[(usize, usize)]| pairs.iter().map(|(axis, device)| (*device, *axis)).collect();
        let held = vec![Vec::new(); profile.devices.len()];
        Devices {
            devices,
            axes_of: reversed(&used),
            of_axis: used.into_iter().collect(),
            held_in_round: held.clone(),
            held,
            read_by: reversed(&read),
            namespaces: vec![None; profile.buses.len()],
        }
    }

    /// Stores the table of namespaces of an OPC UA server. The task of the bus line fills the table.
    pub(in crate::gateway) fn set_namespaces(&mut self, bus: BusId, table: NamespaceTable) {
        self.namespaces[bus.0] = Some(table);
    }

    pub(in crate::gateway) fn namespaces(&self, bus: BusId) -> Option<NamespaceTable> {
        self.namespaces[bus.0].clone()
    }

    pub(in crate::gateway) fn of(&self, device: DeviceId) -> &DeviceContinuity {
        &self.devices[device.0]
    }

    /// Returns whether the device is confirmed: its readings are used, and writes to it are sent.
    pub(in crate::gateway) fn is_confirmed(&self, device: DeviceId) -> bool {
        self.of(device).is_confirmed()
    }

    /// Returns whether the checks of the device have not been read since the last break of its continuity.
    pub(in crate::gateway) fn is_unconfirmed(&self, device: DeviceId) -> bool {
        matches!(self.of(device).state(), Continuity::Unconfirmed { .. })
    }

    /// Returns the result of the device's checks as one sentence, if the checks did not pass.
    pub(in crate::gateway) fn changed(&self, device: DeviceId) -> Option<String> {
        match self.of(device).state() {
            Continuity::Changed(differences) => Some(sentence(differences)),
            Continuity::Confirmed | Continuity::Unconfirmed { .. } => None,
        }
    }

    /// Returns the state of the first changed device of an axis. Without a changed device, returns the state of the
    /// first unconfirmed device. Without such a device, returns [`Continuity::Confirmed`].
    pub(in crate::gateway) fn of_axis(&self, axis: usize) -> &Continuity {
        let states = || self.of_axis.of(axis).map(|device| self.devices[device].state());
        let changed = states().find(|state| matches!(state, Continuity::Changed(_)));
        let unconfirmed = || states().find(|state| matches!(state, Continuity::Unconfirmed { .. }));
        changed.or_else(unconfirmed).unwrap_or(&Continuity::Confirmed)
    }

    /// Returns the first device of the axis whose checks have not been read since the last break of its continuity.
    /// The second value is the cause of this break. `None` if there is no such device.
    pub(super) fn unconfirmed(&self, axis: usize) -> Option<(DeviceId, Break)> {
        self.of_axis.of(axis).find_map(|device| match self.devices[device].state() {
            Continuity::Unconfirmed { cause, .. } => Some((DeviceId(device), *cause)),
            Continuity::Confirmed | Continuity::Changed(_) => None,
        })
    }

    /// Begins a round of checks of a device. Records the present Cz and slope of each armed axis whose models
    /// read the device. An axis that a sign check moves is left out.
    pub(in crate::gateway) fn round_begins(
        &mut self,
        device: DeviceId,
        compensation: &Compensation,
        arming: &DirtyVec<Arming>,
    ) {
        let follows = |axis: usize| arming[axis].is_armed() && !arming[axis].is_moved_by_sign_check();
        let holds = |axis: usize| {
            let Arming { take_over, take_over_slope, .. } = arming[axis];
            let decision = compensation.decision(axis).filter(|_| follows(axis))?;
            // The value from which an axis resumes at its next step is already in its registers.
            let (cz, slope) = (take_over.unwrap_or(decision.cz), take_over_slope.unwrap_or(decision.slope));
            Some((axis, ReturnTo { cz, slope }))
        };
        self.held_in_round[device.0] = self.read_by.of(device.0).filter_map(holds).collect();
    }

    /// Ends a round in which all checks of a device have passed. If the settings of the device change later, the axes
    /// that read the device return to their Cz at the beginning of this round.
    pub(in crate::gateway) fn round_passed(&mut self, device: DeviceId, arming: &mut DirtyVec<Arming>) {
        for axis in self.axes_of.of(device.0) {
            if arming[axis].return_to.is_some() && *self.of_axis(axis) == Continuity::Confirmed {
                arming[axis].return_to = None;
            }
        }
        let (of_device, in_round) = (&mut self.held[device.0], &mut self.held_in_round[device.0]);
        // An axis that was armed during the round keeps its value of that moment.
        of_device.retain(|(axis, _)| in_round.iter().all(|(other, _)| axis != other));
        of_device.append(in_round);
    }

    /// Discards the recorded Cz and slope of the axes that use this reference, because the reference is
    /// captured again.
    pub(in crate::gateway) fn forget_held(&mut self, profile: &Profile, reference: Reference) {
        let is_kept = |axis: usize| !profile.axis(AxisId(axis)).counts_from(reference);
        self.held
            .iter_mut()
            .chain(&mut self.held_in_round)
            .for_each(|held| held.retain(|(axis, _)| is_kept(*axis)));
    }

    /// Records the Cz and slope of an axis at its arming, for each device that its models read.
    pub(in crate::gateway) fn armed(&mut self, axis: usize, held: ReturnTo) {
        for device in self.of_axis.of(axis) {
            self.held_in_round[device].retain(|(known, _)| *known != axis);
            self.held[device].retain(|(known, _)| *known != axis);
            let reads = self.read_by.of(device).any(|reader| reader == axis);
            self.held[device].extend(reads.then_some((axis, held)));
        }
    }

    /// Handles changed settings of a device. The axes that read the device return to their Cz before the last round
    /// of checks that passed.
    pub(in crate::gateway) fn settings_changed(&self, device: DeviceId, arming: &mut DirtyVec<Arming>) {
        for (axis, held) in &self.held[device.0] {
            // If another device was changed before, the value held since then is wrong as well.
            if arming[*axis].is_armed() && arming[*axis].return_to.is_none() {
                arming[*axis].return_to = Some(*held);
            }
        }
    }

    /// Records a break of the continuity of one device: from now on, another device or other settings are possible.
    pub(in crate::gateway) fn breaks(&mut self, device: DeviceId, cause: Break, now: Moment) {
        self.devices[device.0].breaks(cause, now);
    }

    /// Records a break of the continuity of all devices: from now on, other devices or other settings are possible.
    pub(in crate::gateway) fn all_break(&mut self, cause: Break, now: Moment) {
        self.devices.iter_mut().for_each(|device| device.breaks(cause, now));
    }

    /// Records an answer of a device, which may also be the refusal of a request.
    pub(in crate::gateway) fn answers(&mut self, device: DeviceId, now: Moment) {
        self.devices[device.0].answers(now);
    }

    /// Records that a device has answered with the requested values.
    pub(in crate::gateway) fn delivers(&mut self, device: DeviceId, now: Moment) {
        self.devices[device.0].delivers(now);
    }

    /// Records that a request is about to be sent to a device. See [`DeviceContinuity::notice_silence`].
    pub(in crate::gateway) fn notice_silence(&mut self, device: DeviceId, now: Moment) {
        self.devices[device.0].notice_silence(now);
    }

    /// Records a request that a device did not answer.
    pub(in crate::gateway) fn misses(&mut self, device: DeviceId, now: Moment) {
        self.devices[device.0].misses(now);
    }

    /// Processes the result of a device's checks. See [`DeviceContinuity::verified`].
    pub(in crate::gateway) fn verified(
        &mut self,
        device: DeviceId,
        after: u64,
        differences: Vec<Difference>,
    ) -> Option<Continuity> {
        self.devices[device.0].verified(after, differences)
    }
}

fn identity(device: &Device) -> Identity {
    if device.is_checked() { Identity::Checks } else { Identity::None }
}

/// Returns pairs of indices: an axis, and a device that its models read.
fn read_devices(profile: &Profile) -> impl Iterator<Item = (usize, usize)> {
    profile.axes.iter().enumerate().flat_map(move |(place, axis)| {
        let signals = axis.settings.models.iter().flat_map(Model::signals);
        signals.map(move |signal| (place, profile.signal(signal).device.0))
    })
}
