//! Format of a log from another program: separator of columns, decimal mark, order of dates, and time zone. For example,
//! a spreadsheet set to German has semicolons between columns, commas in numbers, and local times.

use std::borrow::Cow;

use jiff::tz::TimeZone;

use super::cell::{Cell, number_and_unit, word};
use super::time_column::TimeUnit;
use super::wall::{self, DateOrder, Wall};
use super::{Moment, time};

/// Decimal mark of the numbers in a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecimalMark {
    /// A point, as in `12.5`. Commas separate thousands.
    Point,
    /// A comma, as in `12,5`. Points separate thousands.
    Comma,
}

impl DecimalMark {
    fn sign(self) -> char {
        match self {
            DecimalMark::Point => '.',
            DecimalMark::Comma => ',',
        }
    }

    fn name(self) -> &'static str {
        match self {
            DecimalMark::Point => "point",
            DecimalMark::Comma => "comma",
        }
    }

    fn other(self) -> DecimalMark {
        match self {
            DecimalMark::Point => DecimalMark::Comma,
            DecimalMark::Comma => DecimalMark::Point,
        }
    }
}

/// Format of one log file: separator of columns, decimal mark, order of dates, and time zone.
#[derive(Clone, Debug)]
pub struct Dialect {
    separator: u8,
    /// Time zone of times without an offset from UTC. If `None`, such times are rejected.
    zone: Option<TimeZone>,
    /// Decimal mark that the operator has stated; `None` if the numbers decide.
    stated: Option<DecimalMark>,
    /// Decimal mark of the first number with a decimal mark, and this number as text. All later numbers must have the
    /// same mark.
    first: Option<(DecimalMark, String)>,
    /// Whether a number of the file has both marks, so that one of them separates thousands.
    has_thousands: bool,
    /// Whether the first rows do not show whether a comma or point before three digits is a decimal mark.
    is_unclear: bool,
    /// Order of day and month; `None` if it is not known.
    dates: Option<DateOrder>,
    wall: Wall,
}

impl Dialect {
    /// Detects the format from the header line. The columns are separated by the comma, semicolon, tab or
    /// pipe that occurs most often outside quotes. If the numbers are equal, a semicolon or tab takes
    /// precedence over a comma, because names often contain commas.
    #[must_use]
    pub fn of(header: &str, zone: Option<TimeZone>) -> Dialect {
        // Every other part is inside quotes.
        let open = || header.split('"').step_by(2).flat_map(str::bytes);
        let count = |separator: u8| open().filter(|byte| *byte == separator).count();
        // `max_by_key` returns the last maximum.
        let there = [b'|', b',', b';', b'\t'].into_iter().filter(|separator| count(*separator) > 0);
        let separator = there.max_by_key(|separator| count(*separator));
        Dialect {
            separator: separator.unwrap_or(b','),
            zone,
            stated: None,
            first: None,
            has_thousands: false,
            is_unclear: false,
            dates: None,
            wall: Wall::default(),
        }
    }

    /// Sets the decimal mark and the order of dates, if they are known.
    #[must_use]
    pub fn with(self, decimal: Option<DecimalMark>, dates: Option<DateOrder>) -> Dialect {
        Dialect { stated: decimal, dates, ..self }
    }

    /// Learns the order of day and month from a time that is not ambiguous. Only the first such time is used.
    pub fn learn_dates(&mut self, text: &str) {
        self.dates = self.dates.or_else(|| wall::order(text));
    }

    /// Reads times without an offset from UTC as times in UTC.
    #[must_use]
    pub fn in_utc(self) -> Dialect {
        Dialect { zone: Some(TimeZone::UTC), ..self }
    }

    /// Returns the decimal mark that the operator has stated, or else the mark of the numbers so far. `None` if no
    /// number had a mark.
    #[must_use]
    pub fn decimal(&self) -> Option<DecimalMark> {
        self.stated.or_else(|| self.first.as_ref().map(|(mark, _)| *mark))
    }

    /// Returns the order of day and month, if it is known.
    #[must_use]
    pub fn dates(&self) -> Option<DateOrder> {
        self.dates
    }

