//! CAN frames and their identifiers.

use std::fmt;

/// An identifier of 11 or of 29 bits. Those of 11 bits come first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanId {
    is_extended: bool,
    raw: u32,
}

/// Which frames: those whose identifier is `id` in the bits of `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanMatch {
    /// What the identifier is.
    pub id: CanId,
    /// Which bits of it count; all of them but for a J1939 group from any sender.
    pub mask: u32,
}

/// One data frame, classic or CAN FD.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: CanId,
    is_fd: bool,
    len: usize,
    data: [u8; 64],
}

impl CanId {
    /// The largest identifier of 11 bits.
    pub const LARGEST_STANDARD: u32 = 0x7ff;
    /// The largest identifier of 29 bits.
    pub const LARGEST_EXTENDED: u32 = 0x1fff_ffff;

    /// An identifier of 11 bits; `None` above 0x7FF.
    pub const fn standard(raw: u32) -> Option<CanId> {
        if raw > CanId::LARGEST_STANDARD { None } else { Some(CanId { is_extended: false, raw }) }
    }

    /// An identifier of 29 bits; `None` above 0x1FFF_FFFF.
    pub const fn extended(raw: u32) -> Option<CanId> {
        if raw > CanId::LARGEST_EXTENDED { None } else { Some(CanId { is_extended: true, raw }) }
    }

    /// An identifier of 11 bits, of the lowest 11 of a number: nothing above 0x7FF comes out.
    pub const fn of_11_bits(number: u16) -> CanId {
        CanId { is_extended: false, raw: number as u32 & CanId::LARGEST_STANDARD }
    }

    /// Its number.
    pub const fn raw(self) -> u32 {
        self.raw
    }

    /// It has 29 bits.
    pub const fn is_extended(self) -> bool {
        self.is_extended
    }
}

impl CanMatch {
    /// Frames with this identifier and no other.
    pub const fn exactly(id: CanId) -> CanMatch {
        let mask = if id.is_extended { CanId::LARGEST_EXTENDED } else { CanId::LARGEST_STANDARD };
        CanMatch { id, mask }
    }

    /// Frames of the J1939 parameter group of this identifier, whatever their priority, from one sender or from any.
    /// A group that is sent to a destination is taken whomever it is sent to.
    pub const fn parameter_group(id: u32, source: Option<u8>) -> Option<CanMatch> {
        // Data page and format; the eight bits below belong to the group from format 240 on, else they are whom it is for.
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

    /// Whether these frames are among them.
    pub const fn takes(self, id: CanId) -> bool {
        self.id.is_extended == id.is_extended && (self.id.raw ^ id.raw) & self.mask == 0
    }

    /// Whether some identifier is among both.
    pub const fn meets(self, other: CanMatch) -> bool {
        self.id.is_extended == other.id.is_extended
            && (self.id.raw ^ other.id.raw) & self.mask & other.mask == 0
    }

    /// One identifier and no other.
    pub fn is_exact(self) -> bool {
        self == CanMatch::exactly(self.id)
    }
}

impl Frame {
    /// A frame of up to eight bytes.
    pub fn classic(id: CanId, bytes: &[u8]) -> Option<Frame> {
        if bytes.len() > 8 { None } else { Frame::of(id, false, bytes) }
    }

    /// A frame whose length is known where it is written, which must be eight bytes at most.
    pub fn short<const N: usize>(id: CanId, bytes: [u8; N]) -> Frame {
        const { assert!(N <= 8, "a classic frame has eight bytes at most") };
        let mut data = [0; 64];
        data[..N].copy_from_slice(&bytes);
        Frame { id, is_fd: false, len: N, data }
    }

    /// A CAN FD frame of up to 64 bytes; the length is one that a frame can have: to 8, 12, 16, 20, 24, 32, 48, 64.
    pub fn fd(id: CanId, bytes: &[u8]) -> Option<Frame> {
        if Frame::fd_length(bytes.len()) == Some(bytes.len()) { Frame::of(id, true, bytes) } else { None }
    }

    /// The shortest length of a CAN FD frame that holds this many bytes.
    pub fn fd_length(bytes: usize) -> Option<usize> {
        const LENGTHS: [usize; 7] = [12, 16, 20, 24, 32, 48, 64];
        if bytes <= 8 { Some(bytes) } else { LENGTHS.into_iter().find(|length| *length >= bytes) }
    }

    fn of(id: CanId, is_fd: bool, bytes: &[u8]) -> Option<Frame> {
        let mut data = [0; 64];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Frame { id, is_fd, len: bytes.len(), data })
    }

    /// Its identifier.
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// It is a CAN FD frame.
    pub const fn is_fd(&self) -> bool {
        self.is_fd
    }

    /// Its bytes.
    pub fn data(&self) -> &[u8] {
        &self.data[..self.len]
    }

    /// Its bytes, to be changed in place.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data[..self.len]
    }
}

/// `0x185`, `0x18fef100`: three digits of an identifier of 11 bits, eight of one of 29.
impl fmt::Display for CanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_extended { write!(f, "0x{:08x}", self.raw) } else { write!(f, "0x{:03x}", self.raw) }
    }
}

/// The identifier, and the mask where it leaves bits out.
impl fmt::Display for CanMatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.id)?;
        if self.is_exact() { Ok(()) } else { write!(f, " in the bits of 0x{:08x}", self.mask) }
    }
}

/// As candump writes it: `185#11223344`, `18FEF100##01122`.
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
