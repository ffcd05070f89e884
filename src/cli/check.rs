//! `isotherm check`: shows the content of a profile, or its errors.

use std::path::{Path, PathBuf};

#[cfg(feature = "mqtt")]
use super::broker;
use super::certificate::Certificate;
use super::connection_test::ConnectionTest;
use super::hints::Hints;
use super::loading::{ProfileArguments, load_quietly, warned};
use super::notices;
use super::print::print_json;
use super::read_once;
use super::run::known_directory;
use crate::cli::print::{say, say_all, say_beside};
use crate::discovery::new_connection::NewConnectionAdvice;
#[cfg(feature = "opcua")]
use crate::discovery::opcua;
use crate::discovery::{can, merged_reads, pipeline, sysfs};
#[cfg(feature = "opcua")]
use crate::gateway::certificates;
use crate::gateway::{control, moved_since, preferences_in, superseded_in, templates};
use crate::observe::http::Admission;
use crate::observe::status::Status;
use isotherm_profile::preview::{self, Preview};
use isotherm_profile::{DeviceId, Profile};

/// Shows every error of the profile with its line. Without errors it shows the read plan, each register in both
/// notations and everything that would be written. It says in words in which direction each signal changes Cz.
#[derive(clap::Args, Debug)]
#[command(
    after_help = "Examples:\n  isotherm check my-machine.toml\n  isotherm check my-machine.toml --online     asks the \
                  devices as well, reading only"
)]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Also reads every signal and every output register once, and writes nothing. If a read of several values fails,
    /// tests which quirks (settings for a device with special requirements) help. Connects to the broker of [mqtt] and
    /// to the servers of [[notify]], and sends them no message
    #[arg(long)]
    online: bool,
    /// The state directory with which the gateway is started. The check reports templates that have changed since the
    /// last run, and names adopted learned models. With --online it also compares the registers of outputs and the
    /// addresses of signals
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

/// Maximum number of warnings about bus lines that are printed individually. Further warnings are only counted.
const MOST_WARNINGS: usize = 50;

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let ProfileArguments { path, set } = &arguments.profile;
    let profile = warned(load_quietly(path, set, arguments.json)?);
    let preview = Preview::of(&profile);
    let warnings = preview::warnings(&profile);
    for warning in warnings.iter().take(MOST_WARNINGS) {
        say_beside!("warning: {warning}");
    }
    if let Some(more) = warnings.len().checked_sub(MOST_WARNINGS).filter(|more| *more > 0) {
        say_beside!("… and {more} more warnings about the bus lines");
    }
    for warning in unlike_run(&profile, arguments.state.as_deref()) {
        say_beside!("warning: {warning}");
    }
    let directory = known_directory(arguments.state.as_deref().or(profile.history.directory.as_deref()));
    for (axis, preference) in preferences_in(&directory, &profile) {
        if let Some(model) = preference.preferred().name() {
            say_beside!(
                "note: axis {axis} follows the learned model {model}; its models in the profile are the fallbacks. \
                 isotherm adopt --export writes the learned model, and --back returns to the previous model"
            );
        }
    }
    for (axis, model) in superseded_in(&directory, &profile) {
        say_beside!(
            "note: axis {axis} will not follow the learned model {model} any more, because its models or their signals \
             in the profile have changed"
        );
    }
    if !arguments.online {
        if arguments.json {
            return print_json(&preview);
        }
        // A reader such as `head` may have closed the pipe before the end.
        return Ok(say_all!("{preview}")?);
    }
    let (lines, sensors) = (can::inspect(&profile), sysfs::inspect(&profile));
    let pairs = super::runtime::start()?.block_on(pipeline::tried(&profile));
    #[cfg(feature = "opcua")]
    let nodes = super::runtime::start()?.block_on(opcua::inspect(&profile));
    #[cfg(feature = "mqtt")]
    let broker = super::runtime::start()?.block_on(broker::test_connection(&profile));
    let servers = notices::look(&profile)?;
    let moved = moved_since(&directory, &profile);
    let status = read_once::once(profile.clone(), directory)?;
    let unread = unread(&profile, &status);
    let merged = super::runtime::start()?.block_on(merged_reads::tried(&profile, &unread));
    let connections = read_once::examined(&profile, &status)?;
    if arguments.json {
        let document = serde_json::json!({
            "profile": preview, "online": status, "can": lines, "pipeline": pairs, "sensors": sensors, "notify": servers,
            "moved": moved, "merged": merged, "connections": connections,
        });
        #[cfg(feature = "opcua")]
        let document = with(document, "nodes", &nodes)?;
        #[cfg(feature = "mqtt")]
        let document = with(document, "broker", &broker)?;
        print_json(&document)?;
    } else {
        say_all!("{preview}")?;
        say!("\nOnline")?;
        for line in &lines {
            say!("  bus {}: interface {}: {}", line.bus, line.interface, line.state)?;
            line.advice.iter().try_for_each(|advice| say!("    warning: {advice}"))?;
        }
        for sysfs::Inspected { of, sensor, read_in, advice, .. } in &sensors {
            let place = read_in.as_deref().unwrap_or("not read");
            say!("  {of} at sensor {sensor}: {place}")?;
            advice.iter().try_for_each(|advice| say!("    warning: {advice}"))?;
        }
        for pipeline::PipelineTest { bus, device, fault } in &pairs {
            let came = fault.as_ref().map_or("both answered".to_owned(), |fault| {
                format!("{fault}: remove `pipeline` from bus {bus}")
            });
            say!("  device {device}: two requests at a time: {came}")?;
        }
        for NewConnectionAdvice { device, advice, .. } in &connections {
            say!("  warning: device {device}: {advice}")?;
        }
        #[cfg(feature = "opcua")]
        nodes.iter().try_for_each(tell)?;
        #[cfg(feature = "mqtt")]
        broker.iter().try_for_each(|looked| say!("{}", looked.line()))?;
        servers.iter().try_for_each(|looked| say!("{}", looked.line()))?;
        for merged_reads::MergedReadTest { device, read, fault, quirks } in &merged {
            say!("  device {device}: {read}: {fault}")?;
            say!("    write {quirks} at the device: all its values can then be read")?;
        }
        moved.iter().try_for_each(|moved| say!("  warning: {moved}"))?;
        let mut hints = Hints::default();
        say_all!("{}", read_once::signals(&status, &mut hints))?;
        say_all!("{}", read_once::fieldbus(&status, &mut hints))?;
    }
    #[cfg(feature = "opcua")]
    assess(&nodes)?;
    if let Some((sensor, advice)) = sensors.iter().find_map(|sensor| Some((sensor, sensor.advice.as_ref()?)))
    {
        anyhow::bail!("{} at sensor {}: {advice}", sensor.of, sensor.sensor);
    }
    read_once::assess(&status)?;
    #[cfg(feature = "mqtt")]
    broker.iter().try_for_each(ConnectionTest::assess)?;
    servers.iter().try_for_each(ConnectionTest::assess)?;
    let unfit = pairs.iter().find(|tried| tried.fault.is_some());
    let unfit = unfit.map(|tried| format!("device {} does not support two requests at a time", tried.device));
    unfit.map_or(Ok(()), |unfit| Err(anyhow::anyhow!("{unfit}: remove `pipeline` from its bus")))
}

