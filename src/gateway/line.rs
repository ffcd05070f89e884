//! Tasks of the lines: reads, steps of the axes, outputs, checks of devices, and the receiving side of CAN.

pub(super) mod can;
#[cfg(feature = "opcua")]
pub mod certificates;
mod inspector;
pub(super) mod poll;
pub(super) mod wire_log;
