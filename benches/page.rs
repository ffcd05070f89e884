//! Benchmark of the web page in a real browser: first paint, first figures, number and size of the loaded files.
//!
//! The page comes from a running demo on this computer, once for each view and run, with an empty cache. It prints the
//! medians, and has no limit: they depend on the browser and the computer.
//!
//! Run it with `cargo bench --bench page`. An argument sets the number of runs of each view. It requires chromium and
//! python3 (`tests/run page`).

#![allow(clippy::unwrap_used, reason = "a bench that cannot go on fails")]

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

const RUNS: usize = 7;
/// First paint of content and first figures in ms since the request, files, and their size in kB with headers.
const MEASURES: &str = "print:(() => { \
    const [paint] = performance.getEntriesByName('first-contentful-paint'); \
    const [figures] = performance.getEntriesByName('figures'); \
    if (!paint || !figures) return null; \
    const files = performance.getEntriesByType('resource').filter(({ name }) => !name.includes('/api/')); \
    const all = [...performance.getEntriesByType('navigation'), ...files]; \
    const size = all.reduce((sum, { transferSize }) => sum + transferSize, 0) / 1000; \
    return [paint.startTime, figures.startTime, all.length, size].join(' '); })()";

/// Running demo, which is killed when this value is dropped.
struct Demo {
    program: Child,
    address: String,
}

impl Demo {
    fn start() -> Demo {
        let mut command = Command::new(env!("CARGO_BIN_EXE_isotherm"));
        command.args(["demo", "--listen", "127.0.0.1:0", "--speed", "600", "--for", "240h"]);
        let mut program = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(program.stdout.take().unwrap()).lines();
        let address = lines.find_map(|line| Some(line.unwrap().trim().strip_prefix("page  ")?.to_owned()));
        // The demo continues to print, and must not wait for a reader.
        std::thread::spawn(move || lines.take_while(Result::is_ok).for_each(drop));
        Demo { program, address: address.unwrap() }
    }
}

impl Drop for Demo {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

fn main() {
    let runs = std::env::args().skip(1).find(|word| word != "--bench");
    let runs = runs.map_or(RUNS, |runs| runs.parse().unwrap()).max(1);
    let demo = Demo::start();
    println!("{:<8}{:>16}{:>18}{:>8}{:>8}", "view", "first paint, ms", "first figures, ms", "files", "kB");
    for (name, view) in [("page", "/"), ("wall", "/?view=wall")] {
        let mut found: Vec<[f64; 4]> =
            (0..runs).map(|_| measure(&format!("{}{view}", demo.address))).collect();
        let [paint, figures, files, size] = [0, 1, 2, 3].map(|place| {
            found.sort_by(|one, other| one[place].total_cmp(&other[place]));
            found[found.len() / 2][place]
        });
        println!("{name:<8}{paint:>16.0}{figures:>18.0}{files:>8.0}{size:>8.0}");
    }
}

/// Measures the page at this address in a new browser.
fn measure(address: &str) -> [f64; 4] {
    let look = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/interop/look.py");
    let seen = Command::new("python3").args([look, address, "Axis z", MEASURES]).output();
    let seen = seen.unwrap_or_else(|error| panic!("no python3 ({error}): `tests/run page` installs it"));
    let text = String::from_utf8_lossy(&seen.stdout);
    let said = String::from_utf8_lossy(&seen.stderr);
    let first = text.lines().next().unwrap_or_default();
    let figures: Vec<f64> = first.split(' ').filter_map(|figure| figure.parse().ok()).collect();
    figures.try_into().unwrap_or_else(|_| panic!("{text}\n{said}\n(without chromium: `tests/run page`)"))
}
