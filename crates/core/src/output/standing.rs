//! What is known, asked for and shown of one output.

use serde::{Deserialize, Serialize};

use super::kept::Account;
use crate::quantity::{Counts, Moment, Shift, Shifted, shifted};

/// A value, and when the question was sent that it answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Seen {
    /// What stands there.
    pub value: Counts,
    /// When the read was asked; of an output that is not read, when the write had left.
    pub asked: Moment,
}

/// What was asked of the caller and not answered yet.
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
    /// The process ends: nothing is begun any more.
    Ended,
}

/// How a write failed that was answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Untaken {
    /// Nobody says that it was done, or nobody knows: whatever is answered as done shows that there is somebody again.
    Refused,
    /// It was answered as done and does not stand there: only another value that does shows something.
    Ignored,
}

/// What is wanted: counts from the bias, or our share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(super) struct Order {
    pub(super) offset: Counts,
    /// Target of the offset.
    #[serde(default)]
    pub(super) target: Option<Counts>,
    pub(super) not_after: Moment,
}

/// Whether it may be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ArmState {
    /// Nobody has armed it, or somebody switched it off.
    Off,
    /// Off until a person arms it: something happened that only a person can judge.
    Barred,
    /// A person armed it and confirmed this value of a shared register, which is read once more.
    Confirming(Counts),
    /// It follows what is wanted.
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

/// What people see.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shown {
    /// What stands in the register, and when it was asked.
    pub verified: Option<Seen>,
    /// It was only acknowledged, not read.
    pub is_only_acknowledged: bool,
    /// Operator offset and gateway share of a shared register.
    pub account: Option<Account>,
    /// Whether it may be written.
    pub standing: ArmState,
    /// How many copies may still arrive.
    pub under_way: usize,
    /// Until when a change waits for them.
    pub waits_until: Option<Moment>,
    /// The last write was refused or not taken, and none was since.
    pub is_untaken: bool,
}
