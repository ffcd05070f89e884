//! `isotherm run`: runs the gateway.

#[cfg(feature = "identify")]
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

use anyhow::Context;
use tracing_appender::non_blocking::WorkerGuard;

#[cfg(feature = "mqtt")]
use super::broker;
use super::loading::{ProfileArguments, warned};
use super::notices;
#[cfg(feature = "opcua")]
use super::opcua_server;
use super::port::Port;
use super::run_profile::{self, RunProfile};
use super::running;
use super::services::{Services, Sockets};
use super::signals::{Signals, survive_file_size_limit};
use super::volume;
use crate::cli::print::{say, say_beside};
use crate::clock::Clock;
#[cfg(feature = "identify")]
use crate::gateway::LearnTimes;
use crate::gateway::{
    Arrival, CHECK_ONLY, Checked, Gateway, Handover, KeptProfile, LearnCommand, Options, Prepared, Program,
    answer_of_check, claims, control, digest_path, make_directory, may_start, with_releases,
};
use crate::observe::events::Event;
use crate::observe::notify::{Outboxes, Rules};
use crate::observe::status::BrokerFigures;
use isotherm_profile::{DeviceId, Profile, Sources, Web, plan};

/// Time to wait for pending log lines when the program ends with an error.
const LAST_WORDS: Duration = Duration::from_millis(200);
/// Longest time to wait for pending log lines before another program starts. During this time no device is polled.
const LOG_WRITTEN_WITHIN: Duration = Duration::from_millis(50);

/// Runs the gateway: polls the devices, calculates Cz and writes it, until SIGTERM or Ctrl-C.
///
/// Before it stops, the gateway executes the fault actions of the axes (hold, ramp or zero). A second signal ends it at
/// once; the registers then keep their values.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm run my-machine.toml --dry-run      see what it would do\n  \
                  isotherm run my-machine.toml --set bus.cell.address=10.0.0.7:502\n  \
                  isotherm run my-machine.toml --listen 127.0.0.1:0 --state /var/lib/isotherm")]
pub(super) struct Arguments {
    #[command(flatten)]
    profile: ProfileArguments,
    /// Address of the web page, instead of the one in [web] of the profile; port 0 selects any free port, which is
    /// printed
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Directory of state and logs, instead of the one in [history] of the profile
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Reads, calculates and shows, but writes nothing
    #[arg(long)]
    dry_run: bool,
    /// Only checks whether this program could replace the gateway that has this command socket
    #[arg(long = CHECK_ONLY, value_name = "SOCKET", hide = true)]
    check_only: Option<PathBuf>,
}

/// Program that replaces this program in the same process, and the data that is handed over to the new program.
pub(super) struct Replacement {
    program: Program,
    handover: Handover,
    checked: Option<Checked>,
    /// Profile of the running program. The running program starts again with it, if the other program cannot be
    /// started.
    own: Option<KeptProfile>,
    /// File for the digest of the data that is handed over.
    digest: PathBuf,
    /// Web page and command socket, which still answer until the other program starts.
    _services: Services,
}

impl Replacement {
    /// Starts the other program in this process. If that fails, starts the previous program again. Returns only if both
    /// fail.
    pub(super) fn take_over(self, log: WorkerGuard) -> anyhow::Error {
        let Replacement { program, handover, checked, own, digest, .. } = self;
        let seal = |prepared: std::io::Result<Prepared>| {
            let sealed = prepared.and_then(|prepared| handover.seal(prepared, &digest));
            let report = |error: &std::io::Error| {
                let what = "the state is not handed over; the new program starts as after a normal stop";
                say_beside!("isotherm: {what}: {error}");
            };
            sealed.inspect_err(report).ok()
        };
        let sealed = seal(checked.map_or_else(|| Prepared::with(None), |checked| Ok(checked.prepared)));
        write_log(log);
        let why = program.start(sealed.as_ref());
        say_beside!("isotherm: {why}; the previous program continues instead");
        let error = program.start_own_image(seal(Prepared::with(own.as_ref())).as_ref());
        anyhow::anyhow!("this gateway has ended, and no other program has replaced it: {error}")
    }
}

