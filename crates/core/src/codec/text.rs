//! Values in lines of text, as readouts, gauges and DCON modules send them: the request, and the pattern of the answer.
//!
//! ```text
//! pattern  >{skip 2}{number}{any}
//! line     >+025.12+023.40-001.57+000.00        the number is -1.57
//! ```
//!
//! A pattern describes a whole line without its end (carriage return, line feed). A line that differs has no value. A
//! readout that was switched to inch sends another unit or another number of decimals, so its lines are rejected.
//!
//! | part | meaning |
//! |---|---|
//! | `{number}` | the value: blanks, sign, blanks, digits with a decimal point, exponent |
//! | `{number.4}` | the value, with exactly four decimals |
//! | `{number 8}`, `{number.4 8}` | the value, with exactly eight characters: blanks, sign, digits and point |
//! | `{number,}`, `{number,4}` | the value with a decimal comma |
//! | `{skip}`, `{skip 2}` | numbers before or after the value that are not used |
//! | `{any}`, `{any 2}` | any characters; with a number, exactly as many |
//! | `{sum}` | at the end: the checksum of DCON, two hexadecimal digits |
//! | anything else | these characters |

use std::fmt;
use std::str::FromStr;

use crate::reading::Reason;

mod number;

use number::Number;

/// Placeholder of the checksum, in a pattern and in a request.
const SUM: &str = "{sum}";
/// Number of digits of a checksum.
const SUM_DIGITS: usize = 2;
/// Number of decimals of a formatted number if the pattern does not state a number of decimals.
const DECIMALS: u8 = 3;
/// Largest number in `{skip 2}`, `{any 2}` and `{number 8}`: numbers or characters of one placeholder.
const LARGEST_COUNT: u16 = 200;
/// Largest number of parts of a pattern.
const MOST_PARTS: usize = 64;
/// Last character that a device can send, because a character has eight bits.
const LAST_CHARACTER: char = '\u{ff}';
/// Largest number of decimals that a pattern can state.
const LARGEST_DECIMALS: u8 = 9;

/// Value in a line of text, and the request for the line.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct TextValue {
    /// Text to send. Empty if the device sends lines without a request.
    pub request: String,
    /// Pattern of the line that contains the value.
    pub pattern: TextPattern,
}

/// Pattern of a line of text with one value.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct TextPattern {
    source: String,
    parts: Vec<Part>,
    /// Decimal separator of all numbers in the line: a point or a comma.
    point: char,
    /// Whether the line ends with a checksum.
    has_sum: bool,
}

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Part {
    Literal(Vec<char>),
    /// The value. If the pattern states the number of decimals, a value with another number of decimals does not match.
    /// If it states a width in characters, a value of another width does not match.
    Number {
        decimals: Option<u8>,
        width: Option<u16>,
    },
    /// Skips this many numbers of the line, which are not used.
    Skip(u16),
    /// Skips exactly this many characters of any kind. With `None`, skips any number of characters.
    Any(Option<u16>),
}

/// Kind of the pattern part that matched the characters directly before the present position in a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Before {
    Literal,
    Number,
    Any,
}

/// Text in the notation of a profile: in quotes, with escapes for control characters.
#[derive(Clone, Copy, Debug)]
pub struct Quoted<'a>(pub &'a str);

impl TextPattern {
    /// Returns the number in a line that matches the pattern.
    ///
    /// # Errors
    /// [`Reason::BadReply`] if the line does not match; [`Reason::Checksum`] if only its checksum is wrong.
    pub fn read(&self, line: &str) -> Result<f64, Reason> {
        let characters: Vec<char> = line.chars().collect();
        if !self.has_sum {
            return self.rest(&self.parts, &characters, (0, Before::Literal), None).ok_or(Reason::BadReply);
        }
        let end = characters.len().checked_sub(SUM_DIGITS).ok_or(Reason::BadReply)?;
        let (body, sum) = characters.split_at(end);
        let value = self.rest(&self.parts, body, (0, Before::Literal), None).ok_or(Reason::BadReply)?;
        let is_right = sum.iter().collect::<String>().eq_ignore_ascii_case(&digits_of_sum(body));
        if is_right { Ok(value) } else { Err(Reason::Checksum) }
    }

