//! Reading of registers that need no signal in the profile: one register, or several consecutive ones. The output shows
//! the registers as read, and the value decoded in different ways.

use std::io::Write;
use std::time::Duration;

use crate::cli::print::print_json;
use crate::cli::print::{Out, say, say_beside};
use crate::cli::target::{Line, Target};
use crate::cli::values;
use crate::cli::values::wrong_arguments;
use crate::clock::Clock;
use crate::discovery::new_connection::examine;
use crate::discovery::remedy::{Question, remedy};
use crate::discovery::unit_reader::{Trace, UnitReader};
use crate::discovery::values::{RegisterValue, ValueFormat};
use crate::discovery::{DataType, Exchange, Fault, PeerFault, Register, WordOrder};

/// Maximum number of registers in one Modbus request. [`MOST_BITS`] is the maximum number of bits.
const MOST_REGISTERS: u16 = 125;
const MOST_BITS: u16 = 2000;

/// Options for the registers to read, and for decoding them.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "One register, without a signal")]
pub(in crate::cli) struct One {
    /// The first register or bit: holding:100, input:0, coil:3, discrete:3, or a Modicon number such as 40101
    #[arg(long, value_name = "REGISTER")]
    register: Option<Register>,
    /// The Modbus unit number
    #[arg(long, value_name = "UNIT", conflicts_with = "device", requires = "register")]
    unit: Option<u8>,
    /// A device of the profile; its line and unit number are used
    #[arg(long, value_name = "DEVICE", requires_all = ["register", "profile"], conflicts_with = "bus")]
    device: Option<String>,
    /// bool, u16, i16, u32, i32, u64, i64, f32, f64, u24, i24, bcd16, bcd32, sm16, sm32 [default: u16, and also i16 if
    /// that differs]
    #[arg(long = "type", value_name = "TYPE", value_parser = data_type, requires = "register")]
    data_type: Option<DataType>,
    /// msw-first or lsw-first [default: both, for values of several registers]
    #[arg(long, value_name = "ORDER", value_parser = word_order, requires = "register")]
    word_order: Option<WordOrder>,
    /// Swaps the two bytes of every register
    #[arg(long, requires = "register")]
    byte_swap: bool,
    /// Number of values to read
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=2000), requires = "register")]
    count: u16,
    /// Engineering units per count (value = count · scale + offset)
    #[arg(long, value_name = "UNITS", default_value = "1", value_parser = scale, allow_negative_numbers = true, requires = "register")]
    scale: f64,
    /// Engineering value of the raw value zero
    #[arg(long, value_name = "UNITS", default_value = "0", value_parser = finite, allow_negative_numbers = true, requires = "register")]
    offset: f64,
    /// With --watch: interval between reads
    #[arg(long, value_name = "SPAN", default_value = "1s", value_parser = humantime::parse_duration, requires = "watch")]
    every: Duration,
    /// Prints the bytes of each frame on stderr
    #[arg(long, requires = "register")]
    trace: bool,
}

fn data_type(text: &str) -> Result<DataType, String> {
    let others = [
        DataType::unsigned(24),
        DataType::signed(24),
        DataType::Bcd(4),
        DataType::Bcd(8),
        DataType::SignMagnitude(16),
        DataType::SignMagnitude(32),
    ];
    let types = || DataType::ALL.into_iter().chain(others);
    let names = || types().map(DataType::name).collect::<Vec<_>>().join(", ");
    types().find(|known| known.name() == text).ok_or_else(|| format!("allowed: {}", names()))
}

fn word_order(text: &str) -> Result<WordOrder, String> {
    let orders = [WordOrder::MswFirst, WordOrder::LswFirst];
    let known = orders.into_iter().find(|known| known.to_string() == text);
    known.ok_or_else(|| "allowed: msw-first, lsw-first".to_owned())
}

fn finite(text: &str) -> Result<f64, String> {
    values::number(text, |_| true, "write a number, such as 0.1")
}

fn scale(text: &str) -> Result<f64, String> {
    let number = finite(text)?;
    if number.abs() > 0.0 {
        Ok(number)
    } else {
        Err("a scale of 0 makes every value the same: write another scale".to_owned())
    }
}

impl One {
    pub(in crate::cli) fn is_asked_for(&self) -> bool {
        self.register.is_some()
    }

    fn form(&self) -> ValueFormat {
        let One { data_type, word_order, byte_swap, scale, offset, .. } = *self;
        ValueFormat { data_type, word_order, byte_swap, scale, offset }
    }
}

