use std::path::Path;
use std::time::Duration;

use super::*;
use isotherm_core::quantity::{DecimalMark, Moment, TimeUnit};

fn read(log: &str, split: &Split) -> Result<Dataset, BadLog> {
    read_used(log, split, &every_column)
}

fn read_used(log: &str, split: &Split, uses: Uses<'_>) -> Result<Dataset, BadLog> {
    let table = csv::from_text(Path::new("day.csv"), log.as_bytes(), split, uses)?;
    Dataset::from_tables(vec![table], split, &|name| (name == "bed").then_some("degC"))
}

#[test]
fn seconds_minutes_and_dates_are_the_same_times() {
    for log in [
        "time,t1\n30,20\n90,21\n",
        "time_s,t1\n30,20\n90,21\n",
        "time_min,t1\n0.5,20\n1.5,21\n",
        "time,t1\n1970-01-01T00:00:30Z,20\n1970-01-01T00:01:30Z,21\n",
    ] {
        let run = read(log, &Split::default()).unwrap().runs.remove(0);
        assert_eq!(run.times, [30, 90].map(|second| Moment::from_nanos(second * 1_000_000_000)), "{log}");
        assert_eq!(run.seconds().collect::<Vec<f64>>(), [0.0, 60.0]);
    }
}

#[test]
fn columns_are_taken_for_what_their_units_names_and_values_say() {
    let log = "time,bed,t01,probe_um,scale_mm,spindle_rpm,door,flow_percent,part\n\
               0,200,20,1.5,-300,900,0,3,A7\n1,210,21,1.6,-299,950,1,4,A7\n";
    let found = read(log, &Split::default()).unwrap();
    let kinds: Vec<(&str, Kind)> =
        found.columns.iter().map(|column| (column.name.as_str(), column.kind)).collect();
    assert_eq!(
        kinds,
        [
            ("bed", Kind::Temperature),
            ("t01", Kind::Temperature),
            ("probe_um", Kind::Displacement),
            ("scale_mm", Kind::Position),
            ("spindle_rpm", Kind::Speed),
            ("door", Kind::Switch),
            ("flow_percent", Kind::Other),
        ]
    );
}

#[test]
fn a_file_is_split_by_a_column_or_a_gap() {
    let log = "time,t1,part\n0,20,A\n60,21,A\n7260,20,B\n7320,22,B\n7380,22,A\n";
    let names = |split: &Split| -> Vec<(String, usize)> {
        let runs = read(log, split).unwrap().runs;
        runs.into_iter().map(|run| (run.name, run.times.len())).collect()
    };
    let owned = |list: &[(&str, usize)]| -> Vec<(String, usize)> {
        list.iter().map(|(name, rows)| ((*name).to_owned(), *rows)).collect()
    };
    assert_eq!(names(&Split::default()), owned(&[("day", 5)]));
    let gap = Split { gap: Some(Duration::from_secs(3600)), ..Split::default() };
    assert_eq!(names(&gap), owned(&[("day 1", 2), ("day 2", 3)]));
    let column = Split { column: Some("part".to_owned()), ..Split::default() };
    assert_eq!(names(&column), owned(&[("day A 1", 2), ("day B", 2), ("day A 3", 1)]));
    let missing = Split { column: Some("cycle".to_owned()), ..Split::default() };
    let reported = read(log, &missing).unwrap_err().to_string();
    assert_eq!(
        reported,
        "day.csv: there is no column cycle, which --run-column names; the columns are t1, part"
    );
}

#[test]
fn missing_cells_are_missing_and_decimal_commas_are_reported() {
    let found = read("time,t1\n0,\n60,NaN\n120,20.5\n", &Split::default()).unwrap();
    assert!(found.runs[0].values[0].at(0).is_nan() && found.runs[0].values[0].at(1).is_nan());
    let reported = read("time,t1\n0,20\n60,\"20,5\"\n", &Split::default()).unwrap_err().to_string();
    assert_eq!(
        reported,
        "day.csv, line 3, column t1: `20,5` has a decimal comma; state --decimal comma, or write 20.5"
    );
    let found = read("time;t1\n0;\n;\n60;20,5\n;\n;\n", &Split::default()).unwrap();
    let values = found.runs[0].values[0].to_vec();
    assert!(values[0].is_nan() && values[1..] == [20.5]);
    let reported = read("t1,t2\n0,20\n", &Split::default()).unwrap_err().to_string();
    assert!(
        reported.contains("line 1: there is no column time") && reported.contains("the columns are t1, t2"),
        "{reported}"
    );
}

