//! The virtual nodes of a CAN interface.
//!
//! A device of a profile is one of two kinds: one that only sends its frames in its time, and a CANopen node.
//!
//! ```text
//! dictionary  the objects of a node and the SDO server before them        both pure: bytes and a moment in, frames out
//! node        NMT state, heartbeat, PDOs by timer or SYNC, emergencies
//! frames      what stands in the frames of a device: its cells as bits of a frame and back
//! power_on    a node as it is when the power comes on, from the profile
//! line        the socket of an interface, and the time
//! ```

pub(crate) mod dictionary;

pub(super) mod frames;
pub(super) mod line;
pub(super) mod node;
pub(super) mod power_on;
