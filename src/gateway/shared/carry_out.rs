//! Execution of one command while the shared state is locked, and the event of the command.

use super::shared_state::Shared;
use super::state::GatewayState;
use crate::observe::events::Event;
use crate::observe::requester::Requester;
use isotherm_core::explained::Explained;

/// Returns the event that reports a command, whether the command was carried out or refused.
pub(in crate::gateway) fn reported(
    command: String,
    axes: Vec<String>,
    requester: &Requester,
    answer: Result<&str, Explained>,
) -> Event {
    let (way, who) = (requester.way, requester.who.clone());
    match answer.map(str::to_owned) {
        Ok(answer) => Event::Command { command, axes, way, who, answer },
        Err(why) => Event::CommandRefused { command, axes, way, who, why },
    }
}

/// Carries out a command, unless its deadline is over or its sender has disconnected. The event about the command
/// precedes the events that the command causes.
pub(in crate::gateway) fn carry_out<T>(
    shared: &Shared,
    (command, axes): (String, Vec<String>),
    requester: &Requester,
    text: impl FnOnce(&T) -> &str,
    act: impl FnOnce(&mut GatewayState) -> Result<T, Explained>,
) -> Result<T, String> {
    let mut core = shared.core();
    if let Some(why) = requester.has_lapsed() {
        let (way, who, said) = (requester.way, requester.who.clone(), format!("not done: {why}"));
        core.events.push(Event::CommandDropped { command, axes, way, who, why });
        return Err(said);
    }
    let before = core.events.len();
    let answer = act(&mut core);
    let event = reported(command, axes, requester, answer.as_ref().map(text).map_err(Explained::clone));
    core.events.insert(before, event);
    drop(core);
    shared.wake();
    answer.map_err(|why| why.to_string())
}
