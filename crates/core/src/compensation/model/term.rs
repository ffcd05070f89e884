//! One term of a sum over temperature rises. What is not a sum (a matrix, a network) lags by such terms as well.

use std::time::Duration;

use crate::compensation::reference::Reference;
use crate::reading::SignalId;

/// One gain times one rise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// The temperature.
    pub signal: SignalId,
    /// µm per unit of the signal; in a slope µm/mm per unit.
    pub gain: f64,
    /// What the rise is measured from.
    pub reference: Reference,
    /// Time constant C of the first-order lag, above zero; `None`: the rise acts at once.
    pub lag: Option<Duration>,
}
