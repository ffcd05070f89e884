//! Example: the gateway has no connection to the broker for an hour, and publishes the stored values
//! afterwards. Prints the required disk space and the number of messages.
//!
//! `cargo run --release -p isotherm-plant --example gap`: a hundred temperatures with one value per second each.

use std::error::Error;

use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::{Address, Sparkplug};
use isotherm_plant::store::Store;
use isotherm_plant::{Metric, Publisher, Snapshot, Subject, Value};

const SIGNALS: u32 = 100;
const SECONDS: u32 = 3600;

fn at(second: u32) -> Moment {
    Moment::from_nanos((1_800_000_000 + u64::from(second)) * 1_000_000_000)
}

/// Returns the snapshot at the time `second`, s. Every temperature differs from its value one second before.
fn snapshot(second: u32) -> Snapshot {
    let signal = |number: u32| Metric {
        subject: Subject::Signal(format!("bed-{number}")),
        name: "value",
        value: Some(Value::Real(20.0 + f64::from(second % 100 + number) / 100.0)),
        kind: Value::Real(0.0),
        unit: "°C",
        resolution: 0.01,
        at: at(second),
    };
    Snapshot { metrics: (0..SIGNALS).map(signal).collect(), ..Snapshot::default() }
}

fn main() -> Result<(), Box<dyn Error>> {
    let directory = tempfile::tempdir()?;
    let mut store = Store::open(directory.path(), 1 << 30)?;
    let mut node = Sparkplug::new(Address::new("shop", "grinder-3")?, None, false);
    for second in 0..SECONDS {
        for record in node.absent(at(second), &snapshot(second)) {
            store.push(&record)?;
        }
    }
    let (records, bytes) = (store.len(), store.bytes());
    println!(
        "stored: {records} records, {bytes} bytes, {} bytes per value",
        bytes / u64::from(SIGNALS * SECONDS)
    );

    let will = node.will();
    let birth = node.connected(at(SECONDS), &snapshot(SECONDS));
    let size = birth.first().map_or(0, |birth| birth.payload.len());
    println!("will: {} bytes; birth: {size} bytes", will.payload.len());
    let (mut messages, mut sent) = (0, 0);
    loop {
        let records = store.first(50)?;
        if records.is_empty() {
            break;
        }
        for message in node.forward(at(SECONDS), &records) {
            messages += 1;
            sent += message.payload.len();
        }
        store.drop_first(records.len())?;
    }
    println!("published: {messages} messages, {sent} bytes; {} bytes left on disk", store.bytes());
    let told = node.publish(at(SECONDS + 1), &snapshot(SECONDS + 1));
    println!(
        "a second: {} message, {} bytes",
        told.len(),
        told.iter().map(|one| one.payload.len()).sum::<usize>()
    );
    Ok(())
}
