//! Many devices, each on a separate connection: processor time and memory of the contenders.

use std::path::Path;
use std::time::Duration;

use isotherm::clock::Clock;

use super::devices::{Counts, Devices};
use super::fleet_profile::Work;
use super::{contender, median};

/// Time before the measurement. It excludes connections, the first decisions, and the memory for reading the profile.
const WARM_UP: Duration = Duration::from_secs(5);
/// Turns of each contender, because the speed of a computer changes from minute to minute. Each turn takes half as long
/// as a measurement.
const TURNS: usize = 5;
/// Limit of the processor time with many devices, as a ratio to the tasks of tokio-modbus in the same turns.
const MOST_OF_TOKIO_MODBUS: f64 = 1.0;

/// Limit of processor time.
enum Most {
    Percent(f64),
    /// Multiple of what the reference program in C takes in the same turns.
    Times(f64),
}

/// Results of a contender in one turn.
struct Turn {
    percent: f64,
    memory_mb: f64,
    wakes: f64,
    /// Reads as a share of the expected number; `writes` likewise.
    reads: f64,
    writes: f64,
}

/// Measures fleets of devices with an axis each, and prints the limits.
///
/// A limit is a multiple of the cost of the reference program in C, or a share of a core, and a size of memory. A share
/// of a core alone is not a useful limit. Computers differ by more than the quantity that is judged, and so does one
/// computer within an hour.
pub(super) fn fleets(own: &Path, loops: &Path, span: Duration) {
    println!(
        "\n{:<44}{:>12}{:>12}{:>14}{:>12}",
        "% of a core, MB", "limit in C", "libmodbus", "tokio-modbus", "isotherm"
    );
    let work = |devices, period_ms, reads_only| Work {
        devices,
        period: Duration::from_millis(period_ms),
        reads_only,
    };
    for (name, work, most) in [
        ("100 devices, 10 Hz, read and write", work(100, 100, false), None),
        ("300 devices", work(300, 100, false), None),
        ("500 devices", work(500, 100, false), Some((Most::Times(3.5), 25.0))),
        ("100 devices, read only", work(100, 100, true), None),
        ("300 devices, read only", work(300, 100, true), None),
        ("500 devices, read only", work(500, 100, true), Some((Most::Times(2.1), 25.0))),
        ("1 device, 1 Hz", work(1, 1000, false), Some((Most::Percent(0.1), 8.0))),
    ] {
        let contenders = [(loops, "sockets"), (loops, "threads"), (own, "tasks"), (own, "fleet")];
        let mut turns = contenders.map(|_| Vec::new());
        for _ in 0..TURNS {
            for ((program, mode), turns) in contenders.iter().zip(&mut turns) {
                turns.push(turn((*program, *mode), &work, span / 2));
            }
        }
        say(name, &work, &turns, most);
    }
}

fn turn((program, mode): (&Path, &str), work: &Work, span: Duration) -> Turn {
    let mut devices = Devices::start(&["devices", "5"]);
    let measured = contender(program, mode, &devices.port, &work.words());
    std::thread::sleep(WARM_UP);
    let (before, woken, counted) = (measured.busy(), measured.wakes(), devices.counts());
    let begun = Clock::wall().now();
    std::thread::sleep(span);
    let passed = Clock::wall().now().since(begun).as_secs_f64();
    let percent = 100.0 * (measured.busy() - before) / passed;
    let wakes = (measured.wakes() - woken) as f64 / passed;
    let Counts { reads, writes, .. } = devices.counts();
    let wanted = f64::from(work.devices) * passed / work.period.as_secs_f64();
    Turn {
        percent,
        memory_mb: measured.memory_mb(),
        wakes,
        reads: (reads - counted.reads) as f64 / wanted,
        writes: (writes - counted.writes) as f64 / wanted,
    }
}

fn say(name: &str, work: &Work, turns: &[Vec<Turn>; 4], most: Option<(Most, f64)>) {
    let each = |of: fn(&Turn) -> f64| turns.each_ref().map(|turns| median(turns.iter().map(of)));
    let (percent, memory) = (each(|turn| turn.percent), each(|turn| turn.memory_mb));
    let cells = [0, 1, 2, 3].map(|place| format!("{:.2}, {:.1}", percent[place], memory[place]));
    line(name, cells);
    let shares = each(|turn| 100.0 * turn.reads).into_iter().zip(each(|turn| 100.0 * turn.writes));
    let shares: Vec<String> = shares.map(|(reads, writes)| format!("{reads:.1} and {writes:.1} %")).collect();
    println!("{:<44}{}", "    reads and writes of those wanted", shares.join("; "));
    line("    woken so often a second", each(|turn| turn.wakes).map(|wakes| format!("{wakes:.1}")));
    let reached = |is_reached| if is_reached { "reached" } else { "MISSED" };
    let [limit, _, tokio_modbus, isotherm] = turns;
    // Ratio to the turn of the other program directly before.
    let times_of =
        |other: &[Turn]| median(isotherm.iter().zip(other).map(|(own, other)| own.percent / other.percent));
    if work.devices > 1 {
        let times = times_of(tokio_modbus);
        let verdict = reached(times <= MOST_OF_TOKIO_MODBUS);
        println!("    at most {MOST_OF_TOKIO_MODBUS:.2} of tokio-modbus: {times:.2}, {verdict}");
    }
    let Some((most, most_memory)) = most else { return };
    let core = match most {
        Most::Percent(most) => {
            format!("at most {most} % of a core: {}", reached(percent[3] <= most))
        }
        Most::Times(most) => {
            let times = times_of(limit);
            format!("at most {most} times the limit in C: {times:.2}, {}", reached(times <= most))
        }
    };
    println!("    {core}; at most {most_memory} MB: {}", reached(memory[3] <= most_memory));
}

fn line(what: &str, [limit, libmodbus, tokio_modbus, isotherm]: [String; 4]) {
    println!("{what:<44}{limit:>12}{libmodbus:>12}{tokio_modbus:>14}{isotherm:>12}");
}
