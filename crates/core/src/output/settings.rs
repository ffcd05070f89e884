//! Settings of an output, in whole counts of its register. A shared register also contains an offset of the operator.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::Counts;

/// Settings of one output, in counts of its register. The caller converts from µm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// Largest change of the register by one write. The value is at least 1, and at least 2 for a shared register.
    pub step: Counts,
    /// Largest distance of a value from the bias, or in a shared register from the operator offset.
    pub limit: Counts,
    /// Register value for an offset of zero. A restarted CNC may show it instead of zero.
    pub bias: Counts,
    /// Lowest and highest count of the register.
    pub range: (Counts, Counts),
    /// Longest time until a sent write arrives at the register. A write that has not arrived by then never arrives.
    pub late: Duration,
    /// Time after `late` during which a write without an answer is still recognised: about ten times `late`.
    pub remembered: Duration,
    /// Longest time between two reads of the register.
    pub every: Duration,
    /// Period at which the register value is sent again. `None`: it is sent only when it changes.
    pub refresh: Option<Duration>,
    /// Whether the register is shared with an operator, whose offset it also contains.
    pub is_shared: bool,
    /// Way in which the gateway verifies a write: by reading the register, or by the answer of the device.
    pub verify: Verify,
    /// Settings of the applied value that the control reports in another register. `None` if the control does not
    /// report it.
    #[serde(default)]
    pub applied: Option<AppliedSettings>,
    /// Active rules of [`step`](super::step). All are active, except in tests that show what each rule prevents.
    #[serde(skip)]
    pub rules: Rules,
}

impl Settings {
    /// Returns whether a restarted CNC may show this value.
    pub fn is_zero(&self, value: Counts) -> bool {
        value == Counts::ZERO || value == self.bias
    }

    /// Returns the register value for an offset. `centre` is the value for an offset of zero: the bias, or the operator
    /// offset of a shared register.
    pub(super) fn target(&self, centre: Counts, offset: Counts) -> Counts {
        let (lowest, highest) = self.range;
        (centre + offset).clamp(lowest, highest)
    }

    /// Returns whether a value must be saved on disk before it is sent: for a shared register, and for a register that
    /// cannot be read.
    pub fn promises(&self) -> bool {
        self.is_shared || self.verify == Verify::Echo
    }

    /// Returns the largest distance between a value to send and a write that may still arrive. For a shared
    /// register, this distance is one count less than a step. An edit of exactly one step is then never
    /// mistaken for a write of the gateway.
    pub(super) fn reach(&self) -> Counts {
        if self.is_shared { self.step - Counts(1) } else { self.step }
    }
}

/// Settings of an applied value, which the control reports in a register of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AppliedSettings {
    /// Largest deviation from the register value, in thousandths of a count.
    pub tolerance: i64,
    /// Time within which the control must apply a change.
    pub settle: Duration,
}

/// Way in which the gateway verifies a write: by reading the register, or by the answer of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verify {
    /// The gateway reads the register after the write.
    Reading,
    /// The answer of the device to the write is sufficient. The register cannot be read, or must not be read.
    Echo,
}

/// Rule of [`step`](super::step) that a test can deactivate, to show what the rule prevents.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// No earlier write that may still arrive is more than one step from the value that is sent.
    NearCopies,
    /// A value that appears in the register belongs to the gateway if a write of this value may still arrive.
    OwnWrites,
    /// A change may be sent only until its last moment.
    LastMoment,
    /// No value beyond the limit is sent, unless it is nearer to the limit than the register value.
    Limit,
    /// If the operator offset cannot be determined, the axis is off until the operator confirms it.
    Doubt,
    /// No write moves the register away from the target.
    NoWindup,
}

/// Active rules of [`step`](super::step): all rules, or all except one.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rules {
    off: Option<Rule>,
}

impl Rules {
    /// Returns all rules except this rule.
    pub const fn without(rule: Rule) -> Rules {
        Rules { off: Some(rule) }
    }

    /// Returns whether this rule is active.
    pub fn has(self, rule: Rule) -> bool {
        self.off != Some(rule)
    }
}