/// Returns the devices that have a signal without a good value.
fn unread(profile: &Profile, status: &Status) -> Vec<DeviceId> {
    let is_unread =
        |name: &str| status.signals.iter().any(|signal| signal.device == name && signal.quality != "good");
    let devices = profile.devices.iter().enumerate();
    devices.filter(|(_, device)| is_unread(&device.name)).map(|(place, _)| DeviceId(place)).collect()
}

#[cfg(feature = "opcua")]
fn expiring(profile: &Profile) -> impl Iterator<Item = String> {
    let now = crate::clock::Clock::wall().time_of_day();
    let early = certificates::early(profile, now).into_iter().map(|early| early.sentence());
    certificates::expiring(profile, now).into_iter().map(|expiry| expiry.sentence()).chain(early)
}

/// Sets the field `name` of a JSON document to `part`, and returns the document.
#[cfg(any(feature = "opcua", feature = "mqtt"))]
fn with(
    mut document: serde_json::Value,
    name: &str,
    part: &impl serde::Serialize,
) -> serde_json::Result<serde_json::Value> {
    document[name] = serde_json::to_value(part)?;
    Ok(document)
}

#[cfg(feature = "opcua")]
fn tell(node: &opcua::Inspected) -> std::io::Result<()> {
    match &node.found {
        Some(found) => {
            say!("{}", format!("  {} at {}: {}", node.of, found.node, opcua::in_a_line(found)).trim_end())?
        }
        None => say!("  {}:", node.of)?,
    }
    node.advice.iter().try_for_each(|advice| say!("    warning: {advice}"))
}

/// Returns an error if an OPC UA node does not fit the output or signal that uses it, for example because of its type.
#[cfg(feature = "opcua")]
fn assess(nodes: &[opcua::Inspected]) -> anyhow::Result<()> {
    let mut unfit = nodes.iter().filter_map(|node| Some((node, node.advice.first()?)));
    let Some((node, advice)) = unfit.next() else { return Ok(()) };
    let at = node.found.as_ref().map_or(String::new(), |found| format!(" at {}", found.node));
    let more = match unfit.count() {
        0 => String::new(),
        more => format!(" (and {more} more nodes with an error)"),
    };
    anyhow::bail!("{}{at}: {advice}{more}", node.of)
}

/// Returns warnings about this computer and its state directory: files that the gateway cannot use, and templates that
/// have changed since the last run.
fn unlike_run(profile: &Profile, state: Option<&Path>) -> Vec<String> {
    let directory = known_directory(state.or(profile.history.directory.as_deref()));
    let changed = templates::changed(&directory, profile).into_iter();
    let changed = changed.map(|(name, changes)| {
        format!("template {name} has changed since the last run of this machine: {changes}")
    });
    let socket = control::path(&directory, &profile.name);
    let tokens = profile.web.as_ref().and_then(|web| Admission::of(web).err());
    let tokens =
        tokens.map(|why| format!("[web]: {why}; the web page is not served until this is corrected"));
    let socket = control::too_long(&socket).map(|why| format!("{}: {why}", socket.display()));
    let files = profile.web.as_ref().and_then(|web| web.tls.as_ref());
    let certificate = files.and_then(|files| Certificate::open(files).err());
    let certificate =
        certificate.map(|why| format!("{why:#}: the gateway does not start until this is corrected"));
    let all = tokens.into_iter().chain(certificate).chain(socket).chain(changed);
    let all = all.chain(notices::hindered(profile));
    #[cfg(feature = "opcua")]
    let all = all.chain(expiring(profile)).chain(certificates::weak(profile));
    all.collect()
}
