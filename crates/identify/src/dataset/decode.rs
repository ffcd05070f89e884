//! Encodings of logs. Loggers and spreadsheets of Windows write cp1252, UTF-16, GBK or Shift_JIS; everything is read as
//! UTF-8.

use std::io::{self, Chain, Cursor, Read};

use encoding_rs::{Decoder, Encoding, GBK, SHIFT_JIS, UTF_16BE, UTF_16LE, WINDOWS_1252};

/// Number of bytes from which the encoding is detected.
const SAMPLE: u64 = 1 << 16;
/// Number of bytes that are decoded at a time.
const PART: usize = 1 << 15;

/// Reader of UTF-8 text.
pub(super) enum Decoded<R> {
    /// The input is UTF-8 already, or no text.
    Plain(Begun<R>),
    /// Input in another encoding.
    Converted(Box<Converter<R>>),
}

/// Input whose first bytes were read to detect its encoding.
type Begun<R> = Chain<Cursor<Vec<u8>>, R>;

/// Reader that decodes its input.
pub(super) struct Converter<R> {
    input: Begun<R>,
    decoder: Decoder,
    raw: Vec<u8>,
    /// Decoded bytes that were not returned yet, from `at` on.
    text: Vec<u8>,
    at: usize,
    is_over: bool,
}

/// Returns a reader of the input as UTF-8, and the name of its encoding if that is another one.
pub(super) fn utf8<R: Read>(mut input: R) -> io::Result<(Decoded<R>, Option<&'static str>)> {
    let mut sample = Vec::new();
    input.by_ref().take(SAMPLE).read_to_end(&mut sample)?;
    let encoding = detect(&sample);
    if encoding.is_none() && sample.starts_with(b"\xEF\xBB\xBF") {
        sample.drain(..3);
    }
    let input = Cursor::new(sample).chain(input);
    Ok(match encoding {
        None => (Decoded::Plain(input), None),
        Some(encoding) => {
            let decoder = encoding.new_decoder_with_bom_removal();
            let (raw, text) = (vec![0; PART], Vec::new());
            let converter = Converter { input, decoder, raw, text, at: 0, is_over: false };
            (Decoded::Converted(Box::new(converter)), Some(encoding.name()))
        }
    })
}

/// Returns the encoding of a text; `None` for UTF-8, and for data that are no text.
fn detect(sample: &[u8]) -> Option<&'static Encoding> {
    if let Some((encoding, _)) = Encoding::for_bom(sample) {
        return Some(encoding).filter(|encoding| *encoding != encoding_rs::UTF_8);
    }
    if sample.contains(&0) {
        return wide(sample);
    }
    match std::str::from_utf8(sample) {
        Ok(_) => None,
        // The sample may end inside a character.
        Err(why) if why.error_len().is_none() => None,
        Err(_) if is_of_pairs(sample) => Some(GBK),
        Err(_) if is_shift_jis(sample) => Some(SHIFT_JIS),
        Err(_) => Some(WINDOWS_1252),
    }
}

/// Returns the byte order of UTF-16 without a mark: in a log, almost every second byte is zero.
fn wide(sample: &[u8]) -> Option<&'static Encoding> {
    let zeros = |from: usize| sample.iter().skip(from).step_by(2).filter(|byte| **byte == 0).count();
    let (first, second) = (zeros(0), zeros(1));
    let pairs = sample.len() / 2;
    match (first * 10 > pairs * 8, second * 10 > pairs * 8) {
        (true, false) if second == 0 => Some(UTF_16BE),
        (false, true) if first == 0 => Some(UTF_16LE),
        _ => None,
    }
}

/// Returns whether all bytes that are not ASCII stand in pairs of GBK. In cp1252, they stand alone: `°`, `µ`, `ä`.
fn is_of_pairs(sample: &[u8]) -> bool {
    let mut groups = sample.split(u8::is_ascii).filter(|group| !group.is_empty()).peekable();
    let is_pair = |pair: &[u8]| matches!(pair, [0xA1..=0xF7, 0xA1..=0xFE]);
    let mut is_valid = true;
    while let Some(group) = groups.next() {
        // The sample may end inside a pair.
        let is_last = groups.peek().is_none();
        let whole = if is_last && group.len() > 1 { &group[..group.len() / 2 * 2] } else { group };
        is_valid &= whole.len().is_multiple_of(2) && whole.chunks(2).all(is_pair);
    }
    is_valid
}

