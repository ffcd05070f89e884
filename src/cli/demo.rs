//! `isotherm demo`: runs the gateway with a virtual machine, without hardware.

use std::cell::Cell;
use std::io::IsTerminal;
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;

use super::machines;
use super::print::print_json;
use super::services::Sockets;
use super::signals::Signals;
use super::values::{self, key_and_value};
use crate::cli::print::{say, say_beside};
use crate::clock::Clock;
use crate::discovery::can;
use crate::gateway::{Gateway, Options, Outcome};
use crate::observe::status::GatewayApi;
use crate::virtual_machine::{AxisSummary, PlantSpec, Published, Setup, Summary, VirtualMachine};
use isotherm_profile::{Commands, Profile, Web};

#[cfg(feature = "identify")]
mod learn;
mod linuxcnc;
mod logs;
mod table;
mod truth;

use linuxcnc::Mill;
use logs::{Logs, NullDisk};
use table::Table;
use truth::WithTruth;

/// Demonstrates isotherm without hardware. The demo starts the devices of a virtual machine on real loopback sockets,
/// runs the gateway with them, and serves the web page. At the end it prints the error without and with compensation.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm demo\n  isotherm demo sinker-edm --for 12h\n  \
                  isotherm demo --speed 3600 --for 8h --seed 7 --json\n  isotherm demo linuxcnc-mill --for 1h\n  \
                  isotherm demo --learn")]
pub(super) struct Arguments {
    /// A shipped machine: surface-grinder, sinker-edm, xc100-lathe, xc100-lathe-can, ram-mc, parts-vmc, spindle-hmc,
    /// jcs018a-vmc, screw-axis, column-hmc, linuxcnc-mill
    #[arg(default_value = "surface-grinder")]
    machine: String,
    /// Overrides one key of the machine's profile, may be repeated: `--set bus.field.interface=vcan1`
    #[arg(long, value_name = "KEY=VALUE", value_parser = key_and_value)]
    set: Vec<(String, String)>,
    /// Highest ratio of machine time to wall-clock time. Default 600; with LinuxCNC, which moves in wall-clock time, 60
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    speed: Option<f64>,
    /// Duration of the demo in machine time (simulated time)
    #[arg(long = "for", default_value = "8h", value_name = "SPAN", value_parser = humantime::parse_duration)]
    span: Duration,
    /// Seed of the simulated day: duty cycle, ambient temperature and noise depend on it
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Address of the web page; port 0 selects any free port. Default 127.0.0.1:8080, or any free port if 8080 is in
    /// use
    #[arg(long, value_name = "ADDR")]
    listen: Option<String>,
    /// Simulates ten days instead, without a web page. A probe measures the error once an hour. Each night a model is
    /// learned; a better one is adopted. The model at the start belongs to another machine
    #[cfg(feature = "identify")]
    #[arg(long, conflicts_with_all = ["set", "speed", "span", "listen", "stay"])]
    learn: bool,
    /// Keeps the web page open after the simulated day, with its time stopped, until Enter or Ctrl-C
    #[arg(long)]
    stay: bool,
    /// Prints one JSON document at the end, and nothing else on stdout
    #[arg(long)]
    json: bool,
}

/// Result of a demo, printed as text or as JSON.
#[derive(Debug, Serialize)]
struct Report {
    machine: String,
    seed: u64,
    machine_hours: f64,
    uncompensated_range_um: f64,
    compensated_range_um: f64,
    axes: serde_json::Map<String, serde_json::Value>,
}

fn positive(text: &str) -> Result<f64, String> {
    values::number(text, |factor| factor > 0.0, "write a number above 0, such as 600")
}

impl Arguments {
    /// Returns the default log filter of a demo. On a terminal the log is off, because log lines would destroy the
    /// table. The table shows the events instead. Without a terminal only errors are logged, because each demo ends
    /// with the normal return of Cz to zero, which needs no warnings.
    pub(super) fn quiet_log(&self) -> &'static str {
        if std::io::stdout().is_terminal() && !self.json { "off" } else { "error" }
    }
}

