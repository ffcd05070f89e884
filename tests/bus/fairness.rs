//! A slow device and a readout on one line: the readout does not wait for the whole round of the slow device.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::clock::Clock;
use isotherm::gateway::{Gateway, Options};
use isotherm_core::quantity::Moment;

use crate::support::starved::Starved;

/// Answer time of the slow device.
const SLOW: Duration = Duration::from_millis(100);
/// Requests to the slow device in one round.
const POLLS: usize = 10;

/// Profile. Holding register 10 of unit 2 is the readout, 20 the heartbeat.
const MACHINE: &str = r#"
[machine]
name = "fair"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "3s"
[device.slow]
bus = "cell"
unit = 1
every = "3s"
quirks = { one_request_per_field = true }
[device.scale]
bus = "cell"
unit = 2
every = "50ms"
[signal.position]
device = "scale"
register = "input:0"
type = "i16"
scale = 0.01
unit = "mm"
max_age = "5s"
[axis.z]
limit = 40.0
step = 1.0
rate = 0.5
every = "1s"
on_fault = { action = "hold" }
[[axis.z.model]]
name = "bed"
kind = "linear"
terms = [ { signal = "slow0", gain = 1.0, reference = 0.0 } ]
[output.readout]
axis = "z"
device = "scale"
writes = "corrected"
position = "position"
register = "holding:10"
type = "i16"
scale = 0.01
verify = "echo"
[heartbeat]
device = "scale"
register = "holding:20"
every = "250ms"
"#;

type Seen = Arc<Mutex<Vec<(u8, u16, Moment)>>>;

/// Serves registers that are all 1; unit 1 answers slowly. Records the time of each request.
fn serve(seen: Seen, clock: Clock) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            answer(stream.unwrap(), &seen, &clock);
        }
    });
    address
}

fn answer(mut stream: TcpStream, seen: &Seen, clock: &Clock) {
    let mut request = [0u8; 12];
    while stream.read_exact(&mut request).is_ok() {
        let register = u16::from_be_bytes([request[8], request[9]]);
        if request[6] == 1 {
            std::thread::sleep(SLOW);
        }
        seen.lock().unwrap().push((request[7], register, clock.now()));
        let mut reply = request.to_vec();
        if request[7] < 5 {
            reply.truncate(8);
            reply.extend_from_slice(&[2, 0, 1]);
            reply[5] = 5;
        }
        if stream.write_all(&reply).is_err() {
            return;
        }
    }
}

#[tokio::test]
async fn a_readout_and_a_heartbeat_wait_for_one_request_of_a_slow_device_and_not_for_its_round() {
    let (seen, clock) = (Seen::default(), Clock::wall());
    let address = serve(seen.clone(), clock.clone());
    let slow = (0..POLLS).map(|place| {
        format!(
            "[signal.slow{place}]\ndevice = \"slow\"\nregister = \"input:{}\"\ntype = \"i16\"\nunit = \"degC\"\n\
             max_age = \"10s\"\n",
            10 * place
        )
    });
    let text = MACHINE.replace("ADDRESS", &address.to_string()) + &slow.collect::<String>();
    let loaded = isotherm_profile::parse(Path::new("fair.toml"), &text, &[], &[])
        .unwrap_or_else(|errors| panic!("{errors}"));
    let gateway = Gateway::new(loaded.profile, &clock, Options::default());
    let source = gateway.source();
    let starved = Starved::of(std::process::id());
    let turns = || source.status().buses[0].jitter_ms.iter().map(|(_, count)| count).sum::<u64>();
    // The first write follows the first round, because no value is known before.
    let written = |register: u16| -> Vec<Moment> {
        let seen = seen.lock().unwrap();
        seen.iter().filter(|entry| entry.0 >= 5 && entry.1 == register).map(|entry| entry.2).collect()
    };
    let rounds = || seen.lock().unwrap().iter().filter(|entry| entry.0 < 5 && entry.1 == 90).count();
    // A busy computer needs longer.
    let enough = async {
        tokio::time::sleep(Duration::from_secs(6)).await;
        for _ in 0..1200 {
            if written(10).len() > 15 && written(20).len() > 15 && rounds() >= 2 && turns() > 20 {
                return;
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    gateway.run(enough, std::future::ready(())).await;
    // The limit is the period, one slow answer, and a margin for a busy computer; a whole round takes a second. Time in
    // which gateway and device wait for a processor is not counted.
    let busy = Duration::from_millis(200);
    for (name, register, every) in [("readout", 10, 50), ("heartbeat", 20, 250)] {
        let at = written(register);
        assert!(at.len() > 15, "register {register} was written {} times", at.len());
        let gap =
            |pair: &[Moment]| pair[1].since(pair[0]).saturating_sub(2 * starved.between(pair[0], pair[1]));
        let worst = at.windows(2).map(gap).max().unwrap();
        println!("worst gap of the {name}: {worst:?}");
        assert!(worst < Duration::from_millis(every) + SLOW + busy, "{name}: {worst:?}");
    }
    assert!(rounds() >= 2, "the slow device is read as well: {} rounds", rounds());
    assert!(turns() > 20, "each turn is counted");
}