    /// Learns from the cells of the first rows, by column, whether a comma or point before three digits
    /// separates thousands. In a column with `900` and `1.200`, the point may separate thousands. But if
    /// another number, for example `20.5`, shows that the point is the decimal mark, the point in `1.200` is
    /// a decimal mark too.
    pub fn learn_marks<'a>(&mut self, rows: impl Iterator<Item = Vec<&'a str>>) {
        if self.separator == b',' || self.stated.is_some() {
            return;
        }
        let (mut has_groups_only, mut has_whole) = (Vec::new(), Vec::new());
        for cells in rows {
            for (column, cell) in cells.into_iter().enumerate() {
                if column >= has_whole.len() {
                    has_groups_only.push(false);
                    has_whole.push(false);
                }
                let Some((number, _)) = number_and_unit(cell) else { continue };
                let marks = number.matches([',', '.']).count();
                let is_date =
                    |sign: char| number.matches(sign).count() == marks && !has_groups(&number, sign);
                if marks > 1 && (is_date(',') || is_date('.')) {
                    continue;
                }
                if marks == 1 && [',', '.'].iter().any(|sign| has_groups(&number, *sign)) {
                    has_groups_only[column] = true;
                } else if marks > 0 {
                    return;
                } else {
                    has_whole[column] |= !number.trim_start_matches(['+', '-', '0']).is_empty();
                }
            }
        }
        self.is_unclear = has_groups_only.iter().zip(&has_whole).any(|(groups, whole)| *groups && *whole);
    }

    /// Returns the character that separates the columns, as a byte.
    #[must_use]
    pub fn separator(&self) -> u8 {
        self.separator
    }

    /// Writes a number with a decimal point and without separators of thousands. Any other text is returned unchanged.
    ///
    /// # Errors
    /// Returns a message if the number can be read in two ways, or if an earlier number of the file has
    /// another decimal mark.
    pub fn number<'a>(&mut self, text: &'a str) -> Result<Cow<'a, str>, String> {
        if self.separator == b',' && self.stated.is_none() && !text.contains(',') {
            return Ok(Cow::Borrowed(text));
        }
        if let Some(stated) = self.stated {
            return by_mark(text, stated);
        }
        match (text.contains(','), text.contains('.')) {
            (false, false) => Ok(Cow::Borrowed(text)),
            (true, true) => {
                let mark = match text.rfind(',') > text.rfind('.') {
                    true => DecimalMark::Comma,
                    false => DecimalMark::Point,
                };
                let read = by_mark(text, mark)?;
                if is_number(&read) {
                    self.agrees(text, mark)?;
                    self.has_thousands = true;
                }
                Ok(read)
            }
            (is_comma, _) => {
                let mark = if is_comma { DecimalMark::Comma } else { DecimalMark::Point };
                self.with_one_mark(text, mark)
            }
        }
    }

    /// Reads a number that contains commas only or points only. The mark is a decimal mark or separates
    /// thousands. Returns a message if both are possible, or if the mark does not fit the other numbers or
    /// the separator of the columns. Any other text is returned unchanged.
    fn with_one_mark<'a>(&mut self, text: &'a str, mark: DecimalMark) -> Result<Cow<'a, str>, String> {
        let sign = mark.sign();
        let (decimal, whole) = (text.replace(sign, "."), text.replace(sign, ""));
        if text.matches(sign).count() > 1 {
            if has_groups(text, sign) && is_number(&whole) {
                self.agrees(text, mark.other())?;
                self.has_thousands = true;
                return Ok(Cow::Owned(whole));
            }
            return Ok(Cow::Borrowed(text));
        }
        if !is_number(&decimal) {
            return Ok(Cow::Borrowed(text));
        }
        let known = self.first.as_ref().map(|(mark, _)| *mark);
        let can_be_thousands = has_groups(text, sign);
        if can_be_thousands && self.has_thousands && known == Some(mark.other()) {
            return Ok(Cow::Owned(whole));
        }
        if self.separator == b',' {
            // Commas separate the columns, so a comma in a cell was quoted.
            return Err(match can_be_thousands {
                true => two_readings(text, mark, (&whole, &decimal)),
                false => format!("`{text}` has a decimal comma; state --decimal comma, or write {decimal}"),
            });
        }
        let is_unclear = self.is_unclear && known.is_none();
        if can_be_thousands
            && (is_unclear || (mark == DecimalMark::Comma && known == Some(DecimalMark::Point)))
        {
            return Err(two_readings(text, mark, (&whole, &decimal)));
        }
        self.agrees(text, mark)?;
        Ok(if mark == DecimalMark::Point { Cow::Borrowed(text) } else { Cow::Owned(decimal) })
    }

    /// Checks that a number has the same decimal mark as the first number with a mark. Returns a message if the marks
    /// differ.
    fn agrees(&mut self, text: &str, mark: DecimalMark) -> Result<(), String> {
        let (known, first) = self.first.get_or_insert_with(|| (mark, text.to_owned()));
        match *known == mark {
            true => Ok(()),
            false => Err(format!(
                "`{text}` and `{first}`: decimal commas and points in one file; use only one of them, or state the \
                 decimal mark with --decimal"
            )),
        }
    }

    /// Returns the meaning of a cell.
    ///
    /// # Errors
    /// The errors of [`Dialect::number`].
    pub fn cell<'a>(&mut self, text: &'a str) -> Result<Cell<'a>, String> {
        let text = text.trim();
        // Most cells of most logs are plain numbers.
        if self.separator == b','
            && self.stated.is_none()
            && let Ok(value) = text.parse::<f64>()
        {
            return Ok(finite(value, ""));
        }
        let Some((number, unit)) = number_and_unit(text) else { return Ok(word(text)) };
        let read = self.number(&number)?.parse::<f64>();
        Ok(read.map_or(Cell::Text, |value| finite(value, unit)))
    }

    /// Parses a time: seconds, RFC 3339, or a local time such as `2026-01-05 06:00:10` or `05.01.2026 06:00:10`. `last`
    /// is the time of the previous row. It decides which hour is meant if the hour occurs twice, at the end of summer
    /// time.
    ///
    /// # Errors
    /// Returns a message that says how to write the time.
    pub fn moment(&mut self, text: &str, last: Option<Moment>) -> Result<Moment, String> {
        self.moment_in(TimeUnit::Seconds, text, last)
    }

    /// Parses a time as [`Dialect::moment`] does. A time that is a number is in this unit.
    ///
    /// # Errors
    /// Returns a message that says how to write the time.
    pub fn moment_in(&mut self, unit: TimeUnit, text: &str, last: Option<Moment>) -> Result<Moment, String> {
        let text = text.trim();
        if !text.contains(':') {
            let found = number_and_unit(text);
            let own = found.as_ref().and_then(|(_, unit)| TimeUnit::of(unit));
            let number = match &found {
                Some((number, unit)) if unit.is_empty() || own.is_some() => self.number(number)?.into_owned(),
                _ => text.to_owned(),
            };
            if unit == TimeUnit::Seconds
                && self.zone.is_some()
                && let Some(date) = wall::compact(text)
            {
                return self.wall.in_zone(date, self.zone.as_ref(), last);
            }
            // `60 s` has a unit of its own.
            let unit = own.unwrap_or(unit);
            if unit.of_a_count().is_none()
                && self.zone.is_some()
                && !is_number(&number)
                && let Some(date) = wall::midnight(text, self.dates)
            {
                return self.wall.in_zone(date?, self.zone.as_ref(), last);
            }
            return match unit {
                TimeUnit::ExcelDays => {
                    self.wall.in_zone(wall::excel(&number, text)?, self.zone.as_ref(), last)
                }
                unit => unit.moment(&number),
            };
        }
        if let Some(nanos) = wall::two_parts(text, unit) {
            return self.wall.of_day(nanos, last);
        }
        if let Some(name) = unit.of_a_count() {
            return Err(format!(
                "`{text}` is a date, but the unit of this column is {name}; rename the column to `time`"
            ));
        }
        let read = time::parse(text);
        if read.is_ok() {
            return read;
        }
        let (plain, zone) = match without_utc(text) {
            Some(plain) => (plain, Some(TimeZone::UTC)),
            None => (text, self.zone.clone()),
        };
        match wall::read(plain, self.dates) {
            None => read,
            Some(Ok(wall::Read::Date(_) | wall::Read::Assumed(_))) if zone.is_none() => read,
            Some(found) => match found? {
                wall::Read::Date(wall) => self.wall.in_zone(wall, zone.as_ref(), last),
                wall::Read::Assumed(wall) => {
                    self.wall.follows(wall, plain)?;
                    self.wall.in_zone(wall, zone.as_ref(), last)
                }
                wall::Read::OfDay(nanos) => self.wall.of_day(nanos, last),
            },
        }
    }
}

