//! How far the turn of a set has come.

use serde::{Deserialize, Serialize};

use super::handshake::HandshakeFault;
use super::set::{OwnWords, SetValue};
use crate::quantity::{Moment, Shift, Shifted};

/// How far a turn has come: the exchange that has no result, or the next decision.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Phase {
    /// The turn has nothing more to do.
    #[default]
    Rest,
    /// The handshake of an earlier turn comes first.
    Handshake,
    /// The acknowledge is read.
    Ask(After),
    /// The strobe is dropped.
    Drop(Dropped),
    /// The strobe is raised.
    Raise,
    /// The outputs take their demand.
    Demand,
    /// Promises of the outputs from this place on are put on disk.
    Keep(usize, Then),
    /// The set decides whether there is something to do.
    Decide,
    /// The acknowledge must be down before anything is written.
    Clear(Reason),
    /// The registers are read.
    Read(Then),
    /// The set decides what is written.
    Judge(Reason),
    /// The outputs that are not to be written go along, one after the other.
    GoAlong {
        /// Values of the outputs so far.
        values: Vec<SetValue>,
        /// Last moment for them.
        not_after: Moment,
        /// Promise of the next output.
        promise: Promised,
    },
    /// The values are written.
    Write { values: Vec<SetValue>, own: OwnWords, not_after: Moment },
    /// Heartbeat and control word are written alone.
    WriteOwn(OwnWords),
    /// The set decides whether the registers hold what was written.
    Confirm,
}

/// Whether the disk was asked to keep the promise of an output that goes along.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Promised {
    NotAsked,
    Asked,
}

/// Next phase after an acknowledge.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum After {
    /// The turn begins.
    Begin,
    /// The registers are read, to be written.
    Clear(Reason),
    /// The strobe is raised.
    Raise,
    /// The turn ends.
    End,
}

/// Reason why the strobe is dropped, or next phase after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Dropped {
    /// An earlier turn or run has left it up.
    Left,
    /// Its level was not known.
    Clear(Reason),
    /// The control has acknowledged the set.
    Acknowledged(After),
    /// The handshake has failed.
    Failed(HandshakeFault),
}

/// Next phase when all promises are on disk, or when the registers were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Then {
    Decide,
    Judge(Reason),
    Confirm,
}

impl Then {
    pub(super) fn phase(self) -> Phase {
        match self {
            Then::Decide => Phase::Decide,
            Then::Judge(reason) => Phase::Judge(reason),
            Then::Confirm => Phase::Confirm,
        }
    }
}

/// Reason why the registers are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Reason {
    /// An output is to be read.
    Look,
    /// An output is to be written, if the read shows nothing new.
    Change,
    /// The set is to be sent: it is refreshed, its control word changes, or the control has not taken it.
    Send,
}

impl Shifted for Phase {
    fn shift(&mut self, by: Shift) {
        if let Phase::GoAlong { not_after, .. } | Phase::Write { not_after, .. } = self {
            not_after.shift(by);
        }
    }
}
