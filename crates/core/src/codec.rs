//! Conversion between registers or frame bits and numbers: addresses, types, word order, scale, sentinels, saturation.
//!
//! A value occupies one to four 16-bit registers, or one coil. A sentinel is a raw value that means "no
//! measurement". Integers are compared with their sentinels *before* scaling. Some modules send −512 for an
//! open circuit, and a scale would convert −512 into a plausible −32.0 °C.

mod address;
mod ascii;
mod bits;
mod can;
mod checksum;
mod control_view;
mod counter;
mod data_type;
mod element;
mod encoded;
mod encoding;
mod field;
mod float;
mod node;
mod object;
mod part;
mod pc_sensor;
mod scale;
mod scale_from;
mod text;

pub use address::{Address, Register, Table};
pub use ascii::{AsciiFrames, ascii_frame};
pub use bits::{BitField, BitKind, ByteOrder};
pub use can::{CanId, CanMatch, Frame};
pub use checksum::checksum;
pub use control_view::{ControlView, Inadmissible};
pub use counter::{Counter, Motion, Tracked};
pub use data_type::DataType;
pub use element::{Element, number_in};
pub use encoded::Encoded;
pub use encoding::{Encoding, Sentinel, WordOrder};
pub use field::{Field, Selector};
pub use node::{Identifier, Namespace, Node, NodeId, Scalar};
pub use object::{Entry, Object};
pub use part::{Part, Whole};
pub use pc_sensor::{Channel, PcSensor};
pub use scale::Scale;
pub use scale_from::{ScaleFrom, ScaleMeaning, ScaleRead, ScaleWatch};
pub use text::{Quoted, TextPattern, TextValue, with_sum, with_unit};

#[cfg(test)]
mod tests;
