//! Detection and conversion of the encodings of logs. Loggers and spreadsheets on Windows write cp1252, cp1251, UTF-16,
//! GBK or Shift_JIS. All of them are converted to UTF-8.
//!
//! The encoding is detected in this order:
//!
//! 1. A byte order mark: UTF-8 and UTF-16.
//! 2. Zero bytes: UTF-16 without a mark, which chardetng does not detect, or no text.
//! 3. Valid UTF-8.
//! 4. Every other encoding, by the crate chardetng. That crate was made for web pages, and a log has few words.
//!    Therefore unit signs such as `°` are removed first, and short column names in Chinese and Japanese are recognised
//!    without the crate.

use std::collections::HashSet;
use std::io::{self, Cursor, Read};

use chardetng::{EncodingDetector, Iso2022JpDetection, Utf8Detection};
use encoding_rs::{
    BIG5, Decoder, EUC_JP, EUC_KR, Encoding, GBK, SHIFT_JIS, UTF_8, UTF_16BE, UTF_16LE, WINDOWS_1252,
    WINDOWS_1254, WINDOWS_1257,
};

use super::text_reader::{Begun, Convert, TextReader};

/// Number of bytes at the start of a log from which the encoding is detected.
const SAMPLE: u64 = 1 << 16;
/// Number of bytes that are decoded in one step.
const PART: usize = 1 << 15;
/// Minimum number of different characters from which the crate chardetng can distinguish Chinese from other languages.
const SHORT: usize = 8;

/// Reader of UTF-8 text. Input in another encoding is converted.
pub(super) type Decoded<R> = TextReader<R, Converter<R>>;

/// Converter from another encoding to UTF-8.
pub(super) struct Converter<R> {
    input: Begun<R>,
    decoder: Decoder,
    raw: Vec<u8>,
}

/// Returns a reader of the input as UTF-8, and the name of the encoding; the name is `None` if the input already is
/// UTF-8.
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
            let converter = Converter { input, decoder, raw: vec![0; PART] };
            (Decoded::converted(converter), Some(encoding.name()))
        }
    })
}

/// Returns the encoding of a text; `None` for UTF-8, and for data that are not text.
fn detect(sample: &[u8]) -> Option<&'static Encoding> {
    if let Some((encoding, _)) = Encoding::for_bom(sample) {
        return Some(encoding).filter(|encoding| *encoding != UTF_8);
    }
    if sample.contains(&0) {
        return wide(sample);
    }
    match std::str::from_utf8(sample) {
        Ok(_) => None,
        // The sample may end inside a character.
        Err(why) if why.error_len().is_none() => None,
        Err(_) => Some(legacy(sample)),
    }
}

/// Returns the encoding of a text that is not UTF-8 or UTF-16.
fn legacy(sample: &[u8]) -> &'static Encoding {
    let letters = without_signs(sample);
    let mut detector = EncodingDetector::new(Iso2022JpDetection::Deny);
    detector.feed(&letters, (sample.len() as u64) < SAMPLE);
    let guess = detector.guess(None, Utf8Detection::Deny);
    if [BIG5, EUC_KR, GBK, SHIFT_JIS].contains(&guess) {
        return guess;
    }
    // Two letters of cp1252 in a row may look like a Chinese character: `AÇÃO`.
    if guess != WINDOWS_1252 && is_short_chinese(sample) {
        return GBK;
    }
    let is_latin = [WINDOWS_1252, WINDOWS_1254, WINDOWS_1257].contains(&guess);
    if (is_latin && has_japanese_word(sample)) || (guess != EUC_JP && is_half_width(&letters)) {
        return SHIFT_JIS;
    }
    guess
}

/// Replaces single unit signs (`°`, `µ`) between ASCII characters by blanks. If the result is pure ASCII, the text is
/// treated as cp1252.
///
/// The crate chardetng assumes that bytes outside ASCII are letters of words. In most logs, the only such bytes are `°`
/// and `µ`. chardetng detects `Temp_°C;Weg_µm` as Big5, because the bytes of `°C` and `µm` are also characters of Big5.
fn without_signs(sample: &[u8]) -> Vec<u8> {
    let byte_at = |place: Option<usize>| place.and_then(|place| sample.get(place)).copied().unwrap_or(b' ');
    let is_sign = |place: usize, byte: u8| {
        let (before, after) = (byte_at(place.checked_sub(1)), byte_at(place.checked_add(1)));
        let is_known = match byte {
            // `©`, `®`, `°`, `±`, `µ` and `·` are the same in the code pages of Windows for Europe.
            0xA9 | 0xAE | 0xB0 | 0xB1 | 0xB5 | 0xB7 => true,
            // `²`, `³` and `Ø`, which are letters of other languages inside a word: `Głowica`.
            0xB2 | 0xB3 | 0xD8 => !after.is_ascii_alphabetic(),
            _ => false,
        };
        is_known && before.is_ascii() && after.is_ascii()
    };
    let bytes = sample.iter().enumerate();
    bytes.map(|(place, byte)| if is_sign(place, *byte) { b' ' } else { *byte }).collect()
}

