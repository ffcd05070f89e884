//! Drift of a run as text: sentences, then tables.

use std::io::{self, Write};

use isotherm_identify::drift::Drift;
use isotherm_profile::counted;

pub(super) fn render(out: &mut impl Write, drift: &Drift) -> io::Result<()> {
    sentences(out, drift)?;
    displacements(out, drift)?;
    stages(out, drift)?;
    temperatures(out, drift)
}

fn sentences(out: &mut impl Write, drift: &Drift) -> io::Result<()> {
    writeln!(
        out,
        "{}: {} over {}, {}. Like a test of ISO 230-3 for {}: {}.",
        drift.name,
        match drift.displacements.len() {
            1 => "one displacement".to_owned(),
            count => format!("{count} displacements"),
        },
        clock(drift.hours),
        counted(drift.rows, "row"),
        drift.test.title(),
        drift.because
    )?;
    for moved in &drift.displacements {
        write!(out, "  {} moved by {:.2} µm", moved.name, moved.range_um)?;
        match (moved.first_hour_um, moved.last_hour_um, moved.largest_60min_um, moved.largest_60min_from_h) {
            (Some(first), Some(last), Some(largest), Some(from)) => writeln!(
                out,
                ": {first:.2} in the first hour, {last:.2} in the last, and at most {largest:.2} in 60 min, from {} on.",
                clock(from)
            )?,
            _ => writeln!(out, "; the log is shorter than an hour.")?,
        }
    }
    let ambient = drift.temperatures.iter().min_by(|one, other| one.range_k.total_cmp(&other.range_k));
    if let Some(calm) = ambient
        && let Some(lively) =
            drift.temperatures.iter().max_by(|one, other| one.range_k.total_cmp(&other.range_k))
    {
        writeln!(
            out,
            "  Temperatures ranged over {:.1} K ({}) to {:.1} K ({}).",
            calm.range_k, calm.name, lively.range_k, lively.name
        )?;
    }
    for remark in &drift.remarks {
        writeln!(out, "  note: {remark}")?;
    }
    Ok(())
}

fn displacements(out: &mut impl Write, drift: &Drift) -> io::Result<()> {
    let width = width(drift.displacements.iter().map(|moved| moved.name.as_str()));
    writeln!(
        out,
        "\n  {:width$}  {:>8}  {:>10}  {:>9}  {:>9}  {:>9}  {:>9}",
        "µm", "range", "first hour", "last hour", "in 60 min", "drift", "each hour"
    )?;
    for moved in &drift.displacements {
        writeln!(
            out,
            "  {:width$}  {:8.2}  {:>10}  {:>9}  {:>9}  {:+9.2}  {:+9.2}",
            moved.name,
            moved.range_um,
            figure(moved.first_hour_um),
            figure(moved.last_hour_um),
            figure(moved.largest_60min_um),
            moved.drift_um,
            moved.drift_um_per_h
        )?;
    }
    Ok(())
}

fn stages(out: &mut impl Write, drift: &Drift) -> io::Result<()> {
    let Some(column) = drift.stages.first().map(|stage| stage.column.as_str()) else { return Ok(()) };
    let names = drift.displacements.iter().map(|moved| format!("  {:>12}", moved.name));
    writeln!(out, "\n  {:>8}  {:>8}  {:>14}{}", "from", "to", column, names.collect::<String>())?;
    for (place, stage) in drift.stages.iter().enumerate() {
        let speed = match (stage.speed, stage.moves) {
            (Some(speed), _) => format!("{speed:.0}"),
            (None, true) => "moves".to_owned(),
            (None, false) => "stands".to_owned(),
        };
        let changes = drift.displacements.iter().map(|moved| moved.stages_um.get(place).copied().flatten());
        let changes: String = changes
            .map(|change| format!("  {:>12}", change.map_or("-".to_owned(), |um| format!("{um:+.2}"))))
            .collect();
        writeln!(out, "  {:>8}  {:>8}  {speed:>14}{changes}", clock(stage.from_h), clock(stage.to_h))?;
    }
    Ok(())
}

fn temperatures(out: &mut impl Write, drift: &Drift) -> io::Result<()> {
    if drift.temperatures.is_empty() {
        return Ok(());
    }
    let width = width(drift.temperatures.iter().map(|sensor| sensor.name.as_str()));
    writeln!(out, "\n  {:width$}  {:>8}  {:>8}  {:>8}  {:>9}", "°C", "begin", "end", "range", "in 60 min")?;
    for sensor in &drift.temperatures {
        writeln!(
            out,
            "  {:width$}  {:8.2}  {:8.2}  {:8.2}  {:>9}",
            sensor.name,
            sensor.begin_c,
            sensor.end_c,
            sensor.range_k,
            figure(sensor.largest_60min_k)
        )?;
    }
    Ok(())
}

fn width<'a>(names: impl Iterator<Item = &'a str>) -> usize {
    names.map(|name| name.chars().count()).max().unwrap_or(0).max(4)
}

fn figure(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.2}"))
}

/// Formats a time in hours as `3:05 h`.
fn clock(hours: f64) -> String {
    let minutes = (hours * 60.0).round();
    format!("{:.0}:{:02.0} h", (minutes / 60.0).floor(), minutes % 60.0)
}
