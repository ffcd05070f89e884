//! Tasks of the bus lines: reads, steps of the axes, outputs, checks of devices, and the reception of CAN frames.

pub(super) mod can;
#[cfg(feature = "opcua")]
pub mod certificates;
mod inspector;
pub(super) mod poll;
pub(super) mod wire_log;
