//! Parts of the state of one output: last value, pending action, decision, arm state.

use serde::{Deserialize, Serialize};

use super::kept::Account;
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// Value with the time of its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Seen {
    /// Register value.
    pub value: Counts,
    /// Time of the request. For an output that cannot be read, the time when the write was sent.
    pub asked: Moment,
}

/// Pending action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Doing {
    Nothing,
    Reading,
    Writing {
        value: Counts,
        begun: Moment,
        read: Option<Moment>,
    },
    Keeping,
    /// The process ends, and nothing is begun any more.
    Ended,
}

/// How the last write failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Untaken {
    /// The write was refused or not sent, or its result is unknown. Any write that is answered as done ends this.
    Refused,
    /// The write was answered as done, but the register holds another value. Only another write that is verified ends
    /// this.
    Ignored,
}

/// Decision to carry out. The offset is in counts from the bias, or is the gateway share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Order {
    pub(super) offset: Counts,
    /// Target of the offset.
    #[serde(default)]
    pub(super) target: Option<Counts>,
    pub(super) not_after: Moment,
}

/// Whether the register may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ArmState {
    /// Not armed yet, or disarmed.
    Off,
    /// Off until the operator arms it: something happened that only the operator can assess.
    Barred,
    /// The operator armed and confirmed this value of a shared register, which is read once more.
    Confirming(Counts),
    /// The register follows the decisions.
    Armed,
}

shifted!(Seen: asked);
shifted!(Order: not_after);

impl Shifted for Doing {
    fn shift(&mut self, by: Shift) {
        if let Doing::Writing { begun, read, .. } = self {
            begun.shift(by);
            read.shift(by);
        }
    }
}

/// State of an output for display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Last verified register value, and the time of its request.
    pub verified: Option<Seen>,
    /// Whether the value was acknowledged, but not read.
    pub is_only_acknowledged: bool,
    /// Operator offset and gateway share of a shared register.
    pub account: Option<Account>,
    /// Whether the register may be written.
    pub standing: ArmState,
    /// Number of copies that may still arrive.
    pub under_way: usize,
    /// Time until which a change waits for them.
    pub waits_until: Option<Moment>,
    /// Whether the last write was refused or not taken.
    pub is_untaken: bool,
}
