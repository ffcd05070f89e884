//! Death number (bdSeq): a number in the birth and death messages of a node. A host uses it to find the death message
//! that belongs to a birth message.

/// Death numbers of the connections: 0 for the first CONNECT packet, and one more for each further packet. After 255,
/// the numbers begin again at 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct DeathNumber {
    /// Death number in the last CONNECT packet that was sent, in this run or an earlier one; `None` if no packet was
    /// ever sent.
    sent: Option<u8>,
    /// Death number of the last will message and of its birth messages.
    current: u8,
}

impl DeathNumber {
    /// Creates the state at the start of the gateway. `sent` is the last death number that an earlier run
    /// sent; `None` if no number is known.
    pub(super) fn after(sent: Option<u8>) -> DeathNumber {
        DeathNumber { sent, current: 0 }.next()
    }

    /// Returns the state with the number for the next will message. The number changes only if a CONNECT packet with
    /// the current number was sent.
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