/// Returns the date and time before the word `UTC`; `None` if no such word follows.
fn without_utc(text: &str) -> Option<&str> {
    let (plain, zone) = text.rsplit_once(' ')?;
    ["utc", "gmt", "z"].iter().any(|word| zone.eq_ignore_ascii_case(word)).then(|| plain.trim_end())
}

fn finite(value: f64, unit: &str) -> Cell<'_> {
    match value {
        value if value.is_finite() => Cell::Number(value, unit),
        value if value.is_nan() => Cell::Absent,
        _ => Cell::Failed,
    }
}

fn is_number(text: &str) -> bool {
    text.parse::<f64>().is_ok()
}

/// Returns whether this sign separates the digits before the decimal mark into groups of three: `1,020`, `12.345.678`.
fn has_groups(text: &str, sign: char) -> bool {
    let mut groups = text.trim_start_matches(['+', '-']).split(sign);
    let is_group = |group: &str, lengths: std::ops::RangeInclusive<usize>| {
        lengths.contains(&group.len()) && group.bytes().all(|byte| byte.is_ascii_digit())
    };
    // `0.123` does not contain thousands.
    let first = groups.next().unwrap_or_default();
    is_group(first, 1..=3) && !first.starts_with('0') && groups.all(|group| is_group(group, 3..=3))
}