/// Returns whether the sample is text in Shift_JIS. It has bytes that are rare in cp1252, each followed by a byte that may
/// follow.
fn is_shift_jis(sample: &[u8]) -> bool {
    let is_valid =
        |text: &[u8]| SHIFT_JIS.decode_without_bom_handling_and_without_replacement(text).is_some();
    // The sample may end inside a character.
    let but_last = sample.split_last().map_or(sample, |(_, rest)| rest);
    sample.iter().any(|byte| matches!(byte, 0x81..=0x9F)) && (is_valid(sample) || is_valid(but_last))
}

impl<R: Read> Read for Decoded<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        match self {
            Decoded::Plain(input) => input.read(out),
            Decoded::Converted(converter) => converter.read(out),
        }
    }
}

impl<R: Read> Converter<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.is_over {
            let count = self.input.read(&mut self.raw)?;
            self.is_over = count == 0;
            // No encoding needs more than three bytes of UTF-8 for one byte.
            self.text.resize(3 * count + 16, 0);
            let (_, _, written, _) =
                self.decoder.decode_to_utf8(&self.raw[..count], &mut self.text, self.is_over);
            self.text.truncate(written);
            self.at = 0;
        }
        let count = out.len().min(self.text.len() - self.at);
        out[..count].copy_from_slice(&self.text[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "Zeit;Öl [°C];Weg [µm]\n0;20,5;1,5\n60;20,6;1,6\n";
    const CHINESE: &str = "时间,主轴温度,床身\n0,20.5,19.9\n60,20.6,19.9\n";

    const JAPANESE: &str = "時刻,主軸温度,ベッド\n0,20.5,19.9\n60,20.6,19.9\n";

    #[track_caller]
    fn reads(bytes: &[u8], text: &str, encoding: Option<&str>) {
        let (mut decoded, name) = utf8(bytes).unwrap();
        let mut found = String::new();
        decoded.read_to_string(&mut found).unwrap();
        assert_eq!((found.as_str(), name), (text, encoding));
    }

    #[test]
    fn logs_are_read_in_the_encodings_of_loggers_and_spreadsheets() {
        reads(LOG.as_bytes(), LOG, None);
        reads(format!("\u{feff}{LOG}").as_bytes(), LOG, None);
        reads(&WINDOWS_1252.encode(LOG).0, LOG, Some("windows-1252"));
        reads(&GBK.encode(CHINESE).0, CHINESE, Some("GBK"));
        reads(&SHIFT_JIS.encode(JAPANESE).0, JAPANESE, Some("Shift_JIS"));
        let quoted = "Zeit;\u{201c}Öl\u{201d};Druck \u{2013} bar\n0;20,5;1\n";
        reads(&WINDOWS_1252.encode(quoted).0, quoted, Some("windows-1252"));
        let little: Vec<u8> = LOG.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = LOG.encode_utf16().flat_map(u16::to_be_bytes).collect();
        reads(&[[0xFF, 0xFE].as_slice(), &little].concat(), LOG, Some("UTF-16LE"));
        reads(&[[0xFE, 0xFF].as_slice(), &big].concat(), LOG, Some("UTF-16BE"));
        reads(&little, LOG, Some("UTF-16LE"));
        reads(&big, LOG, Some("UTF-16BE"));
    }

    #[test]
    fn a_long_log_is_decoded_in_parts() {
        let long = LOG.repeat(5000);
        reads(&WINDOWS_1252.encode(&long).0, &long, Some("windows-1252"));
        let chinese = CHINESE.repeat(5000);
        reads(&GBK.encode(&chinese).0, &chinese, Some("GBK"));
    }

    #[test]
    fn data_that_are_no_text_are_not_decoded() {
        let (_, name) = utf8([0x89, b'P', b'N', b'G', 0, 0, 0, 13].as_slice()).unwrap();
        assert_eq!(name, None);
    }
}
