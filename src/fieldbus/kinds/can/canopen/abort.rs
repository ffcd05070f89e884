//! Reasons for which a device aborts an SDO transfer (the read or write of one of its objects), as text.

use std::fmt;

/// 32-bit code that states why an SDO transfer was aborted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AbortCode(pub u32);

impl AbortCode {
    /// The toggle bit, which must change with each segment of a transfer, did not change.
    pub const TOGGLE: AbortCode = AbortCode(0x0503_0000);
    /// The answer did not arrive in time.
    pub const TIMED_OUT: AbortCode = AbortCode(0x0504_0000);
    /// The command of the SDO frame is not valid, or not known.
    pub const COMMAND: AbortCode = AbortCode(0x0504_0001);
    /// The data is larger than the available memory.
    pub const MEMORY: AbortCode = AbortCode(0x0504_0005);
    /// The object can only be read.
    pub const READ_ONLY: AbortCode = AbortCode(0x0601_0002);
    /// The object does not exist.
    pub const NO_OBJECT: AbortCode = AbortCode(0x0602_0000);
    /// The length of the data differs from the length of the object.
    pub const LENGTH: AbortCode = AbortCode(0x0607_0010);
    /// The object exists, but does not have this sub-index.
    pub const NO_SUB_INDEX: AbortCode = AbortCode(0x0609_0011);

    /// Returns the text of this code in CiA 301. Codes of manufacturers have no text in CiA 301, and get a general
    /// text.
    const fn message(self) -> &'static str {
        match self.0 {
            0x0503_0000 => "the toggle bit did not alternate",
            0x0504_0000 => "the transfer took too long",
            0x0504_0001 => "the command is not valid or not known",
            0x0504_0002 => "the block size is not valid",
            0x0504_0003 => "the sequence number is not valid",
            0x0504_0004 => "the checksum is wrong",
            0x0504_0005 => "out of memory",
            0x0601_0000 => "the object cannot be accessed in this way",
            0x0601_0001 => "the object can only be written",
            0x0601_0002 => "the object can only be read",
            0x0602_0000 => "there is no such object",
            0x0604_0041 => "the object cannot be mapped to a PDO",
            0x0604_0042 => "the mapped objects are longer than a PDO",
            0x0604_0043 => "the parameters are incompatible",
            0x0604_0047 => "the device has an internal incompatibility",
            0x0606_0000 => "the device's hardware has failed",
            0x0607_0010 => "the data does not have the length of the object",
            0x0607_0012 => "the data is longer than the object",
            0x0607_0013 => "the data is shorter than the object",
            0x0609_0011 => "there is no such sub-index",
            0x0609_0030 => "the value is not allowed",
            0x0609_0031 => "the value is too high",
            0x0609_0032 => "the value is too low",
            0x0609_0036 => "the maximum is less than the minimum",
            0x060a_0023 => "the resource is not available",
            0x0800_0000 => "a general error",
            0x0800_0020 => "the data cannot be stored in the application",
            0x0800_0021 => "the data cannot be stored: the device is under local control",
            0x0800_0022 => "the data cannot be stored in this state of the device",
            0x0800_0023 => "there is no object dictionary",
            0x0800_0024 => "there is no data",
            _ => "a manufacturer-specific reason",
        }
    }
}

impl fmt::Display for AbortCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (abort {:04X} {:04X}h)", self.message(), self.0 >> 16, self.0 & 0xffff)
    }
}
