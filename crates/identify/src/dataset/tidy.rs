//! Reader of logs in long format, in which each row has the time, the name of a sensor, and its value. Such a log
//! becomes a table with one column for each sensor.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use super::csv::{MOST_COLUMNS, check_header, fits, message, own_line, uneven_row};
use super::head::{self, Head};
use super::table::{Reader, Table, TooMuch};
use super::{BadLog, Split, Uses};
use isotherm_core::quantity::{Dialect, TimeColumns, name_and_unit, with_date};
use isotherm_profile::safe_file::{Lines, quoted};

/// Maximum number of values of a log in long format. The values are kept as texts until the names of all sensors are
/// known.
const MOST_VALUES: usize = 5_000_000;

/// Possible names of the column that contains the sensor names.
const SENSORS: [&str; 16] = [
    "sensor",
    "sensors",
    "sensor_id",
    "sensor_name",
    "signal",
    "channel",
    "variable",
    "tag",
    "tagname",
    "point",
    "parameter",
    "kanal",
    "messstelle",
    "sensorname",
    "measurement",
    "_field",
];
/// Possible names of the column that contains the values.
const VALUES: [&str; 6] = ["value", "values", "wert", "messwert", "reading", "_value"];
/// Possible names of the column that contains the units.
const UNITS: [&str; 4] = ["unit", "units", "einheit", "uom"];

/// Indices of the columns of a log in long format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tidy {
    times: TimeColumns,
    sensor: usize,
    value: usize,
    unit: Option<usize>,
}

impl Tidy {
    /// Finds the columns of a log in long format; `None` if the log has another format. If the column with the sensor
    /// names is the column that divides the log into runs, the result is also `None`.
    pub(super) fn find(names: &[String], split: &Split) -> Option<Tidy> {
        let place = |known: &[&str]| {
            names.iter().position(|name| known.contains(&name_and_unit(name).0.to_lowercase().as_str()))
        };
        let (sensor, value) = (place(&SENSORS)?, place(&VALUES)?);
        let divides_runs = split.column.as_ref().is_some_and(|column| *column == names[sensor]);
        let times = TimeColumns::find(names, split.time_unit)?;
        (!divides_runs).then(|| Tidy { times, sensor, value, unit: place(&UNITS) })
    }

    /// Reads the rows of a log in long format, below the line with the column names.
    pub(super) fn read<R: Read>(
        self,
        (file, names, head): (&Path, &[String], &Head),
        reader: &mut csv::Reader<Lines<R>>,
        dialect: Dialect,
        (split, uses): (&Split, Uses<'_>),
    ) -> Result<Table, BadLog> {
        let refused =
            |line: u64, why: String| BadLog(vec![format!("{}, line {line}: {why}", file.display())]);
        let separator = dialect.separator();
        let mut long = Long::default();
        let mut record = csv::StringRecord::new();
        loop {
            match reader.read_record(&mut record) {
                Ok(true) => {}
                Ok(false) => break,
                Err(why) => {
                    let line = why.position().map_or_else(|| reader.position().line(), csv::Position::line);
                    return Err(refused(line + head.skipped, message(&why)));
                }
            }
            let own_line = own_line(reader, &record);
            reader.get_mut().row_is_over();
            if own_line <= 1 + head.after || record.iter().all(|cell| cell.trim().is_empty()) {
                continue;
            }
            let line = own_line + head.skipped;
            let unnamed = names.iter().rev().take_while(|name| name.is_empty()).count();
            if !fits(&record, names.len(), unnamed) {
                return Err(refused(line, uneven_row((record.len(), names.len()), separator, "")));
            }
            let cell = |place: usize| record.get(place).unwrap_or_default().trim();
            let time = with_date(cell(self.times.time), self.times.date.map(cell));
            let unit = self.unit.map(cell).unwrap_or_default();
            let added = long.push((line, &*time), (cell(self.sensor), unit), cell(self.value));
            added.map_err(|why| refused(line, why))?;
        }
        long.sort().map_err(|(line, why)| refused(line, why))?;
        let time = names.get(self.times.time).cloned().unwrap_or_default();
        let wide: Vec<String> = std::iter::once(time).chain(long.headers.iter().cloned()).collect();
        check_header(&wide).map_err(|why| refused(1 + head.skipped, why))?;
        let by = split.column.as_deref();
        let rows = Reader::new(file, wide, ("line", dialect), (by, split.time_unit), uses);
        let mut rows = rows.ok_or_else(|| refused(1 + head.skipped, "there is no column time".to_owned()))?;
        let dated = self.times.date.unwrap_or(self.times.time);
        rows.learn(head.rows.iter().map(|line| {
            let cells = head::cells(line, separator);
            [dated, self.value].map(|place| cells.get(place).copied().unwrap_or_default()).to_vec()
        }));
        for row in &long.rows {
            match rows.begin(row.line, &row.time) {
                Ok(true) => {}
                Ok(false) => continue,
                Err(TooMuch) => break,
            }
            for place in 1..=long.headers.len() {
                if rows.reads(place) {
                    let found = row.cells.binary_search_by_key(&place, |cell| cell.place).ok();
                    let (line, text) = found.map_or((row.line, ""), |found| {
                        let Value { line, text, .. } = &row.cells[found];
                        (*line, &**text)
                    });
                    rows.text(place, line, text);
                }
            }
        }
        rows.finish((2 + head.skipped + head.after, "there are no rows under the header"))
    }
}

/// Rows of a log in long format. All values with the same time are in one row.
#[derive(Debug, Default)]
struct Long {
    /// Names of the sensors with their units, in the order of their first occurrence.
    headers: Vec<String>,
    /// Index of the table column of each sensor. The key is the name of the sensor. The first name in
    /// `headers` has the column 1.
    places: HashMap<String, usize>,
    rows: Vec<Row>,
    by_time: HashMap<Box<str>, usize>,
    values: usize,
}

#[derive(Debug)]
struct Row {
    line: u64,
    time: Box<str>,
    cells: Vec<Value>,
}

#[derive(Debug)]
struct Value {
    place: usize,
    line: u64,
    text: Box<str>,
}

impl Long {
    fn push(
        &mut self,
        (line, time): (u64, &str),
        (sensor, unit): (&str, &str),
        text: &str,
    ) -> Result<(), String> {
        let place = match self.places.get(sensor) {
            Some(place) => *place,
            None if sensor.is_empty() => return Err("the name of the sensor is missing".to_owned()),
            None if self.headers.len() + 1 >= MOST_COLUMNS => {
                return Err(format!("more than {MOST_COLUMNS} sensor names: check the sensor column"));
            }
            None => {
                let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
                self.headers.push(format!("{sensor}{unit}"));
                self.places.insert(sensor.to_owned(), self.headers.len());
                self.headers.len()
            }
        };
        self.values += 1;
        if self.values > MOST_VALUES {
            return Err(format!(
                "the log has one row for each value, and more than {} million values: write one column for \
                 each sensor instead",
                MOST_VALUES / 1_000_000
            ));
        }
        let row = match self.by_time.get(time) {
            Some(row) => *row,
            None => {
                self.by_time.insert(time.into(), self.rows.len());
                self.rows.push(Row { line, time: time.into(), cells: Vec::new() });
                self.rows.len() - 1
            }
        };
        self.rows[row].cells.push(Value { place, line, text: text.into() });
        Ok(())
    }

