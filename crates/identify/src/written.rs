//! Output of an identification: the model as TOML text for a profile (an `[[axis.z.model]]` table), and the files that
//! this text names.

use std::time::Duration;

use humantime::format_duration;
use serde_json::{Value, json};

use crate::bank::Candidate;
use crate::expected::Expected;
use crate::identified::{Alone, Identified, TermFound};
use crate::learn::Learned;
use crate::region::Region;
use crate::stand_in::StandIn;
use crate::validate::OVER_TOUCHES;
use isotherm_core::compensation::model::Outside;
use isotherm_profile::sha256;

/// Model as TOML text for a profile, with its files.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// TOML text with comments: an `[[axis.….model]]` table for the model, and one table for each fallback model.
    pub block: String,
    /// Name and content of each file that `block` names. The files must be saved next to the profile.
    pub files: Vec<(String, String)>,
}

/// Returns a model as TOML text with its files. Each file name begins with `stem`. The files are called
/// `<stem>.envelope.json`, `<stem>.halves.json`, `<stem>.stand-ins.json` and `<stem>.network.json`.
pub fn written(found: &Identified, stem: &str, outside: Outside) -> Written {
    let (position, mut files) = (found.position.as_ref(), Vec::new());
    let mut block = head(found).iter().map(|line| format!("# {line}\n")).collect::<String>();
    if found.learned.inputs().is_empty() {
        block += "# No model: it would have no term.\n";
        return Written { block, files };
    }
    let with = identified_with(found.settle_s);
    let body = match &found.learned {
        Learned::Sum(_) | Learned::Mean { .. } => format!("{}\n{with}", sum(&found.terms, position)),
        Learned::Net { file, inputs, .. } => {
            let inputs = network_inputs(file, inputs);
            let file = named("file", format!("{stem}.network.json"), file, &mut files);
            format!("kind = \"network\"\n{file}{inputs}\nreference = \"start\"\n{with}")
        }
    };
    let has_halves = matches!(found.learned, Learned::Mean { .. });
    let beside = beside(found, stem, &mut files);
    let mut model = |name: &str, body: String, region: Option<&Region>, file: String, has_halves: bool| {
        // Without halves there is no agreement, and `check` would reject it.
        let outside = if outside == Outside::Agree && !has_halves { Outside::Warn } else { outside };
        let envelope = match region {
            None => "# No envelope: too many inputs, or an input that never changed.".to_owned(),
            Some(region) => {
                let envelope = named("envelope", file, &region.file(), &mut files);
                format!(
                    "# The envelope: the range of rises on which the model was identified.\n{envelope}outside = {}",
                    json!(outside)
                )
            }
        };
        format!("[[axis.{}.model]]\nname = {}\n{body}\n{envelope}\n", found.axis, json!(name))
    };
    block += &model(found.method, body, found.region.as_ref(), format!("{stem}.envelope.json"), has_halves);
    block += &beside;
    for fallback in &found.fallbacks {
        let (without, means) = (&fallback.without, &fallback.means);
        let (body, file) = match &fallback.alone {
            Some(alone) => (formula(alone), format!("{stem}.{}-alone.envelope.json", alone.signal)),
            None => (
                format!("{}\n{with}", sum(&fallback.terms, position)),
                format!("{stem}.without-{without}.envelope.json"),
            ),
        };
        block += &format!("\n# Used while {without} is lost");
        if !found.runs.is_empty() {
            block += &format!(
                "; held out: mean range {:.1} µm, worst {:.1} µm, {:.0} % of the runs worse than uncompensated",
                means.mean_range_um,
                means.worst_range_um,
                100.0 * means.worse_share
            );
        }
        block += ".\n";
        let name = format!("{} without {without}", fallback.method);
        block += &model(&name, body, fallback.region.as_ref(), file, false);
        block += &expected(fallback.expected.as_ref());
    }
    Written { block, files }
}

