//! What an output is, in whole counts of its register.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::quantity::Counts;

/// One output. Counts are those of the register; whoever calls converts from µm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Settings {
    /// The largest change of the register by one write: at least 1, of a shared register at least 2.
    pub step: Counts,
    /// The largest distance from the bias, or from the operator's part.
    pub limit: Counts,
    /// What the register holds where the offset is zero: a CNC may come up with it as well as with zero.
    pub bias: Counts,
    /// The lowest and the highest count that the register holds.
    pub range: (Counts, Counts),
    /// How long after it left a write may still arrive.
    pub late: Duration,
    /// How long a value whose answer never came is still recognised after that: some ten times `late`.
    pub remembered: Duration,
    /// The longest time between two readings of the register.
    pub every: Duration,
    /// What stands there is sent again after this long.
    pub refresh: Option<Duration>,
    /// An operator writes to the register too, and keeps what is his.
    pub is_shared: bool,
    /// How a write is known to stand there.
    pub verify: Verify,
    /// Register in which the control says what it applies, if there is one.
    #[serde(default)]
    pub applied: Option<AppliedSettings>,
    /// All of them, outside of the search that shows what each is for.
    #[serde(skip)]
    pub rules: Rules,
}

impl Settings {
    /// A restarted CNC shows this.
    pub fn is_zero(&self, value: Counts) -> bool {
        value == Counts::ZERO || value == self.bias
    }

    /// What should stand there for this offset from the bias, or from the operator's part.
    pub(super) fn target(&self, centre: Counts, offset: Counts) -> Counts {
        let (lowest, highest) = self.range;
        (centre + offset).clamp(lowest, highest)
    }

    /// What is on disk before a value is sent: a register that says itself what stands in it needs no promise.
    pub fn promises(&self) -> bool {
        self.is_shared || self.verify == Verify::Echo
    }

    /// How far a value may be from another one under way. One count less where an operator writes too: his edit of
    /// exactly one step is then never taken for ours.
    pub(super) fn reach(&self) -> Counts {
        if self.is_shared { self.step - Counts(1) } else { self.step }
    }
}

/// Register in which a control says what it applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct AppliedSettings {
    /// Largest distance from the register value, in thousandths of a count.
    pub tolerance: i64,
    /// Time that the control has to apply a change.
    pub settle: Duration,
}

/// How a write is known to stand there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verify {
    /// The register is read.
    Reading,
    /// It cannot be, or is not to be: the device's answer is all there is.
    Echo,
}

/// The rules that can be taken out one by one, to show that the search finds what each of them prevents.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rules {
    /// What may still arrive is never more than one step away.
    pub near_what_may_arrive: bool,
    /// A value that appears is ours if it is under way.
    pub knows_its_own: bool,
    /// A change has a last moment.
    pub last_moment: bool,
    /// Nothing is sent beyond the limit.
    pub limit: bool,
    /// Where the operator's part cannot be known, a person decides.
    pub doubt: bool,
    /// No write moves the register away from the target.
    pub no_windup: bool,
}

impl Default for Rules {
    fn default() -> Rules {
        Rules {
            near_what_may_arrive: true,
            knows_its_own: true,
            last_moment: true,
            limit: true,
            doubt: true,
            no_windup: true,
        }
    }
}