    /// Sorts the cells of each row by their columns. If a sensor has two values at one time, returns the line of the
    /// second value and a message.
    fn sort(&mut self) -> Result<(), (u64, String)> {
        for row in &mut self.rows {
            row.cells.sort_by_key(|cell| (cell.place, cell.line));
            if let Some(pair) = row.cells.windows(2).find(|pair| pair[0].place == pair[1].place) {
                let sensor = self.headers.get(pair[1].place - 1).map_or("", String::as_str);
                let why = format!("{} has a second value at the time {}", quoted(sensor), quoted(&row.time));
                return Err((pair[1].line, why));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::csv::from_text;
    use super::super::every_column;
    use super::*;

    fn read(log: &str) -> Result<Table, BadLog> {
        from_text(Path::new("day.csv"), log.as_bytes(), &Split::default(), &every_column)
    }

    #[test]
    fn a_long_log_is_read_as_one_with_a_column_for_each_sensor() {
        let wide = read("time,bed,air\n0,20,19\n60,21,\n120,22,19.5\n").unwrap();
        for log in [
            "time,sensor,value\n0,bed,20\n0,air,19\n60,bed,21\n120,bed,22\n120,air,19.5\n",
            "Zeit;Messstelle;Wert\n0;bed;20\n60;bed;21\n120;bed;22\n0;air;19\n120;air;19,5\n",
            "Logger\ntime,sensor,value,unit\n0,bed,20,degC\n0,air,19,degC\n60,bed,21,degC\n120,bed,22,degC\n120,air,19.5,degC\n",
        ] {
            let long = read(log).unwrap_or_else(|why| panic!("{log}: {why}"));
            assert_eq!(long.times, wide.times, "{log}");
            for name in ["bed", "air"] {
                let [long, wide] = [&long, &wide].map(|table| format!("{:?}", table.numbers(name)));
                assert_eq!(long, wide, "{log}");
            }
        }
    }

    #[test]
    fn mistakes_of_a_long_log_are_named_with_their_line() {
        for (log, says) in [
            ("time,sensor,value\n0,bed,20\n0,bed,21\n", "line 3: bed has a second value at the time 0"),
            ("time,sensor,value\n0,bed,20,5\n", "line 2: this row has 4 cells, but there are 3 column names"),
            ("time,sensor,value\n0,bed,20\n60,,21\n", "line 3: the name of the sensor is missing"),
            ("time,sensor,value\n0,bed,20\n60,bed,oops\n", "line 3, column bed: `oops` is not a number"),
            ("time,sensor,value\nnoon,bed,20\n", "line 2, column time: `noon` is not a time"),
            ("time,sensor,value\n", "there are no rows under the header"),
        ] {
            let said = read(log).unwrap_err().to_string();
            assert!(said.contains(says), "{said}");
        }
        let by = Split { column: Some("sensor".to_owned()), ..Split::default() };
        let log = "time,sensor,value\n0,bed,20\n60,air,21\n";
        let found = from_text(Path::new("day.csv"), log.as_bytes(), &by, &every_column).unwrap();
        assert!(found.numbers("value").is_some(), "the column divides runs");
    }
}
