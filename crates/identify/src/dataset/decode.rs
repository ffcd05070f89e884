//! Encodings of logs. Loggers and spreadsheets of Windows write cp1252, cp1251, UTF-16, GBK or Shift_JIS; everything is
//! read as UTF-8.

use std::io::{self, Chain, Cursor, Read};

use encoding_rs::{
    BIG5, Decoder, EUC_JP, EUC_KR, Encoding, GBK, IBM866, KOI8_R, SHIFT_JIS, UTF_16BE, UTF_16LE,
    WINDOWS_1251, WINDOWS_1252,
};

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
        Err(_) => Some(cyrillic(sample).or_else(|| east_asian(sample)).unwrap_or(WINDOWS_1252)),
    }
}

/// Returns the encoding of a text with Russian or Ukrainian words; `None` if it has none. In every other encoding, the
/// letters have the wrong case, or stand between Latin letters.
fn cyrillic(sample: &[u8]) -> Option<&'static Encoding> {
    let is_valid = |encoding: &&'static Encoding| {
        let text = encoding.decode_without_bom_handling_and_without_replacement(sample);
        let Some(found) = text.as_deref().and_then(CyrillicWords::of) else { return false };
        match *encoding == WINDOWS_1251 {
            // Two Chinese characters may look like a word in capitals.
            true => found.has_small_letters || !is_of_pairs(sample),
            // In the older encodings, they may also look like a word in small letters.
            false => found.has_small_letters && (found.letters >= 10 || !is_of_pairs(sample)),
        }
    };
    [WINDOWS_1251, KOI8_R, IBM866].into_iter().find(is_valid)
}

/// Cyrillic words of a text.
struct CyrillicWords {
    letters: usize,
    /// Whether a word of three or more letters has small ones.
    has_small_letters: bool,
}

impl CyrillicWords {
    /// Returns the words; `None` if the text has other letters than these words and Latin ones, or no word of three
    /// letters.
    fn of(text: &str) -> Option<CyrillicWords> {
        let is_cyrillic = |letter: char| {
            matches!(letter, 'А'..='я' | 'Ё' | 'ё' | 'І' | 'і' | 'Ї' | 'ї' | 'Є' | 'є' | 'Ґ' | 'ґ')
        };
        let is_sign = |sign: char| "°µ№±«»–—·²³\u{a0}…".contains(sign);
        if text.chars().any(|sign| !sign.is_ascii() && !is_cyrillic(sign) && !is_sign(sign)) {
            return None;
        }
        let (mut all, mut is_long, mut has_small_letters) = (0, false, false);
        let is_letter = |sign: char| is_cyrillic(sign) || sign.is_ascii_alphabetic();
        for word in text.split(|sign: char| !is_letter(sign)).filter(|word| !word.is_ascii()) {
            let mut others = word.chars().skip(1);
            let others_are_small = others.clone().all(char::is_lowercase);
            let is_in_capitals = word.chars().all(char::is_uppercase);
            if others.any(|letter| letter.is_ascii()) || word.starts_with(|first: char| first.is_ascii()) {
                return None;
            }
            if !others_are_small && !is_in_capitals {
                return None;
            }
            let letters = word.chars().count();
            all += letters;
            is_long |= letters >= 3;
            has_small_letters |= letters >= 3 && others_are_small;
        }
        is_long.then_some(CyrillicWords { letters: all, has_small_letters })
    }
}

/// Returns the encoding of a Chinese, Japanese or Korean text; `None` if it is none.
fn east_asian(sample: &[u8]) -> Option<&'static Encoding> {
    if is_of_pairs(sample) {
        return Some(of_pairs(sample));
    }
    // Narrow characters of Shift_JIS are single bytes, which many bytes of Big5 look like.
    match is_big5(sample) {
        true => Some(BIG5),
        false => is_shift_jis(sample).then_some(SHIFT_JIS),
    }
}

/// Returns the encoding of a text whose bytes that are not ASCII stand in pairs. Only Japanese has kana, and Korean has
/// other first bytes than Chinese.
fn of_pairs(sample: &[u8]) -> &'static Encoding {
    let mut pairs = sample.split(u8::is_ascii).flat_map(|group| group.chunks_exact(2));
    if pairs.clone().any(|pair| matches!(pair[0], 0xA4 | 0xA5)) {
        return EUC_JP;
    }
    // A few pairs may be Chinese too.
    let is_korean = pairs.clone().nth(7).is_some() && pairs.all(|pair| matches!(pair[0], 0xB0..=0xC8));
    if is_korean { EUC_KR } else { GBK }
}

