//! CAN frames and their identifiers. An identifier has 11 bits (standard) or 29 bits (extended). A frame is classic or
//! CAN FD.

use std::fmt;

/// CAN identifier of 11 or 29 bits. All identifiers of 11 bits sort before all identifiers of 29 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanId {
    is_extended: bool,
    raw: u32,
}

/// Filter of CAN frames: an identifier matches if it equals `id` in the bits of `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanMatch {
    /// Identifier with which the identifier of a frame is compared.
    pub id: CanId,
    /// Bits of the identifier that are compared: all bits, except in a filter for a J1939 parameter group.
    pub mask: u32,
}

/// CAN data frame, classic or CAN FD.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: CanId,
    is_fd: bool,
    len: usize,
    data: [u8; 64],
}

impl CanId {
    /// Largest number of an identifier of 11 bits.
    pub const LARGEST_STANDARD: u32 = 0x7ff;
    /// Largest number of an identifier of 29 bits.
    pub const LARGEST_EXTENDED: u32 = 0x1fff_ffff;

    /// Creates an identifier of 11 bits. Returns `None` above 0x7FF.
    pub const fn standard(raw: u32) -> Option<CanId> {
        if raw > CanId::LARGEST_STANDARD { None } else { Some(CanId { is_extended: false, raw }) }
    }

    /// Creates an identifier of 29 bits. Returns `None` above 0x1FFF_FFFF.
    pub const fn extended(raw: u32) -> Option<CanId> {
        if raw > CanId::LARGEST_EXTENDED { None } else { Some(CanId { is_extended: true, raw }) }
    }

    /// Creates an identifier from the lowest 11 bits of a number.
    pub const fn of_11_bits(number: u16) -> CanId {
        CanId { is_extended: false, raw: number as u32 & CanId::LARGEST_STANDARD }
    }

    /// Returns the identifier as a number, which does not show whether the identifier has 11 or 29 bits.
    pub const fn raw(self) -> u32 {
        self.raw
    }

    /// Returns whether the identifier has 29 bits.
    pub const fn is_extended(self) -> bool {
        self.is_extended
    }
}

impl CanMatch {
    /// Creates a filter that matches this identifier only.
    pub const fn exactly(id: CanId) -> CanMatch {
        let mask = if id.is_extended { CanId::LARGEST_EXTENDED } else { CanId::LARGEST_STANDARD };
        CanMatch { id, mask }
    }

    /// Creates a filter for the J1939 parameter group of this identifier at any priority, from one sender (`source`) or
    /// from any sender. If the identifiers of the group contain a destination address, the filter matches every
    /// destination. Returns `None` if the identifier would not fit 29 bits.
    pub const fn parameter_group(id: u32, source: Option<u8>) -> Option<CanMatch> {
        // Data page and format. From format 240 on, the next eight bits belong to the group; below, they are the
        // destination.
        let is_broadcast = id >> 16 & 0xff >= 240;
        let group = if is_broadcast { 0x03ff_ff00 } else { 0x03ff_0000 };
        let (mask, source) = match source {
            Some(source) => (group | 0xff, source as u32),
            None => (group, 0),
        };
        match CanId::extended(id & group | source) {
            Some(id) => Some(CanMatch { id, mask }),
            None => None,
        }
    }

    /// Returns whether the filter matches this identifier.
    pub const fn takes(self, id: CanId) -> bool {
        self.id.is_extended == id.is_extended && (self.id.raw ^ id.raw) & self.mask == 0
    }

    /// Returns whether both filters can match the same identifier.
    pub const fn meets(self, other: CanMatch) -> bool {
        self.id.is_extended == other.id.is_extended
            && (self.id.raw ^ other.id.raw) & self.mask & other.mask == 0
    }

    /// Returns whether the filter matches exactly one identifier.
    pub fn is_exact(self) -> bool {
        self == CanMatch::exactly(self.id)
    }
}

impl Frame {
    /// Creates a classic frame. Returns `None` for more than eight bytes.
    pub fn classic(id: CanId, bytes: &[u8]) -> Option<Frame> {
        if bytes.len() > 8 { None } else { Frame::of(id, false, bytes) }
    }

    /// Creates a classic frame from an array of at most eight bytes. A call with a longer array does not
    /// compile.
    pub fn short<const N: usize>(id: CanId, bytes: [u8; N]) -> Frame {
        const { assert!(N <= 8, "a classic frame has eight bytes at most") };
        let mut data = [0; 64];
        data[..N].copy_from_slice(&bytes);
        Frame { id, is_fd: false, len: N, data }
    }

