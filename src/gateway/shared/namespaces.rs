//! OPC UA namespaces that the profile refers to by index. The code saves the URI of each namespace. If the server has
//! assigned another namespace to an index, the code reports or refuses the index, as [`isotherm_core::namespaces`]
//! decides.

use std::path::Path;

use super::state::GatewayState;
use crate::fieldbus::kinds::opcua::namespaces::NamespaceTable;
use crate::observe::events::Event;
use isotherm_core::codec::{Namespace, Node, NodeId};
use isotherm_core::continuity::{CheckFailure, Difference};
use isotherm_core::explained::Explained;
use isotherm_core::namespaces::{KnownNamespaces, Located};
use isotherm_profile::{Bus, BusId, Output, Profile, Share};

/// Namespaces of one OPC UA server, as they were last reported.
#[derive(Debug, Default)]
pub(in crate::gateway) struct NamespaceWatch {
    /// Number of changes of the namespace table that were processed.
    seen: u64,
    found: Vec<(u16, Located)>,
    known: KnownNamespaces,
    /// Namespace URIs of the server, by index.
    array: Vec<String>,
}

impl NamespaceWatch {
    /// Saves and reports the namespaces that have changed since the last call. Returns whether there were changes.
    pub(in crate::gateway) fn check(
        &mut self,
        bus: &Bus,
        table: &NamespaceTable,
        core: &mut GatewayState,
    ) -> bool {
        let changes = table.changes();
        if changes == self.seen {
            return false;
        }
        let (found, known) = (table.found(), table.known());
        // Another line may use the same server. Only the indices that have changed on this line are saved.
        let indices = found.iter().map(|(index, _)| *index);
        let learnt: Vec<u16> = indices.filter(|index| !known.agrees(*index, &self.known)).collect();
        (self.seen, self.known, self.array) = (changes, known, table.array().to_vec());
        for one in found.iter().filter(|one| !self.found.contains(one)) {
            core.events.extend(self.event(bus, one));
        }
        self.found = found;
        if core.places.remember_namespaces(&bus.address, &learnt, &self.known) {
            core.storage.remember_soon();
        }
        true
    }

    fn event(&self, bus: &Bus, (index, located): &(u16, Located)) -> Option<Event> {
        let bus = bus.name.clone();
        let uri = self.known.uri(*index)?.to_owned();
        match located {
            Located::New(_) => Some(Event::NamespaceRecorded { bus, index: *index, uri }),
            Located::Moved(to) => Some(Event::NamespaceMoved { bus, uri, from: *index, to: *to }),
            Located::Unidentified | Located::Same | Located::Gone | Located::Ambiguous | Located::Unclear => {
                None
            }
        }
    }

    /// Returns whether an index has a namespace that cannot be identified. The devices of the server may then not be
    /// used.
    pub(in crate::gateway) fn is_lost(&self) -> bool {
        self.found.iter().any(|(_, located)| located.is_lost())
    }

    /// Returns why a device of the server may not be used. The list contains one difference for each index whose
    /// namespace cannot be identified.
    pub(in crate::gateway) fn differences(&self, profile: &Path, device: &str) -> Vec<Difference> {
        let lost = self.found.iter().filter(|(_, located)| located.is_lost());
        let difference = |(index, located): &(u16, Located)| {
            let was = self.known.uri(*index).unwrap_or_default();
            let now = self.array.get(usize::from(*index)).filter(|uri| !uri.is_empty());
            let is = now.map_or("nothing".to_owned(), Clone::clone);
            let found = match located {
                Located::Ambiguous => format!("the server has namespace {was} (ns={index}) more than once"),
                Located::Unclear => format!(
                    "the server has moved namespace {was} (ns={index}) to another index; ns={index} is {is}, and \
                     the new nodes of the profile may mean either"
                ),
                _ => format!("the server no longer has namespace {was} (ns={index}); ns={index} is {is}"),
            };
            let meant = format!("write the intended namespace as nsu=... in place of ns={index}");
            let confirmed = now.map_or(String::new(), |now| {
                format!("; or, if {now} is correct, run isotherm confirm {} {device}", profile.display())
            });
            Difference {
                what: format!("ns={index}"),
                was: was.to_owned(),
                is: CheckFailure::Described(found),
                meaning: String::new(),
                remedy: meant + &confirmed,
            }
        };
        lost.map(difference).collect()
    }
}

/// Accepts the present namespaces of the server for the indices that cannot be identified, after the operator has
/// confirmed a device of this server. Returns a message, or `None` if all indices can be identified.
///
/// # Errors
/// The server has no namespace at such an index. Or a register in the namespace is shared with an operator, and its
/// entry in the register ledger belongs to the former namespace.
pub(in crate::gateway) fn confirm_namespaces(
    profile: &Profile,
    bus: BusId,
    core: &mut GatewayState,
) -> Result<Option<String>, Explained> {
    let Some(table) = core.devices.namespaces(bus) else { return Ok(None) };
    let lost = table.found().into_iter().filter(|(_, located)| located.is_lost());
    let lost: Vec<u16> = lost.map(|(index, _)| index).collect();
    if lost.is_empty() {
        return Ok(None);
    }
    let array = table.array();
    let has = |index: &u16| array.get(usize::from(*index)).is_some_and(|uri| !uri.is_empty());
    if let Some(index) = lost.iter().find(|index| !has(index)) {
        return Err(Explained::new(
            format!("the server has no namespace at ns={index} now"),
            "wait until the server has loaded the namespace, or write the intended namespace as nsu=... and \
             restart",
        ));
    }
    let is_named = |output: &Output| match output.address.node() {
        Some(Node { id: NodeId { namespace: Namespace::Index(index), .. }, .. }) => lost.contains(index),
        _ => false,
    };
    let is_concerned = |output: &&Output| {
        profile.device(output.device).bus == bus && output.share == Share::Ledger && is_named(output)
    };
    if let Some(output) = profile.outputs.iter().find(is_concerned) {
        return Err(Explained::new(
            format!(
                "output {} shares its register with an operator, and the saved entry of the register is for \
                 the former namespace",
                output.name
            ),
            "write the intended namespace as nsu=... in the profile, and restart",
        ));
    }
    let accepted = table.confirm().into_iter().map(|(index, uri)| format!("ns={index} is {uri}"));
    let accepted: Vec<String> = accepted.collect();
    Ok(Some(format!("{} from now on", accepted.join(", "))))
}