/// Returns the additional TOML keys of the model: the file of its halves, its expected error, and its stand-ins. The
/// halves are the two models of which the model is the mean. Fallback models do not have these keys.
fn beside(found: &Identified, stem: &str, files: &mut Vec<(String, String)>) -> String {
    let mut keys = String::new();
    let mut file = |key: &str, word: &str, content: Value| {
        keys += &named(key, format!("{stem}.{word}.json"), &content, files);
    };
    // The agreement of the halves is used only outside the envelope.
    if let (Learned::Mean { halves, .. }, Some(_)) = (&found.learned, &found.region) {
        let half = |(term, [ridge, net]): (&TermFound, &[f64; 2])| json!({ "signal": term.signal, "lag_s": term.lag_s, "ridge": ridge, "net": net });
        let terms: Vec<Value> = found.terms.iter().zip(halves).map(half).collect();
        file("halves", "halves", json!({ "format": "isotherm-halves", "version": 1, "terms": terms }));
    }
    if !found.stand_ins.is_empty() {
        let sensors: Vec<Value> = found.stand_ins.iter().map(StandIn::file).collect();
        file(
            "stand_ins",
            "stand-ins",
            json!({ "format": "isotherm-stand-ins", "version": 1, "sensors": sensors }),
        );
    }
    let missing = found.expected_missing.map(|why| format!("# The expected error is not known: {why}.\n"));
    keys + &expected(found.expected.as_ref()) + &missing.unwrap_or_default()
}

/// Returns the TOML keys with the name and the hash of a file. Adds the file to `files`.
fn named(key: &str, name: String, content: &Value, files: &mut Vec<(String, String)>) -> String {
    let content = format!("{content:#}\n");
    let keys = format!("{key} = {}\nsha256.{key} = \"{}\"\n", json!(name), sha256(content.as_bytes()));
    files.push((name, content));
    keys
}

fn expected(found: Option<&Expected>) -> String {
    let Some(Expected { since_datum, since_touch }) = found else { return String::new() };
    let pair = |[a, b]: &[f64; 2]| format!("[{}, {}]", short(*a), short(*b));
    let (datum, touch) = (pair(since_datum), pair(since_touch));
    format!(
        "expected = {{ since_datum = {datum}, since_touch = {touch} }}   # σ² = a·h + b, µm², h in hours\n"
    )
}

/// Returns the averaging time of the references as text for a profile.
fn settle(seconds: f64) -> humantime::FormattedDuration {
    format_duration(Duration::try_from_secs_f64(seconds).unwrap_or_default())
}

/// Returns the TOML key `identified_with`, which contains the averaging time of the references during the
/// identification. `isotherm check` compares this time with the setting `settle` in the profile.
pub(crate) fn identified_with(settle_s: f64) -> String {
    format!("identified_with = {{ settle = \"{}\" }}", settle(settle_s))
}

/// Returns a message with the setting of the axis that `isotherm zero` requires with this model. A rise
/// (input minus its reference) that is counted from machine start does not change with a zero command.
pub(crate) fn zero_needs(axis: &str) -> String {
    format!(
        "The rises of this model are counted from machine start. If you use `isotherm zero`, write datum = \"zero\" \
         under [axis.{axis}]."
    )
}

/// Returns the comment lines above the TOML text of the model. They contain the facts that the operator must know about
/// the model.
fn head(found: &Identified) -> Vec<String> {
    let (means, before) = (&found.means, &found.uncompensated);
    let settle = settle(found.settle_s);
    let mut lines = vec![
        format!(
            "Cz = −e, where e is {}. Identified by isotherm identify --method {}.",
            found.error, found.method
        ),
        match found.runs.is_empty() {
            true => "One run: no run could be held out, so it is not known how good the model is.".to_owned(),
            false => format!(
                "Each of {} runs held out in turn: mean range {:.1} µm ({:.1} µm uncompensated), worst run \
                 {:.1} µm ({:.1} µm), mean RMS {:.1} µm ({:.1} µm).",
                found.runs.len(),
                means.mean_range_um,
                before.mean_range_um,
                means.worst_range_um,
                before.worst_range_um,
                means.mean_rmse_um,
                before.mean_rmse_um
            ),
        },
        format!(
            "Rises are measured from the mean of the first {settle}: write settle = \"{settle}\" in \
             [machine]."
        ),
        zero_needs(&found.axis),
    ];
    if !found.runs.is_empty() {
        let (share, runs) = (100.0 * means.worse_share, found.runs.len());
        let worse = match found.worse_runs.is_empty() {
            true => String::new(),
            false => format!(": {}", found.worse_runs.join(", ")),
        };
        lines.push(format!(
            "With this model, {share:.0} % of {runs} held-out runs are worse than uncompensated{worse}."
        ));
    }
    let touched = found.runs.iter().filter(|run| run.touches.is_some()).count();
    if touched > 0 {
        lines.push(format!(
            "{touched} of these runs were measured by touches of a probe. A measurement in every row would \
             give ranges that are about {OVER_TOUCHES} times as large."
        ));
    }
    lines.extend(found.probe_q.map(|q| {
        format!(
            "The residual error drifts randomly: write q = {} for the probe of the axis, if it has one \
             (µm²/h).",
            short(q)
        )
    }));
    lines.extend(
        found.notes.excluded.iter().map(|faulty| format!("Left out: {}: {}.", faulty.signal, faulty.reason)),
    );
    lines.extend(found.repaired.iter().map(|mended| {
        format!("Repaired: {} {} in {}: {}.", mended.signal, mended.fault, mended.run, mended.done)
    }));
    lines
}