#[test]
fn of_a_column_that_nobody_uses_its_name_is_known_and_no_mistake_in_it_is_told() {
    let log = "time,bed,door,spare_c,level,wrong,state,z_cz_um\n\
               0,20,0,19,700,1,idle,0\n60,21,1,19.5,900,broken,runs,0\n";
    let found = read_used(log, &Split::default(), &|name| name == "bed").unwrap();
    let kinds = |columns: &[Column]| -> Vec<(String, Kind)> {
        columns.iter().map(|column| (column.name.clone(), column.kind)).collect()
    };
    // The columns with the active Cz are always read; a text is not among them.
    let owned = |known: &[(&str, Kind)]| -> Vec<(String, Kind)> {
        known.iter().map(|(name, kind)| ((*name).to_owned(), *kind)).collect()
    };
    let used = owned(&[("bed", Kind::Temperature), ("z_cz_um", Kind::Displacement)]);
    assert_eq!(kinds(&found.columns), used);
    let unread = [
        ("door", Kind::Switch),
        ("spare_c", Kind::Temperature),
        ("level", Kind::Other),
        ("wrong", Kind::Switch),
    ];
    assert_eq!(kinds(&found.unread), owned(&unread));
    assert_eq!(found.runs[0].values, [vec![20.0, 21.0], vec![0.0, 0.0]].map(Series::from));
    assert_eq!(found.names(), ["bed", "z_cz_um", "door", "spare_c", "level", "wrong"]);
    let said = read(log, &Split::default()).unwrap_err().to_string();
    assert!(said.contains("line 3, column wrong: `broken` is not a number"), "{said}");
}

#[test]
fn a_log_that_is_read_in_part_is_the_same_in_that_part() {
    use std::fmt::Write;
    let mut log = String::from("time,t1,t2,t3\n");
    (0..5000).for_each(|row| writeln!(log, "{row},{},{}.5,20", row % 30, row % 7).unwrap());
    let (part, all) = (
        read_used(&log, &Split::default(), &|name| name == "t2").unwrap(),
        read(&log, &Split::default()).unwrap(),
    );
    assert_eq!(part.columns, all.columns[1..2]);
    assert_eq!(part.runs[0].values[0], all.runs[0].values[1]);
    assert_eq!(part.runs[0].times, all.runs[0].times);
    assert_eq!(part.unread, [all.columns[0].clone(), all.columns[2].clone()]);
}

#[test]
fn files_of_one_name_are_runs_of_different_names() {
    let tables = ["a", "b", "c"].map(|folder| {
        let path = Path::new(folder).join("day.csv");
        csv::from_text(&path, "time,t1\n0,20\n60,21\n".as_bytes(), &Split::default(), &every_column).unwrap()
    });
    let dataset = Dataset::from_tables(tables.into(), &Split::default(), &|_| None).unwrap();
    let names: Vec<&str> = dataset.runs.iter().map(|run| run.name.as_str()).collect();
    assert_eq!(names, ["day", "day (2)", "day (3)"]);
}