/// Returns whether the sample is text in Big5 with common characters.
fn is_big5(sample: &[u8]) -> bool {
    // The sample may end inside a character.
    let but_last = sample.split_last().map_or(sample, |(_, rest)| rest);
    let mut texts = [sample, but_last].into_iter();
    let text = texts.find_map(|text| BIG5.decode_without_bom_handling_and_without_replacement(text));
    let Some(text) = text else { return false };
    let (mut all, mut run, mut longest) = (0, 0, 0);
    for sign in text.chars() {
        run = if is_ideograph(sign) { run + 1 } else { 0 };
        all += usize::from(run > 0);
        longest = longest.max(run);
    }
    // Rare characters have first bytes that are letters of cp1252.
    let mut bytes = sample.iter().copied();
    let mut is_common = true;
    while let Some(byte) = bytes.next() {
        if !byte.is_ascii() {
            is_common &= matches!(byte, 0xA1..=0xC6);
            bytes.next();
        }
    }
    // `µm²` of cp1252 looks like two characters.
    is_common && all >= 4 && longest >= 3
}

fn is_ideograph(sign: char) -> bool {
    matches!(sign, '\u{4E00}'..='\u{9FFF}')
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

/// Returns whether the sample is text in Shift_JIS: it has two or more Japanese characters in a row, and none of those that
/// no program writes.
fn is_shift_jis(sample: &[u8]) -> bool {
    // The sample may end inside a character.
    let but_last = sample.split_last().map_or(sample, |(_, rest)| rest);
    let mut texts = [sample, but_last].into_iter();
    let text = texts.find_map(|text| SHIFT_JIS.decode_without_bom_handling_and_without_replacement(text));
    let Some(text) = text else { return false };
    let is_wide = |sign: char| is_ideograph(sign) || matches!(sign, '\u{3005}' | '\u{3041}'..='\u{30FF}');
    let is_narrow = |sign: char| matches!(sign, '\u{FF66}'..='\u{FF9F}');
    let run_of = |length: usize, is: &dyn Fn(char) -> bool| {
        text.split(|sign: char| !is(sign)).any(|run| run.chars().count() >= length)
    };
    // Each narrow character is one byte, which may also be a letter of cp1252.
    let is_private = |sign: char| matches!(sign, '\u{E000}'..='\u{F8FF}');
    !text.contains(is_private) && (run_of(2, &is_wide) || run_of(3, &is_narrow))
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

    const RUSSIAN: &str = "Время;Температура шпинделя [°C];Станина;Ось Z\n0;20,5;19,9;1\n60;20,6;19,9;1\n";
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
        for russian in [RUSSIAN, "time;Шпиндель;Станина\n0;20;20\n", "ВРЕМЯ;СТОЙКА\n", "час;Шпіндель\n"]
        {
            reads(&WINDOWS_1251.encode(russian).0, russian, Some("windows-1251"));
        }
        reads(&KOI8_R.encode(RUSSIAN).0, RUSSIAN, Some("KOI8-R"));
        reads(&IBM866.encode(RUSSIAN).0, RUSSIAN, Some("IBM866"));
        let narrow = "time,ｼｭｼﾞｸ,ﾍﾞｯﾄﾞ\n0,20,20\n";
        reads(&SHIFT_JIS.encode(narrow).0, narrow, Some("Shift_JIS"));
        reads(&EUC_JP.encode(JAPANESE).0, JAPANESE, Some("EUC-JP"));
        let korean = "시간,주축온도,베드온도\n0,20,20\n";
        reads(&EUC_KR.encode(korean).0, korean, Some("EUC-KR"));
        let big = "時間,主軸溫度,床身\n0,20,20\n";
        reads(&BIG5.encode(big).0, big, Some("Big5"));
        for western in [
            "Zeit;Größe;Öl [°C];Weg [µm²];Fläche [m²]\n",
            "temps;pièce n°1;côté;décalage\n",
            "hora;máquina;posición;año\n",
            "ÄÖ;°C;µm\n",
            "time;bed [°C];spot [µm²];air [°C];oil [°C]\n",
        ] {
            reads(&WINDOWS_1252.encode(western).0, western, Some("windows-1252"));
        }
        for chinese in ["time,油温\n", "time,油温,主轴\n", "时间,环境温度,电机\n", "time,床身,导轨,冷却\n"]
        {
            reads(&GBK.encode(chinese).0, chinese, Some("GBK"));
        }
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
