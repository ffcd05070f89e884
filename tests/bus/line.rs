//! Tests of a control that applies K0 + tanβ·(P − P0) itself, and of the level above which a model is rejected. The
//! gateway runs over a real socket. The device records all writes in order.
#![allow(clippy::unwrap_used, reason = "a test may stop where it stands")]

use std::collections::BTreeMap;
use std::io::Write;
use std::net::{SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::gateway::{Options, Pace};
use isotherm::observe::requester::{Channel, Requester};
use isotherm::observe::status::{Answer, Command, GatewayApi};

use crate::support::device;

use device::gateway::{self, wait_until};
use device::server::{self, Question};

const PROFILE: &str = r#"
[machine]
name = "line"
[bus.cell]
type = "modbus-tcp"
address = "ADDRESS"
timeout = "1s"
[device.cnc]
bus = "cell"
unit = 1
every = "25ms"
[signal.bed]
device = "cnc"
register = "holding:0"
type = "i16"
scale = 0.1
unit = "degC"
max_age = "5s"
max_rate = "none"
[signal.scale_y]
device = "cnc"
register = "holding:1"
type = "i16"
scale = 0.01
unit = "mm"
max_age = "5s"
[axis.y]
limit = 40.0
warn = 4.5
error = 60.0
step = 1.0
rate = 100.0
every = "50ms"
on_fault = { action = "zero" }
[[axis.y.model]]
name = "line"
kind = "linear"
terms = [ { signal = "bed", gain = 1.0, reference = 20.0 } ]
slope = { position = "scale_y", reference = -50.0, travel = [-350.0, 0.0], terms = [ { signal = "bed", gain = 0.007, reference = 20.0 } ] }
[output.tan_beta]
axis = "y"
device = "cnc"
writes = "slope"
register = "holding:11"
type = "i16"
scale = 0.001
[output.k0]
axis = "y"
device = "cnc"
writes = "intercept"
register = "holding:10"
type = "i16"
scale = 0.1
[output.p0]
axis = "y"
device = "cnc"
writes = "reference"
register = "holding:12"
type = "i16"
scale = 0.01
"#;

/// Twenty holding registers, and all writes in order.
#[derive(Default)]
struct Bank {
    words: [u16; 20],
    written: Vec<(u16, u16)>,
    /// Numbers of answers of the first connections, the next one last.
    lives: Vec<usize>,
    /// Registers that were written on a connection without a read of them before.
    unseen: Vec<u16>,
    connections: BTreeMap<usize, Life>,
}

/// State of a connection.
#[derive(Default)]
struct Life {
    /// Answers until the connection ends.
    left: usize,
    seen: Vec<u16>,
}

impl Bank {
    fn answer(&mut self, question: &Question) -> (Vec<u8>, bool) {
        let lives = &mut self.lives;
        let begins = || Life { left: lives.pop().unwrap_or(usize::MAX), seen: Vec::new() };
        let life = self.connections.entry(question.connection).or_insert_with(begins);
        life.left -= 1;
        let is_last = life.left == 0;
        let from = question.from();
        if question.is_read() {
            life.seen.extend(from..from + question.count());
            return (question.read(&self.words), is_last);
        }
        let word = question.words()[0];
        self.words[usize::from(from)] = word;
        self.written.push((from, word));
        if !life.seen.contains(&from) {
            self.unseen.push(from);
        }
        (question.done(), is_last)
    }
}

fn serve(bank: &Arc<Mutex<Bank>>) -> SocketAddr {
    let bank = bank.clone();
    server::serve(move |question: &Question, stream: &mut TcpStream| {
        let (answer, is_last) = bank.lock().unwrap().answer(question);
        stream.write_all(&question.answer(&answer))?;
        if is_last { server::hang_up() } else { Ok(()) }
    })
}

/// Runs the gateway together with `script`, which sees its state. The gateway stops when the script ends.
fn beside(bank: &Arc<Mutex<Bank>>, script: impl FnOnce(&dyn GatewayApi) + Send + 'static) {
    with(PROFILE, bank, None, script);
}

/// Runs the gateway with another profile, and optionally with other periods than those of the profile.
fn with(
    text: &str,
    bank: &Arc<Mutex<Bank>>,
    pace: Option<Pace>,
    script: impl FnOnce(&dyn GatewayApi) + Send + 'static,
) {
    let text = text.replace("ADDRESS", &serve(bank).to_string());
    gateway::beside(&text, Options { pace, ..Options::default() }, script);
}

fn signed(word: u16) -> i16 {
    i16::from_be_bytes(word.to_be_bytes())
}

#[test]
fn the_reference_position_comes_first_and_both_parts_walk_to_their_values() {
    let bank = Arc::new(Mutex::new(Bank::default()));
    bank.lock().unwrap().words[0] = 250;
    let seen = bank.clone();
    beside(&bank, move |source| {
        wait_until(source, "K0 and tanβ arrive", |_| {
            let bank = seen.lock().unwrap();
            bank.words[10..13] == [50, 35, 0u16.wrapping_sub(5000)]
        });
        wait_until(source, "it is reported", |status| status.axes[0].warned);
    });
    let bank = bank.lock().unwrap();
    assert_eq!(bank.written[0], (12, 0u16.wrapping_sub(5000)), "{:?}", bank.written);
    for (register, per_count) in [(10, 0.1), (11, 0.001 * 300.0)] {
        let values = bank.written.iter().filter(|(at, _)| *at == register).map(|(_, word)| signed(*word));
        let mut last = 0;
        for value in values {
            assert!(
                f64::from(value - last).abs() * per_count <= 1.0 + 1e-9,
                "{register}: {:?}",
                bank.written
            );
            last = value;
        }
        assert_eq!(last, 0, "stopping takes it to zero");
    }
}

#[test]
fn beyond_the_error_level_the_axis_goes_to_zero_and_stays_off_until_it_is_armed() {
    let bank = Arc::new(Mutex::new(Bank::default()));
    bank.lock().unwrap().words[0] = 250;
    let seen = bank.clone();
    beside(&bank, move |source| {
        let set_bed = |tenths: u16| seen.lock().unwrap().words[0] = tenths;
        wait_until(source, "it follows", |status| status.axes[0].state == "active");
        set_bed(1000);
        wait_until(source, "it is off", |status| {
            !status.axes[0].arming.armed && status.axes[0].state == "off"
        });
        assert_eq!(seen.lock().unwrap().words[10..12], [0, 0]);
        let reported = source.status().event_counts;
        assert_eq!(
            (reported.get("beyond-error"), reported.get("disarmed")),
            (Some(&1), Some(&1)),
            "{reported:?}"
        );
        let arm = || source.command(Command::Arm, None, &Arc::new(Requester::new(Channel::Api, "a test")));
        let why = arm().unwrap_err();
        assert!(why.contains("more than axis.y.error"), "{why}");
        assert!(source.status().event_counts.contains_key("arm-refused"), "it says why not");
        set_bed(250);
        wait_until(source, "it is armed where that can be", |_| matches!(arm(), Ok(Answer::Done(_))));
        wait_until(source, "it follows again", |status| status.axes[0].state == "active");
    });
}

#[test]
fn on_a_line_that_is_never_done_with_its_reads_the_axes_go_on() {
    let bank = Arc::new(Mutex::new(Bank::default()));
    bank.lock().unwrap().words[0] = 250;
    let pace = Pace { polls: Duration::from_micros(1), axes: Duration::from_millis(50) };
    let seen = bank.clone();
    with(PROFILE, &bank, Some(pace), move |source| {
        wait_until(source, "K0 and tanβ arrive", |_| seen.lock().unwrap().words[10..12] == [50, 35]);
    });
}

#[test]
fn on_a_connection_that_is_new_a_register_is_read_before_it_is_written_also_where_the_echo_is_enough() {
    let bank = Arc::new(Mutex::new(Bank { lives: vec![8, 7], ..Bank::default() }));
    bank.lock().unwrap().words[0] = 250;
    let text = PROFILE.replace("writes = ", "verify = \"echo\"\nwrites = ");
    let seen = bank.clone();
    with(&text, &bank, None, move |source| {
        wait_until(source, "K0 and tanβ arrive", |_| seen.lock().unwrap().words[10..12] == [50, 35]);
    });
    let bank = bank.lock().unwrap();
    assert!(bank.unseen.is_empty(), "{:?}: {:?}", bank.unseen, bank.written);
}