/// Runs the demo of `--learn`: ten days in which a model is learned.
#[cfg(feature = "identify")]
fn run_learning(arguments: &Arguments) -> anyhow::Result<()> {
    let days = learn::run(&arguments.machine, arguments.seed, arguments.json)?;
    if arguments.json {
        print_json(
            &serde_json::json!({ "machine": arguments.machine, "seed": arguments.seed, "days": days }),
        )?;
    }
    Ok(())
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    #[cfg(feature = "identify")]
    if arguments.learn {
        return run_learning(arguments);
    }
    let (profile, plant) = machines::with_plant(&arguments.machine, &arguments.set)?;
    usable(&profile)?;
    let mill = Mill::of(&arguments.machine)?;
    let mut sockets = Sockets::default();
    let page = open_page(&mut sockets, arguments.listen.as_deref(), profile.web.as_ref())?;
    if !arguments.json {
        say_beside!(
            "every user of this computer may control this demo on its web page (commands = \"local\")"
        );
    }
    let outcome =
        super::runtime::start()?.block_on(show(arguments, profile, (plant, mill), sockets, page))?;
    anyhow::ensure!(!outcome.failed, "an internal error occurred; run the demo again with --log info");
    Ok(())
}

async fn show(
    arguments: &Arguments,
    profile: Profile,
    (plant, mill): (PlantSpec, Option<Mill>),
    sockets: Sockets,
    page: String,
) -> anyhow::Result<Outcome> {
    let published = plant.published().cloned();
    let speed = arguments.speed.unwrap_or(if mill.is_some() { 60.0 } else { 600.0 });
    let clock = Clock::simulated(plant.start(), Some(speed));
    let begun = clock.now();
    // The clock must not advance before all tasks have joined it.
    let hold = clock.hold();
    let mut machine =
        VirtualMachine::start(&profile, Setup::on_free_ports(plant, arguments.seed), &clock).await?;
    let mut profile = machine.serving(profile);
    let window = machine.window();
    let mut mill = mill.map(|mill| mill.takes_the_place_of_the_control(&mut profile, &window)).transpose()?;
    let mut signals = Signals::listen()?;
    let mut last = clock.join();
    let logs = Logs::make();
    let directory = logs.as_ref().map(Logs::path);
    let options = Options { directory, disk: Arc::new(NullDisk), ..Options::default() };
    let lines = profile.buses.len();
    let gateway = Gateway::new(profile, &clock, options);
    let log = logs.as_ref().map(|logs| logs.path().join("truth.csv"));
    let with_truth = Arc::new(WithTruth { source: gateway.source(), window: window.clone(), log });
    let source: Arc<dyn GatewayApi> = with_truth.clone();
    let _services = sockets.serve(&source, gateway.wire_log(), lines)?;
    drop(hold);
    let is_over = Cell::new(false);
    let mut reported = Ok(());
    let over = async {
        let is_whole = tokio::select! {
            _ = last.sleep_until(begun.after(arguments.span)) => true,
            () = signals.next() => false,
        };
        // Stops the clock before the fault actions of the stop return Cz to zero.
        let _still = (is_whole && arguments.stay).then(|| clock.hold());
        is_over.set(true);
        with_truth.keep(&clock);
        drop(last);
        reported = report(arguments, &window.summary(), clock.now().since(begun), published.as_ref());
        if is_whole && arguments.stay && reported.is_ok() {
            let stays = format!("the web page stays open at {page} until Enter or Ctrl-C");
            if arguments.json {
                say_beside!("{stays}");
            } else {
                reported = say!("{stays}").map_err(Into::into);
            }
            tokio::select! {
                () = signals.next() => {}
                () = enter() => {}
            }
        }
    };
    let outcome = tokio::select! {
        outcome = gateway.run(over, std::future::pending()) => outcome,
        error = machine.failure() => return Err(error.into()),
        error = draw(arguments, (&with_truth, &clock), (&page, &is_over)) => return Err(error.into()),
    };
    reported?;
    if let Some(mill) = &mut mill {
        mill.has_run_through()?;
    }
    Ok(outcome)
}

/// Waits until the user presses Enter. If standard input ends or fails, waits forever.
async fn enter() {
    let (tell, pressed) = tokio::sync::oneshot::channel();
    std::thread::spawn(move || {
        if std::io::stdin().read_line(&mut String::new()).is_ok_and(|read| read > 0) {
            let _ = tell.send(());
        }
    });
    if pressed.await.is_err() {
        std::future::pending().await
    }
}

