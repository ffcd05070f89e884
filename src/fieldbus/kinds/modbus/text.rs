//! Text on a line on which Modbus RTU or Modbus TCP is expected: Modbus ASCII, DCON (the text protocol of
//! ADAM and similar I/O modules), or any other text.

/// Protocol of text that arrived instead of a Modbus frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum TextProtocol {
    /// Frames of Modbus ASCII.
    #[error("Modbus ASCII arrives instead of Modbus RTU")]
    ModbusAscii,
    /// Messages of the protocol DCON.
    #[error("text of the protocol DCON arrives instead of Modbus")]
    Dcon,
    /// Other text, for example from a console or a web server.
    #[error("text arrives instead of Modbus")]
    Other,
}

/// Smallest number of bytes that count as text of an unknown protocol. Noise of this length seldom consists only of
/// printable characters and an end of line.
const SHORTEST: usize = 5;
/// Smallest number of digits of a frame of Modbus ASCII: unit, function, checksum.
const FEWEST_DIGITS: usize = 6;

/// Returns the protocol of the text in these bytes; `None` if they contain no text.
pub(super) fn recognise(bytes: &[u8]) -> Option<TextProtocol> {
    if has_ascii_frame(bytes) {
        return Some(TextProtocol::ModbusAscii);
    }
    let is_text = bytes.iter().all(|byte| matches!(byte, b' '..=b'~' | b'\t' | b'\r' | b'\n'));
    if !is_text {
        return None;
    }
    if bytes.split_inclusive(|byte| *byte == b'\r').any(is_dcon) {
        return Some(TextProtocol::Dcon);
    }
    let has_end = bytes.iter().any(|byte| matches!(byte, b'\r' | b'\n'));
    (bytes.len() >= SHORTEST && has_end).then_some(TextProtocol::Other)
}

/// Returns whether the bytes contain a frame of Modbus ASCII: a colon, pairs of hexadecimal digits with a correct
/// checksum, and a carriage return. The highest bit of each byte is ignored, because such lines often have 7 data bits
/// and a parity.
fn has_ascii_frame(bytes: &[u8]) -> bool {
    let plain: Vec<u8> = bytes.iter().map(|byte| byte & 0x7f).collect();
    let mut parts = plain.split(|byte| *byte == b':').skip(1);
    parts.any(|part| {
        let end = part.iter().position(|byte| *byte == b'\r');
        end.is_some_and(|end| is_ascii_content(&part[..end]))
    })
}

/// Returns whether these characters are the content of a frame of Modbus ASCII. The sum of all its bytes is zero.
fn is_ascii_content(digits: &[u8]) -> bool {
    if digits.len() < FEWEST_DIGITS || !digits.len().is_multiple_of(2) {
        return false;
    }
    let pairs: Option<Vec<u8>> =
        digits.chunks(2).map(|pair| Some(hex(pair[0])? * 16 + hex(pair[1])?)).collect();
    pairs.is_some_and(|pairs| pairs.iter().fold(0u8, |sum, byte| sum.wrapping_add(*byte)) == 0)
}

/// Returns whether these bytes are one message of DCON. An answer begins with `!`, `?` or `>`, a command with another
/// sign. The sign is followed by an address; after `>`, a value is also possible.
fn is_dcon(message: &[u8]) -> bool {
    let message = message.strip_prefix(b"\n").unwrap_or(message);
    let [sign, first, second, .., b'\r'] = message else { return false };
    match sign {
        b'!' | b'?' | b'#' | b'$' | b'%' | b'@' | b'~' => hex(*first).is_some() && hex(*second).is_some(),
        b'>' => matches!(first, b'+' | b'-') && second.is_ascii_digit(),
        _ => false,
    }
}

/// Returns the value of a hexadecimal digit; `None` for other characters. Small letters do not count, because the
/// protocols use capital letters.
fn hex(digit: u8) -> Option<u8> {
    match digit {
        b'0'..=b'9' => Some(digit - b'0'),
        b'A'..=b'F' => Some(digit - b'A' + 10),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
