//! Virtual devices on a CAN interface.
//!
//! A CAN device of a profile is either a CANopen node, or a device that only sends its frames periodically.
//!
//! ```text
//! dictionary  the objects of a node and its SDO server                    pure: bytes and a time in, frames out
//! node        NMT state, heartbeat, PDOs by timer or SYNC, emergencies    pure, as `dictionary`
//! frames      conversion between stored values and the bits of frames
//! power_on    initial state of a node at power-on, from the profile
//! line        socket of an interface, and the times at which its devices act
//! ```

pub(crate) mod dictionary;

pub(super) mod frames;
pub(super) mod line;
pub(super) mod node;
pub(super) mod power_on;