fn first_column(log: &str) -> Vec<f64> {
    let mut found = read(log, &Split::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
    found.runs.remove(0).values.remove(0).to_vec()
}

#[test]
fn cells_of_loggers_are_numbers() {
    for log in [
        "time,bed\n0,+   20.5\n60,-  1.0\n",
        "time,bed\n0,20.5 °C\n60,-1 °C\n",
        "time,bed [°C]\n0,20.5\n60,-1\n",
        "time,bed\n0,2.05D+01\n60,-1.0D+00\n",
        "Zeit;bed\n0;20,5 °C\n60;-1,0 °C\n",
        "time;bed;\n0;20,5;\n60;-1\n",
        "time,bed\n0,20.5,\n60,-1,\n",
        "Logger 34970A\nSerial: 1234\nTime,bed\ns,°C\n0,20.5\n60,-1\n",
        "time,bed [°F]\n0,68.9\n60,30.2\n",
        "Date,Time,bed\n05.01.2026,06:00:00,20.5\n05.01.2026,06:01:00,-1\n",
        "time_h,bed\n0,20.5\n0.5,-1\n",
        "# time,bed\n0,20.5\n60,-1\n",
        "Elapsed Time (min),bed\n0,20.5\n1,-1\n",
        "Time (UTC);bed\n05.01.2026;20,5\n05.01.2026 00:01:00;-1\n",
    ] {
        let split = Split { zone: Some(jiff::tz::TimeZone::UTC), ..Split::default() };
        let found = read(log, &split).unwrap_or_else(|wrong| panic!("{log}: {wrong}"));
        let bed = found.columns.iter().position(|column| column.name == "bed").unwrap();
        let values = found.runs[0].values[bed].to_vec();
        assert!((values[0] - 20.5).abs() < 1e-9 && (values[1] + 1.0).abs() < 1e-9, "{log}: {values:?}");
    }
}

#[test]
fn a_number_or_a_time_with_two_readings_is_refused_with_the_option() {
    for (log, says) in [
        (
            "time,bed\n0,20\n\"1,020\",21\n",
            "`1,020` can be 1020 or 1.020: state the decimal mark with --decimal",
        ),
        ("time,bed\n0,20\n60,68 °F\n", "`°F` follows this number, but not the numbers before"),
        ("time,bed\n0,20 °C\n60,68 °F\n", "the column is in °C"),
    ] {
        let said = read(log, &Split::default()).unwrap_err().to_string();
        assert!(said.contains(says) && said.contains("line 3"), "{said}");
    }
    let stated = Split { decimal: Some(DecimalMark::Point), ..Split::default() };
    let run = read("time,bed\n0,20\n\"1,020\",21\n", &stated).unwrap().runs.remove(0);
    assert_eq!(run.lasts(), Duration::from_secs(1020));
    let hours = Split { time_unit: Some(TimeUnit::Hours), ..Split::default() };
    assert_eq!(read("time,bed\n0,20\n0.2,21\n", &hours).unwrap().runs[0].lasts(), Duration::from_secs(720));
}

/// Log of 100 minutes. The function changes a cell of the error column.
fn log_of_error(change: impl Fn(u32) -> Option<&'static str>) -> String {
    let row = |row: u32| {
        let error = 10.0 + 0.1 * f64::from(row);
        let cell = change(row).map_or_else(|| error.to_string(), str::to_owned);
        format!("{},{cell},{}\n", 60 * row, 20.0 + 0.03 * f64::from(row))
    };
    format!("time,z_error_um,bed\n{}", (0..100).map(row).collect::<String>())
}

#[test]
fn values_that_no_sensor_measured_are_left_out_with_file_line_and_value() {
    for (word, shown) in
        [("9.9E+37", "9.9e37"), ("0", "0"), ("-9999", "-9999"), ("OL", "OL"), ("1.#QNAN", "1.#QNAN")]
    {
        let found =
            read(&log_of_error(|row| (row == 40 || row == 41).then_some(word)), &Split::default()).unwrap();
        let values = found.runs[0].values[0].to_vec();
        assert!(values[40].is_nan() && values[41].is_nan() && values[42].is_finite(), "{word}");
        let remark = found.remarks.join("; ");
        let expected = format!(
            "day.csv, line 42, column z_error_um: `{shown}` is not a measured value, also in line 43"
        );
        assert!(remark.contains(&expected), "{remark}");
        assert!(found.implausible.is_empty(), "{:?}", found.implausible);
    }
    for word in ["9.9E+37", "OL", "---"] {
        let many = read(&log_of_error(|row| (row % 10 == 5).then_some(word)), &Split::default()).unwrap();
        assert_eq!(many.implausible.len(), 1, "{word}");
        assert!(
            many.implausible[0].message.contains("more than 5 % of the values"),
            "{:?}",
            many.implausible
        );
    }
    assert_eq!(read(&log_of_error(|_| None), &Split::default()).unwrap().remarks, Vec::<String>::new());
}

#[test]
fn words_for_missing_values_are_named_and_any_number_of_them_is_a_gap() {
    for word in ["n/a", "#N/A", "#NV", "-", "missing", "k.A."] {
        let found = read(&log_of_error(|row| (row % 10 == 5).then_some(word)), &Split::default()).unwrap();
        let values = found.runs[0].values[0].to_vec();
        assert!(values[5].is_nan() && values[6].is_finite() && values[95].is_nan(), "{word}");
        assert!(found.implausible.is_empty(), "{:?}", found.implausible);
        let expected = format!(
            "day.csv, line 7, column z_error_um: `{word}` is not a measured value, also in line 17, 27, 37, 47, 57 and 4 more: \
             left out"
        );
        assert_eq!(found.remarks, [expected]);
    }
    for word in ["", "NaN", "null"] {
        let found = read(&log_of_error(|row| (row % 10 == 5).then_some(word)), &Split::default()).unwrap();
        assert_eq!(found.remarks, Vec::<String>::new(), "{word}");
    }
}

#[test]
fn the_remark_about_a_run_has_the_first_word_of_that_run() {
    let log = log_of_error(|row| match row {
        10 => Some("n/a"),
        60 => Some("Over"),
        61 => Some("OL"),
        _ => None,
    });
    // The second run begins two hours later.
    let late = |line: &str| match line.split_once(',') {
        Some((time, rest)) if time.parse::<u32>().is_ok_and(|time| time >= 3000) => {
            format!("{},{rest}\n", time.parse::<u32>().unwrap() + 7200)
        }
        _ => format!("{line}\n"),
    };
    let log: String = log.lines().map(late).collect();
    let split = Split { gap: Some(Duration::from_secs(3600)), ..Split::default() };
    let found = read(&log, &split).unwrap();
    assert_eq!(found.runs.len(), 2);
    let said = found.remarks.join("; ");
    assert!(
        said.contains("line 12, column z_error_um: `n/a`")
            && said.contains("line 62, column z_error_um: `Over`"),
        "{said}"
    );
}

#[test]
fn a_column_of_messages_only_is_named_with_the_first_of_them() {
    let found = read("time,bed,air\n0,,20\n60,OL,21\n", &Split::default()).unwrap();
    assert_eq!(
        found.lost[0].message,
        "day.csv, line 3: `OL` is not a measured value, and no line of this column has a value"
    );
}

#[test]
fn an_overload_of_a_temperature_is_bridged_and_the_column_stays_a_temperature() {
    let log = log_of_error(|_| None).replace("\n2400,14,21.2\n", "\n2400,14,+9.9E+37\n");
    let found = read_used(&log, &Split::default(), &every_column).unwrap();
    assert!(log.contains("9.9E+37"), "{log}");
    assert!((found.runs[0].values[1].at(40) - 21.2).abs() < 1e-9, "{:?}", found.runs[0].values[1].at(40));
    assert!(found.remarks.join("; ").contains("filled by linear interpolation"), "{:?}", found.remarks);
    let values = [[20.0; 60].as_slice(), &[9.9e37]].concat();
    assert_eq!(Kind::guess("spindle", None, values.into_iter()), Kind::Temperature);
    let many = [[20.0; 60].as_slice(), &[9.9e37; 20]].concat();
    assert_eq!(Kind::guess("spindle", None, many.into_iter()), Kind::Temperature);
    let speeds = [[0.0; 60].as_slice(), &[1000.0; 20]].concat();
    assert_eq!(Kind::guess("spindle", None, speeds.into_iter()), Kind::Other);
    let speeds = [0.0, 1000.0, 1200.0];
    assert_eq!(Kind::guess("spindle", None, speeds.into_iter()), Kind::Other);
}

#[test]
fn a_column_without_numbers_is_named_with_its_first_cell() {
    let found = read("time,bed,air\n0,cold,20\n60,warm,21\n", &Split::default()).unwrap();
    assert_eq!(found.lost.len(), 1);
    assert_eq!(found.lost[0].column, "bed");
    assert_eq!(found.lost[0].message, "day.csv, line 2: `cold` is not a number");
    assert!(
        found.remarks.join("; ").contains("bed (day.csv, line 2: `cold` is not a number)"),
        "{:?}",
        found.remarks
    );
}

#[test]
fn each_column_that_is_not_used_is_listed_with_the_reason() {
    let log = "time,bed,part,humidity,spare_c\n0,20,A,45,20\n60,21,B,46,21\n";
    let found = read_used(log, &Split::default(), &|name| ["bed", "part"].contains(&name)).unwrap();
    let unused = found.unused(&|column| column.name == "bed");
    let names: Vec<&str> = unused.iter().map(|column| column.name.as_str()).collect();
    assert_eq!(names, ["humidity", "spare_c", "part"]);
    assert!(unused[0].why.contains("its unit, name and values do not show"), "{unused:?}");
    assert_eq!(unused[1].why, "temperature, but this command did not select it");
    assert_eq!(unused[2].why, "day.csv, line 2: `A` is not a number");
}

#[test]
fn a_column_whose_unit_is_not_that_of_the_profile_is_refused() {
    for (unit, says) in [("V", true), ("%", true), ("µm", true), ("°C", false), ("K", false), ("°F", false)]
    {
        let found = read(&format!("time,bed [{unit}]\n0,300\n60,301\n"), &Split::default()).unwrap();
        assert_eq!(found.implausible.len(), usize::from(says), "{unit}: {:?}", found.implausible);
    }
}

#[test]
fn a_wrong_time_in_every_row_is_one_mistake() {
    let said = read("time,bed\n01/05/2026 06:00:00,20\n01/05/2026 06:01:00,21\n", &Split::default());
    let BadLog(said) = said.unwrap_err();
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].contains("--dates") && said[0].ends_with("(also in 1 more line)"), "{said:?}");
}