    /// Matches the remaining parts of the pattern with the rest of the line, from the position `at` on. Returns the
    /// value; `None` if the line does not match.
    fn rest(
        &self,
        parts: &[Part],
        line: &[char],
        (at, before): (usize, Before),
        value: Option<f64>,
    ) -> Option<f64> {
        let Some((part, parts)) = parts.split_first() else {
            return value.filter(|_| line[at..].iter().all(|character| *character == ' '));
        };
        match part {
            Part::Literal(literal) => {
                let end = at + literal.len();
                if line.get(at..end)? != literal.as_slice() {
                    return None;
                }
                self.rest(parts, line, (end, Before::Literal), value)
            }
            Part::Number { decimals, width } => {
                let found = self.number(is_before_any(parts), line, (at, before))?;
                if decimals.is_some_and(|decimals| usize::from(decimals) != found.decimals)
                    || width.is_some_and(|width| usize::from(width) != found.end - at)
                {
                    return None;
                }
                self.rest(parts, line, (found.end, Before::Number), Some(found.value))
            }
            Part::Skip(count) => {
                let mut place = (at, before);
                for left in (0..*count).rev() {
                    let is_before_any = left == 0 && is_before_any(parts);
                    place = (self.number(is_before_any, line, place)?.end, Before::Number);
                }
                self.rest(parts, line, place, value)
            }
            Part::Any(Some(count)) => {
                let end = at + usize::from(*count);
                if end > line.len() { None } else { self.rest(parts, line, (end, Before::Any), value) }
            }
            Part::Any(None) => {
                (at..=line.len()).find_map(|end| self.rest(parts, line, (end, Before::Any), value))
            }
        }
    }

    /// Returns the number at this position. Returns `None` if there is no number, or if the number could be a
    /// part of a longer number.
    fn number(&self, is_before_any: bool, line: &[char], (at, before): (usize, Before)) -> Option<Number> {
        let is_of_number =
            |character: &char| character.is_ascii_digit() || matches!(character, '.' | ',' | '+' | '-');
        let begins_inside = match before {
            Before::Literal => false,
            Before::Number => !matches!(line.get(at), Some('+' | '-' | ' ')),
            Before::Any => at > 0 && line.get(at - 1).is_some_and(is_of_number),
        };
        if begins_inside {
            return None;
        }
        let found = Number::at(line, at, self.point)?;
        let ends_inside = is_before_any && matches!(line.get(found.end), Some('.' | ','));
        (!ends_inside).then_some(found)
    }

    /// Returns a line that matches the pattern and contains this value, for a virtual device.
    pub fn line(&self, value: f64) -> String {
        let mut line = String::new();
        for part in &self.parts {
            match part {
                Part::Literal(literal) => line.extend(literal),
                Part::Number { .. } => line += &self.rendered(value),
                Part::Skip(count) => (0..*count).for_each(|_| line += &self.rendered(0.0)),
                Part::Any(count) => line += &" ".repeat(usize::from(count.unwrap_or(1))),
            }
        }
        self.ended(line)
    }

    /// Returns a line with all these values, one after the other, for a virtual device. A pattern such as
    /// `>{skip 2}{number}{any}` then reads one of the values and skips the values before it. Returns `None`
    /// unless the pattern consists of literal text, `{skip N}`, the number, and `{any}` or `{skip N}`, in
    /// this order. All parts except the number may be missing.
    pub fn line_of_all(&self, values: &[f64]) -> Option<String> {
        let (literal, parts) = match self.parts.as_slice() {
            [Part::Literal(literal), parts @ ..] => (literal.as_slice(), parts),
            parts => (&[][..], parts),
        };
        let parts = if let [Part::Skip(_), parts @ ..] = parts { parts } else { parts };
        let is_list =
            matches!(parts, [Part::Number { .. }] | [Part::Number { .. }, Part::Any(None) | Part::Skip(_)]);
        if !is_list {
            return None;
        }
        let values: String = values.iter().map(|value| self.rendered(*value)).collect();
        Some(self.ended(literal.iter().collect::<String>() + &values))
    }

