//! What was found, for a person.

use std::fmt::Write;
use std::time::Duration;

use isotherm_identify::Identified;

/// Most terms that are printed; all of them stand in the block and in the JSON.
const MOST_TERMS: usize = 40;

pub(super) fn told(found: &Identified, probe: Option<Duration>) -> String {
    let mut text = String::new();
    // Writing to a string never fails.
    let _ = tell(&mut text, found, probe);
    text
}

fn tell(text: &mut String, found: &Identified, probe: Option<Duration>) -> std::fmt::Result {
    let probed = probe.map(|interval| format!(", probed every {}", humantime::format_duration(interval)));
    writeln!(text, "axis {}: {}{}", found.axis, found.method, probed.unwrap_or_default())?;
    let columns = |used: &str| {
        let named = found.columns.iter().filter(|column| column.used == used);
        named.map(|column| format!("{} ({})", column.name, column.kind)).collect::<Vec<String>>().join(", ")
    };
    writeln!(text, "  error   {}", columns("error"))?;
    writeln!(text, "  inputs  {}", columns("input"))?;
    let unused = columns("not used");
    if !unused.is_empty() {
        writeln!(text, "  unused  {unused}")?;
    }
    for faulty in &found.excluded {
        writeln!(text, "  left out: {} {}", faulty.signal, faulty.reason)?;
    }
    for mended in &found.repaired {
        writeln!(text, "  mended: {} {} in {}: {}", mended.signal, mended.fault, mended.run, mended.done)?;
    }
    for like in &found.ambient {
        writeln!(text, "  note: {} {}", like.signal, like.reason)?;
    }
    for remark in &found.remarks {
        writeln!(text, "  note: {remark}")?;
    }
    if !found.terms.is_empty() {
        writeln!(text, "\n  Cz = −e, added up from")?;
    }
    if let Some(network) = &found.network {
        writeln!(text, "\n  Cz = −e, by a {network}")?;
    }
    let mut terms: Vec<_> = found.terms.iter().collect();
    terms.sort_by(|one, other| other.gain.abs().total_cmp(&one.gain.abs()));
    let width = terms.iter().map(|term| term.signal.chars().count()).max().unwrap_or(0);
    for term in terms.iter().take(MOST_TERMS) {
        let lag = match term.lag_s {
            lag if lag > 0.0 => format!("lag {}", humantime::format_duration(Duration::from_secs_f64(lag))),
            _ => "at once".to_owned(),
        };
        let unit = if term.slope { "µm/mm" } else { "µm" };
        writeln!(
            text,
            "    {:+10.4} ± {:<8.4} {unit} per unit of {:width$}  {lag}",
            term.gain, term.se, term.signal
        )?;
    }
    if terms.len() > MOST_TERMS {
        writeln!(text, "    … and {} smaller ones", terms.len() - MOST_TERMS)?;
    }
    let width = found.runs.iter().map(|run| run.name.chars().count()).max().unwrap_or(0).max(4);
    writeln!(
        text,
        "\n  held out{}     range µm (bare)      RMS µm (bare)",
        " ".repeat(width.saturating_sub(6))
    )?;
    for run in &found.runs {
        writeln!(
            text,
            "    {:width$}  {:8.2} ({:6.2})   {:8.2} ({:6.2})",
            run.name, run.range_um, run.uncompensated_range_um, run.rmse_um, run.uncompensated_rmse_um
        )?;
    }
    let bare = &found.uncompensated;
    writeln!(
        text,
        "    {:width$}  {:8.2} ({:6.2})   {:8.2} ({:6.2})\n    {:width$}  {:8.2} ({:6.2})",
        "mean",
        found.means.mean_range_um,
        bare.mean_range_um,
        found.means.mean_rmse_um,
        bare.mean_rmse_um,
        "worst",
        found.means.worst_range_um,
        bare.worst_range_um
    )?;
    for fallback in &found.fallbacks {
        writeln!(
            text,
            "  without {} ({}): mean range {:.2} µm, worst {:.2} µm",
            fallback.without,
            fallback.kind(),
            fallback.means.mean_range_um,
            fallback.means.worst_range_um
        )?;
    }
    Ok(())
}
