//! Nodes of an output set (outputs that are written together) on an OPC UA server. One request writes all nodes, and
//! one request reads them back.
//!
//! A server may write the nodes of a request in any order, and may write only some of them. The values are therefore
//! verified only after they were read back.

use super::set_io::{SetReadings, Written};
use super::turn::LineTurn;
use crate::fieldbus::error::{Fault, PeerFault};
use crate::fieldbus::send_guard::SendDeadline;
use crate::fieldbus::wire::{Answer, Request};
use isotherm_core::codec::Encoded;
use isotherm_core::output::OwnWords;
use isotherm_profile::{OutputSet, OwnWord};

/// Reads every node of the output set.
pub(super) async fn read(turn: &mut LineTurn<'_>, set: &OutputSet) -> Result<SetReadings, Fault> {
    let nodes = set.nodes(&turn.shared.profile);
    let request = Request::read_nodes(&nodes);
    let answered = turn.line.request(set.device, request, SendDeadline::None).await?;
    let Answer::Nodes(found) = answered.answer else { return Err(Fault::Peer(PeerFault::Malformed)) };
    let mut unreadable = found.iter().zip(1..).filter_map(|(node, place)| Some((node.value.err()?, place)));
    if let Some((reason, place)) = unreadable.next() {
        return Err(Fault::Unreadable { reason, place });
    }
    let mut found = found.into_iter().filter_map(|node| node.value.ok());
    let values = found.by_ref().take(set.outputs.len()).collect();
    let mut words = set.own_nodes().zip(found);
    let heartbeat = words.find(|((word, _), _)| *word == OwnWord::Heartbeat).map(|(_, found)| low(found));
    Ok(SetReadings { values, sequence: None, heartbeat, asked: answered.asked })
}

/// Writes every node of the output set.
pub(super) async fn write(
    turn: &mut LineTurn<'_>,
    set: &OutputSet,
    values: &[Encoded],
    own: OwnWords,
    leave: SendDeadline,
) -> Written {
    let nodes = set.nodes(&turn.shared.profile);
    let words = set.own_nodes().map(|(word, node)| {
        node.word(match word {
            OwnWord::Heartbeat => own.beat,
            OwnWord::Control => own.control,
            OwnWord::Version(number) => number,
        })
    });
    let each: Vec<Encoded> = values.iter().copied().chain(words).collect();
    let values: Vec<u16> = each.iter().flat_map(Encoded::registers).copied().collect();
    let request = Request::write_nodes(&nodes, &values);
    let sent = turn.line.request(set.device, request, leave).await;
    sent.map(|_| ()).map_err(|fault| (fault, fault.outcome()))
}

/// Writes only the heartbeat and the control word of the output set, without its values.
pub(super) async fn write_own(turn: &mut LineTurn<'_>, set: &OutputSet, own: OwnWords) -> Written {
    let words = set.own_nodes().filter_map(|(word, node)| match word {
        OwnWord::Heartbeat => Some((node.clone(), node.word(own.beat))),
        OwnWord::Control => Some((node.clone(), node.word(own.control))),
        OwnWord::Version(_) => None,
    });
    let (nodes, words): (Vec<_>, Vec<Encoded>) = words.unzip();
    let values: Vec<u16> = words.iter().flat_map(Encoded::registers).copied().collect();
    let request = Request::write_nodes(&nodes, &values);
    let sent = turn.line.request(set.device, request, SendDeadline::None).await;
    sent.map(|_| ()).map_err(|fault| (fault, fault.outcome()))
}

/// Returns the lowest 16 bits of an integer value.
fn low(found: Encoded) -> u16 {
    found.registers().last().copied().unwrap_or_default()
}
