//! Division of the bytes of a port into lines of text. The module has no input, no output and no clock.
//!
//! A line ends with a carriage return or a line feed. Empty lines are skipped. A line whose beginning was not received
//! is never returned, because a number without its first digits is another number.

use std::collections::VecDeque;

/// Longest line in characters. The rest of a longer line is skipped.
pub const LONGEST: usize = 512;
/// Control characters (XON and XOFF) by which a device pauses and resumes the sender.
const XON: u8 = 0x11;
const XOFF: u8 = 0x13;

/// Whether the beginning of the present line was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Beginning {
    Received,
    Missed,
}

/// Buffer that divides received bytes into lines of text.
#[derive(Clone, Debug)]
pub struct LineBuffer {
    /// Bit mask for the data bits of a received byte: 7 or 8 bits.
    mask: u8,
    beginning: Beginning,
    line: String,
    /// Number of characters in the incomplete line `line`.
    length: usize,
    whole: VecDeque<String>,
}

impl LineBuffer {
    /// Returns a buffer for characters with 7 or 8 data bits. The first line counts as incomplete until
    /// [`LineBuffer::begin`] is called.
    pub fn new(data_bits: u8) -> LineBuffer {
        let mask = if data_bits == 7 { 0x7f } else { 0xff };
        let (line, whole) = (String::new(), VecDeque::new());
        LineBuffer { mask, beginning: Beginning::Missed, line, length: 0, whole }
    }

    /// Divides received bytes into lines of text, and adds the lines to the buffer.
    pub fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match byte & self.mask {
                b'\r' | b'\n' => self.end(),
                XON | XOFF => {}
                // A character that is not ASCII is that of Latin-1, such as `°`.
                character => self.add(char::from(character)),
            }
        }
    }

    /// Removes and returns the next complete line, without its end; `None` if there is none.
    pub fn pop(&mut self) -> Option<String> {
        self.whole.pop_front()
    }

    /// Returns whether a part of a line has arrived, without the end of this line.
    pub fn is_inside(&self) -> bool {
        self.length > 0
    }

    /// Discards everything that has arrived. Returns the number of complete lines that were discarded.
    pub fn discard(&mut self) -> usize {
        if self.is_inside() {
            self.beginning = Beginning::Missed;
        }
        (self.line, self.length) = (String::new(), 0);
        self.whole.drain(..).count()
    }

    /// Discards everything that has arrived. The next character counts as the beginning of a line.
    pub fn begin(&mut self) {
        self.discard();
        self.beginning = Beginning::Received;
    }

    fn add(&mut self, character: char) {
        if self.length == LONGEST {
            self.beginning = Beginning::Missed;
        }
        // The characters of an incomplete line are only counted.
        self.length = (self.length + 1).min(LONGEST);
        if self.beginning == Beginning::Received {
            self.line.push(character);
        }
    }

    fn end(&mut self) {
        let line = std::mem::take(&mut self.line);
        if self.beginning == Beginning::Received && self.length > 0 {
            self.whole.push_back(line);
        }
        (self.beginning, self.length) = (Beginning::Received, 0);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn all(buffer: &mut LineBuffer) -> Vec<String> {
        std::iter::from_fn(|| buffer.pop()).collect()
    }

    #[test]
    fn a_line_whose_beginning_is_missing_is_skipped() {
        let mut buffer = LineBuffer::new(8);
        buffer.push(b"45.6\r\n+1.0\r\n\r\n+2.0\n+3");
        assert_eq!(all(&mut buffer), ["+1.0", "+2.0"]);
        assert_eq!(buffer.discard(), 0);
        buffer.push(b".25\r+4.0\r");
        assert_eq!(all(&mut buffer), ["+4.0"], "the rest of +3.25 is skipped");
        buffer.push(b"+5");
        buffer.begin();
        buffer.push(b"+6.0\r\n");
        assert_eq!(all(&mut buffer), ["+6.0"]);
        assert_eq!(buffer.discard(), 0);
        buffer.push(b"+7.0\r\n+8.0\r\n");
        assert_eq!(buffer.discard(), 2);
        buffer.push(b"+9.0\r\n");
        assert_eq!(all(&mut buffer), ["+9.0"], "nothing of this line was discarded");
    }

    #[test]
    fn characters_are_those_of_the_data_bits() {
        let mut buffer = LineBuffer::new(7);
        buffer.begin();
        buffer.push(&[0xb1, 0x32, XON, 0xae, 0xb5, XOFF, 0x8d]);
        assert_eq!(all(&mut buffer), ["12.5"]);
        let mut buffer = LineBuffer::new(8);
        buffer.begin();
        buffer.push(b"21 \xb0C\r1\x002\r");
        assert_eq!(all(&mut buffer), ["21 °C", "1\u{0}2"]);
    }

    #[test]
    fn a_line_that_is_too_long_is_skipped() {
        let mut buffer = LineBuffer::new(8);
        buffer.begin();
        buffer.push(&[b'1'; LONGEST + 1]);
        buffer.push(b"\r2\r");
        assert_eq!(all(&mut buffer), ["2"]);
        buffer.push(&[b'1'; LONGEST]);
        buffer.push(b"\r");
        assert_eq!(all(&mut buffer)[0].len(), LONGEST);
    }

    proptest! {
        #[test]
        fn the_pieces_in_which_bytes_arrive_do_not_matter(
            bytes in proptest::collection::vec(any::<u8>(), 0..80),
            piece in 1_usize..9,
        ) {
            let (mut whole, mut pieces) = (LineBuffer::new(8), LineBuffer::new(8));
            whole.push(&bytes);
            bytes.chunks(piece).for_each(|chunk| pieces.push(chunk));
            let lines = all(&mut whole);
            prop_assert!(lines.iter().all(|line| !line.is_empty() && !line.contains(['\r', '\n'])));
            prop_assert_eq!(lines, all(&mut pieces));
        }
    }
}