/// Returns an error if a CAN interface of the profile is not up. A demo cannot create CAN interfaces.
fn usable(profile: &Profile) -> anyhow::Result<()> {
    let Some(down) = can::inspect(profile).into_iter().find(|interface| !interface.is_up) else {
        return Ok(());
    };
    let can::Inspected { bus, interface, state, advice, .. } = down;
    anyhow::bail!(
        "{} needs a CAN interface, and {interface} is not usable: {state}; {}. To use another interface: \
         --set bus.{bus}.interface=NAME. If `ip` prints \"Unknown device type\", the kernel does not support \
         CAN, as in most containers",
        profile.name,
        advice.join("; ")
    )
}

/// Opens the port of the web page, and returns the address of the page. Without `--listen`, a demo uses any free port
/// if the usual one cannot be opened.
fn open_page(sockets: &mut Sockets, listen: Option<&str>, web: Option<&Web>) -> anyhow::Result<String> {
    // Commands need no token, because a demo moves no real machine.
    let at = |listen: &str| Web { listen: listen.to_owned(), commands: Commands::Local, ..Web::default() };
    if let Some(listen) = listen {
        return sockets.open_page(&at(listen));
    }
    let usual = web.map_or("127.0.0.1:8080", |web| web.listen.as_str());
    sockets.open_page(&at(usual)).or_else(|_| sockets.open_page(&at("127.0.0.1:0")))
}

/// Draws the table until the demo ends. Returns an error if the table cannot be written.
async fn draw(
    arguments: &Arguments,
    (source, clock): (&WithTruth, &Clock),
    (page, is_over): (&str, &Cell<bool>),
) -> std::io::Error {
    let mut table = Table::new(arguments.json, page, arguments.span);
    loop {
        if !is_over.get() {
            source.keep(clock);
            if let Err(error) = table.draw(&source.status(), &source.window.summary()) {
                return error;
            }
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

/// Prints the error ranges of the demo without and with compensation, as text or as JSON.
fn report(
    arguments: &Arguments,
    summary: &Summary,
    span: Duration,
    published: Option<&Published>,
) -> anyhow::Result<()> {
    let axes = &summary.axes;
    let ranges = |axis: &AxisSummary| {
        let ranges = serde_json::json!({
            "uncompensated_range_um": round(axis.uncompensated.range_um()),
            "compensated_range_um": round(axis.compensated.range_um()),
        });
        (axis.axis.clone(), ranges)
    };
    let worst = |range: fn(&AxisSummary) -> f64| round(axes.iter().map(range).fold(0.0, f64::max));
    let report = Report {
        machine: arguments.machine.clone(),
        seed: arguments.seed,
        machine_hours: round(span.as_secs_f64() / 3600.0),
        uncompensated_range_um: worst(|axis| axis.uncompensated.range_um()),
        compensated_range_um: worst(|axis| axis.compensated.range_um()),
        axes: axes.iter().map(ranges).collect(),
    };
    if arguments.json {
        return print_json(&report);
    }
    say!("\n{}, seed {}: {:.1} h of machine time", report.machine, report.seed, report.machine_hours)?;
    for axis in axes {
        let (before, after) = (axis.uncompensated.range_um(), axis.compensated.range_um());
        say!("  {}: error range {before:.1} µm uncompensated, {after:.1} µm compensated", axis.axis)?;
    }
    if arguments.machine == linuxcnc::MACHINE {
        say!(
            "During the demo, LinuxCNC moved Z and cut a part. Only the offset that LinuxCNC applied is part of \
             these figures."
        )?;
    }
    say!("The machine is a simulation. The coefficients were identified on another simulated day.")?;
    published.map(source_lines).into_iter().flatten().try_for_each(|line| say!("{line}"))?;
    Ok(())
}

/// Returns the results that the published source of this machine reports, one line for each axis.
fn source_lines(published: &Published) -> Vec<String> {
    let micron = |value: Option<f64>| value.map_or("not published".to_owned(), |value| format!("{value} µm"));
    let mut lines = vec![format!("Source of the machine: {}", published.text)];
    lines.extend(published.axes.iter().map(|axis| {
        let (before, after) = (micron(axis.uncompensated_um), micron(axis.compensated_um));
        format!("  {}: uncompensated {before}, compensated {after}", axis.name)
    }));
    lines
}

/// Rounds a value in µm to three decimals, that is, to nanometres.
fn round(value: f64) -> f64 {
    (value * 1000.0).round() / 1000.0
}

#[cfg(test)]
mod tests;
