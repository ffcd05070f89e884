//! Inspection of an OPC UA server before a gateway connects to it.

use std::time::Duration;

use crate::fieldbus::error::Fault;
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::kinds::opcua::client::browse::Browser;
use crate::fieldbus::kinds::opcua::client::offer;
use isotherm_core::codec::NodeId;
use isotherm_profile::{Bus, Transport};

mod nodes;

pub use crate::fieldbus::kinds::opcua::client::browse::{Described, Tree};
pub use crate::fieldbus::kinds::opcua::client::certificate::{Certificate, NewCertificate, make};
pub use crate::fieldbus::kinds::opcua::client::offer::Offer;
pub use nodes::{Inspected, in_a_line, inspect};

/// Returns the endpoints that the server at this URL offers.
///
/// # Errors
/// A sentence with the reason why the server did not answer, and advice.
pub async fn offers(url: &str, timeout: Duration) -> Result<Vec<Offer>, String> {
    offer::offers(url, timeout)
        .await
        .map_err(|fault| format!("{url}: {}", explain_on(Transport::OpcUa, fault)))
}

/// Browses the nodes of a server from `first` down to `depth` levels, and returns at most `most` of them.
///
/// # Errors
/// A sentence with the reason why browsing failed, and advice.
pub async fn browse(bus: &Bus, first: &NodeId, depth: usize, most: usize) -> Result<Tree, String> {
    let said = |fault: Fault| format!("{}: {}", bus.address, explain_on(Transport::OpcUa, fault));
    let mut browser = Browser::open(bus).await.map_err(said)?;
    let tree = browser.tree(first, depth, most).await;
    browser.close().await;
    tree.map_err(|fault| match fault {
        Fault::Status(_) => format!("{first}: {}", explain_on(Transport::OpcUa, fault)),
        fault => said(fault),
    })
}