    /// Returns how many numbers the pattern skips before the value.
    pub fn skipped(&self) -> usize {
        let before = self.parts.iter().take_while(|part| !matches!(part, Part::Number { .. }));
        before.map(|part| if let Part::Skip(count) = part { usize::from(*count) } else { 0 }).sum()
    }

    /// Returns whether the pattern states the decimals of the value, or the characters directly after it. Without
    /// either, a value in another unit (mm, inch) would also match.
    pub fn distinguishes_units(&self) -> bool {
        let mut parts = self.parts.iter().skip_while(|part| !matches!(part, Part::Number { .. }));
        matches!(parts.next(), Some(Part::Number { decimals: Some(_), .. }))
            || matches!(parts.next(), Some(Part::Literal(_)))
    }

    /// Formats a number with sign, leading zeros, and the decimals and the width of the pattern.
    fn rendered(&self, value: f64) -> String {
        let form = |part: &Part| match part {
            Part::Number { decimals, width } => Some((*decimals, width.map(usize::from))),
            _ => None,
        };
        let (stated, width) = self.parts.iter().find_map(form).unwrap_or_default();
        let with_decimals = |decimals: usize| {
            // Sign, three digits, and the decimals with their point.
            let usual = 4 + if decimals == 0 { 0 } else { decimals + 1 };
            let width = width.unwrap_or(usual);
            format!("{value:+0width$.decimals$}")
        };
        let most = usize::from(stated.unwrap_or(DECIMALS));
        // As many decimals as the width allows, if the pattern states no number.
        let least = if stated.is_some() { most } else { 0 };
        let fits = |text: &String| width.is_none_or(|width| text.len() <= width);
        let fitting = (least..=most).rev().map(with_decimals).find(fits);
        let text = fitting.unwrap_or_else(|| with_decimals(least));
        if self.point == ',' { text.replace('.', ",") } else { text }
    }

    fn ended(&self, mut line: String) -> String {
        if self.has_sum {
            let characters: Vec<char> = line.chars().collect();
            line += &digits_of_sum(&characters);
        }
        line
    }

    /// Returns a pattern that matches lines like `line`. The value is the first number with decimals, or else the first
    /// number. The decimal point may be a comma. Returns `None` if the line has no number, or characters that a pattern
    /// cannot contain.
    pub fn like(line: &str) -> Option<TextPattern> {
        match TextPattern::like_with(line, '.') {
            Some(pattern) if pattern.has_decimals() => Some(pattern),
            other => TextPattern::like_with(line, ',').filter(TextPattern::has_decimals).or(other),
        }
    }

    /// Returns whether the pattern states the decimals of the value.
    pub fn has_decimals(&self) -> bool {
        self.parts.iter().any(|part| matches!(part, Part::Number { decimals: Some(_), .. }))
    }

    /// Returns whether the line ends with a checksum.
    pub const fn has_sum(&self) -> bool {
        self.has_sum
    }

