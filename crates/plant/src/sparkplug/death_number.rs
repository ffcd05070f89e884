//! Death number (bdSeq), by which a host finds the death that belongs to a birth.

/// Death numbers of the connections: 0 for the first CONNECT packet, and one more for each further one. 0 follows 255.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeathNumber {
    /// Number in the last CONNECT packet that was sent, also by earlier runs; `None` if none was ever sent.
    sent: Option<u8>,
    /// Number of the last will and of its births.
    current: u8,
}

impl DeathNumber {
    /// Creates the numbers after this one of the last run.
    pub(super) fn after(sent: Option<u8>) -> DeathNumber {
        DeathNumber { sent, current: 0 }.next()
    }

    /// Returns the state with the number of the next will. It stays the same until a CONNECT packet with it was sent.
    pub(super) fn next(self) -> DeathNumber {
        DeathNumber { current: self.sent.map_or(0, |sent| sent.wrapping_add(1)), ..self }
    }

    /// Records that a CONNECT packet with the current number was sent.
    pub(super) fn is_sent(&mut self) {
        self.sent = Some(self.current);
    }

    pub(super) fn current(self) -> u8 {
        self.current
    }

    pub(super) fn sent(self) -> Option<u8> {
        self.sent
    }
}
