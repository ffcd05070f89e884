//! Parts of the state of one output: last value, pending action, decision, arm state.

use serde::{Deserialize, Serialize};

use super::saved_output::Account;
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// Value with the time of its request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TimedValue {
    /// Register value.
    pub value: Counts,
    /// Time of the request. For an output that cannot be read, the time when the write was sent.
    pub asked: Moment,
}

/// Pending action of the register, whose result is awaited.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PendingAction {
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

/// Whether the disk contains what it must contain before the next write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct DiskState {
    /// Whether the disk lacks something that it must contain before the next write.
    pub(super) is_unsaved: bool,
    /// Whether the disk contains that this run has begun. A run ends in order only if its end is recorded too.
    #[serde(rename = "has_begun_on_disk")]
    pub(super) has_begun: bool,
}

/// Read that must come before anything else is decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "ReadFlags", into = "ReadFlags")]
pub(super) enum RequiredRead {
    /// No read is required. The register is read with its period.
    None,
    /// The register must be read.
    Pending,
    /// The register must be read, and the CNC was restarted since the last read.
    PendingAfterRestart,
}

/// Serialised form of [`RequiredRead`]. After a restart a read is always required.
#[derive(Serialize, Deserialize)]
struct ReadFlags {
    is_rebooted: bool,
    must_read: bool,
}

impl RequiredRead {
    /// Returns whether the register must be read before anything else is decided.
    pub(super) fn is_pending(self) -> bool {
        self != RequiredRead::None
    }

    /// Returns whether the CNC was restarted since the last read.
    pub(super) fn is_after_restart(self) -> bool {
        self == RequiredRead::PendingAfterRestart
    }

    /// Requires a read. A restart since the last read remains known.
    pub(super) fn request(&mut self) {
        if *self == RequiredRead::None {
            *self = RequiredRead::Pending;
        }
    }
}

impl From<ReadFlags> for RequiredRead {
    fn from(flags: ReadFlags) -> RequiredRead {
        match flags {
            ReadFlags { is_rebooted: true, .. } => RequiredRead::PendingAfterRestart,
            ReadFlags { must_read: true, .. } => RequiredRead::Pending,
            ReadFlags { .. } => RequiredRead::None,
        }
    }
}

impl From<RequiredRead> for ReadFlags {
    fn from(read: RequiredRead) -> ReadFlags {
        ReadFlags { is_rebooted: read.is_after_restart(), must_read: read.is_pending() }
    }
}

/// Evidence for a doubt about the operator offset. The same evidence twice in a row is a doubt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Evidence {
    /// Whether the last change of the operator equalled an unanswered one of the gateway.
    pub(super) was_like_our_own: bool,
    /// Whether the register held another value after the last write that was answered as done.
    pub(super) was_unsteady: bool,
}

/// Failure of the last write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum WriteFailure {
    /// The write was refused or not sent, or its result is unknown. Any write that is answered as done ends this.
    Refused,
    /// The write was answered as done, but the register holds another value. Only another write that is verified ends
    /// this.
    Ignored,
}

/// Decision to carry out. The offset is in counts from the bias, or is the gateway share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Setpoint {
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

shifted!(TimedValue: asked);
shifted!(Setpoint: not_after);

impl Shifted for PendingAction {
    fn shift(&mut self, by: Shift) {
        if let PendingAction::Writing { begun, read, .. } = self {
            begun.shift(by);
            read.shift(by);
        }
    }
}

/// State of an output for display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputView {
    /// Last verified register value, and the time of its request.
    pub verified: Option<TimedValue>,
    /// Whether the value was acknowledged, but not read.
    pub is_only_acknowledged: bool,
    /// Operator offset and gateway share of a shared register.
    pub account: Option<Account>,
    /// Whether the register may be written.
    pub standing: ArmState,
    /// Number of copies that may still arrive.
    pub under_way: usize,
    /// Time until which a change waits for these copies.
    pub waits_until: Option<Moment>,
    /// Whether the last write was refused or not taken.
    pub is_untaken: bool,
}