#[test]
fn the_cells_of_comments_may_be_missing_at_the_end_of_a_row() {
    let found = read("X_Value\tbed\tComment\n0\t20\n60\t21\tdoor open\n", &Split::default()).unwrap();
    assert_eq!(found.column("bed").map(|place| found.runs[0].values[place].to_vec()), Some(vec![20.0, 21.0]));
    assert!(read("time\tbed\tair\n0\t20\n", &Split::default()).is_err());
}

#[test]
fn dates_under_an_empty_first_name_are_the_time() {
    let split = Split { zone: Some(jiff::tz::TimeZone::UTC), ..Split::default() };
    let found = read(",bed\n2026-01-05 06:00:00,20\n2026-01-05 06:01:00,21\n", &split).unwrap();
    assert_eq!(found.runs[0].values, [Series::from(vec![20.0, 21.0])]);
    assert_eq!(found.runs[0].lasts(), Duration::from_secs(60));
    let said = read(",bed\n0,20\n1,21\n", &split).unwrap_err().to_string();
    assert!(said.contains("there is no column time"), "{said}");
}

#[test]
fn other_quantities_are_no_temperatures() {
    let log = "time,bed,humidity,oil_pressure,air [%],temp_of_pressure_valve\n0,20,45,39,45,30\n60,20,46,40,46,31\n";
    let kinds: Vec<Kind> =
        read(log, &Split::default()).unwrap().columns.iter().map(|column| column.kind).collect();
    assert_eq!(kinds, [Kind::Temperature, Kind::Other, Kind::Other, Kind::Other, Kind::Temperature]);
    // Their values are those of temperatures.
    for header in [
        "CO2 [ppm]",
        "Torque (Nm)",
        "Salt [µS/cm]",
        "Level [dB]",
        "Light [lux]",
        "Weight [kg]",
        "Energy [kWh]",
        "P1 [MPa]",
        "Freq [kHz]",
        "Strain [µm/m]",
        "Coil [Ω]",
        "Wind [km/h]",
        "accel [g]",
        "Luftdruck",
        "Öldruck",
        "Scan",
        "No.",
        "pH",
        "Füllstand",
    ] {
        let found = read(&format!("time,{header}\n0,20.5\n60,21\n"), &Split::default()).unwrap();
        assert_eq!(found.columns[0].kind, Kind::Other, "{header}");
    }
    for header in ["coolant in", "bed (front)", "Kanal 1", "bearing A", "part"] {
        let found = read(&format!("time,{header}\n0,20.5\n60,21\n"), &Split::default()).unwrap();
        assert_eq!(found.columns[0].kind, Kind::Temperature, "{header}");
    }
}

