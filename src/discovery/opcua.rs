//! An OPC UA server looked at before a gateway speaks to it.

use std::time::Duration;

use crate::fieldbus::error::Fault;
use crate::fieldbus::explain::explain_on;
use crate::fieldbus::opcua::browse::Browser;
use crate::fieldbus::opcua::offer;
use isotherm_core::codec::NodeId;
use isotherm_profile::{Bus, Transport};

mod nodes;

pub use crate::fieldbus::opcua::browse::{Described, Tree};
pub use crate::fieldbus::opcua::certificate::{Certificate, Made, make};
pub use crate::fieldbus::opcua::offer::Offer;
pub use nodes::{Inspected, in_a_line, inspect};

/// What the server at this URL offers.
///
/// # Errors
/// A sentence: why there is no answer, and what to do.
pub async fn offers(url: &str, timeout: Duration) -> Result<Vec<Offer>, String> {
    offer::offers(url, timeout)
        .await
        .map_err(|fault| format!("{url}: {}", explain_on(Transport::OpcUa, fault)))
}

/// The nodes of a server from this one on, down to `depth` below it, `most` of them.
///
/// # Errors
/// A sentence: why there is no answer, and what to do.
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
