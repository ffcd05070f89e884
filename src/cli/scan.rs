//! `isotherm scan`: lists the units that answer on a bus line, and their registers.

use std::io::{IsTerminal, Write};
use std::time::Duration;

use super::hints::Hints;
use super::print::print_json;
use super::signals::Signals;
use super::target::{self, Line, Target};
use super::values::wrong_arguments;
use crate::cli::print::{say, say_all, say_beside, say_progress};
use crate::clock::Clock;
use crate::discovery::bus::{LineAddress, Parity, ScanKind, ScanReport, Serial, baud};
use crate::discovery::new_connection::NewConnection;
use crate::discovery::register_search::{RegisterRange, walk};
use crate::discovery::remedy::{Question, remedy};
use crate::discovery::scan::{AnswerKind, Event, FailedScan, Responder, Scan};
use crate::discovery::{Exchange, Fault, Register};
use crate::fieldbus::explain::explain_on;
use isotherm_core::quantity::Moment;
use isotherm_profile::{counted, duration_text};

mod text;

/// Requests one register from every unit once, and prints the units that answer. An exception counts as an answer too.
/// Writes nothing. For an OPC UA server it shows the security, users and certificate that the server offers. For this
/// computer it lists the temperatures that its kernel reads.
///
/// Some devices do not answer a request for a register that they do not have. Such a device is found only with another
/// --register.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:\n  isotherm scan --bus tcp://192.168.0.10:502\n  isotherm scan --bus \
                  rtu:///dev/ttyUSB0 --baud 1200,9600,19200 --parity none,even --units 1..32\n  isotherm scan --bus \
                  tcp://192.168.0.10 --units 1 --registers holding:0..199\n  isotherm scan my-machine.toml --bus cell\n  \
                  isotherm scan --bus opc.tcp://192.168.0.12\n  isotherm scan --bus /sys")]
