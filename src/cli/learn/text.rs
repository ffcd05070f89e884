//! Result of `isotherm learn` for one axis, as text for the terminal.

use super::result::AxisResult;
use crate::cli::print::say;
use isotherm_identify::learning::TakenRun;
use isotherm_profile::counted;

pub(super) fn render(result: &AxisResult) -> std::io::Result<()> {
    let AxisResult { axis, new, runs, .. } = result;
    say!("axis {axis}: {} new, candidate from {}", counted(new.len(), "run"), counted(*runs, "run"))?;
    for run in new {
        say!("  {}: {}", run.run, sentence(run))?;
    }
    for remark in &result.remarks {
        say!("  note: {remark}")?;
    }
    let Some(gain) = result.gain else {
        return say!(
            "  not judged yet: this needs touches of a day that was not used to learn the candidate"
        );
    };
    let basis = format!("{}, touches: {}", counted(gain.days, "day"), gain.touches);
    let (left, before) = (gain.candidate_um, gain.in_use_um);
    let next = match result.is_learning {
        true => "`isotherm adopt` adopts it",
        false => "--write MODEL.toml writes it",
    };
    match result.proposed {
        true => say!(
            "  proposed: the candidate would have left a residual error of {left:.1} instead of {before:.1} \
             µm RMS ({basis}); {next}"
        ),
        false => say!(
            "  the model in use stays: it left a residual error of {before:.1} µm RMS, the candidate would \
             have left {left:.1} µm ({basis})"
        ),
    }
}

/// Returns a text about a run: why it was not used, or its number of touches and the residual errors with both models.
fn sentence(run: &TakenRun) -> String {
    if let Some(why) = &run.skipped {
        return format!("not used: {why}");
    }
    let Some(touches) = run.touches else { return "the error was measured in every row".to_owned() };
    let doubted = match run.doubted {
        0 => String::new(),
        some => format!(", {some} left out as wrong"),
    };
    let judged = run.judged.map(|judged| {
        format!("; in use {:.1} µm RMS, candidate {:.1} µm", judged.in_use_um, judged.candidate_um)
    });
    format!("touches: {touches}{doubted}{}", judged.unwrap_or_default())
}
