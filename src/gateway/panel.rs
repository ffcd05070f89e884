//! What page, API and commands see and touch of the gateway: its state, and what a person asks for: arm, disarm, zero, a
//! measured error.

use std::sync::Arc;

use super::probing::{Missed, acting, why_refused};
use super::shared::Shared;
use super::status::status;
use crate::observe::events::Event;
use crate::observe::status::{Command, Source, Status};
use isotherm_core::compensation::{Measured, Snapshot};
use isotherm_core::quantity::Micron;
use isotherm_profile::AxisId;

/// What page, API and command socket have at hand: one hold to look, one to command.
pub(super) struct Panel {
    page: PageHandle,
    commands: CommandHandle,
}

/// Whoever looks: it sees the state, and touches nothing.
struct PageHandle(Arc<Shared>);

/// Whoever commands.
struct CommandHandle(Arc<Shared>);

impl Panel {
    pub(super) fn new(shared: Arc<Shared>) -> Panel {
        Panel { page: PageHandle(Arc::clone(&shared)), commands: CommandHandle(shared) }
    }
}

impl Source for Panel {
    fn status(&self) -> Status {
        self.page.status()
    }

    fn command(&self, command: Command) -> Result<String, String> {
        self.commands.command(command)
    }

    fn arming(&self) -> Option<Result<String, String>> {
        self.commands.arming()
    }

    fn measured(&self, axis: &str, error: Option<f64>) -> Result<String, String> {
        self.commands.measured(axis, error)
    }
}

impl PageHandle {
    fn status(&self) -> Status {
        status(&self.0)
    }
}

impl CommandHandle {
    fn command(&self, command: Command) -> Result<String, String> {
        let shared = &*self.0;
        let mut core = shared.core();
        let names: Vec<&str> = shared.profile.axes.iter().map(|axis| axis.settings.name.as_str()).collect();
        let names = names.join(", ");
        let answer = match command {
            Command::Arm if core.stopping => return Err("the gateway is stopping".to_owned()),
            Command::Arm => {
                for axis in 0..core.arming.len() {
                    let arming = &mut core.arming[axis];
                    arming.asked = !arming.armed || arming.tripped;
                    arming.refusal = None;
                }
                // At once where that can be: whoever asks hears whether he is refused.
                let now = shared.clock.now();
                core.board.look(now);
                core.arm_where_possible(now);
                format!("{names}: will be armed as soon as devices and readings allow it")
            }
            Command::Disarm => {
                for axis in 0..core.arming.len() {
                    core.disarm(AxisId(axis), "switched off by a person");
                }
                format!("{names}: off; what stands in the registers stays")
            }
            Command::Zero => {
                let now = shared.clock.now();
                core.compensation.zero(now);
                core.storage.zeroed(now);
                core.events.push(Event::Zeroed);
                "references are captured from now on".to_owned()
            }
        };
        drop(core);
        shared.wake();
        Ok(answer)
    }

    fn arming(&self) -> Option<Result<String, String>> {
        let core = self.0.core();
        let names = self.0.profile.axes.iter().map(|axis| axis.settings.name.as_str());
        let refused = core.arming.iter().zip(names.clone()).find_map(|(arming, name)| {
            let why = arming.refusal.as_ref().filter(|_| arming.asked)?;
            Some(format!("axis {name} is not armed: {why}"))
        });
        if let Some(refused) = refused {
            return Some(Err(refused));
        }
        let all = core.arming.iter().all(|arming| arming.armed && !arming.asked);
        all.then(|| Ok(format!("{}: armed", names.collect::<Vec<_>>().join(", "))))
    }

    /// The error is that of the diameter where the axis acts on one.
    fn measured(&self, axis: &str, error: Option<f64>) -> Result<String, String> {
        let shared = &*self.0;
        let axes = &shared.profile.axes;
        let place = axes.iter().position(|known| known.settings.name == axis).ok_or_else(|| {
            let names: Vec<&str> = axes.iter().map(|axis| axis.settings.name.as_str()).collect();
            format!("there is no axis {axis}; there are {}", names.join(", "))
        })?;
        let settings = &axes[place];
        if settings.settings.probe.is_none() {
            return Err(format!(
                "axis {axis} takes no measured errors: its profile has no [axis.{axis}.probe]"
            ));
        }
        let mut core = shared.core();
        let answer = match error {
            None => {
                core.probing[place].forget = true;
                core.probing[place].measured = None;
                format!("{axis}: what probings have taught is taken back; Cz goes there step by step")
            }
            Some(_) if core.stopping => return Err("the gateway is stopping".to_owned()),
            Some(error) => {
                let of_radius = if settings.diameter { 0.5 } else { 1.0 };
                let error =
                    Micron::new(error * of_radius).ok_or("a measured error is a finite number, in µm")?;
                let acting = acting(place, &core.outputs, &core.arming[place]).ok_or_else(|| {
                    format!("{axis}: {}; measure again when it is", Missed::Acting.message())
                })?;
                let measured = Measured { error, acting: Some(acting) };
                let now = shared.clock.now();
                core.board.look(now);
                let snapshot = Snapshot { now, readings: core.board.seen() };
                if let Err(probed) = core.compensation.would_learn(place, &snapshot, measured) {
                    let why = probed.refused.map(|why| why_refused(&shared.profile, place, why, &probed));
                    return Err(format!("{axis}: not learned from: {}", why.unwrap_or_default()));
                }
                core.probing[place].measured = Some(measured);
                format!("{axis}: {error} with a Cz of {acting} acting; it is learned from at once")
            }
        };
        drop(core);
        shared.wake();
        Ok(answer)
    }
}
