//! Commands of operators and programs: the axes to which a command applies, its rate limit, and its effect on the
//! state.

use std::sync::Arc;

use crate::clock::BootClock;
use crate::gateway::shared::carry_out::{carry_out, reported};
use crate::gateway::shared::namespaces::confirm_namespaces;
use crate::gateway::shared::rates::{PresentTime, RateSubject};
use crate::gateway::shared::shared_state::Shared;
use crate::gateway::shared::state::GatewayState;
use crate::gateway::shared::{releasing, signing};
use crate::gateway::state::arming::{ArmRequest, BY_A_PERSON};
use crate::gateway::state::causes;
use crate::gateway::state::probing::{MissReason, acting, why_refused};
use crate::observe::events::Event;
use crate::observe::requester::Requester;
use crate::observe::status::{Answer, Command, ReleaseRequest};
use isotherm_core::compensation::reference::Reference;
use isotherm_core::compensation::{Measured, MeasuredReport, Refused, Snapshot};
use isotherm_core::explained::Explained;
use isotherm_core::quantity::Micron;
use isotherm_profile::safe_file::quoted;
use isotherm_profile::{AxisId, DeviceId};

/// Answer to a zero command when no axis or model has the reference "zero".
const NO_ZERO: &str = "nothing is captured: no model and no datum of the chosen axes uses the reference \
                       \"zero\". Write reference = \"zero\" in a model, or datum = \"zero\" in its axis, and restart";

/// Handle that carries out commands on the shared state.
pub(super) struct CommandHandle(pub(super) Arc<Shared>);

/// Converts the chosen axes of a command to subjects of the rate limit (one command per second for each axis). If the
/// axis is unknown, the subject is [`RateSubject::Nothing`].
fn about<E>(axes: Result<&[usize], E>) -> Vec<RateSubject> {
    let each = |axes: &[usize]| axes.iter().map(|axis| RateSubject::Axis(*axis)).collect();
    axes.map_or_else(|_| vec![RateSubject::Nothing], each)
}

/// Returns the index of the chosen axis. If several axes are chosen, the error is a message that tells the user to
/// choose one.
fn one(chosen: &[usize]) -> Result<usize, String> {
    match chosen {
        [one] => Ok(*one),
        _ => Err("the profile has several axes: choose one with --axis".to_owned()),
    }
}

