//! Checksum of a Modbus RTU frame.

/// Computes CRC-16/MODBUS: polynomial 0x8005 reflected, initial value 0xFFFF. The low byte is sent first.
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |sum, byte| {
        (0..8)
            .fold(sum ^ u16::from(*byte), |sum, _| if sum & 1 == 1 { (sum >> 1) ^ 0xa001 } else { sum >> 1 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_published_examples() {
        assert_eq!(checksum(b"123456789"), 0x4b37, "the check value of CRC-16/MODBUS");
        assert_eq!(checksum(&[17, 3, 0, 107, 0, 3]).to_le_bytes(), [0x76, 0x87]);
    }
}
