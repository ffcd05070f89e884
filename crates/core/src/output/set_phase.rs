//! Phases in the turn of an output set. A turn is the work of the bus line's task on the set, from the demand to the
//! end of the turn.

use serde::{Deserialize, Serialize};

use super::handshake::HandshakeFault;
use super::set::{OwnWords, SetValue};
use crate::quantity::{Moment, Shift, Shifted};

/// Phase of a turn (the work of the bus line's task on an output set): the pending exchange, or the next decision.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Phase {
    /// The turn of the output set is complete.
    #[default]
    Rest,
    /// The handshake that an earlier turn of the output set has begun comes first.
    Handshake,
    /// The acknowledge signal is read.
    Ask(After),
    /// The strobe signal is reset.
    Drop(DropReason),
    /// The strobe signal is set.
    Raise,
    /// The controllers of the outputs process their demands.
    Demand,
    /// The states of the outputs from this index on are saved to disk, if that is necessary.
    Keep(usize, NextPhase),
    /// The controller decides whether an exchange is necessary.
    Decide,
    /// The acknowledge signal must be down before anything is written.
    Clear(Reason),
    /// The registers of the output set are read.
    Read(NextPhase),
    /// The registers have been read, and the controller decides what is written.
    Judge(Reason),
    /// The values of the outputs are collected one after the other.
    GoAlong {
        /// Values of the outputs that have been collected so far.
        values: Vec<SetValue>,
        /// Last moment for sending the values.
        not_after: Moment,
        /// Whether the disk was asked to save the state of the next output.
        promise: PromiseState,
    },
    /// The values of all outputs are written in one request.
    Write { values: Vec<SetValue>, own: OwnWords, not_after: Moment },
    /// Heartbeat and control word are written alone.
    WriteOwn(OwnWords),
    /// The controller checks whether the registers contain the written values.
    Confirm,
}

/// Whether the disk was asked to save the state of an output before its value is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PromiseState {
    NotAsked,
    Asked,
}

/// Phase that follows when the acknowledge signal has the awaited level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum After {
    /// The handshake that an earlier turn of the output set has begun is completed first. Then the present turn begins.
    Begin,
    /// The registers are read and then written.
    Clear(Reason),
    /// The strobe signal is set.
    Raise,
    /// The handshake of this turn of the output set continues. The turn ends with it.
    End,
}

/// Reason why the strobe signal is dropped, with the next phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum DropReason {
    /// An earlier turn or run left the strobe signal up.
    Left,
    /// The level of the strobe signal was unknown.
    Clear(Reason),
    /// The control has acknowledged the output set.
    Acknowledged(After),
    /// The handshake (strobe and acknowledge signal) has failed.
    Failed(HandshakeFault),
}

/// Phase that follows when all states are saved on disk, or when the registers were read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum NextPhase {
    Decide,
    Judge(Reason),
    Confirm,
}

impl NextPhase {
    pub(super) fn phase(self) -> Phase {
        match self {
            NextPhase::Decide => Phase::Decide,
            NextPhase::Judge(reason) => Phase::Judge(reason),
            NextPhase::Confirm => Phase::Confirm,
        }
    }
}

/// Reason why the registers of the output set are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Reason {
    /// The registers of an output must be read.
    Look,
    /// An output is written if the read shows the expected value.
    Change,
    /// The output set must be sent: it is refreshed, its control word changes, or the control has not taken it.
    Send,
}

impl Shifted for Phase {
    fn shift(&mut self, by: Shift) {
        if let Phase::GoAlong { not_after, .. } | Phase::Write { not_after, .. } = self {
            not_after.shift(by);
        }
    }
}
