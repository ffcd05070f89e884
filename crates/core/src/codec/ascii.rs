//! Frames of Modbus ASCII, converted from and to frames of Modbus RTU with the same content.
//!
//! ```text
//! RTU     unit, function, data, CRC (2 bytes)
//! ASCII   ':', two hexadecimal digits for each byte of unit, function, data, LRC, then carriage return and line feed
//! ```
//!
//! Code for RTU therefore also serves ASCII: it recognises answers by unit, length and checksum in the same way. The
//! unit is the address of the device.

use super::checksum;

/// Largest number of bytes in a frame: address of the device, protocol data unit, LRC.
const LONGEST: usize = 255;
/// Smallest number of bytes in a frame: address of the device, function code, LRC.
const SHORTEST: usize = 3;
/// Byte that replaces characters outside of valid frames. The code for RTU discards this byte as noise.
const NOISE: u8 = 0;
/// Length of the checksum of an RTU frame, in bytes.
const CRC: usize = 2;

/// Converts a frame of RTU to ASCII. If the RTU checksum is wrong, the ASCII checksum is wrong too.
pub fn ascii_frame(rtu: &[u8]) -> Vec<u8> {
    let (content, sum) = rtu.split_at(rtu.len().saturating_sub(CRC));
    let is_right = checksum(content).to_le_bytes() == *sum;
    let lrc = longitudinal(content) ^ u8::from(!is_right);
    let mut frame = Vec::with_capacity(2 * content.len() + 5);
    frame.push(b':');
    for byte in content.iter().chain([&lrc]) {
        frame.extend([digit(byte >> 4), digit(byte & 0xf)]);
    }
    frame.extend(b"\r\n");
    frame
}

/// Computes the longitudinal redundancy check: the negative sum of all bytes.
fn longitudinal(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)).wrapping_neg()
}

fn digit(value: u8) -> u8 {
    if value < 10 { b'0' + value } else { b'A' + value - 10 }
}

/// Returns the value of a hexadecimal digit; `None` for any other character. Lower-case letters are accepted, because
/// some devices send them.
fn value(digit: u8) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        b'a'..=b'f' => Some(digit - b'a' + 10),
        _ => None,
    }
}

/// Converter of received characters of Modbus ASCII to frames of RTU.
#[derive(Clone, Debug, Default)]
pub struct AsciiFrames {
    /// Values of the digits since the last colon; `None` outside of a frame.
    digits: Option<Vec<u8>>,
}

impl AsciiFrames {
    /// Processes received characters, and appends the complete frames to `rtu`. An invalid frame becomes bytes of
    /// noise, and so does each character outside of frames. The highest bit of a character is ignored, because it may
    /// be a parity bit.
    pub fn push(&mut self, characters: &[u8], rtu: &mut Vec<u8>) {
        for character in characters {
            match character & 0x7f {
                b':' => {
                    if self.digits.replace(Vec::new()).is_some() {
                        rtu.push(NOISE);
                    }
                }
                b'\r' | b'\n' => {
                    if let Some(digits) = self.digits.take() {
                        end(&digits, rtu);
                    }
                }
                other => {
                    if let Some(digits) = &mut self.digits
                        && let Some(value) = value(other)
                        && digits.len() < 2 * LONGEST
                    {
                        digits.push(value);
                    } else {
                        self.digits = None;
                        rtu.push(NOISE);
                    }
                }
            }
        }
    }
}

/// Appends the frame with these digits to `rtu`, or bytes of noise if the frame is invalid.
fn end(digits: &[u8], rtu: &mut Vec<u8>) {
    let bytes: Vec<u8> = digits.chunks_exact(2).map(|pair| pair[0] << 4 | pair[1]).collect();
    let is_whole = digits.len().is_multiple_of(2) && bytes.len() >= SHORTEST;
    // With its LRC, the sum of a frame is zero.
    let Some((_, content)) = bytes.split_last().filter(|_| is_whole && longitudinal(&bytes) == 0) else {
        return rtu.resize(rtu.len() + bytes.len() + 1, NOISE);
    };
    rtu.extend(content);
    rtu.extend(checksum(content).to_le_bytes());
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rtu(content: &[u8]) -> Vec<u8> {
        [content, &checksum(content).to_le_bytes()].concat()
    }

    fn received(characters: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        AsciiFrames::default().push(characters, &mut bytes);
        bytes
    }

    #[test]
    fn frames_are_those_of_the_specification() {
        // Modbus over Serial Line V1.02: the LRC of 02 07 is F7.
        assert_eq!(ascii_frame(&rtu(&[2, 7])), b":0207F7\r\n");
        assert_eq!(received(b":0207F7\r\n"), rtu(&[2, 7]));
        assert_eq!(received(b":0207f7\n"), rtu(&[2, 7]));
        let parity: Vec<u8> = b":0207F7\r\n".iter().map(|character| character | 0x80).collect();
        assert_eq!(received(&parity), rtu(&[2, 7]));
        assert_eq!(ascii_frame(&[2, 7, 0, 0]), b":0207F6\r\n", "a wrong checksum stays wrong");
    }

    #[test]
    fn characters_outside_of_frames_are_noise() {
        for (characters, noise) in [
            (&b":0207F8\r\n"[..], 4),
            (b":0207F\r\n", 3),
            (b":02FE\r\n", 3),
            (b":\r\n", 1),
            (b":0207F7", 0),
            (b":02:0207F8\r\n", 5),
            (b":02x7F7\r\n", 4),
            (b"\r\n\r\n", 0),
            (b"ab\0", 3),
        ] {
            assert_eq!(received(characters), vec![NOISE; noise], "{characters:?}");
        }
        assert_eq!(received(b"x:02:0207F7\r\n"), [&[NOISE, NOISE][..], &rtu(&[2, 7])].concat());
        assert_eq!(received(&[&b":"[..], &[b'0'; 2 * LONGEST + 1], b"\r"].concat()), [NOISE]);
    }

    proptest! {
        #[test]
        fn a_frame_survives_any_division_into_pieces(
            content in proptest::collection::vec(any::<u8>(), 2..254),
            piece in 1_usize..20,
        ) {
            let frame = rtu(&content);
            let (mut frames, mut bytes) = (AsciiFrames::default(), Vec::new());
            ascii_frame(&frame).chunks(piece).for_each(|chunk| frames.push(chunk, &mut bytes));
            prop_assert_eq!(bytes, frame);
        }

        #[test]
        fn a_changed_digit_is_noise(content in proptest::collection::vec(any::<u8>(), 2..40), at in 0_usize..80) {
            let mut characters = ascii_frame(&rtu(&content));
            let place = 1 + at % (characters.len() - 3);
            characters[place] = if characters[place] == b'0' { b'1' } else { b'0' };
            prop_assert_eq!(received(&characters), vec![NOISE; content.len() + 2]);
        }
    }
}