/// Rewrites a number that has this decimal mark: with a decimal point, and without separators of thousands.
/// Any other text is returned unchanged. Returns a message if the other mark does not separate groups of
/// three digits.
fn by_mark(text: &str, mark: DecimalMark) -> Result<Cow<'_, str>, String> {
    let (decimal, thousands) = (mark.sign(), mark.other().sign());
    if !text.contains([',', '.']) {
        return Ok(Cow::Borrowed(text));
    }
    let (whole, fraction) =
        text.split_once(decimal).map_or((text, None), |(whole, rest)| (whole, Some(rest)));
    let plain = whole.replace(thousands, "");
    let read = match fraction {
        Some(fraction) => format!("{plain}.{fraction}"),
        None => plain,
    };
    if !is_number(&read) {
        return Ok(Cow::Borrowed(text));
    }
    if whole.contains(thousands) && !has_groups(whole, thousands) {
        let (name, other) = (mark.name(), mark.other().name());
        let hint = match text.matches(thousands).count() == 1 && fraction.is_none() {
            true => format!("; if the {other} is the decimal mark, state --decimal {other}"),
            false => String::new(),
        };
        return Err(format!(
            "`{text}` is not a number with a decimal {name} and groups of three digits{hint}"
        ));
    }
    Ok(Cow::Owned(read))
}

/// Returns the message about an ambiguous number: its comma or point, before three digits, may be a decimal
/// mark or may separate thousands. `whole` and `decimal` are the number in these two readings.
fn two_readings(text: &str, mark: DecimalMark, (whole, decimal): (&str, &str)) -> String {
    let (point, comma) = match mark {
        DecimalMark::Point => (decimal, whole),
        DecimalMark::Comma => (whole, decimal),
    };
    format!(
        "`{text}` can be {whole} or {decimal}: state the decimal mark with --decimal point ({point}) or --decimal comma \
         ({comma})"
    )
}

#[cfg(test)]
mod tests;
