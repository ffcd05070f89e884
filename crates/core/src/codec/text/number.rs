//! Numbers in a line of text: where a number begins and ends, and how many decimals it has.

/// Number in a line of text, with its number of decimals and the position of its end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Number {
    pub(super) value: f64,
    /// Number of digits after the decimal point.
    pub(super) decimals: usize,
    /// Position after the last character of the number.
    pub(super) end: usize,
}

impl Number {
    /// Returns the longest number that begins at this position, with its sign and the blanks before and after the sign.
    pub(super) fn at(line: &[char], at: usize, point: char) -> Option<Number> {
        let blanks = |from: usize| from + run(line, from, |character| character == ' ');
        let digits = |from: usize| run(line, from, |character| character.is_ascii_digit());
        let mut text = String::new();
        let mut end = blanks(at);
        if let Some(sign @ ('+' | '-')) = line.get(end).copied() {
            text.push(sign);
            end = blanks(end + 1);
        }
        let whole = digits(end);
        text.extend(&line[end..end + whole]);
        end += whole;
        let mut decimals = 0;
        if line.get(end) == Some(&point) {
            decimals = digits(end + 1);
            if whole + decimals > 0 {
                text.push('.');
                text.extend(&line[end + 1..=end + decimals]);
                end += 1 + decimals;
            }
        }
        if whole + decimals == 0 {
            return None;
        }
        if let Some('e' | 'E') = line.get(end) {
            let sign = usize::from(matches!(line.get(end + 1), Some('+' | '-')));
            let exponent = digits(end + 1 + sign);
            if exponent > 0 {
                text.extend(&line[end..=end + sign + exponent]);
                end += 1 + sign + exponent;
            }
        }
        let value: f64 = text.parse().ok()?;
        value.is_finite().then_some(Number { value, decimals, end })
    }
}

/// Returns the number of consecutive characters from this position on for which `is` returns true.
fn run(line: &[char], from: usize, is: impl Fn(char) -> bool) -> usize {
    line.get(from..).unwrap_or_default().iter().take_while(|character| is(**character)).count()
}
