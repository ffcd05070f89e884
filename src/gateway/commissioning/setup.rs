//! The setup list of a CANopen node: written before each of its starts, in its order. A dry run writes nothing, so there it
//! is only compared.

use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::line::Line;
use crate::fieldbus::wire::{Answer, CanRequest, Request};
use crate::gateway::poll;
use crate::gateway::shared::Shared;
use crate::profile::{DeviceId, Setup};

/// What is wrong with it afterwards, in words; nothing, where it is set up.
///
/// # Errors
/// The node does not answer.
pub(super) async fn set_up(line: &mut Line, shared: &Shared, device: DeviceId) -> Result<Vec<String>, Fault> {
    let Some(can) = &shared.profile.device(device).can else { return Ok(Vec::new()) };
    let mut wrong = Vec::new();
    for setup in &can.setup {
        let words = setup.object.words(&setup.bytes());
        let words = words.ok_or(Fault::Peer(PeerFault::Width))?;
        let request = match shared.dry_run {
            true => CanRequest::Read { object: setup.object },
            false => CanRequest::Write { object: setup.object, words: words.words() },
        };
        match poll::call(line, shared, device, Request::Can(request), shared.clock.now()).await {
            Ok(Answer::Words(found)) if found != words.words() => wrong.push(format!(
                "{} is not {} yet, and nothing is set up while nothing may be written",
                named(setup),
                setup.value
            )),
            Ok(_) => {}
            Err(fault) if fault.is_refusal() => {
                wrong.push(format!("{} cannot be set to {}: {fault}", named(setup), setup.value));
                // What comes after it may rely on it.
                break;
            }
            Err(fault) => return Err(fault),
        }
    }
    Ok(wrong)
}

/// `1800:05 (event timer)`.
fn named(setup: &Setup) -> String {
    match setup.what.as_str() {
        "" => setup.object.to_string(),
        what => format!("{} ({what})", setup.object),
    }
}
