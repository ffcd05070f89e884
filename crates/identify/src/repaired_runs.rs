//! Files of the runs in which a faulty sensor was repaired. The operator can inspect the repair in these files.

use crate::setup::Ready;

/// Returns the name and the CSV text of each run with a repaired sensor. The columns are `time_s` and all log columns,
/// as they are used for identification. In addition, each repaired column occurs as it was recorded, for example with
/// the name `bed_recorded`.
pub fn repaired_files(ready: &Ready<'_>) -> Vec<(String, String)> {
    let (dataset, logs) = (ready.campaign.dataset.as_ref(), ready.logs);
    let of_run = |(place, run): (usize, &crate::dataset::Run)| {
        let is_mended =
            |name: &str| ready.repaired.iter().any(|mended| mended.signal == name && mended.run == run.name);
        let columns = || dataset.columns.iter().map(|column| column.name.as_str()).enumerate();
        let recorded: Vec<usize> =
            columns().filter(|(_, name)| is_mended(name)).map(|(column, _)| column).collect();
        if recorded.is_empty() {
            return None;
        }
        let names = columns().map(|(_, name)| name.to_owned());
        let names =
            names.chain(recorded.iter().map(|column| format!("{}_recorded", dataset.columns[*column].name)));
        let mut writer = csv::Writer::from_writer(Vec::new());
        let cell = |value: f64| if value.is_finite() { value.to_string() } else { String::new() };
        // Writing to a vector cannot fail.
        let mut write = |row: Vec<String>| drop(writer.write_record(row));
        write(["time_s".to_owned()].into_iter().chain(names).collect());
        for (row, second) in run.seconds().enumerate() {
            let learnt = run.values.iter().map(|column| cell(column.at(row)));
            let as_recorded = recorded.iter().map(|column| cell(logs.runs[place].values[*column].at(row)));
            write([second.to_string()].into_iter().chain(learnt).chain(as_recorded).collect());
        }
        let bytes = writer.into_inner().ok()?;
        Some((run.name.clone(), String::from_utf8(bytes).ok()?))
    };
    dataset.runs.iter().enumerate().filter_map(of_run).collect()
}
