//! `isotherm identify --balls`: converts the measurements of a ball array to a log of drifts and tilts.

use crate::cli::print::say;
use std::path::PathBuf;

use anyhow::Context;

use super::super::print::print_json;
use isotherm_identify::balls::{DIRECTIONS, Terms, log, terms};
use isotherm_identify::dataset::{Dataset, Split, every_column};
use isotherm_profile::counted;

#[derive(clap::Args, Debug)]
pub(super) struct Touches {
    /// Instead of PROFILE and LOG: the measurements of a 1-D ball array. Columns: time, ball (its number), x_mm, y_mm,
    /// z_mm, and stylus_mm if two stylus lengths were used. The first round must be with the cold machine
    #[arg(long, value_name = "BALLS.csv", requires = "out", conflicts_with_all = ["path", "logs", "write", "probe", "error"])]
    balls: Option<PathBuf>,
    /// With --balls: the log to write, with the drifts and tilts. It has one row for each round, or the rows of
    /// --recorded
    #[arg(long, value_name = "DRIFT.csv", requires = "balls")]
    out: Option<PathBuf>,
    /// With --balls: the log of the temperatures during the measurements
    #[arg(long, value_name = "LOG", requires = "balls")]
    recorded: Option<PathBuf>,
    /// With --balls: position along the array for which the drift of the origin is calculated, mm [default: the first
    /// ball]
    #[arg(long, value_name = "MM", requires = "balls", allow_negative_numbers = true)]
    origin: Option<f64>,
}

pub(super) fn run(arguments: &Touches, json: bool) -> anyhow::Result<()> {
    let (Some(balls), Some(out)) = (&arguments.balls, &arguments.out) else {
        anyhow::bail!("give a profile and logs, or --balls and --out");
    };
    let read = |path: &PathBuf| {
        Dataset::read(std::slice::from_ref(path), &Split::default(), &|_| None, &every_column)
    };
    let touches = read(balls)?;
    let in_file = || balls.display().to_string();
    let found = terms(&touches, arguments.origin).map_err(anyhow::Error::from).with_context(in_file)?;
    let recorded = arguments.recorded.as_ref().map(read).transpose()?;
    let text = log(&found, recorded.as_ref())?;
    std::fs::write(out, text).with_context(|| format!("cannot write {}", out.display()))?;
    if json {
        return print_json(&found);
    }
    tell(&found)?;
    say!("the drifts, tilts and errors (e = −d) are in the log {}", out.display())?;
    Ok(())
}

fn tell(found: &Terms) -> std::io::Result<()> {
    say!(
        "array of balls along {}, {}; drift of the measured coordinates since the first round, with the origin at {} mm",
        found.array,
        counted(found.rounds.len(), "round"),
        found.origin_mm
    )?;
    for remark in &found.remarks {
        say!("  note: {remark}")?;
    }
    let slopes: String = DIRECTIONS
        .iter()
        .enumerate()
        .map(|(place, axis)| {
            format!("  {:>10}", format!("{}_{axis} µm/m", if place == found.along { "k" } else { "A" }))
        })
        .collect();
    say!("  {:>6}  {:>8}  {:>8}  {:>8}{slopes}  {:>8}", "hour", "d_x µm", "d_y µm", "d_z µm", "left µm")?;
    for round in &found.rounds {
        let [x, y, z] = round.drift_um;
        let slopes = round.slope_um_per_mm.map(|slope| format!("  {:10.2}", 1000.0 * slope)).concat();
        say!("  {:6.2}  {x:8.2}  {y:8.2}  {z:8.2}{slopes}  {:8.2}", round.hours, round.rms_um)?;
    }
    if found.rounds.iter().any(|round| round.spindle_um_per_mm.is_some()) {
        say!("  {:>6}  tilt B of the spindle, µm/m of stylus", "hour")?;
        for round in &found.rounds {
            let tilts = round.spindle_um_per_mm.map_or("unknown".to_owned(), |tilts| {
                let across = (0..3).filter(|place| *place != found.along);
                across
                    .map(|place| format!("{} {:+.2}", DIRECTIONS[place], 1000.0 * tilts[place]))
                    .collect::<Vec<_>>()
                    .join("  ")
            });
            say!("  {:6.2}  {tilts}", round.hours)?;
        }
    }
    Ok(())
}
