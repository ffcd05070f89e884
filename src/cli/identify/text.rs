//! Result of an identification as text for the terminal.

use std::io::{self, Write};
use std::time::Duration;

use isotherm_identify::Identified;
use isotherm_profile::duration_text;

/// Maximum number of terms of the model that are printed. The block for the profile and the JSON document
/// contain all terms.
const MOST_TERMS: usize = 40;

pub(super) fn render(out: &mut impl Write, found: &Identified, probe: Option<Duration>) -> io::Result<()> {
    let probed = probe.map(|interval| format!(", probed every {}", duration_text(interval)));
    writeln!(out, "axis {}: {}{}", found.axis, found.method, probed.unwrap_or_default())?;
    let columns = |used: &str| {
        let named = found.columns.iter().filter(|column| column.used == used);
        named.map(|column| format!("{} ({})", column.name, column.kind)).collect::<Vec<String>>().join(", ")
    };
    writeln!(out, "  error   {}", columns("error"))?;
    writeln!(out, "  inputs  {}", columns("input"))?;
    let touches = columns("touches");
    if !touches.is_empty() {
        writeln!(out, "  touches {touches}")?;
    }
    for faulty in &found.notes.excluded {
        writeln!(out, "  left out: {} {}", faulty.signal, faulty.reason)?;
    }
    for omission in &found.notes.omissions {
        writeln!(
            out,
            "  {}: error of held-out runs {:.2} µm RMS without this signal, {:.2} µm with it",
            omission.signal, omission.without_um, omission.with_um
        )?;
    }
    for mended in &found.repaired {
        writeln!(out, "  repaired: {} {} in {}: {}", mended.signal, mended.fault, mended.run, mended.done)?;
    }
    for like in &found.notes.ambient {
        writeln!(out, "  note: {} {}", like.signal, like.reason)?;
    }
    for remark in &found.notes.remarks {
        writeln!(out, "  note: {remark}")?;
    }
    if !found.terms.is_empty() {
        writeln!(out, "\n  Cz = −e is the sum of")?;
    }
    if let Some(network) = &found.network {
        writeln!(out, "\n  Cz = −e, by a {network}")?;
    }
    let terms = found.by_size();
    let width = terms.iter().map(|term| term.signal.chars().count()).max().unwrap_or(0);
    for term in terms.iter().take(MOST_TERMS) {
        let lag = match term.lag_s {
            lag if lag > 0.0 => format!("lag {}", duration_text(Duration::from_secs_f64(lag))),
            _ => "at once".to_owned(),
        };
        // Four decimals would show nothing of a gain per rpm².
        let is_tiny = term.gain.abs() < 1e-3;
        let gain = if is_tiny { format!("{:+10.2e}", term.gain) } else { format!("{:+10.4}", term.gain) };
        let se = match term.se {
            None => String::new(),
            Some(se) if is_tiny => format!("± {se:.2e}"),
            Some(se) => format!("± {se:.4}"),
        };
        writeln!(out, "    {gain} {se:10} {:7}  {:width$}  {lag}", term.unit, term.signal)?;
    }
    if terms.len() > MOST_TERMS {
        writeln!(out, "    … and {} smaller ones", terms.len() - MOST_TERMS)?;
    }
    if !found.runs.is_empty() {
        held_out(out, found)?;
    }
    if let Some(why) = found.expected_missing {
        writeln!(out, "  expected error: not known, because {why}")?;
    }
    lost(out, found)
}

/// Prints the residual error of each held-out run: a run that was used only to test a model from the other
/// runs.
fn held_out(out: &mut impl Write, found: &Identified) -> io::Result<()> {
    let width = found.runs.iter().map(|run| run.name.chars().count()).max().unwrap_or(0).max(4);
    writeln!(
        out,
        "\n  held out{}     range µm (uncomp.)   RMS µm (uncomp.)",
        " ".repeat(width.saturating_sub(6))
    )?;
    for run in &found.runs {
        writeln!(
            out,
            "    {:width$}  {:8.2} ({:6.2})   {:8.2} ({:6.2}){}",
            run.name,
            run.range_um,
            run.uncompensated_range_um,
            run.rmse_um,
            run.uncompensated_rmse_um,
            run.touches.map_or_else(String::new, |touches| format!("{}, {touches} touches", run.mark()))
        )?;
    }
    let uncompensated = &found.uncompensated;
    writeln!(
        out,
        "    {:width$}  {:8.2} ({:6.2})   {:8.2} ({:6.2})\n    {:width$}  {:8.2} ({:6.2})",
        "mean",
        found.means.mean_range_um,
        uncompensated.mean_range_um,
        found.means.mean_rmse_um,
        uncompensated.mean_rmse_um,
        "worst",
        found.means.worst_range_um,
        uncompensated.worst_range_um
    )?;
    if let Some(expected) = found.expected {
        let after = |[a, b]: [f64; 2], hours: f64| (a * hours + b).sqrt();
        writeln!(
            out,
            "  expected error (1 σ): ± {:.2} µm 1 h after the run's start, ± {:.2} µm after 8 h, and ± {:.2} µm 1 h after a probing",
            after(expected.since_datum, 1.0),
            after(expected.since_datum, 8.0),
            after(expected.since_touch, 1.0)
        )?;
    }
    if let Some(q) = found.probe_q {
        writeln!(out, "  value of `q` for a probe of the axis: {q:.2} µm²/h")?;
    }
    let runs = found.runs.len();
    match found.worse_runs.len() {
        0 => writeln!(out, "  worse than without compensation: none of {runs} runs"),
        worse => writeln!(
            out,
            "  worse than without compensation: {worse} of {runs} runs ({:.0} %): {}",
            100.0 * found.means.worse_share,
            found.worse_runs.join(", ")
        ),
    }
}

/// Prints, for each sensor of the model, the error of the model if this sensor is lost.
fn lost(out: &mut impl Write, found: &Identified) -> io::Result<()> {
    let virtually = found.stand_ins.iter().filter(|stand_in| stand_in.stands_in);
    let virtually = virtually
        .map(|own| (&own.signal, "the value predicted from the other sensors".to_owned(), own.means));
    let models = found.fallbacks.iter().map(|own| (&own.without, own.kind(), own.means));
    for (signal, kind, means) in virtually.chain(models) {
        match found.runs.is_empty() {
            true => writeln!(out, "  without {signal}: {kind}")?,
            false => writeln!(
                out,
                "  without {signal} ({kind}): mean range {:.2} µm, worst {:.2} µm; {:.0} % of the runs worse than uncompensated",
                means.mean_range_um,
                means.worst_range_um,
                100.0 * means.worse_share
            )?,
        }
    }
    for signal in &found.irreplaceable {
        writeln!(out, "  no other sensor can replace {signal}: keep a spare sensor")?;
    }
    Ok(())
}
