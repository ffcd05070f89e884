//! What was found as a `[[axis.z.model]]` block, ready to paste, and the files beside it.

use std::fmt::Write;

use crate::bank::Candidate;
use crate::identified::{Alone, Identified, TermFound};
use crate::learn::Learned;
use crate::region::Region;
use isotherm_core::compensation::model::Outside;

/// A block and its files, by name.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// TOML.
    pub block: String,
    /// Names and contents of the files that the block names; they belong beside the profile.
    pub files: Vec<(String, String)>,
}

/// The block of a model; its files are called `<stem>.envelope.json` and `<stem>.network.json`.
pub fn written(found: &Identified, stem: &str, outside: Outside) -> Written {
    let mut files = Vec::new();
    let mut block = String::new();
    let mut line = |text: &str| {
        block.push_str(text);
        block.push('\n');
    };
    for remark in head(found) {
        line(format!("# {remark}").trim_end());
    }
    line(&format!("[[axis.{}.model]]", found.axis));
    line(&format!("name = {}", quoted(found.method)));
    match &found.learned {
        Learned::Sum(_) => line(&sum(&found.terms, found.position.as_ref())),
        Learned::Net { file, inputs, .. } => {
            let name = format!("{stem}.network.json");
            line("kind = \"network\"");
            line(&format!("file = {}", quoted(&name)));
            line(&network_inputs(file, inputs));
            line("reference = \"start\"");
            files.push((name, format!("{file:#}\n")));
        }
    }
    let mut bounded = |region: Option<&Region>, name: String| {
        let Some(region) = region else {
            return "# No envelope: too many inputs, or one that never moved.".to_owned();
        };
        let text = format!(
            "envelope = {}   # the rises it was identified on\noutside = \"{}\"",
            quoted(&name),
            word(outside)
        );
        files.push((name, format!("{:#}\n", region.file())));
        text
    };
    line(&bounded(found.region.as_ref(), format!("{stem}.envelope.json")));
    for fallback in &found.fallbacks {
        line("");
        line(&format!(
            "# Where {} is lost; held out: mean range {:.1} µm, worst {:.1} µm.",
            fallback.without, fallback.means.mean_range_um, fallback.means.worst_range_um
        ));
        line(&format!("[[axis.{}.model]]", found.axis));
        line(&format!("name = {}", quoted(&format!("{} without {}", fallback.method, fallback.without))));
        let name = match &fallback.alone {
            Some(alone) => {
                line(&formula(alone));
                format!("{stem}.{}-alone.envelope.json", alone.signal)
            }
            None => {
                line(&sum(&fallback.terms, found.position.as_ref()));
                format!("{stem}.without-{}.envelope.json", fallback.without)
            }
        };
        line(&bounded(fallback.region.as_ref(), name));
    }
    Written { block, files }
}

fn head(found: &Identified) -> Vec<String> {
    let bare = &found.uncompensated;
    let settle = humantime::format_duration(std::time::Duration::from_secs_f64(found.settle_s));
    let mut lines = vec![
        format!("Cz = −e, e being {}: found by isotherm identify --method {}.", found.error, found.method),
        format!(
            "Each of {} runs held out in turn: mean range {:.1} µm ({:.1} µm bare), worst run {:.1} µm ({:.1} µm), mean RMS \
             {:.1} µm ({:.1} µm).",
            found.runs.len(),
            found.means.mean_range_um,
            bare.mean_range_um,
            found.means.worst_range_um,
            bare.worst_range_um,
            found.means.mean_rmse_um,
            bare.mean_rmse_um
        ),
        format!("Rises are measured from the first {settle}: [machine] settle = \"{settle}\" belongs to it."),
    ];
    for faulty in &found.excluded {
        lines.push(format!("Left out: {}: {}.", faulty.signal, faulty.reason));
    }
    for mended in &found.repaired {
        lines.push(format!("Mended: {} {} in {}: {}.", mended.signal, mended.fault, mended.run, mended.done));
    }
    lines
}

/// kind, offset, terms and slope. A gain has every digit, so that what was validated is what runs.
fn sum(terms: &[TermFound], position: Option<&(String, f64)>) -> String {
    let mut text = "kind = \"linear\"\n".to_owned();
    list(&mut text, "terms = [", terms.iter().filter(|term| !term.slope));
    text.push(']');
    let mut slope = terms.iter().filter(|term| term.slope).peekable();
    if let (Some((name, reference)), Some(_)) = (position, slope.peek()) {
        let begin = format!("\nslope = {{ position = {}, reference = {reference:?}, terms = [", quoted(name));
        list(&mut text, &begin, slope);
        text.push_str("] }");
    }
    text
}

fn list<'a>(text: &mut String, begin: &str, terms: impl Iterator<Item = &'a TermFound>) {
    text.push_str(begin);
    text.push('\n');
    for term in terms {
        let lag = match term.lag_s {
            lag if lag > 0.0 => {
                let lag = std::time::Duration::from_secs_f64(lag);
                format!(", lag = \"{}\"", humantime::format_duration(lag))
            }
            _ => String::new(),
        };
        let error = if term.se > 0.0 { format!("   # ± {}", short(term.se)) } else { String::new() };
        // Writing to a string never fails.
        let _ = writeln!(
            text,
            "  {{ signal = {}, gain = {:?}, reference = \"start\"{lag} }},{error}",
            quoted(&term.signal),
            term.gain
        );
    }
}

/// Three digits that count.
fn short(value: f64) -> String {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 9 decimals")]
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}")
}

/// In the network's order, one line for each sensor.
fn network_inputs(file: &serde_json::Value, inputs: &[Candidate]) -> String {
    let names = file["inputs"]["names"].as_array().map(Vec::as_slice).unwrap_or_default();
    let mut text = "inputs = [".to_owned();
    let mut last = None;
    for (name, Candidate { input, lag, .. }) in names.iter().zip(inputs) {
        text.push_str(if last == Some(input) { " " } else { "\n  " });
        last = Some(input);
        // Writing to a string never fails.
        let _ = match lag {
            Some(lag) => {
                write!(text, "{{ signal = {name}, lag = \"{}\" }},", humantime::format_duration(*lag))
            }
            None => write!(text, "{name},"),
        };
    }
    text + "\n]"
}

fn formula(alone: &Alone) -> String {
    let constants = alone.constants.iter().map(|(name, value)| format!("{name} = {value:?}"));
    format!(
        "kind = \"formula\"\nformula = {}\ninputs = {{ {} = {} }}\nconstants = {{ {} }}",
        quoted(alone.formula),
        alone.symbol,
        quoted(&alone.signal),
        constants.collect::<Vec<String>>().join(", ")
    )
}

fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}

fn word(outside: Outside) -> &'static str {
    match outside {
        Outside::Warn => "warn",
        Outside::Hold => "hold",
        Outside::Shrink => "shrink",
    }
}