    /// Returns a pattern that matches lines like `line`, with the decimal point `point`.
    fn like_with(line: &str, point: char) -> Option<TextPattern> {
        let characters: Vec<char> = line.chars().collect();
        let is_first_digit = |at: &usize| {
            let is_digit = |at: usize| characters.get(at).is_some_and(char::is_ascii_digit);
            is_digit(*at) && !at.checked_sub(1).is_some_and(is_digit)
        };
        // A number may begin with its decimal point. A comma before a number separates it from the number before.
        let is_inside = |character: &char| *character == ' ' || *character == '.' && point == '.';
        let behind_text = |end: usize| {
            characters[..end].iter().rposition(|character| *character != ' ').map_or(0, |text| text + 1)
        };
        // A number includes its sign, and the blanks before and after the sign.
        let begin = |first: usize| {
            let other = characters[..first].iter().rposition(|character| !is_inside(character));
            match other {
                Some(sign) if matches!(characters[sign], '+' | '-') => behind_text(sign),
                Some(other) => other + 1,
                None => 0,
            }
        };
        let found = |first: usize| Some((begin(first), Number::at(&characters, begin(first), point)?));
        // A number with decimals is more likely the value. A number without decimals may be a channel number.
        let mut numbers: Vec<_> = (0..characters.len()).filter(is_first_digit).filter_map(found).collect();
        numbers.sort_by_key(|(_, number)| number.decimals == 0);
        let (begin, found) = numbers.into_iter().next()?;
        let part = |range: &[char]| range.iter().collect::<String>();
        let end = part(&characters[found.end..]);
        // Numbers after the value may differ in other lines, so any characters are accepted there.
        let end = if end.contains(|other: char| other.is_ascii_digit()) { "{any}" } else { end.trim_end() };
        let decimals = match found.decimals {
            0 => String::new(),
            decimals => format!("{point}{decimals}"),
        };
        let source = format!("{}{{number{decimals}}}{}", part(&characters[..begin]), end);
        source.parse().ok().filter(|pattern: &TextPattern| pattern.read(line).is_ok())
    }
}

/// Replaces `{unit}` in a text by the address of the device. As DCON modules require, the address has two hexadecimal
/// digits.
pub fn with_unit(text: &str, unit: u8) -> String {
    text.replace("{unit}", &format!("{unit:02X}"))
}

/// Replaces `{sum}` in a request by the checksum of DCON: the sum of all characters before it.
///
/// # Errors
/// Returns a sentence with the mistake and, after `; `, the correct notation.
pub fn with_sum(request: &str) -> Result<String, String> {
    let (before, sum, end) = match request.split_once(SUM) {
        Some((before, end)) => (before, digits_of_sum(&before.chars().collect::<Vec<_>>()), end),
        None => (request, String::new(), ""),
    };
    if let Some(other) = [before, end].iter().find(|part| part.contains(['{', '}'])) {
        return Err(format!(
            "{} contains an unknown word in braces; a request may contain {{unit}} and {{sum}}",
            Quoted(other)
        ));
    }
    Ok(format!("{before}{sum}{end}"))
}

/// Returns the checksum of DCON: the sum of all characters modulo 256, as two digits.
fn digits_of_sum(characters: &[char]) -> String {
    let sum = characters.iter().fold(0_u32, |sum, character| sum.wrapping_add(u32::from(*character)));
    format!("{:02X}", sum & 0xff)
}

impl FromStr for TextPattern {
    type Err = String;

