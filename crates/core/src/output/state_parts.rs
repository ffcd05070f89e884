//! Parts of the state of one output: last value, pending action, decision, arm state.

use serde::{Deserialize, Serialize};

use super::saved_output::Account;
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// Register value, and the time of the request that gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct TimedValue {
    /// Register value that was read or acknowledged.
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
    /// The process is about to end. No further action is begun.
    Ended,
}

/// Whether the state on disk is sufficient for the next write to the register.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct DiskState {
    /// Whether a change must be saved to disk before the next write to the register.
    pub(super) is_unsaved: bool,
    /// Whether the disk shows that this run writes to the register. If the run is killed, the next start then knows
    /// that the run was not stopped cleanly.
    #[serde(rename = "has_begun_on_disk")]
    pub(super) has_begun: bool,
}

/// Read that must come before anything else is decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "ReadFlags", into = "ReadFlags")]
pub(super) enum RequiredRead {
    /// No read is required before the next decision. The register is read at its normal period.
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

    /// Requires a read before the next decision. If a restart of the CNC since the last read was recorded, it stays
    /// recorded.
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

/// Evidence for a doubt about the operator offset (part of a shared register's value that the operator entered). A
/// doubt arises only when the same evidence occurs twice in a row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Evidence {
    /// Whether the last change by another client equalled the change of a gateway write that was not
    /// acknowledged.
    pub(super) was_like_our_own: bool,
    /// Whether the first read after the last acknowledged write showed a value that the gateway had not
    /// written.
    pub(super) was_unsteady: bool,
}

/// Failure of the last write: refused, or without effect on the register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum WriteFailure {
    /// The write was refused or not sent, or its result is unknown. The register value is sent again as a test.
    Refused,
    /// The write was acknowledged, but the register holds another value. Only another write that is verified ends this
    /// failure.
    Ignored,
}

/// Decision of the axis that must be carried out. The offset is counted from the bias (register value for an offset of
/// zero), or in a shared register from the operator offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Setpoint {
    pub(super) offset: Counts,
    /// Target that the offset approaches.
    #[serde(default)]
    pub(super) target: Option<Counts>,
    pub(super) not_after: Moment,
}

/// Arm state of an output: whether its register may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ArmState {
    /// The output is not armed yet, or was disarmed.
    Off,
    /// The output is off until the operator arms it: something happened that only the operator can assess.
    Barred,
    /// The operator armed the output, and confirmed this value of the shared register. The register is read once more.
    Confirming(Counts),
    /// The output is armed: its register follows the decisions of the axis.
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

/// State of an output, as it is displayed to the operator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutputView {
    /// Last verified register value, and the time of its request.
    pub verified: Option<TimedValue>,
    /// Whether the last write was acknowledged, but the register was not read.
    pub is_only_acknowledged: bool,
    /// Both parts of a shared register's value (operator offset and gateway share), if they are known.
    pub account: Option<Account>,
    /// Arm state of the output: whether its register may be written.
    pub standing: ArmState,
    /// Number of writes that may still arrive.
    pub under_way: usize,
    /// Time until which a change waits for earlier writes. `None` if no change waits.
    pub waits_until: Option<Moment>,
    /// Whether the last write was refused or not taken.
    pub is_untaken: bool,
}