impl CommandHandle {
    pub(super) fn command(
        &self,
        command: Command,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, String> {
        let shared = &*self.0;
        let chosen = match command {
            // The operator may end a release, too.
            Command::Disarm | Command::Cancel => self.named(axis),
            Command::Adopt | Command::AdoptBack if axis.is_none() => self.learning(),
            _ => self.chosen(axis),
        };
        let name = |place: &usize| shared.profile.axes[*place].settings.name.clone();
        let names: Vec<String> = chosen.iter().flatten().map(name).collect();
        let said = names.join(", ");
        // Commands that stop the machine are never rejected as too frequent.
        let about = about(chosen.as_deref());
        if self.withdraws(command, chosen.as_deref().unwrap_or_default()) {
            shared.rates().note(command.name(), &about, self.now());
        } else if let Err(too_soon) = self.takes(command.name(), &about) {
            return Ok(too_soon);
        }
        carry_out(&self.0, (command.name().to_owned(), names), requester, Answer::text, |core| {
            let chosen = chosen?;
            match command {
                Command::Arm if core.phase.is_stopping() => Err("the gateway is stopping".into()),
                Command::Arm => self.arm(core, axis, requester),
                Command::Disarm => {
                    for axis in &chosen {
                        core.disarm(AxisId(*axis), BY_A_PERSON);
                        core.arming[*axis].trust = true;
                    }
                    Ok(Answer::Done(format!("{said}: off; the registers keep their values")))
                }
                Command::Zero => {
                    let (now, only) = (shared.clock.now(), axis.map(|_| chosen[0]));
                    let of = if only.is_some() { format!("{said}: ") } else { String::new() };
                    if !chosen.iter().any(|axis| shared.profile.axes[*axis].counts_from(Reference::Zero)) {
                        return Ok(Answer::Done(format!("{of}{NO_ZERO}")));
                    }
                    match only {
                        None => core.compensation.zero(now),
                        Some(place) if core.compensation.zero_axis(place, now) => {}
                        Some(_) => {
                            return Err(Explained::new(
                                format!("axis {said} and another axis use the zero of the same signal"),
                                "capture zero for all axes together",
                            ));
                        }
                    }
                    core.devices.forget_held(&shared.profile, Reference::Zero);
                    core.storage.zeroed(now, only);
                    core.events.push(Event::Zeroed);
                    Ok(Answer::Done(format!("{of}references are captured from now on")))
                }
                Command::Sign => signing::begin(core, one(&chosen)?, requester, shared.clock.now()),
                Command::Signed(moved) => {
                    let stamp = shared.clock.stamp(shared.clock.now()).to_string();
                    signing::answer(core, one(&chosen)?, moved, (requester, stamp))
                }
                Command::Adopt => core.adopt(one(&chosen)?).map(Answer::Done),
                Command::AdoptBack => core.adopt_back(one(&chosen)?).map(Answer::Done),
                Command::Cancel => {
                    let by = requester.way.by(&requester.who);
                    let mut signs = chosen.clone();
                    signs.retain(|axis| signing::end(core, *axis, format!("cancelled {by}").into()));
                    let waiting = chosen.into_iter().filter(|axis| core.arming[*axis].asked.is_some());
                    let waiting: Vec<usize> = waiting.collect();
                    waiting.iter().for_each(|axis| core.cancel(*axis, format!("cancelled {by}").into()));
                    match waiting.iter().map(name).collect::<Vec<_>>() {
                        names if names.is_empty() && signs.is_empty() => {
                            Err("no request to arm is waiting".into())
                        }
                        names if names.is_empty() => Ok(Answer::Done(format!(
                            "{}: Cz returns to the value of the model",
                            signs.iter().map(name).collect::<Vec<_>>().join(", ")
                        ))),
                        names => {
                            Ok(Answer::Done(format!("{}: the request to arm is cancelled", names.join(", "))))
                        }
                    }
                }
            }
        })
    }

    /// Returns whether the command has an effect on one of these axes: `disarm` on an armed or waiting axis, `cancel`
    /// on a request to arm or a sign check. Any other command gives `false`.
    fn withdraws(&self, command: Command, axes: &[usize]) -> bool {
        let core = self.0.core();
        let does = |axis: &usize| {
            let arming = &core.arming[*axis];
            match command {
                Command::Disarm => arming.is_armed() || arming.is_waiting(&self.0.profile, *axis),
                Command::Cancel => arming.asked.is_some() || arming.sign.is_some(),
                _ => false,
            }
        };
        axes.iter().any(does)
    }

    fn now(&self) -> PresentTime {
        PresentTime { machine: self.0.clock.now(), passed: BootClock::default().passed() }
    }

    /// Applies the rate limit to a command. If the gateway accepted the same command for one of these axes less than
    /// a second ago, the error is the answer to the sender.
    fn takes(&self, verb: &'static str, about: &[RateSubject]) -> Result<(), Answer> {
        if self.0.rates().take(verb, about, self.now()) {
            return Ok(());
        }
        let axes = about.iter().filter_map(|about| match about {
            RateSubject::Axis(place) => Some(self.0.profile.axes[*place].settings.name.as_str()),
            _ => None,
        });
        let axes = axes.collect::<Vec<_>>().join(", ");
        let of = if axes.is_empty() { String::new() } else { format!("{axes}: ") };
        Err(Answer::TooSoon(format!(
            "{of}{verb} was requested less than a second ago; it is accepted once a second"
        )))
    }

    /// Returns the indices of the chosen axes. The result does not contain an axis that returns a released register
    /// to its base value, because only `isotherm release` moves such an axis.
    fn chosen(&self, axis: Option<&str>) -> Result<Vec<usize>, String> {
        let mut places = self.named(axis)?;
        places.retain(|place| !self.0.profile.is_release(AxisId(*place)));
        match axis {
            Some(axis) if places.is_empty() => Err(format!(
                "axis {axis} only returns a register to its base value; `isotherm release` starts this"
            )),
            _ => Ok(places),
        }
    }

    /// Returns the indices of the axes that learn a model.
    fn learning(&self) -> Result<Vec<usize>, String> {
        let axes = self.0.profile.axes.iter().enumerate();
        let places: Vec<usize> =
            axes.filter(|(_, axis)| axis.learning.is_some()).map(|(place, _)| place).collect();
        match places.is_empty() {
            true => Err("no axis of the profile learns a model: set `learn` in the table `probe` of an axis"
                .to_owned()),
            false => Ok(places),
        }
    }

    /// Returns the index of the named axis, or all indices if `axis` is `None`.
    fn named(&self, axis: Option<&str>) -> Result<Vec<usize>, String> {
        let axes = &self.0.profile.axes;
        let Some(axis) = axis else { return Ok((0..axes.len()).collect()) };
        let place = axes.iter().position(|known| known.settings.name == axis);
        place.map(|place| vec![place]).ok_or_else(|| {
            let names: Vec<&str> = axes.iter().map(|axis| axis.settings.name.as_str()).collect();
            format!("there is no axis {}; there are {}", quoted(axis), names.join(", "))
        })
    }

    /// Requests to arm the chosen axes, and arms them at once if possible. If an axis cannot be armed, the answer
    /// contains the reason.
    fn arm(
        &self,
        core: &mut GatewayState,
        axis: Option<&str>,
        requester: &Arc<Requester>,
    ) -> Result<Answer, Explained> {
        let (now, chosen) = (self.0.clock.now(), self.armable(axis)?.0);
        for axis in &chosen {
            let until = now.after(self.0.profile.arm_timeout);
            let asked =
                ArmRequest { by: requester.clone(), until, reported: (String::new(), now), from: None };
            let arming = &mut core.arming[*axis];
            arming.asked = (!arming.is_armed() || arming.is_tripped()).then_some(asked);
            arming.refusal = None;
        }
        core.board.check(now);
        core.arm_where_possible(now);
        for axis in &chosen {
            let why = core.why(*axis, now);
            if let Some(asked) = &mut core.arming[*axis].asked {
                asked.reported = (why.cause, now);
            }
        }
        self.progress(core, axis)
    }

    /// Returns the progress of the sign check of the chosen axis.
    pub(super) fn signing(&self, axis: Option<&str>) -> Result<Answer, String> {
        let axis = one(&self.chosen(axis)?)?;
        let mut core = self.0.core();
        let now = self.0.clock.now();
        signing::follow(&mut core, now);
        signing::progress(&core, axis, now).map_err(|why| why.to_string())
    }

    pub(super) fn arming(&self, axis: Option<&str>) -> Result<Answer, Explained> {
        let mut core = self.0.core();
        core.end_requests(self.0.clock.now());
        self.progress(&core, axis)
    }

    /// Returns the indices of the chosen axes that have a model, and the names of the chosen axes without a model. If
    /// no axis can be armed, the error explains why.
    fn armable(&self, axis: Option<&str>) -> Result<(Vec<usize>, Vec<&str>), Explained> {
        let profile = &self.0.profile;
        let (armable, unmodelled): (Vec<usize>, Vec<usize>) =
            self.chosen(axis)?.into_iter().partition(|axis| profile.axes[*axis].has_model());
        let name = |axis: &usize| profile.axes[*axis].settings.name.as_str();
        match unmodelled.first() {
            Some(first) if armable.is_empty() => {
                let why = causes::unmodelled(profile, *first);
                Err(why.within(|cause| format!("axis {} is not armed: {cause}", name(first))))
            }
            _ => Ok((armable, unmodelled.iter().map(name).collect())),
        }
    }

    fn progress(&self, core: &GatewayState, axis: Option<&str>) -> Result<Answer, Explained> {
        let (profile, now) = (&self.0.profile, self.0.clock.now());
        let (chosen, unmodelled) = self.armable(axis)?;
        let (mut armed, mut waiting) = (Vec::new(), Vec::new());
        for axis in chosen {
            let name = &profile.axes[axis].settings.name;
            let arming = &core.arming[axis];
            if arming.is_armed() && arming.asked.is_none() {
                armed.push(name.as_str());
            } else if arming.refusal.is_some()
                || !(arming.asked.is_some() || arming.is_waiting(profile, axis))
            {
                let why = arming.refusal.as_ref().unwrap_or(&arming.why).clone();
                return Err(why.within(|cause| format!("axis {name} is not armed: {cause}")));
            } else {
                waiting.push(format!("{name}: waiting to arm: {}", core.why(axis, now)));
            }
        }
        if waiting.is_empty() {
            let others = unmodelled.iter().map(|axis| format!("; {axis}: no model yet")).collect::<String>();
            return Ok(Answer::Done(format!("{}: armed{others}", armed.join(", "))));
        }
        Ok(Answer::Waits(waiting.join("; ")))
    }

    /// Adds a reminder to the answer for each axis whose sign was never checked with a dial gauge. The gateway gives
    /// this reminder only once for each axis.
    pub(super) fn reminding(&self, answer: Answer, axis: Option<&str>) -> Answer {
        let Answer::Done(mut said) = answer else { return answer };
        let profile = &self.0.profile;
        let mut core = self.0.core();
        for axis in self.armable(axis).unwrap_or_default().0 {
            let (name, path) = (&profile.axes[axis].settings.name, profile.path.display());
            if core.storage.signs.entry(name.clone()).or_default().reminds() {
                core.storage.remember_soon();
                said += &format!(
                    "; the sign of {name} was never checked with a dial gauge: isotherm sign {path} --axis {name}"
                );
            }
        }
        Answer::Done(said)
    }

    /// Acknowledges one alarm, or all alarms if `alarm` is `None`. Only the event journal changes, so the shared state
    /// is not locked.
    pub(in crate::gateway) fn acknowledge(
        &self,
        alarm: Option<&str>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        let shared = &*self.0;
        let about = alarm.map(|alarm| {
            let is_active = shared.journal.alarms().iter().any(|one| one.id == alarm);
            if is_active { RateSubject::Alarm(alarm.to_owned()) } else { RateSubject::Nothing }
        });
        if let Err(too_soon) =
            self.takes("acknowledge", &[about.unwrap_or(RateSubject::Alarm(String::new()))])
        {
            return Ok(too_soon);
        }
        let command =
            alarm.map_or("acknowledge".to_owned(), |alarm| format!("acknowledge {}", quoted(alarm)));
        if let Some(why) = requester.has_lapsed() {
            let (way, who, said) = (requester.way, requester.who.clone(), format!("not done: {why}"));
            shared.report(&Event::CommandDropped { command, axes: Vec::new(), way, who, why });
            return Err(said);
        }
        let by = requester.way.by(&requester.who);
        let answer = match shared.journal.acknowledge(shared.clock.now(), alarm, by) {
            Some(0) => Ok("already acknowledged".to_owned()),
            Some(1) => Ok("one alarm acknowledged".to_owned()),
            Some(count) => Ok(format!("{count} alarms acknowledged")),
            None => Err(Explained::new(
                "there is no such alarm",
                "the alarm has ended, or has another name: `isotherm status` lists the alarms",
            )),
        };
        let answered = answer.as_ref().map(String::as_str).map_err(Explained::clone);
        shared.report(&reported(command, Vec::new(), requester, answered));
        answer.map(Answer::Done).map_err(|why| why.to_string())
    }

    /// Confirms that the operator has checked a device whose signals have jumped. The gateway then accepts
    /// the next values of these signals. The device must still hold the settings that `verify` in the profile
    /// requires. Exception: an OPC UA server may have lost namespaces that the profile names by index. The
    /// gateway then accepts the present namespaces at these indices.
    pub(in crate::gateway) fn confirm(&self, device: &str, requester: &Requester) -> Result<Answer, String> {
        let profile = &*self.0.profile;
        let place = profile.devices.iter().position(|known| known.name == device);
        let about = place.map_or(RateSubject::Nothing, RateSubject::Device);
        if let Err(too_soon) = self.takes("confirm", &[about]) {
            return Ok(too_soon);
        }
        let command = format!("confirm {}", quoted(device));
        carry_out(&self.0, (command, Vec::new()), requester, Answer::text, |core| {
            let Some(place) = place else {
                let names: Vec<&str> = profile.devices.iter().map(|known| known.name.as_str()).collect();
                return Err(
                    format!("there is no device {}; there are {}", quoted(device), names.join(", ")).into()
                );
            };
            if let Some(found) = core.devices.changed(DeviceId(place)) {
                if let Some(accepted) = confirm_namespaces(profile, profile.devices[place].bus, core)? {
                    return Ok(Answer::Done(format!("{device}: confirmed; {accepted}")));
                }
                let hint = "change the setting at the device, or correct `verify` in the profile";
                return Err(Explained::new(format!("the checks of the device do not pass: {found}"), hint));
            }
            let jumped = core.board.confirm(DeviceId(place));
            Ok(Answer::Done(match jumped.as_slice() {
                [] => format!("{device}: nothing to confirm: no signal jumped while the device was silent"),
                names => format!("{device}: confirmed; the next values of {} are accepted", names.join(", ")),
            }))
        })
    }

    /// Requests the release of the former registers of an output, or withdraws this request. After the next start,
    /// the gateway moves the former registers back to their base values.
    pub(super) fn release(
        &self,
        output: &str,
        wish: ReleaseRequest<'_>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        let ReleaseRequest::Back(seen) = wish else {
            return Ok(Answer::Done(releasing::take_back(&mut self.0.core(), output)));
        };
        if let Err(too_soon) = self.takes("release", &[RateSubject::Nothing]) {
            return Ok(too_soon);
        }
        let command = format!("release {}", quoted(output));
        carry_out(&self.0, (command, Vec::new()), requester, String::as_str, |core| {
            releasing::ask(core, (output, seen), requester.way.by(&requester.who))
        })
        .map(Answer::Done)
    }

