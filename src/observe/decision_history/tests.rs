use super::*;
use std::fmt::Write as _;
use std::time::Duration;

fn at(second: u64) -> Moment {
    Moment::default().after(Duration::from_secs(1_800_000_000 + second))
}

fn question(from: u64, to: u64, columns: &[&str]) -> Question {
    let column = |name: &&str| Column { name: (*name).to_owned(), unit: "degC" };
    Question { from: at(from), to: at(to), columns: columns.iter().map(column).collect() }
}

/// Writes a log with a row for each second. `bed` counts seconds, and `peak` is 99 in one row.
fn log(directory: &Path, name: &str, seconds: std::ops::Range<u64>, peak: u64) -> PathBuf {
    let mut text = "time,bed,peak,z_cz_um,z_state\n".to_owned();
    for second in seconds {
        let value = if second == peak { "99" } else { "" };
        writeln!(text, "{},{second},{value},-1.5,active", at(second)).unwrap();
    }
    let path = directory.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn no_peak_is_lost_however_few_points_there_are_and_a_gap_is_a_gap() {
    let home = tempfile::tempdir().unwrap();
    // By name, the second file of the day comes before the first.
    let logs = [log(home.path(), "m.2.csv", 40_000..50_000, 0), log(home.path(), "m.csv", 0..30_000, 12_345)];
    let found = course(&logs, &question(0, 50_000, &["bed", "peak", "none"]), 50, &|| true).unwrap();
    assert_eq!(found.rows, 40_000);
    let [bed, peak, none] = found.columns.as_slice() else { panic!("{found:?}") };
    let peaks: Vec<f64> = peak.max.iter().copied().filter(|value| !value.is_nan()).collect();
    assert_eq!(peaks, [99.0]);
    assert!(none.min.iter().all(|value| value.is_nan()));
    assert_eq!((bed.min[0], bed.max[0], bed.max[40]), (0.0, 999.0, 49_999.0));
    assert!(found.time.is_sorted() && found.time.len() == 41, "{:?}", found.time);
    let gap: Vec<f64> =
        (found.time.iter().zip(&bed.min)).filter(|(_, bed)| bed.is_nan()).map(|(at, _)| *at).collect();
    assert!(matches!(gap.as_slice(), [one] if (*one - 1_800_035_000.0).abs() < 10.0), "{gap:?}");
}

#[test]
fn of_a_short_span_every_row_is_there_with_its_own_time() {
    let home = tempfile::tempdir().unwrap();
    let logs = [log(home.path(), "m.csv", 0..40_000, 0)];
    let found = course(&logs, &question(39_000, 39_009, &["bed"]), 1000, &|| true).unwrap();
    assert_eq!(found.columns[0].min, (39_000..39_010).map(f64::from).collect::<Vec<_>>());
    assert_eq!((found.time[0], found.rows), (1_800_039_000.0, 10));
    let nothing = course(&logs, &question(50_000, 60_000, &["bed"]), 10, &|| true).unwrap();
    assert_eq!((nothing.time.len(), nothing.rows), (0, 0));
}

#[test]
fn a_row_that_is_half_written_a_log_that_is_gone_and_one_that_is_none_are_left_out() {
    let home = tempfile::tempdir().unwrap();
    let path = log(home.path(), "m.csv", 0..10, 0);
    let whole = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, format!("{whole}{},1", at(10))).unwrap();
    let none = home.path().join("none.csv");
    std::fs::write(&none, [0xff, 0, 10, 13, 200]).unwrap();
    let logs = [home.path().join("gone.csv"), none, home.path().to_owned(), path];
    let found = course(&logs, &question(0, 20, &["bed"]), 100, &|| true).unwrap();
    assert_eq!(found.columns[0].max.last(), Some(&9.0));
    let stopped = course(&logs, &question(0, 20, &["bed"]), 100, &|| false).unwrap_err();
    assert_eq!(stopped.kind(), io::ErrorKind::Interrupted);
}

#[test]
fn a_download_has_the_rows_as_they_stand_in_the_order_of_time() {
    let home = tempfile::tempdir().unwrap();
    let logs = [log(home.path(), "m.2.csv", 5000..9000, 0), log(home.path(), "m.csv", 0..4000, 3999)];
    let mut text = Vec::new();
    let mut pieces = 0;
    download(&logs, &question(3998, 8000, &["z_cz_um", "peak"]), &mut |piece| {
        text.extend(piece);
        pieces += 1;
        true
    })
    .unwrap();
    let text = String::from_utf8(text).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let (first, second) = (format!("{},-1.5,", at(3998)), format!("{},-1.5,99", at(3999)));
    assert_eq!(lines[..3], ["time,z_cz_um,peak", first.as_str(), second.as_str()]);
    assert_eq!((lines.len(), pieces > 1), (1 + 2 + 3001, true));
    let mut pieces = 0;
    let refused = download(&logs, &question(0, 8000, &["bed"]), &mut |_| {
        pieces += 1;
        false
    });
    assert_eq!((refused.unwrap_err().kind(), pieces), (io::ErrorKind::Interrupted, 1));
}
