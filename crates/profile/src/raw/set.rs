//! `[set.*]`, handshakes and restarts as written.

use schemars::JsonSchema;
use serde::Deserialize;

use super::Span;

/// Outputs of one device that a control must see together or not at all.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Set")]
pub(crate) struct RawSet {
    /// A holding register that counts up with every whole set, written last: the control takes the set when it changes.
    pub(crate) sequence: Option<String>,
    /// A holding register that counts up with every write of the set, 0 to 32767: the control sees the gateway die.
    pub(crate) heartbeat: Option<String>,
    /// A holding register that says what the gateway does: bit 0 all its axes are armed, bit 1 one keeps its value, bit 2
    /// one takes its fault action, bit 3 one follows a lesser model.
    pub(crate) control: Option<String>,
    /// A holding register with a number that control and profile agree on.
    pub(crate) version: Option<RawVersion>,
    /// Registers between its words that are nobody's are written as 0, so that one request carries all of it. Default false.
    pub(crate) zeros: Option<bool>,
    /// A holding register for the check word: all other words of the set summed to 16 bits, inverted.
    pub(crate) complement: Option<String>,
    /// A strobe and its acknowledgement around each write of the set.
    pub(crate) handshake: Option<RawHandshake>,
}

/// A number that control and profile agree on.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Version")]
pub(crate) struct RawVersion {
    /// A holding register.
    #[schemars(required)]
    pub(crate) register: Option<String>,
    /// The number.
    #[schemars(required)]
    pub(crate) value: Option<u16>,
}

/// A strobe and its acknowledgement.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Handshake")]
pub(crate) struct RawHandshake {
    /// Ours, "take it": a coil ("coil:20"), a holding register (1 and 0), or one bit of one ("holding:101.3").
    #[schemars(required)]
    pub(crate) strobe: Option<String>,
    /// The control's, "taken": a coil, a discrete input ("discrete:20"), a register (0 or not), or one bit of one
    /// ("input:16.0").
    #[schemars(required)]
    pub(crate) acknowledge: Option<String>,
    /// Longest wait for the acknowledge to come, and again for it to drop.
    #[schemars(required)]
    pub(crate) timeout: Option<Span>,
}

/// How a restart of the CNC is seen.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Restart")]
pub(crate) struct RawRestart {
    /// A register that changes at every start of the CNC, read with the device's signals.
    #[schemars(required)]
    pub(crate) boot_counter: Option<String>,
}