    /// Corrects an axis by a measured error. Without a `report`, removes the correction that results from earlier
    /// measured errors. If the axis acts on a diameter, the measured error is an error of the diameter.
    pub(super) fn measured(
        &self,
        axis: &str,
        report: Option<MeasuredReport>,
        requester: &Requester,
    ) -> Result<Answer, String> {
        let shared = &*self.0;
        let verb = if report.is_some() { "measured" } else { "measured clear" };
        if let Err(too_soon) = self.takes(verb, &about(self.chosen(Some(axis)).as_deref())) {
            return Ok(too_soon);
        }
        let command = report.as_ref().map_or(verb.to_owned(), |report| format!("{verb} {report}"));
        carry_out(&self.0, (command, vec![quoted(axis).into_owned()]), requester, String::as_str, |core| {
            let place = self.chosen(Some(axis))?[0];
            let settings = &shared.profile.axes[place];
            if settings.settings.probe.is_none() {
                return Err(Explained::new(
                    format!(
                        "axis {axis} does not accept measured errors: the profile has no [axis.{axis}.probe]"
                    ),
                    "add this table to the profile, and restart",
                ));
            }
            let Some(report) = report else {
                core.probing[place].forget = true;
                core.probing[place].measured = None;
                return Ok(format!(
                    "{axis}: the correction from probings is removed; Cz moves in steps to the value of the model"
                ));
            };
            if core.phase.is_stopping() {
                return Err("the gateway is stopping".into());
            }
            let of_radius = if settings.diameter { 0.5 } else { 1.0 };
            let error_of_radius = Micron::new(report.error_um * of_radius)
                .ok_or("the measured error must be a finite number, in µm")?;
            let now = shared.clock.now();
            let rejected = core.compensation.check_report(place, &report, (now, shared.clock.shift())).err();
            if let Some(why) = rejected {
                return Err(format!("{axis}: rejected: {why}").into());
            }
            let acting = acting(place, &core.outputs, &core.arming[place]).ok_or_else(|| {
                let cause = format!("{axis}: {}", MissReason::Acting.message());
                Explained::new(cause, "measure again when the output is verified")
            })?;
            let measured = Measured { error: error_of_radius, acting: Some(acting) };
            core.board.check(now);
            let snapshot = Snapshot::new(now, core.board.seen());
            let refused = core.compensation.would_learn(place, &snapshot, measured).err();
            let why = refused.and_then(|probed| {
                Some((probed.refused?, why_refused(&shared.profile, place, probed.refused?, &probed)))
            });
            let taken = match why {
                None => "the error is used for the correction now".to_owned(),
                Some((Refused::Doubted(_), why)) => {
                    format!("the error is not used for the correction yet: {why}")
                }
                // The log keeps it, and a first model is learned from it.
                Some((Refused::NoModel, why)) if settings.learning.is_some() => {
                    format!("the error is not used for a correction: {why}")
                }
                Some((refused, why)) => {
                    // The comparison of the model with no compensation uses the error nevertheless.
                    if matches!(refused, Refused::Implausible | Refused::Outside) {
                        core.compensation.take_report(place, report, now);
                        core.probing[place].measured = Some(measured);
                    }
                    return Err(why.within(|cause| format!("{axis}: not used for the correction: {cause}")));
                }
            };
            core.compensation.take_report(place, report, now);
            core.probing[place].measured = Some(measured);
            Ok(format!("{axis}: error {error_of_radius}, measured while a Cz of {acting} acted; {taken}"))
        })
        .map(Answer::Done)
    }
}
