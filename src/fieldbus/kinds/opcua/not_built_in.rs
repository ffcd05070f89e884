//! Connection opener (dial) of a program that was built without OPC UA.

use super::fault::OpcUaFault;
use crate::fieldbus::connection::{Connection, Dial};
use crate::fieldbus::error::{Fault, LinkFault};
use crate::fieldbus::trace::Tap;
use crate::fieldbus::wire::Boxed;

/// Connection opener that only returns the fault "not built in".
pub(super) struct NotBuiltIn;

impl Dial for NotBuiltIn {
    fn dial<'a>(&'a mut self, _: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(std::future::ready(Err(Fault::Link(LinkFault::OpcUa(OpcUaFault::NotBuiltIn)))))
    }
}