/// Returns the groups of successive bytes outside ASCII.
fn groups(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(u8::is_ascii).filter(|group| !group.is_empty())
}

/// Returns whether the bytes outside ASCII form only a few common Chinese characters in GBK.
///
/// The crate chardetng detects `温度` as Japanese, `油温` as Russian and `主轴` as Czech.
fn is_short_chinese(sample: &[u8]) -> bool {
    // The characters of level 1 of GB 2312.
    let is_common = |pair: &[u8]| matches!(pair, [0xB0..=0xD7, 0xA1..=0xFE]);
    let pairs = || groups(sample).flat_map(|group| group.chunks(2));
    pairs().all(is_common) && pairs().collect::<HashSet<_>>().len() < SHORT
}

/// Returns whether the text, decoded as Shift_JIS, contains two or more common Japanese characters in a row.
///
/// The crate chardetng detects some short Japanese texts as text in Latin letters. In Latin encodings, the first byte
/// of these characters is a quotation mark, a dash, or a letter like `Š`.
fn has_japanese_word(sample: &[u8]) -> bool {
    let (mut bytes, mut run, mut has_word) = (sample.iter(), 0, false);
    while let Some(byte) = bytes.next() {
        run = if matches!(byte, 0x81..=0x9F) { run + 1 } else { 0 };
        has_word |= run >= 2;
        if matches!(byte, 0x81..=0x9F | 0xE0..=0xFC) {
            bytes.next();
        }
    }
    has_word && SHIFT_JIS.decode_without_bom_handling_and_without_replacement(sample).is_some()
}

/// Returns whether all bytes outside ASCII are very probably half-width katakana in Shift_JIS, which have one
/// byte each.
///
/// The crate chardetng gives such katakana a low rating, because web pages rarely have them. Other encodings
/// use the same bytes. At least one word must have an odd number of bytes, and three or more: a word with an
/// even number may be Chinese or Korean. At least one byte must be from 0xB3 to 0xBF: Cyrillic capitals use
/// bytes from 0xC0 on, and a few letters below 0xB3.
fn is_half_width(letters: &[u8]) -> bool {
    let is_kana = |byte: &u8| matches!(byte, 0xA6..=0xDF);
    let is_no_capital = |byte: &u8| matches!(byte, 0xB3..=0xBF);
    let is_word = |group: &[u8]| group.len() >= 3 && !group.len().is_multiple_of(2);
    groups(letters).all(|group| group.iter().all(is_kana))
        && groups(letters).any(is_word)
        && groups(letters).any(|group| group.iter().any(is_no_capital))
}

/// Returns the byte order of UTF-16 without a byte order mark; `None` if the text is not UTF-16. In a log in UTF-16,
/// almost every second byte is zero, because most characters are ASCII.
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

impl<R: Read> Convert for Converter<R> {
    fn next_part(&mut self, text: &mut Vec<u8>) -> io::Result<bool> {
        let count = self.input.read(&mut self.raw)?;
        let is_over = count == 0;
        // No encoding needs more than three bytes of UTF-8 for one byte.
        text.resize(3 * count + 16, 0);
        let (_, _, written, _) = self.decoder.decode_to_utf8(&self.raw[..count], text, is_over);
        text.truncate(written);
        Ok(!is_over)
    }
}

#[cfg(test)]
mod tests {
    use encoding_rs::{IBM866, ISO_8859_2, KOI8_R, WINDOWS_1250, WINDOWS_1251};

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

    /// Checks that each of these texts, encoded in this encoding, is detected as this encoding and is read
    /// unchanged.
    #[track_caller]
    fn all_read(encoding: &'static Encoding, texts: &[&str]) {
        for text in texts {
            reads(&encoding.encode(text).0, text, Some(encoding.name()));
        }
    }