/// Returns the keys `kind`, `terms` and `slope`. Gains are written with all digits, so that the gateway uses exactly
/// the model that was validated.
pub(crate) fn sum(terms: &[TermFound], position: Option<&(String, f64)>) -> String {
    let list = |of_slope: bool| -> String {
        terms.iter().filter(|term| term.slope == of_slope).map(listed).collect()
    };
    let text = format!("kind = \"linear\"\nterms = [\n{}]", list(false));
    match (position, list(true)) {
        (Some((name, reference)), slope) if !slope.is_empty() => {
            let name = json!(name);
            format!("{text}\nslope = {{ position = {name}, reference = {reference:?}, terms = [\n{slope}] }}")
        }
        _ => text,
    }
}

fn listed(term: &TermFound) -> String {
    let signal = json!(term.signal);
    let lag = match Duration::from_secs_f64(term.lag_s) {
        Duration::ZERO => String::new(),
        lag => format!(", lag = \"{}\"", format_duration(lag)),
    };
    let error = term.se.map_or_else(String::new, |se| format!("   # ± {}", short(se)));
    let power = if term.squared { ", power = 2" } else { "" };
    let reference = if term.is_speed { "0.0" } else { "\"start\"" };
    format!(
        "  {{ signal = {signal}{power}, gain = {:?}, reference = {reference}{lag} }},{error}\n",
        term.gain
    )
}

/// Returns a number as decimal text with three significant digits.
fn short(value: f64) -> String {
    if value.abs() < 1e-9 {
        return "0.0".to_owned();
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 9 decimals")]
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 9.0) as usize;
    format!("{value:.decimals$}")
}

/// Returns the inputs of a network as TOML text, in the order of the network, with one line for each sensor.
fn network_inputs(file: &Value, inputs: &[Candidate]) -> String {
    let names = file["inputs"]["names"].as_array().map(Vec::as_slice).unwrap_or_default();
    let named: Vec<(&Value, &Candidate)> = names.iter().zip(inputs).collect();
    let input = |(name, candidate): &(&Value, &Candidate)| match candidate.lag {
        Some(lag) => format!("{{ signal = {name}, lag = \"{}\" }},", format_duration(lag)),
        None => format!("{name},"),
    };
    let of_sensor = |own: &[(&Value, &Candidate)]| own.iter().map(input).collect::<Vec<String>>().join(" ");
    let sensors = named.chunk_by(|one, other| one.1.input == other.1.input);
    let lines: String = sensors.map(|own| format!("\n  {}", of_sensor(own))).collect();
    format!("inputs = [{lines}\n]")
}

fn formula(alone: &Alone) -> String {
    let constants = alone.constants.iter().map(|(name, value)| format!("{name} = {value:?}"));
    format!(
        "kind = \"formula\"\nformula = {}\ninputs = {{ {} = {} }}\nconstants = {{ {} }}",
        json!(alone.formula),
        alone.symbol,
        json!(alone.signal),
        constants.collect::<Vec<String>>().join(", ")
    )
}