    /// Parses a pattern in the notation of the profile, for example `{number} mm`.
    ///
    /// # Errors
    /// Returns a sentence with the mistake and, after `; `, the correct notation.
    fn from_str(text: &str) -> Result<TextPattern, String> {
        const FORMS: &str =
            "write {number}, {number.4}, {number 8}, {skip 2}, {any}, {any 2}, {unit} or {sum} in braces";
        if text.contains(['\r', '\n']) {
            return Err(
                "the pattern contains a line end (carriage return, line feed); leave out \\r and \\n"
                    .to_owned(),
            );
        }
        if let Some(other) = text.chars().find(|character| *character > LAST_CHARACTER) {
            return Err(format!(
                "a device cannot send `{other}`, because a character has eight bits; write {{any 1}} instead"
            ));
        }
        let has_sum = text.ends_with(SUM);
        let mut rest = text.strip_suffix(SUM).unwrap_or(text);
        let mut pattern = TextPattern { source: text.to_owned(), parts: Vec::new(), point: '.', has_sum };
        while !rest.is_empty() {
            let Some(begin) = rest.find(['{', '}']) else {
                pattern.parts.push(Part::Literal(rest.chars().collect()));
                break;
            };
            if begin > 0 {
                pattern.parts.push(Part::Literal(rest[..begin].chars().collect()));
            }
            let word = rest[begin..].strip_prefix('{').and_then(|inner| inner.split_once('}'));
            let (word, behind) =
                word.ok_or_else(|| format!("a brace in {} has no matching brace; {FORMS}", Quoted(text)))?;
            if word == "sum" {
                return Err("{sum} is not at the end of the pattern; write {sum} last".to_owned());
            }
            let part = part(word, &mut pattern.point);
            pattern.parts.push(part.ok_or_else(|| format!("`{{{word}}}` is unknown; {FORMS}"))?);
            rest = behind;
        }
        // A placeholder with a count of zero matches no characters, so it is left out.
        pattern.parts.retain(|part| !matches!(part, Part::Skip(0) | Part::Any(Some(0))));
        if pattern.parts.len() > MOST_PARTS {
            return Err(format!(
                "the pattern has more than {MOST_PARTS} parts; use fewer, for example one {{skip 2}} for \
                 two numbers"
            ));
        }
        let is_too_narrow = |part: &Part| match *part {
            Part::Number { decimals: Some(decimals), width: Some(width) } => u16::from(decimals) >= width,
            _ => false,
        };
        if pattern.parts.iter().any(is_too_narrow) {
            return Err(format!(
                "the number in {} has too few characters for its decimals; count the sign, all digits and the point",
                Quoted(text)
            ));
        }
        let count = |is: fn(&Part) -> bool| pattern.parts.iter().filter(|part| is(part)).count();
        match count(|part| matches!(part, Part::Number { .. })) {
            1 => {}
            0 => return Err(format!("{} has no {{number}}; {FORMS}", Quoted(text))),
            _ => {
                return Err(format!(
                    "{} has several values; write {{number}} once, and {{skip}} for other numbers",
                    Quoted(text)
                ));
            }
        }
        if count(|part| matches!(part, Part::Any(None))) > 1 {
            return Err(format!(
                "{} has several {{any}}; write it once, and give the others a length, for example {{any 2}}",
                Quoted(text)
            ));
        }
        Ok(pattern)
    }
}

fn is_before_any(next: &[Part]) -> bool {
    matches!(next.first(), Some(Part::Any(_)))
}

/// Parses the word between two braces. `None` if it is unknown. If the word states a decimal comma, sets `point` to a
/// comma.
fn part(word: &str, point: &mut char) -> Option<Part> {
    let (name, count) = match word.split_once(' ') {
        Some((name, count)) => {
            let count: u16 = count.trim().parse().ok()?;
            if count > LARGEST_COUNT {
                return None;
            }
            (name, Some(count))
        }
        None => (word, None),
    };
    let width = match (name, count) {
        ("skip", count) => return Some(Part::Skip(count.unwrap_or(1))),
        ("any", count) => return Some(Part::Any(count)),
        // A number has at least one character.
        (_, Some(0)) => return None,
        (_, width) => width,
    };
    let form = name.strip_prefix("number")?;
    let mut characters = form.chars();
    match characters.next() {
        None => return Some(Part::Number { decimals: None, width }),
        Some('.') => {}
        Some(',') => *point = ',',
        Some(_) => return None,
    }
    match characters.as_str() {
        "" if form == "," => Some(Part::Number { decimals: None, width }),
        decimals => {
            let decimals: u8 = decimals.parse().ok()?;
            (decimals <= LARGEST_DECIMALS).then_some(Part::Number { decimals: Some(decimals), width })
        }
    }
}

impl fmt::Display for TextPattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.source)
    }
}

/// Formats the value for messages: `text "{number} mm"`, `text ">{number}" after "#01\r"`.
impl fmt::Display for TextValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "text {}", Quoted(&self.pattern.source))?;
        match self.request.as_str() {
            "" => Ok(()),
            request => write!(f, " after {}", Quoted(request)),
        }
    }
}

impl fmt::Display for Quoted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("\"")?;
        for character in self.0.chars() {
            match character {
                '\r' => f.write_str("\\r")?,
                '\n' => f.write_str("\\n")?,
                '\t' => f.write_str("\\t")?,
                '"' | '\\' => write!(f, "\\{character}")?,
                control if control.is_control() => write!(f, "\\u{:04X}", u32::from(control))?,
                other => write!(f, "{other}")?,
            }
        }
        f.write_str("\"")
    }
}

#[cfg(test)]
mod tests;