/// Returns the bus line and the unit number that the arguments name.
fn line(target: &Target, one: &One, json: bool) -> anyhow::Result<(Line, u8)> {
    let Some(name) = &one.device else {
        if target.bus.is_none() {
            return Err(wrong_arguments(
                "--register needs a unit number: --bus tcp://HOST --unit 1, or a PROFILE with --device NAME",
            ));
        }
        let Some(unit) = one.unit else {
            return Err(wrong_arguments(match target.is_at_a_server() {
                true => "an OPC UA server has nodes, not registers: replace --register with --browse",
                false => "--unit is missing: the Modbus unit, often 1",
            }));
        };
        return Ok((target.find(json)?, unit));
    };
    let Some(profile) = target.load(json)? else { return Err(wrong_arguments("--device needs a PROFILE")) };
    let device = profile.devices.iter().find(|device| device.name == *name).cloned().ok_or_else(|| {
        let known: Vec<&str> = profile.devices.iter().map(|device| device.name.as_str()).collect();
        anyhow::anyhow!("the profile has no device `{name}`; it has: {}", known.join(", "))
    })?;
    let line = Target::of(profile, device.bus, target.timeout)?;
    Ok((Line { quirks: device.quirks, ..line }, device.unit))
}

pub(super) fn run(target: &Target, one: &One, watch: bool, json: bool) -> anyhow::Result<()> {
    let Some(from) = one.register else { return Ok(()) };
    let form = one.form();
    let is_bits = from.table.is_bits();
    if is_bits && one.data_type.is_some_and(|known| known != DataType::Bool) {
        return Err(wrong_arguments(format!("{from} is a single bit: leave --type out")));
    }
    let most = if is_bits { MOST_BITS } else { MOST_REGISTERS };
    let count = u32::from(one.count) * u32::from(form.registers());
    let Some(count) = u16::try_from(count).ok().filter(|count| *count <= most) else {
        return Err(wrong_arguments(format!(
            "at most {} values of this type fit into one request",
            most / form.registers()
        )));
    };
    if u32::from(from.offset) + u32::from(count) > 65_536 {
        return Err(wrong_arguments(format!(
            "{count} registers from {from} exceed the last register, 65535"
        )));
    }
    let (line, unit) = line(target, one, json)?;
    let (values, timeout) = (one.count, line.bus.timeout);
    let question = Question { line: &line.address, unit, from, count, values, timeout };
    let trace = one.trace.then_some(print_exchange as Trace);
    let mut requester = UnitReader::new(&line.address, &line.bus, line.quirks, trace);
    crate::cli::runtime::start()?.block_on(async {
        let clock = Clock::wall();
        let begun = clock.now();
        loop {
            let mut answer = requester.read(unit, from, count).await;
            let is_echoed = requester.has_come_back();
            let needs = match answer {
                Err(Fault::Timeout) if !watch => {
                    requester.hang_up();
                    examine(&line.address, &line.bus, line.quirks, unit, (from, count)).await
                }
                _ => None,
            };
            if answer == Err(Fault::Timeout) && is_echoed {
                answer = Err(Fault::Peer(PeerFault::Echoed));
            }
            let values = answer.map(|answer| form.values(from, &answer)).map_err(|fault| match needs {
                Some(needs) => format!("unit {unit}: {needs}"),
                None => remedy(fault, question),
            });
            let now = watch.then(|| clock.time_of_day().to_string());
            let why = values.as_ref().err();
            if json {
                let document = serde_json::json!({
                    "now": now, "bus": line.address.to_string(), "unit": unit, "values": values.as_ref().ok(), "fault": why,
                });
                if watch { say!("{document}")? } else { print_json(&document)? }
            } else {
                print(&values, &form, now.as_deref())?;
            }
            if !watch {
                return values.map(|_| ()).map_err(anyhow::Error::msg);
            }
            let next = clock.now().next_tick(begun, one.every.max(Duration::from_millis(10)));
            tokio::time::sleep(next.since(clock.now())).await;
        }
    })
}

fn print_exchange(exchange: &Exchange) {
    say_beside!("{exchange}");
}

/// Prints the result of one read. With `--watch`, `now` is the time of the read, and an error is printed without ending
/// the verb.
fn print(
    values: &Result<Vec<RegisterValue>, String>,
    form: &ValueFormat,
    now: Option<&str>,
) -> std::io::Result<()> {
    let mut out = Out;
    if let Some(now) = now {
        writeln!(out, "{now}")?;
    }
    match values {
        Ok(values) => {
            let width = values.iter().map(|value| value.register.len()).max().unwrap_or(0);
            for RegisterValue { register, modicon, raw, readings } in values {
                let read = readings
                    .iter()
                    .map(|read| format!("{} {}", read.way, read.value).trim_start().to_owned());
                let read: Vec<String> = read.collect();
                writeln!(out, "  {register:<width$} ({modicon})  {raw}  {}", read.join("   "))?;
            }
            if form.lacks_order() && now.is_none() {
                say_beside!(
                    "no word order was given, and values of 32 and 64 bits have no default: add --word-order"
                );
            }
        }
        // A single reading ends with its error, which the verb prints.
        Err(why) if now.is_some() => writeln!(out, "  {why}")?,
        Err(_) => {}
    }
    out.flush()
}
