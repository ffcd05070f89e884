//! Value that is encoded as one to four registers.

/// One value as registers that were read or will be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Encoded {
    pub(super) registers: [u16; 4],
    pub(super) len: usize,
    /// Whether the value did not fit its type and was limited to the nearest value that fits.
    pub saturated: bool,
}

impl Encoded {
    /// Creates a value from registers that were read, lowest address first. Registers after the fourth are ignored.
    pub fn of(registers: &[u16]) -> Encoded {
        let mut kept = [0; 4];
        let len = registers.len().min(kept.len());
        kept[..len].copy_from_slice(&registers[..len]);
        Encoded { registers: kept, len, saturated: false }
    }

    /// Returns the registers, lowest address first.
    pub fn registers(&self) -> &[u16] {
        &self.registers[..self.len]
    }

    /// Returns the bits of the registers as one integer, most significant register first. Inverse of
    /// [`DataType::encode`](super::DataType::encode).
    pub fn bits(&self) -> u64 {
        self.registers().iter().fold(0, |bits, word| bits << 16 | u64::from(*word))
    }
}