#[test]
fn a_copy_of_a_run_is_named() {
    let tables = ["day1", "day1 - Copy"].map(|name| {
        let path = Path::new(name).with_extension("csv");
        csv::from_text(&path, log_of_error(|_| None).as_bytes(), &Split::default(), &every_column).unwrap()
    });
    let dataset = Dataset::from_tables(tables.into(), &Split::default(), &|_| None).unwrap();
    assert_eq!(dataset.repeats.len(), 1, "{:?}", dataset.repeats);
    assert!(
        dataset.repeats[0].contains("contains the same rows as day1 (day1.csv)"),
        "{:?}",
        dataset.repeats
    );
}

#[test]
fn a_thousand_is_read_where_the_file_shows_it() {
    assert_eq!(first_column("time;bed\n0;1.234,5\n60;1.235\n"), [1234.5, 1235.0]);
    assert_eq!(first_column("time,bed\n0,\"1,234.5\"\n60,\"1,235\"\n"), [1234.5, 1235.0]);
}

#[cfg(feature = "parquet")]
mod of_parquet {
    use std::fs::File;
    use std::path::PathBuf;
    use std::sync::Arc;

    use ::parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType};
    use ::parquet::file::properties::WriterProperties;
    use ::parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
    use ::parquet::schema::parser::parse_message_type;

    use super::*;

    type Rows<'a> = SerializedRowGroupWriter<'a, File>;

    /// Writes a file with these columns, which `write` fills in their order.
    fn file(columns: &str, write: impl FnOnce(&mut Rows<'_>)) -> (tempfile::TempDir, PathBuf) {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.parquet");
        let schema = Arc::new(parse_message_type(&format!("message log {{ {columns} }}")).unwrap());
        let properties = Arc::new(WriterProperties::builder().build());
        let mut writer = SerializedFileWriter::new(File::create(&path).unwrap(), schema, properties).unwrap();
        let mut rows = writer.next_row_group().unwrap();
        write(&mut rows);
        rows.close().unwrap();
        writer.close().unwrap();
        (directory, path)
    }

    /// Writes the next column; `there` is 0 for a missing value.
    fn column<T: DataType>(rows: &mut Rows<'_>, values: &[T::T], there: Option<&[i16]>) {
        let mut column = rows.next_column().unwrap().unwrap();
        column.typed::<T>().write_batch(values, there, None).unwrap();
        column.close().unwrap();
    }

    #[test]
    fn parquet_is_read_like_csv() {
        let columns = "required double time; optional double t1; required binary part (UTF8);";
        let (_directory, path) = file(columns, |rows| {
            column::<DoubleType>(rows, &[0.5, 60.25, 120.0], None);
            column::<DoubleType>(rows, &[20.125, 21.1], Some(&[1, 0, 1]));
            column::<ByteArrayType>(rows, &["A", "A", "B"].map(ByteArray::from), None);
        });
        let split = Split { column: Some("part".to_owned()), ..Split::default() };
        let found = Dataset::read(&[path], &split, &|_| None, &every_column).unwrap();
        let csv = read("time,t1,part\n0.5,20.125,A\n60.25,,A\n120,21.1,B\n", &split).unwrap();
        assert_eq!(found.columns, csv.columns);
        for (one, other) in found.runs.iter().zip(&csv.runs) {
            assert_eq!((&one.name, &one.times), (&other.name, &other.times));
            assert_eq!(format!("{:?}", one.values), format!("{:?}", other.values));
        }
    }

    #[test]
    fn a_column_of_parquet_that_nobody_uses_is_not_read_through() {
        let columns =
            "required double time; required double t1; required double t2; required binary part (UTF8);";
        let rows = 20_000;
        let (_directory, path) = file(columns, |group| {
            let times: Vec<f64> = (0..rows).map(f64::from).collect();
            column::<DoubleType>(group, &times, None);
            column::<DoubleType>(group, &times.iter().map(|time| time / 1000.0).collect::<Vec<f64>>(), None);
            column::<DoubleType>(group, &vec![20.0; times.len()], None);
            column::<ByteArrayType>(group, &vec![ByteArray::from("A"); times.len()], None);
        });
        let found = Dataset::read(&[path], &Split::default(), &|_| None, &|name| name == "t1").unwrap();
        assert_eq!(found.names(), ["t1", "t2"]);
        assert_eq!(found.unread, [Column { name: "t2".to_owned(), kind: Kind::Temperature }]);
        assert_eq!(found.runs[0].values, [(0..rows).map(|row| f64::from(row) / 1000.0).collect::<Series>()]);
    }

    /// Writes a file with the column `time` of this type, in nanoseconds, and the column `t1`. An empty row group
    /// precedes the rows.
    fn stamps(time: &str) -> (tempfile::TempDir, PathBuf) {
        use ::parquet::data_type::Int64Type;
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("day.parquet");
        let schema = format!("message log {{ required int64 time ({time}); required double t1; }}");
        let schema = Arc::new(parse_message_type(&schema).unwrap());
        let properties = Arc::new(WriterProperties::builder().build());
        let mut writer = SerializedFileWriter::new(File::create(&path).unwrap(), schema, properties).unwrap();
        let times = [1_773_036_000_000_000_000, 1_773_036_060_000_000_000];
        for (times, values) in [(&[][..], &[][..]), (&times[..], &[20.0, 21.0][..])] {
            let mut rows = writer.next_row_group().unwrap();
            column::<Int64Type>(&mut rows, times, None);
            column::<DoubleType>(&mut rows, values, None);
            rows.close().unwrap();
        }
        writer.close().unwrap();
        (directory, path)
    }

    #[test]
    fn time_stamps_in_nanoseconds_are_read_in_utc_or_by_the_clock_on_the_wall() {
        let split = Split { zone: jiff::tz::TimeZone::get("Europe/Berlin").ok(), ..Split::default() };
        for (time, first, form) in [
            ("TIMESTAMP(NANOS,true)", 1_773_036_000_000_000_000, "time: time stamps in UTC\n"),
            ("TIMESTAMP(NANOS,false)", 1_773_032_400_000_000_000, "time: time stamps without a zone;"),
        ] {
            let (_directory, path) = stamps(time);
            let explained = explain(&path, &split).unwrap().to_string();
            assert!(explained.contains(form), "{explained}");
            let found = Dataset::read(&[path], &split, &|_| None, &every_column).unwrap();
            assert_eq!(found.runs[0].times[0], Moment::from_nanos(first), "{time}");
            assert_eq!(
                found.runs[0].values,
                [Series::from(vec![20.0, 21.0])],
                "the empty row group is passed over"
            );
        }
    }

    #[test]
    fn a_date_and_a_time_of_the_day_are_one_time() {
        use ::parquet::data_type::{Int32Type, Int64Type};
        let columns =
            "required int32 Date (DATE); required int64 Time (TIME(NANOS,false)); required double bed;";
        let (_directory, path) = file(columns, |rows| {
            column::<Int32Type>(rows, &[20_521, 20_522], None);
            column::<Int64Type>(rows, &[86_340_000_000_000, 0], None);
            column::<DoubleType>(rows, &[20.0, 21.0], None);
        });
        let split = Split { zone: Some(jiff::tz::TimeZone::UTC), ..Split::default() };
        let found = Dataset::read(&[path], &split, &|_| None, &every_column).unwrap();
        let minutes = [1_773_100_740, 1_773_100_800].map(|second| Moment::from_nanos(second * 1_000_000_000));
        assert_eq!(found.runs[0].times, minutes);
    }

    #[test]
    fn a_nested_column_is_named() {
        let columns = "required double time; required double t1; required group list { required double x; }";
        let (_directory, path) = file(columns, |rows| {
            column::<DoubleType>(rows, &[0.0, 60.0], None);
            column::<DoubleType>(rows, &[20.0, 21.0], None);
            column::<DoubleType>(rows, &[1.0, 2.0], None);
        });
        let found = Dataset::read(&[path], &Split::default(), &|_| None, &every_column).unwrap();
        assert!(
            found.remarks.join("; ").contains("the values of this column are nested"),
            "{:?}",
            found.remarks
        );
    }

    #[test]
    fn what_is_wrong_in_parquet_is_named_by_its_row() {
        let (_directory, path) = file("required binary time (UTF8); required binary t1 (UTF8);", |rows| {
            column::<ByteArrayType>(rows, &["0", "later", "120", "180"].map(ByteArray::from), None);
            column::<ByteArrayType>(rows, &["20", "21", "22,5", "23"].map(ByteArray::from), None);
        });
        let said =
            Dataset::read(&[path], &Split::default(), &|_| None, &every_column).unwrap_err().to_string();
        assert!(said.contains("day.parquet, row 2, column time: `later`"), "{said}");
        assert!(
            said.contains("day.parquet, row 3, column t1: `22,5` has a decimal comma; state --decimal comma, or write 22.5"),
            "{said}"
        );
        assert!(!said.contains("line"), "{said}");
    }
}