pub(super) struct Arguments {
    #[command(flatten)]
    target: Target,
    /// Unit numbers to scan, both ends included
    #[arg(long, value_name = "FROM..TO", default_value = "1..247", value_parser = target::units)]
    units: (u8, u8),
    /// Register to request from each unit; if several are given, the next one is requested if the previous one gets no
    /// answer
    #[arg(long, value_name = "REGISTER", value_delimiter = ',', default_value = "holding:0")]
    register: Vec<Register>,
    /// Baud rates to try on a serial line, one after the other
    #[arg(long, value_name = "BAUD", value_delimiter = ',', value_parser = baud)]
    baud: Vec<u32>,
    /// Parities to try on a serial line: none, even, odd
    #[arg(long, value_name = "PARITY", value_delimiter = ',')]
    parity: Vec<Parity>,
    /// Also reads these registers of every unit that answers, in steps of 16, and prints the registers that exist
    #[arg(long, value_name = "holding:0..99", value_parser = target::range)]
    registers: Option<(Register, u16)>,
    /// Prints the bytes of each frame on stderr
    #[arg(long)]
    trace: bool,
    /// Prints one JSON document
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> anyhow::Result<()> {
    if arguments.target.bus.is_none() && arguments.target.profile.is_none() {
        return Err(wrong_arguments(
            "give a bus line: --bus tcp://192.168.0.10:502, or a PROFILE with --bus NAME",
        ));
    }
    let line = arguments.target.any(arguments.json)?;
    let has_settings = !arguments.baud.is_empty() || !arguments.parity.is_empty();
    if let ScanKind::Other { scan: Some(scan), .. } = line.address.kind().scan {
        if has_settings {
            return Err(wrong_arguments(
                "--baud and --parity are for a serial line with units: rtu:///dev/ttyUSB0. For a line with text, write \
                 them in its address: ascii:///dev/ttyUSB0?baud=4800&data_bits=7&parity=even",
            ));
        }
        let report = super::runtime::start()?.block_on(scan(&line.bus, arguments.target.timeout));
        let report = report.map_err(|fault| {
            anyhow::anyhow!("{}: {}", line.address, explain_on(line.bus.transport, fault))
        })?;
        return print_report(&line, report, arguments.json);
    }
    line.has_registers()?;
    let is_serial = line.address.serial().is_some();
    if has_settings && !is_serial {
        return Err(wrong_arguments("--baud and --parity are for a serial line: rtu:///dev/ttyUSB0"));
    }
    let scan = Scan {
        lines: settings(&line.address, &arguments.baud, &arguments.parity),
        bus: line.bus.clone(),
        quirks: line.quirks,
        units: arguments.units.0..=arguments.units.1,
        registers: arguments.register.clone(),
        trace: arguments.trace.then_some(print_exchange),
    };
    say_beside!("{}", text::plan(&scan));
    let runtime = super::runtime::start()?;
    let (seen, stopped) = runtime.block_on(async {
        let mut signals = Signals::listen()?;
        let clock = Clock::wall();
        let mut seen = ScanResults::new(&scan, &clock, arguments.json);
        let all = async {
            scan.run(|event| seen.take(event)).await?;
            if let Some(range) = arguments.registers {
                seen.walk(&scan, range).await;
            }
            if seen.found.is_empty() {
                seen.needs = scan.examine().await;
            }
            Ok(())
        };
        let stopped: Option<Option<FailedScan>> = tokio::select! {
            done = all => done.err().map(Some),
            () = signals.next() => Some(None),
        };
        anyhow::Ok((seen, stopped))
    })?;
    clear_line();
    let stopped = stopped.map(|stopped| match stopped {
        None => format!("stopped after {} of {}", seen.asked, counted(scan.questions(), "request")),
        Some(FailedScan { unit, fault }) => {
            let (line, from) = (&scan.lines[0], scan.registers[0]);
            remedy(fault, Question { line, unit, from, count: 1, values: 1, timeout: scan.bus.timeout })
        }
    });
    if arguments.json {
        print_json(&text::document(&scan, &seen, stopped.as_deref()))?;
    } else {
        let bus = line.known.as_ref().map(|(profile, bus)| (profile, *bus));
        say_all!("{}", text::summary(&scan, &seen.found, bus))?;
    }
    match stopped {
        Some(why) => anyhow::bail!(why),
        None if seen.found.is_empty() => match seen.needs {
            Some((unit, needs)) => anyhow::bail!("unit {unit}: {needs}"),
            None => anyhow::bail!(text::nobody(&scan, &seen.noticed)),
        },
        None => Ok(()),
    }
}

/// Prints the result of a scan of a line without registers.
fn print_report(line: &Line, report: ScanReport, json: bool) -> anyhow::Result<()> {
    if json {
        print_json(&report.json)?;
    } else {
        say_all!("{}", report.text)?;
    }
    match report.profile {
        Ok((name, more)) if !json && line.known.is_none() => {
            let lines = line.address.profile_lines();
            Ok(say_all!("\n# for a profile:\n[bus.{name}]\n{lines}{more}")?)
        }
        Err(why) if !json || report.is_empty => anyhow::bail!(why),
        _ => Ok(()),
    }
}

/// Returns the address of the line once for each combination of baud rate and parity to try.
fn settings(line: &LineAddress, bauds: &[u32], parities: &[Parity]) -> Vec<LineAddress> {
    let Some(serial) = line.serial() else { return vec![line.clone()] };
    let bauds = if bauds.is_empty() { &[serial.baud] } else { bauds };
    let parities = if parities.is_empty() { &[serial.parity] } else { parities };
    let each = bauds.iter().flat_map(|baud| parities.iter().map(move |parity| (*baud, *parity)));
    each.map(|(baud, parity)| line.with_serial(|serial| Serial { baud, parity, ..serial })).collect()
}

/// Results of the scan so far.
struct ScanResults {
    found: Vec<(LineAddress, Responder)>,
    /// Faults that show that a device is connected to the line, but do not show its unit number. Each fault
    /// is listed once, with its line.
    noticed: Vec<(LineAddress, Fault)>,
    hints: Hints,
    ranges: Vec<(u8, RegisterRange)>,
    /// Unit that answers only with another connection setting (a pause, or a second request), and its behaviour. `None`
    /// if there is no such unit, or if other units have answered.
    needs: Option<(u8, NewConnection)>,
    /// Number of requests sent. `questions` is the number of all planned requests.
    asked: usize,
    questions: usize,
    several: bool,
    json: bool,
    clock: Clock,
    begun: Moment,
}

impl ScanResults {
    fn new(scan: &Scan, clock: &Clock, json: bool) -> ScanResults {
        let (found, ranges, questions) = (Vec::new(), Vec::new(), scan.questions());
        ScanResults {
            found,
            noticed: Vec::new(),
            hints: Hints::default(),
            ranges,
            needs: None,
            asked: 0,
            questions,
            several: false,
            json,
            clock: clock.clone(),
            begun: clock.now(),
        }
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Line(line) => {
                if self.several || line.serial().is_some() {
                    clear_line();
                    say_beside!("{line}");
                }
                self.several = true;
            }
            Event::Found(line, found) => {
                self.say(&text::found(&line, &found));
                self.found.push((line, found));
            }
            Event::Noticed(line, fault) => {
                let noticed = (line, fault);
                if !self.noticed.contains(&noticed) {
                    let said = text::noticed(&noticed, &mut self.hints);
                    self.say(&said);
                    self.noticed.push(noticed);
                }
            }
            Event::Asked(asked) => {
                self.asked = asked;
                self.show();
            }
        }
    }

    /// Reads `count` registers, beginning with `from`, of every unit that was found. Units with garbled answers are
    /// skipped.
    async fn walk(&mut self, scan: &Scan, (from, count): (Register, u16)) {
        for (line, found) in self.found.clone() {
            if matches!(found.how, AnswerKind::Garbled(_)) {
                continue;
            }
            let unit = found.unit;
            let mut requester = scan.asker(&line);
            let walked = walk(&mut requester, unit, from, count, |range| {
                self.say(&text::range(unit, &range));
                self.ranges.push((unit, range));
            });
            if let Err(fault) = walked.await {
                self.say(&format!("unit {unit}: the other registers of the unit are skipped: {fault}"));
            }
        }
    }

    /// Prints a line of the result, unless the result is printed as JSON. Write errors are ignored, and the scan
    /// continues.
    fn say(&self, line: &str) {
        clear_line();
        if !self.json {
            let _ = say!("{line}");
        }
    }

    /// Redraws the progress line on a terminal.
    fn show(&self) {
        let mut stderr = std::io::stderr();
        if !stderr.is_terminal() {
            return;
        }
        let spent = self.clock.now().since(self.begun);
        let share = self.asked.max(1).min(self.questions);
        let left = spent.mul_f64((self.questions - share) as f64 / share as f64);
        let _ = write!(
            stderr,
            "\r\x1b[K{} of {} requests sent, {} found, about {} left",
            self.asked,
            self.questions,
            self.found.len(),
            duration_text(Duration::from_secs(left.as_secs()))
        );
    }
}

fn print_exchange(exchange: &Exchange) {
    clear_line();
    say_beside!("{exchange}");
}

/// Clears the progress line of a terminal.
fn clear_line() {
    if std::io::stderr().is_terminal() {
        say_progress!("\r\x1b[K");
    }
}
