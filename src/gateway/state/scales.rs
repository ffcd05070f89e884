//! Scales that devices store in separate registers. A value may wait until its scale is read, and a device may change
//! a scale.

use isotherm_core::codec::{Encoded, Encoding, ScaleRead, ScaleWatch};
use isotherm_core::quantity::Moment;
use isotherm_core::reading::Reason;

/// Whether the scale is in the same answer as the value, or in the answer to another request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::gateway) enum ScalePlace {
    /// The scale is in the same answer as the value.
    SameAnswer,
    /// The scale is read with another request.
    OtherAnswer,
}

/// State of the scale of one signal. Unused for a signal with a fixed scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct SignalScale {
    watch: ScaleWatch,
    /// Exponent (power of ten of the scale) in the last answer. The error is the reason why the last answer has no
    /// exponent.
    current: Result<i8, Reason>,
    /// Value that waits for the next read of the scale. `None` if no value waits.
    waiting: Option<WaitingValue>,
    /// Number of changes of the scale so far. Each change is a break of the continuity of the signal.
    changes: u64,
    /// Former and new exponent of a change that has not been reported yet; `None` if no change must be reported.
    unreported: Option<(i8, i8)>,
    plausibility: Plausibility,
}

/// Whether the gateway has received a plausible value after a change of the scale. A value is compared with the
/// values before the change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Plausibility {
    /// The scale has not changed, or a value after its last change was plausible.
    Confirmed,
    /// No plausible value was received since the last change of the scale.
    Open,
}

/// Value as raw registers, which cannot be used before its scale is read.
#[derive(Clone, Copy, Debug)]
struct WaitingValue {
    raw: Encoded,
    /// Time of the value.
    at: Moment,
    /// Number of breaks in the device's continuity at the time of the read.
    breaks: u64,
}

impl Default for SignalScale {
    fn default() -> SignalScale {
        SignalScale {
            watch: ScaleWatch::default(),
            current: Err(Reason::NeverRead),
            waiting: None,
            changes: 0,
            unreported: None,
            plausibility: Plausibility::Confirmed,
        }
    }
}

impl SignalScale {
    /// Creates the state of a scale at the start of the gateway. `exponent` is the last power of ten in the previous
    /// run; `None` if it is not known.
    pub(super) fn after_start(exponent: Option<i8>) -> SignalScale {
        SignalScale { watch: ScaleWatch::after_start(exponent), ..SignalScale::default() }
    }

    /// Returns the exponent in use. `None` if no exponent was read yet, or if the scale is fixed.
    pub(super) fn exponent(&self) -> Option<i8> {
        self.watch.accepted()
    }

    /// Returns `true` if the scale has changed, and no plausible value was received since the change.
    pub(super) fn is_open(&self) -> bool {
        self.plausibility == Plausibility::Open
    }

    /// Processes a new exponent (power of ten of the scale). Returns the value that waited for this exponent, with
    /// its time. `None` if no value waited, or if the exponent is not known.
    pub(super) fn read(
        &mut self,
        exponent: Result<i8, Reason>,
        encoding: &Encoding,
        breaks: u64,
    ) -> Option<(Result<f64, Reason>, Moment)> {
        let ScaleRead { together, before, changed } = self.watch.read(exponent);
        self.current = together;
        if let Some((from, to)) = changed {
            self.changes += 1;
            self.plausibility = Plausibility::Open;
            let from = self.unreported.map_or(from, |(first, _)| first);
            self.unreported = Some((from, to));
        }
        // After a break of the continuity, the value may be that of another device.
        let waiting = self.waiting.take().filter(|waiting| waiting.breaks == breaks)?;
        let value = before?.and_then(|exponent| encoding.decode_at(waiting.raw.registers(), exponent));
        Some((value, waiting.at))
    }

    /// Converts a value whose scale is in the same answer.
    pub(super) fn value(&self, raw: Encoded, encoding: &Encoding) -> Result<f64, Reason> {
        self.current.and_then(|exponent| encoding.decode_at(raw.registers(), exponent))
    }

    /// Stores a value until its scale is read.
    pub(super) fn wait(&mut self, raw: Encoded, at: Moment, breaks: u64) {
        self.waiting = Some(WaitingValue { raw, at, breaks });
    }

    /// Discards a value that waits for its scale.
    pub(super) fn forget(&mut self) {
        self.waiting = None;
    }

    /// Returns the number of breaks of the signal's continuity: the breaks of its device, plus the changes of its
    /// scale.
    pub(super) fn breaks(&self, of_device: u64) -> u64 {
        of_device.wrapping_add(self.changes)
    }

    /// Returns the reason for rejecting a value that differs too much from an earlier value. Between the two values,
    /// the continuity was broken or the scale has changed.
    pub(super) fn why_jumped(&self) -> Reason {
        match self.plausibility {
            Plausibility::Confirmed => Reason::Jumped,
            Plausibility::Open => Reason::ScaleChanged,
        }
    }

    /// Records that a value was plausible.
    pub(super) fn confirm(&mut self) {
        self.plausibility = Plausibility::Confirmed;
    }

    /// Returns the change that has not been reported yet: former and new exponent. The change then counts as reported.
    pub(super) fn take_change(&mut self) -> Option<(i8, i8)> {
        self.unreported.take().filter(|(from, to)| from != to)
    }
}
