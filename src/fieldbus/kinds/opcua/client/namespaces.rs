//! Namespaces of an OPC UA server: the index of each URI, and the present identifiers of the nodes of a
//! profile.

use std::sync::Arc;

use ::opcua::types::{NodeId, Variant};
use isotherm_core::codec::{self, Namespace};

use crate::fieldbus::error::{CallerFault, Fault};
use crate::fieldbus::kinds::opcua::conversion;
use crate::fieldbus::kinds::opcua::namespaces::NamespaceTable;

/// Namespaces that the server had when the connection was opened.
#[derive(Clone, Debug, Default)]
pub(super) struct Namespaces {
    /// Namespace URIs of the server; the position is the index.
    uris: Arc<[String]>,
    /// Table of the namespaces that the profile names by index, which the bus line and the gateway share.
    table: NamespaceTable,
}

impl Namespaces {
    /// Reads the NamespaceArray of the server. If `array` is not a list of texts, no URI is known. The gateway then
    /// finds a node only if the profile names its namespace by an index for which no URI is stored.
    pub(super) fn of(array: Option<&Variant>, table: &NamespaceTable) -> Namespaces {
        let uri = |value: &Variant| match value {
            Variant::String(uri) => uri.as_ref().to_owned(),
            _ => String::new(),
        };
        let uris = match array {
            Some(Variant::Array(array)) => array.values.iter().map(uri).collect(),
            _ => Vec::new(),
        };
        table.connected(uris);
        Namespaces { uris: table.array(), table: table.clone() }
    }

    /// Returns the index of a namespace at the server; `None` if the server does not have its URI, or has the URI
    /// twice.
    fn index(&self, namespace: &Namespace) -> Option<u16> {
        let uri = match namespace {
            Namespace::Index(index) => return self.table.index(*index),
            Namespace::Uri(uri) => uri,
        };
        let mut places = (0..=u16::MAX).zip(&*self.uris).filter(|(_, known)| *known == uri);
        let first = places.next()?.0;
        places.next().is_none().then_some(first)
    }

    /// Returns the table of the namespaces that the profile names by index.
    pub(super) fn table(&self) -> NamespaceTable {
        self.table.clone()
    }

    /// Returns the namespace URI at this index of the server; `None` if the server has no URI at this index.
    pub(super) fn uri(&self, index: u16) -> Option<&str> {
        self.uris.get(usize::from(index)).map(String::as_str).filter(|uri| !uri.is_empty())
    }

    /// Returns the identifier of a node in the type of the library; `None` if the server does not have the node's
    /// namespace.
    ///
    /// # Errors
    /// The identifier is invalid.
    pub(super) fn node_id(&self, id: &codec::NodeId) -> Result<Option<NodeId>, Fault> {
        let Some(namespace) = self.index(&id.namespace) else { return Ok(None) };
        let found = conversion::node_id(namespace, &id.identifier);
        Ok(Some(found.ok_or(Fault::Caller(CallerFault::Extent))?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::opcua::types::{Array, UAString, VariantScalarTypeId};

    fn namespaces(uris: &[&str]) -> Namespaces {
        let values: Vec<Variant> = uris.iter().map(|uri| Variant::String(UAString::from(*uri))).collect();
        let array = Array::new(VariantScalarTypeId::String, values).unwrap();
        Namespaces::of(Some(&Variant::from(array)), &NamespaceTable::default())
    }

    fn found(namespaces: &Namespaces, node: &str) -> Option<String> {
        namespaces.node_id(&node.parse().unwrap()).unwrap().map(|id| id.to_string())
    }

    #[test]
    fn a_uri_has_the_index_at_which_the_server_has_it_now() {
        let before = namespaces(&["http://opcfoundation.org/UA/", "urn:server", "urn:lathe", "urn:mill"]);
        let after = namespaces(&["http://opcfoundation.org/UA/", "urn:server", "urn:mill", "urn:lathe"]);
        assert_eq!(found(&before, "nsu=urn:mill;s=offset").as_deref(), Some("ns=3;s=offset"));
        assert_eq!(found(&after, "nsu=urn:mill;s=offset").as_deref(), Some("ns=2;s=offset"));
        assert_eq!(found(&after, "ns=3;s=offset").as_deref(), Some("ns=3;s=offset"));
        assert_eq!(found(&after, "i=2258").as_deref(), Some("i=2258"));
        assert_eq!((before.uri(2), before.uri(4)), (Some("urn:lathe"), None));
    }

    #[test]
    fn a_uri_that_is_not_there_or_there_twice_names_no_node() {
        let twice = namespaces(&["http://opcfoundation.org/UA/", "urn:mill", "urn:mill"]);
        assert_eq!(found(&twice, "nsu=urn:mill;i=7"), None);
        assert_eq!(found(&twice, "nsu=urn:lathe;i=7"), None);
        for none in [None, Some(&Variant::from(7_u32))] {
            let namespaces = Namespaces::of(none, &NamespaceTable::default());
            assert_eq!(found(&namespaces, "nsu=urn:mill;i=7"), None);
            assert_eq!(found(&namespaces, "ns=2;i=7").as_deref(), Some("ns=2;i=7"));
        }
    }
}