    #[test]
    fn utf_8_and_utf_16_are_detected_with_and_without_a_mark() {
        reads(LOG.as_bytes(), LOG, None);
        reads(format!("\u{feff}{LOG}").as_bytes(), LOG, None);
        let little: Vec<u8> = LOG.encode_utf16().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = LOG.encode_utf16().flat_map(u16::to_be_bytes).collect();
        reads(&[[0xFF, 0xFE].as_slice(), &little].concat(), LOG, Some("UTF-16LE"));
        reads(&[[0xFE, 0xFF].as_slice(), &big].concat(), LOG, Some("UTF-16BE"));
        reads(&little, LOG, Some("UTF-16LE"));
        reads(&big, LOG, Some("UTF-16BE"));
    }

    #[test]
    fn words_of_european_languages_are_read() {
        all_read(
            WINDOWS_1252,
            &[
                LOG,
                "Zeit;Größe;Öl [°C];Weg [µm²];Fläche [m²]\n",
                "temps;pièce n°1;côté;décalage\n",
                "temps;présélection;température\n",
                "hora;máquina;posición;año\n",
                "t;DESLOCAÇÃO µm;FUSO °C\n",
                "tid;måling °C;aksel µm\n",
                "aika;öljy °C;pään µm\n",
                "ZEIT;ÖLTEMP;STÄNDER\n",
                "ÄÖ;°C;µm\n",
                "Zeit;\u{201c}Öl\u{201d};Druck \u{2013} bar\n0;20,5;1\n",
            ],
        );
        all_read(WINDOWS_1250, &["Čas;Vřeteno;Teplota °C;Lože\n", "czas;Głowica;T °C\n"]);
        all_read(WINDOWS_1250, &["Czas;Wrzeciono;Łoże;Przesunięcie µm\n"]);
        all_read(ISO_8859_2, &["Čas;Vřeteno;Šířka\n"]);
        all_read(
            WINDOWS_1251,
            &[
                RUSSIAN,
                "time;Шпиндель;Станина\n0;20;20\n",
                "ВРЕМЯ;СТОЙКА\n",
                "час;Шпіндель\n",
                "время;темп\n",
                "Время;Темп. °C\n",
            ],
        );
        all_read(IBM866, &[RUSSIAN, "Дата;Время\n"]);
        // The letters of KOI8-R and KOI8-U are the same in Russian.
        reads(&KOI8_R.encode(RUSSIAN).0, RUSSIAN, Some("KOI8-U"));
    }

    #[test]
    fn signs_of_units_are_read_without_other_letters() {
        all_read(
            WINDOWS_1252,
            &[
                "Zeit;Temp_°C;Weg_µm\n0;20;1\n",
                "time;bed [°C];spot [µm²];air [°C];oil [°C]\n",
                "time;°C;µm\n0;20.5;1\n",
                "Temp(°C),Disp(µm),°,°\n",
                "time [s],err [µm]\n0,1\n",
                "T1/°C\tT2/°C\tdz/µm\n",
                "time;v [m/s²];flow [m³/h];dx ±;x µm/m·K\n",
                "® Logger\ntime;°C\n",
                "Ø 20 Welle;T °C\n",
                "°C\n",
            ],
        );
    }

    #[test]
    fn words_of_east_asian_languages_are_read() {
        all_read(
            GBK,
            &[
                CHINESE,
                "time,油温\n",
                "time,温度\n",
                "time,主轴\n",
                "time,油温,主轴\n",
                "时间,环境温度,电机\n",
                "time,床身,导轨,冷却\n",
                "日期,X轴,Y轴,Z轴\n",
                "时间,温度℃,位移μm\n",
                "time,温度\n0,20\ntime,温度\n0,20\ntime,温度\n0,20\ntime,温度\n0,20\ntime,温度\n0,20\n",
            ],
        );
        all_read(
            SHIFT_JIS,
            &[JAPANESE, "time,ｼｭｼﾞｸ,ﾍﾞｯﾄﾞ\n0,20,20\n", "時間,温度\n", "time,変位\n", "日時,温度[℃],変位[μm]\n"],
        );
        all_read(EUC_JP, &[JAPANESE]);
        all_read(EUC_KR, &["시간,주축온도,베드온도\n0,20,20\n", "시간,온도\n"]);
        all_read(BIG5, &["時間,主軸溫度,床身\n0,20,20\n", "時間,溫度\n"]);
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
