//! Events as one enum. The log line, the counter and the line on the web page are made from a variant and its entry in
//! the catalogue [`isotherm_core::events`].
//!
//! An event is reported once when a state begins, and once when that state ends. Further occurrences in between are
//! only counted. The event at the end contains their number.

use std::borrow::Cow;

use isotherm_core::events::EventKind;
use isotherm_core::quantity::Moment;
use isotherm_profile::one_line;
use isotherm_profile::safe_file::cut;

mod adoption;
mod alarms;
mod broker;
#[cfg(feature = "opcua")]
mod certificate;
mod comparison;
mod data;
mod delivery;
mod description;
mod event;
pub mod file;
mod journal;
mod opcua_server;
mod page;
mod stand_in;

pub use adoption::Adoption;
pub use alarms::{Acknowledgement, Alarm, Change};
pub use broker::Broker;
#[cfg(feature = "opcua")]
pub use certificate::{CertificateOwner, EarlyCertificate, Expiry};
pub use comparison::Comparison;
pub(crate) use comparison::found_worse;
pub use delivery::Delivery;
pub use event::Event;
pub use isotherm_core::events::Level;
pub use isotherm_core::output::HandshakeFault;
pub use journal::{Entry, EventListener, Journal, LoggedText, ReportedEvent};
pub use opcua_server::OpcUaServerEvent;
pub use page::{PagePort, PageToken};
pub use stand_in::StandIn;
pub(crate) use stand_in::others;

impl Event {
    /// Returns this event as an entry of the event journal, with the time `at`.
    pub fn entry(&self, at: Moment) -> Entry {
        let described = self.described();
        // Numbers and texts always have a JSON form.
        let mut data = serde_json::to_value(self).unwrap_or_default();
        described.explain(&mut data);
        data::bound(&mut data);
        let text = cut(&one_line(&described.text()), data::LONGEST).into_owned();
        let kind = Cow::Borrowed(described.kind.name());
        Entry { at: at.to_string(), kind, level: described.level, text, data }
    }

    /// Returns the sentence of the event, without the hint that follows it.
    pub(crate) fn text_without_hint(&self) -> String {
        cut(&one_line(&self.described().text_without_hint()), data::LONGEST).into_owned()
    }

    /// Returns the kind of the event in the catalogue.
    pub(crate) fn kind(&self) -> EventKind {
        self.described().kind
    }
}

#[cfg(test)]
mod tests;
