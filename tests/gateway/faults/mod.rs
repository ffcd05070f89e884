//! Scripted faults with a running gateway, over real sockets: the readings, the reaction of the axis, the requests on
//! the wire, and the reports.

#![allow(clippy::unwrap_used, clippy::expect_used, reason = "these are tests")]

mod admitted;
mod answers;
mod clocks;
mod commissioning;
mod counters;
mod day;
mod earlier;
mod gateways;
mod handshakes;
mod keeping;
mod law;
mod learned;
mod ledger;
mod load;
mod logged;
mod moved;
mod outputs;
mod plausible;
mod probing;
mod released;
mod restarts;
mod rig;
mod rtu;
mod scales;
mod sealed;
mod sets;
mod sign;
mod stand_ins;
mod stop;
mod targets;
mod trust;
