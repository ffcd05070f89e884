//! The setup list of a CANopen node: written before each of its starts, in its order. A dry run writes nothing, so there it
//! is only compared.

use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, CanRequest, Request};
use crate::gateway::line_handle::LineHandle;
use isotherm_profile::{DeviceId, Setup};

/// What is wrong with it afterwards; nothing, where it is set up.
///
/// # Errors
/// The node does not answer.
pub(super) async fn set_up(
    line: &mut DeviceLine,
    shared: &LineHandle,
    device: DeviceId,
) -> Result<Vec<String>, Fault> {
    let Some(can) = &shared.profile.device(device).can else { return Ok(Vec::new()) };
    let mut wrong = Vec::new();
    for setup in &can.setup {
        let value = setup.object.words(&setup.bytes());
        let value = value.ok_or(Fault::Peer(PeerFault::Width))?;
        let request = match shared.dry_run {
            true => CanRequest::Read { object: setup.object },
            false => CanRequest::Write { object: setup.object, words: value.words() },
        };
        match line
            .request(device, Request::Can(request), Leave::Whenever)
            .await
            .map(|answered| answered.answer)
        {
            Ok(Answer::Words(found)) if found != value.words() => wrong.push(format!(
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