    /// Creates a CAN FD frame. Returns `None` for a length that no CAN FD frame has. Allowed are 0 to 8, 12, 16, 20,
    /// 24, 32, 48 and 64 bytes.
    pub fn fd(id: CanId, bytes: &[u8]) -> Option<Frame> {
        if Frame::fd_length(bytes.len()) == Some(bytes.len()) { Frame::of(id, true, bytes) } else { None }
    }

    /// Returns the shortest length of a CAN FD frame that has room for this number of bytes. `None` above 64 bytes.
    pub fn fd_length(bytes: usize) -> Option<usize> {
        const LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];
        if bytes <= 8 { Some(bytes) } else { LENGTHS.into_iter().find(|length| *length >= bytes) }
    }

    fn of(id: CanId, is_fd: bool, bytes: &[u8]) -> Option<Frame> {
        let mut data = [0; 64];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Frame { id, is_fd, len: bytes.len(), data })
    }

    /// Returns the identifier of the frame.
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// Returns whether the frame is a CAN FD frame.
    pub const fn is_fd(&self) -> bool {
        self.is_fd
    }

    /// Returns the data bytes of the frame.
    pub fn data(&self) -> &[u8] {
        &self.data[..self.len]
    }

    /// Returns the data bytes of the frame as a mutable slice.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data[..self.len]
    }
}

/// Formats the identifier as `0x185` or `0x18fef100`: three digits for 11 bits, eight for 29 bits.
impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_extended { write!(f, "0x{:08x}", self.raw) } else { write!(f, "0x{:03x}", self.raw) }
    }
}

/// Formats the identifier of the filter, and its mask if not all bits are compared.
impl fmt::Display for CanMatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.id)?;
        if self.is_exact() { Ok(()) } else { write!(f, " in the bits of 0x{:08x}", self.mask) }
    }
}

/// Formats the frame as candump does: `185#11223344`, `18FEF100##01122`.
impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let raw = self.id.raw;
        if self.id.is_extended {
            write!(f, "{raw:08X}")?
        } else {
            write!(f, "{raw:03X}")?
        }
        f.write_str(if self.is_fd { "##0" } else { "#" })?;
        self.data().iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Frame({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn extended(raw: u32) -> CanId {
        CanId::extended(raw).unwrap()
    }

    #[test]
    fn an_identifier_of_11_bits_is_another_than_the_same_number_in_29() {
        let (short, long) = (CanId::standard(0x185).unwrap(), extended(0x185));
        assert_ne!(short, long);
        assert!(!CanMatch::exactly(short).takes(long) && !CanMatch::exactly(long).takes(short));
        assert_eq!((short.to_string(), long.to_string()), ("0x185".to_owned(), "0x00000185".to_owned()));
        assert_eq!((CanId::standard(0x800), CanId::extended(0x2000_0000)), (None, None));
    }

    #[test]
    fn a_parameter_group_is_taken_at_every_priority_and_from_every_sender_or_from_one() {
        // Engine temperature 1, PGN 65262 = 0xFEEE.
        let any = CanMatch::parameter_group(0x18fe_eefe, None).unwrap();
        assert_eq!((any.id.raw(), any.mask), (0x00fe_ee00, 0x03ff_ff00));
        assert!(any.takes(extended(0x18fe_ee00)) && any.takes(extended(0x0cfe_ee21)));
        assert!(!any.takes(extended(0x18fe_ef00)) && !any.takes(CanId::standard(0x600).unwrap()));
        let one = CanMatch::parameter_group(0x18fe_eefe, Some(0x21)).unwrap();
        assert!(one.takes(extended(0x0cfe_ee21)) && !one.takes(extended(0x18fe_ee00)));
        assert!(any.meets(one) && one.meets(any));
    }

    #[test]
    fn a_parameter_group_with_a_destination_is_taken_whomever_it_is_sent_to() {
        let any = CanMatch::parameter_group(0x18ef_0000, None).unwrap();
        assert!(any.takes(extended(0x18ef_2705)) && any.takes(extended(0x18ef_ff05)));
        assert!(!any.takes(extended(0x18ee_0005)));
    }

    #[test]
    fn a_frame_has_a_length_that_its_kind_can_have_and_is_written_as_candump_writes_it() {
        let id = CanId::standard(0x185).unwrap();
        assert_eq!(Frame::classic(id, &[0x11, 0x22]).unwrap().to_string(), "185#1122");
        assert_eq!(Frame::classic(id, &[0; 9]), None);
        assert_eq!(Frame::fd(id, &[0; 9]), None);
        assert_eq!(Frame::fd(extended(0x18fe_f100), &[0; 12]).unwrap().data().len(), 12);
        assert_eq!(Frame::fd(id, &[7]).unwrap().to_string(), "185##007");
        assert_eq!((Frame::fd_length(33), Frame::fd_length(65)), (Some(48), None));
    }
}