/// Writes pending log lines. Waits at most [`LOG_WRITTEN_WITHIN`] until they are written.
fn write_log(log: WorkerGuard) {
    let (written, is_written) = channel();
    std::thread::spawn(move || {
        drop(log);
        let _ = written.send(());
    });
    let _ = is_written.recv_timeout(LOG_WRITTEN_WITHIN);
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Option<Replacement>> {
    let program = Program::of_this_process();
    let runtime = super::runtime::start()?;
    {
        let _inside = runtime.enter();
        survive_file_size_limit()?;
    }
    if let Some(socket) = &arguments.check_only {
        return check(arguments, socket).map(|()| None);
    }
    let arrival = Arrival::take();
    let handed_over = handed_over(arguments, &arrival)?;
    let takes_over = handed_over.is_some();
    let RunProfile { loaded, kept } =
        handed_over.map_or_else(|| RunProfile::from_disk(&arguments.profile), Ok)?;
    let profile = warned(loaded);
    for overridden in &profile.overridden {
        tracing::info!("{overridden}");
    }
    if let Some(warning) = running::other_directory(arguments.state.as_deref(), &profile) {
        tracing::warn!("{warning}");
    }
    let directory = state_directory(arguments.state.as_deref(), &profile)?;
    if let Some(place) = volume::volatile_mount(&directory) {
        let directory = directory.display();
        tracing::warn!(
            "the saved state in {directory} is stored in {place}: keep it in a directory or a named volume \
             of the host"
        );
    }
    let figures = profile.mqtt.as_ref().map(|mqtt| Arc::new(BrokerFigures::of(mqtt.broker.to_string())));
    let outboxes = Outboxes::of(&profile, arguments.dry_run);
    let mut options = Options {
        dry_run: arguments.dry_run,
        listener: outboxes.listener(),
        directory: Some(directory.clone()),
        give_up: Arc::new(|| {
            std::thread::sleep(LAST_WORDS);
            std::process::exit(1)
        }),
        broker: figures.clone(),
        profile_changes: run_profile::watched(kept.as_ref(), &arguments.profile),
        learn: learn_command(&arguments.profile, &directory),
        ..Options::default()
    };
    may_start(&options, &profile).map_err(anyhow::Error::msg)?;
    let unseen = match arguments.dry_run {
        true => None,
        false => claim(&profile, &directory, &mut options)?,
    };
    let mut sockets = Sockets::default();
    match web(arguments.listen.as_deref(), &profile) {
        // The gateway must not wait for the web page. This program has checked it, but its files may be gone by now.
        Some(web) if takes_over => sockets.open_page_later(web),
        Some(web) => {
            if let Some(url) = sockets.open_page_now_or_later(&web)? {
                // A closed stdout must not stop the machine.
                let _ = say!("page {url}");
            }
        }
        None => {}
    }
    sockets.open_control(&directory, &profile.name)?;
    // The handover is accepted only when the socket belongs to this gateway: another running gateway may be handing
    // over.
    let digest = digest_path(&directory, &profile.name);
    options.handover = arrival.accept(&digest);
    for (place, device) in profile.devices.iter().enumerate() {
        let (name, requests) = (&device.name, profile.register_requests(DeviceId(place)));
        tracing::info!("device {name}: {}", plan::summary(&requests));
        for request in &requests {
            tracing::info!("device {name}: {request}: {}", request.signals(&profile).join(", "));
        }
    }
    let outcome = runtime.block_on(async {
        let signals = Signals::listen()?.count();
        // An error would mean that the counting task has ended.
        let after = |times: u32| {
            let mut signals = signals.clone();
            async move { drop(signals.wait_for(|count| *count >= times).await) }
        };
        let lines = profile.buses.len();
        let socket = control::path(&directory, &profile.name);
        #[cfg(any(feature = "mqtt", feature = "opcua"))]
        let published = (profile.mqtt.is_some() || profile.opcua_server.is_some()).then(|| profile.clone());
        let gateway = Gateway::new(profile, &Clock::wall(), options);
        let successor = program.as_ref().ok().map(|program| gateway.successor(program.clone(), socket));
        sockets.successor = successor.clone();
        let source = gateway.source();
        unseen.into_iter().for_each(|why| source.report(&Event::NotExclusive { why }));
        let services = sockets.serve(&source, gateway.wire_log(), lines)?;
        if takes_over {
            run_profile::report_differences(kept.as_ref(), &arguments.profile, &source);
        }
        #[cfg(feature = "mqtt")]
        let publishing = match &published {
            Some(profile) => broker::publish(profile, &source, figures.as_ref(), &directory)?,
            None => None,
        };
        #[cfg(feature = "opcua")]
        let serving = match &published {
            Some(profile) => opcua_server::serve(profile, &source, &directory)?,
            None => None,
        };
        #[cfg(any(feature = "mqtt", feature = "opcua"))]
        drop(published);
        let report = Arc::new(move |delivery| source.report(&Event::Delivery(delivery)));
        let posting = outboxes.posted(report, Rules::default(), notices::trust)?;
        let outcome = gateway.run(after(1), after(2)).await;
        #[cfg(feature = "opcua")]
        if let Some(serving) = serving
            && outcome.handover.is_none()
        {
            serving.finish().await;
        }
        // Until the next program starts, no gateway controls the machine. Messages must not delay it.
        let patience = || after(if outcome.handover.is_some() { 0 } else { 2 });
        let posted = async {
            if let Some(posting) = posting {
                posting.finish(patience()).await;
            }
        };
        #[cfg(feature = "mqtt")]
        let posted = async {
            let published = async {
                if let Some(publishing) = publishing {
                    publishing.finish(patience()).await;
                }
            };
            tokio::join!(published, posted);
        };
        posted.await;
        anyhow::Ok((outcome, successor.and_then(|successor| successor.take_checked()), services))
    });
    // A name lookup that has not ended must not delay the end.
    runtime.shutdown_background();
    let (outcome, checked, services) = outcome?;
    anyhow::ensure!(!outcome.failed, "an internal error occurred (see above); {}", outcome.left);
    anyhow::ensure!(outcome.rested, "stopped before the fault actions were complete; {}", outcome.left);
    let Some((handover, program)) = outcome.handover.zip(program.ok()) else { return Ok(None) };
    Ok(Some(Replacement { program, handover, checked, own: kept, digest, _services: services }))
}

/// Returns the command that learns the models of the axes in another process. The command starts the same program as
/// this process, even if the program file was replaced.
#[cfg(feature = "identify")]
fn learn_command(profile: &ProfileArguments, state: &Path) -> Option<LearnCommand> {
    let mut arguments: Vec<OsString> =
        vec!["learn".into(), profile.path.clone().into(), "--background".into()];
    for (key, value) in &profile.set {
        arguments.push("--set".into());
        arguments.push(format!("{key}={value}").into());
    }
    arguments.push("--state".into());
    arguments.push(state.into());
    Some(LearnCommand { program: "/proc/self/exe".into(), arguments, times: LearnTimes::default() })
}

/// Returns `None`, because this program was built without the feature `identify` and cannot learn models.
#[cfg(not(feature = "identify"))]
fn learn_command(_: &ProfileArguments, _: &Path) -> Option<LearnCommand> {
    None
}

/// Returns the profile that the previous program in this process has handed over. Returns `None` if there is none, or
/// it is not accepted.
fn handed_over(arguments: &Arguments, arrival: &Arrival) -> anyhow::Result<Option<RunProfile>> {
    let Some(kept) = arrival.profile() else { return Ok(None) };
    let Some(run_profile) = RunProfile::handed_over(&arguments.profile, kept)? else { return Ok(None) };
    let profile = &run_profile.loaded.profile;
    let digest = digest_path(&state_path(arguments.state.as_deref(), profile), &profile.name);
    Ok(arrival.is_announced(&digest).then_some(run_profile))
}

/// Checks whether this program could replace the running gateway that has the command socket `socket`. The
/// error is the reason why this program could not replace it.
fn check(arguments: &Arguments, socket: &Path) -> anyhow::Result<()> {
    let (loaded, sources) = run_profile::read(&arguments.profile, answer_of_check())?;
    let profile = &warned(loaded);
    let directory = state_directory(arguments.state.as_deref(), profile)?;
    let own = control::path(&directory, &profile.name);
    anyhow::ensure!(
        own == socket,
        "the machine name or the state directory has changed, so this would be another gateway ({} instead \
         of {}). Stop the running gateway, and start it again",
        own.display(),
        socket.display()
    );
    let options = Options { directory: Some(directory.clone()), ..Options::default() };
    may_start(&options, profile).map_err(anyhow::Error::msg)?;
    if !arguments.dry_run {
        claims::could_claim(profile, &directory).map_err(anyhow::Error::msg)?;
    }
    web(arguments.listen.as_deref(), profile).map_or(Ok(()), |web| Port::new(&web).map(drop))?;
    // Sealed, because a wrapper script around this program may still write to the file.
    let seal = |sources: Sources| KeptProfile::seal(sources.finish()?.0).map(drop);
    sources.map_or(Ok(()), seal).context("the profile cannot be handed over")
}

/// Claims the registers to which this gateway writes, so that no other gateway on this computer writes to them. If
/// another gateway writes to a register that is to be released, no register is released, and this gateway runs. Returns
/// the reason if other gateways cannot be detected.
fn claim(profile: &Profile, directory: &Path, options: &mut Options) -> anyhow::Result<Option<String>> {
    let released = with_releases(directory, profile.clone());
    if released.outputs.len() > profile.outputs.len() {
        options.may_release = claims::could_claim(&released, directory);
    }
    let claimed = if options.may_release.is_ok() { &released } else { profile };
    claims::claim(claimed, directory).map_err(anyhow::Error::msg)
}

/// Returns the settings of the web page in the profile, with the address `listen` if it is given. `None` if
/// the profile has no `[web]`, and `listen` is not given.
fn web(listen: Option<&str>, profile: &Profile) -> Option<Web> {
    let Some(listen) = listen else { return profile.web.clone() };
    Some(Web { listen: listen.to_owned(), ..profile.web.clone().unwrap_or_default() })
}

/// Creates the state directory if needed, and returns its path. It comes from the option, from the profile, or from the
/// platform. The path is absolute, so that other verbs find the command socket in the kernel's list of sockets. It
/// stays relative if the absolute path is too long for a socket.
fn state_directory(option: Option<&Path>, profile: &Profile) -> anyhow::Result<PathBuf> {
    let directory = state_path(option, profile);
    make_directory(&directory).with_context(|| {
        format!(
            "the state directory {} cannot be created; give another directory with --state",
            directory.display()
        )
    })?;
    Ok(directory)
}

/// Returns the path of the state directory, which need not exist.
fn state_path(option: Option<&Path>, profile: &Profile) -> PathBuf {
    let directory = known_directory(option.or(profile.history.directory.as_deref()));
    let from_root = std::path::absolute(&directory).ok();
    let from_root = from_root.filter(|path| control::too_long(&control::path(path, &profile.name)).is_none());
    from_root.unwrap_or(directory)
}

/// Returns the path of the named directory, or else of the platform's state directory.
pub(super) fn known_directory(named: Option<&Path>) -> PathBuf {
    let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".local/state"));
    let platform = || {
        let of_service = std::env::var_os("STATE_DIRECTORY").map(PathBuf::from);
        let of_person = std::env::var_os("XDG_STATE_HOME").map(PathBuf::from).or_else(home);
        of_service.or_else(|| of_person.map(|base| base.join("isotherm")))
    };
    named.map(Path::to_owned).or_else(platform).unwrap_or_else(|| PathBuf::from("/var/lib/isotherm"))
}
