//! Controls and displays from their templates, end to end: the raw registers on the wire.

use std::time::Duration;

use isotherm::observe::status::Command;
use isotherm::virtual_machine::SeenRequest;
use isotherm_core::output::ControlWord;

use crate::faults::law;
use crate::faults::rig::{Trace, World, block_on, run};

const MINUTE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);

const BREAKS: &str =
    "[[fault]]\ndevice = \"thermocouples\"\nkind = \"sentinel\"\nsignal = \"bed\"\nat = \"60s\"\n";

/// Profile with a thermocouple module, a control from a template, and axes that follow the bed.
fn machine(control: &str, axes: &[&str], more: &str) -> String {
    let mut text = format!(
        r#"
[machine]
name = "bench"
[bus.sensors]
type = "modbus-tcp"
address = "127.0.0.1:1502"
timeout = "100ms"
[bus.control]
type = "modbus-tcp"
address = "127.0.0.1:1503"
timeout = "100ms"
[device.thermocouples]
bus = "sensors"
unit = 1
template = "icp-das-m7018"
[device.scale]
bus = "sensors"
unit = 2
every = "500ms"
[device.cnc]
bus = "control"
unit = 1
{control}
[signal.bed]
device = "thermocouples"
channel = 0
max_age = "5s"
max_rate = "none"
[signal.scale_z]
device = "scale"
register = "holding:84"
type = "i32"
word_order = "lsw-first"
scale = 0.0005
unit = "mm"
max_age = "2s"
"#
    );
    for axis in axes {
        let sign = if *axis == "x" { "-" } else { "" };
        text += &format!(
            r#"
[axis.{axis}]
limit = 40.0
step = 1.0
rate = 1.0
every = "2s"
on_fault = {{ action = "ramp", after = "5s" }}
[[axis.{axis}.model]]
name = "bed"
kind = "linear"
offset = {sign}8.0
terms = [{{ signal = "bed", gain = {sign}2.0, reference = 21.0 }}]
"#
        );
    }
    text + more
}

fn outputs(channels: &[(&str, &str)]) -> String {
    let one = |(axis, channel): &(&str, &str)| {
        format!("[output.cnc_{channel}]\naxis = \"{axis}\"\ndevice = \"cnc\"\nchannel = \"{channel}\"\n")
    };
    channels.iter().map(one).collect()
}

/// Writes to the control, in their order.
fn written(trace: &Trace) -> Vec<&SeenRequest> {
    let cnc = trace.profile.devices.iter().position(|device| device.name == "cnc");
    trace.wire.iter().filter(|seen| seen.is_write() && Some(seen.device.0) == cnc).collect()
}

fn signed(words: &[u16]) -> i32 {
    i32::from_be_bytes([words[0].to_be_bytes(), words[1].to_be_bytes()].concat().try_into().unwrap())
}

fn real(words: &[u16]) -> f32 {
    f32::from_be_bytes([words[0].to_be_bytes(), words[1].to_be_bytes()].concat().try_into().unwrap())
}

/// Blocks that were written. Checks that each is one request, heartbeat and sequence count, the version is constant,
/// and the check word fits.
fn blocks(trace: &Trace, base: u16) -> Vec<&SeenRequest> {
    let blocks = written(trace);
    assert!(blocks.len() > 60, "{}", blocks.len());
    for (place, seen) in blocks.iter().enumerate() {
        assert_eq!(
            (seen.function, seen.address.register().unwrap().offset, seen.count),
            (16, base, 11),
            "{seen:?}"
        );
        let count = u16::try_from(place + 1).unwrap();
        assert_eq!((seen.wanted[0], seen.wanted[2], seen.wanted[3]), (count, 1, count), "{seen:?}");
        let sum = seen.wanted[..10].iter().fold(0u16, |sum, word| sum.wrapping_add(*word));
        assert_eq!(seen.wanted[10], !sum, "{seen:?}");
    }
    blocks
}

#[test]
fn a_plc_is_given_its_block_in_one_request_a_second_with_heartbeat_control_and_check_word() {
    let text = machine(
        "template = \"plc-block\"\nbase = 100",
        &["x", "y", "z"],
        &outputs(&[("x", "x"), ("y", "y"), ("z", "z")]),
    );
    let trace = run(&text, BREAKS, 2 * MINUTE);
    law::holds(&trace);
    law::nothing_taken_jumps(&trace);
    let blocks = blocks(&trace, 100);
    let controls: Vec<u16> = blocks.iter().map(|seen| seen.wanted[1]).collect();
    let mut words = controls.clone();
    words.dedup();
    let enabled = ControlWord::ENABLE;
    let faulty = enabled | ControlWord::FAULT;
    // The heartbeat begins with the first good reading, which may be one turn before the axes are armed.
    let words = words.strip_prefix(&[0]).unwrap_or(&words);
    // The last word reports that nothing is armed any more.
    assert_eq!(words, [enabled, faulty | ControlWord::HOLD, faulty, ControlWord::FAULT], "{}", trace.lines());
    let high = blocks.iter().map(|seen| signed(&seen.wanted[8..10])).max().unwrap();
    for seen in &blocks {
        let [x, y, z] = [4, 6, 8].map(|at| signed(&seen.wanted[at..at + 2]));
        assert_eq!((x, y), (-z, z), "half a block: {seen:?}");
    }
    assert!(high > 50, "in tenths of a µm: {high}");
    let last = blocks.last().unwrap();
    assert_eq!(signed(&last.wanted[8..10]), 0, "ramped to zero");
    let silence = blocks.windows(2).map(|pair| pair[1].at.since(pair[0].at)).max().unwrap();
    assert!(silence < Duration::from_secs(2), "the heartbeat stood still for {silence:?}");
}

fn plc(arm: &str) -> String {
    let text = machine("template = \"plc-block\"\nbase = 100", &["z"], &outputs(&[("z", "z")]));
    text.replace("name = \"bench\"", &format!("name = \"bench\"\narm = \"{arm}\""))
}

#[test]
fn the_heartbeat_of_a_set_goes_on_while_its_axis_is_off_and_its_control_word_says_so() {
    let text = plc("manual");
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        let trial = world.gateway().command(10 * SECOND, Command::Arm);
        let trial = trial.command(40 * SECOND, Command::Disarm).command(70 * SECOND, Command::Arm);
        trial.run(2 * MINUTE).await
    });
    law::holds(&trace);
    let blocks = blocks(&trace, 100);
    let at = |seen: &SeenRequest| trace.seconds(seen.at);
    assert!(at(blocks[0]) >= 10.0, "nothing before a person arms: {:?}", blocks[0]);
    let silence = blocks.windows(2).map(|pair| pair[1].at.since(pair[0].at)).max().unwrap();
    assert!(silence < Duration::from_millis(1500), "the heartbeat stood still for {silence:?}");
    let within = |from: f64, to: f64| blocks.iter().filter(move |seen| (from..to).contains(&at(seen)));
    assert!(within(41.0, 69.0).count() > 25, "while it is off");
    assert!(within(41.0, 69.0).all(|seen| seen.wanted[1] & ControlWord::ENABLE == 0));
    let off: std::collections::BTreeSet<_> =
        within(41.0, 69.0).map(|seen| seen.wanted[8..10].to_vec()).collect();
    assert_eq!(off.len(), 1, "what stands there goes along: {off:?}");
    assert!(within(72.0, 119.0).all(|seen| seen.wanted[1] & ControlWord::ENABLE != 0));
    assert_eq!(blocks.last().unwrap().wanted[1] & ControlWord::ENABLE, 0, "at the end nothing is armed");
}

#[test]
fn a_dry_run_sends_no_heartbeat_in_a_set() {
    let text = plc("auto");
    let trace = block_on(async {
        let mut world = World::new(&text, "").await;
        world.gateway().options(|options| options.dry_run = true).run(MINUTE).await
    });
    assert_eq!(written(&trace).len(), 0);
}

#[test]
fn a_set_with_an_open_interlock_goes_along_as_it_stands() {
    let text = plc("auto").replace(
        "[output.cnc_z]",
        "[signal.ready]\ndevice = \"scale\"\nregister = \"holding:90\"\ntype = \"u16\"\nunit = \"bool\"\nmax_age = \"3s\"\n\
         [output.cnc_z]\nwhen = \"ready == 1\"",
    );
    let ready = |value: u16, at: u64| {
        let keys = "device = \"scale\"\nkind = \"value\"\nsignal = \"ready\"";
        format!("[[fault]]\n{keys}\nvalue = {value}.0\nat = \"{at}s\"\nfor_time = \"30s\"\n")
    };
    let trace = run(&text, &(ready(1, 0) + &ready(0, 30) + &ready(1, 60)), 90 * SECOND);
    assert_eq!((trace.reported("interlocked"), trace.reported("released")), (1, 1), "{}", trace.lines());
    law::holds(&trace);
    let blocks = blocks(&trace, 100);
    let silence = blocks.windows(2).map(|pair| pair[1].at.since(pair[0].at)).max().unwrap();
    assert!(silence < Duration::from_millis(1500), "the heartbeat stood still for {silence:?}");
    let held = blocks.iter().filter(|seen| (32.0..59.0).contains(&trace.seconds(seen.at)));
    let held: std::collections::BTreeSet<_> = held.map(|seen| seen.wanted[8..10].to_vec()).collect();
    assert_eq!(held.len(), 1, "{held:?}\n{}", trace.lines());
}

#[test]
fn a_plc_with_one_axis_is_given_zeros_for_the_others() {
    let text = machine("template = \"plc-block\"\nbase = 100", &["z"], &outputs(&[("z", "z")]));
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    for seen in blocks(&trace, 100) {
        assert_eq!(seen.wanted[4..8], [0; 4], "{seen:?}");
    }
    assert_eq!(trace.states(), ["waiting", "active"], "{}", trace.lines());
}

#[test]
fn a_fanuc_server_is_sent_functions_03_and_16_alone() {
    let text = machine("template = \"fanuc-modbus-server\"\nbase = 1000", &["z"], &outputs(&[("z", "z")]));
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    blocks(&trace, 1000);
    let functions: std::collections::BTreeSet<u8> = trace
        .wire
        .iter()
        .filter(|seen| trace.profile.device(seen.device).name == "cnc")
        .map(|seen| seen.function)
        .collect();
    assert_eq!(functions, [3, 16].into());
}

#[test]
fn a_sinumerik_is_given_the_parts_of_its_line_as_real_numbers_in_millimetres() {
    let slope = "slope = { position = \"scale_z\", reference = 100.0, travel = [0.0, 300.0], terms = [\n\
                 { signal = \"bed\", gain = 0.05, reference = 21.0 } ] }";
    let parts = [("z", "intercept"), ("z", "slope"), ("z", "reference")];
    let text =
        machine("template = \"sinumerik-plc\"\nbase = 0", &["z"], "") + slope + "\n" + &outputs(&parts);
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    let blocks = blocks(&trace, 0);
    // Before the axis is armed, all members are written with their present values.
    let stands = |words: &[u16]| real(words) == 0.0;
    let armed = blocks.iter().skip_while(|seen| stands(&seen.wanted[4..6]) && stands(&seen.wanted[8..10]));
    for seen in armed {
        let [k0, slope, reference] = [4, 6, 8].map(|at| real(&seen.wanted[at..at + 2]));
        assert!(k0.abs() <= 0.040 && slope.abs() <= 0.040 / 200.0, "{k0} mm, {slope}");
        assert!((reference - 100.0).abs() < 1e-6, "{reference} mm");
    }
    let most = blocks.iter().map(|seen| real(&seen.wanted[4..6]).abs()).fold(0.0, f32::max);
    assert!(most > 0.005, "K0 came to {most} mm");
    assert!(blocks.iter().any(|seen| real(&seen.wanted[6..8]).abs() > 1e-6), "tanβ was never anything");
}

#[test]
fn a_heidenhain_control_is_given_whole_micrometres_one_at_a_time_and_one_a_second() {
    let text = machine("template = \"heidenhain-tnc-words\"\nbase = 576", &["z"], &outputs(&[("z", "z")]))
        .replace("every = \"2s\"\non_fault", "every = \"1s\"\non_fault");
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    let words: Vec<_> = written(&trace);
    assert!(words.len() > 5, "{}", words.len());
    let mut before: Option<(i16, isotherm_core::quantity::Moment)> = None;
    for seen in words {
        assert_eq!((seen.address.register().unwrap().offset, seen.count), (578, 1), "W580: {seen:?}");
        let micron = i16::from_be_bytes(seen.wanted[0].to_be_bytes());
        if let Some((last, at)) = before {
            assert!((micron - last).abs() <= 1, "{last} → {micron} µm");
            assert!(seen.at.since(at) >= Duration::from_millis(900), "{:?}", seen.at.since(at));
        }
        before = Some((micron, seen.at));
    }
}

#[test]
fn linuxcnc_is_given_words_around_32768_that_never_wrap() {
    let heartbeat = "[heartbeat]\ndevice = \"cnc\"\nevery = \"500ms\"\n";
    let text = machine(
        "template = \"linuxcnc-classicladder\"",
        &["x", "z"],
        &(outputs(&[("x", "x"), ("z", "z")]) + heartbeat),
    );
    let trace = run(&text, "", 2 * MINUTE);
    law::holds(&trace);
    let of = |register| {
        written(&trace).into_iter().filter(move |seen| seen.address.register().unwrap().offset == register)
    };
    let (x, z): (Vec<u16>, Vec<u16>) =
        (of(0).map(|seen| seen.wanted[0]).collect(), of(2).map(|seen| seen.wanted[0]).collect());
    assert!(x.iter().all(|word| (32768 - 400..=32768).contains(word)), "X goes below: {x:?}");
    assert!(z.iter().all(|word| (32768..=32768 + 400).contains(word)), "Z goes above: {z:?}");
    assert!(z.iter().any(|word| *word > 32768 + 50) && x.iter().any(|word| *word < 32768 - 50));
    assert!(trace.beats().len() > 200, "%W4 counts");
    assert_eq!(trace.profile.heartbeat.as_ref().unwrap().address.to_string(), "holding:3 (40004)");
}

/// Profile with a display of the corrected position.
fn display(template: &str) -> String {
    let output =
        "[output.readout]\naxis = \"z\"\ndevice = \"cnc\"\nchannel = \"value\"\nposition = \"scale_z\"\n";
    machine(&format!("template = \"{template}\""), &["z"], output)
}

#[test]
fn a_ditel_display_shows_value_point_and_colour_in_one_request_red_on_a_fault_and_dashes_when_stale() {
    let silent = "[[fault]]\ndevice = \"scale\"\nkind = \"silent\"\nat = \"90s\"\nfor_time = \"15s\"\n";
    let trace = run(&display("ditel-dn-nb"), &format!("{BREAKS}{silent}"), 2 * MINUTE);
    law::holds(&trace);
    let written = written(&trace);
    let values: Vec<&&SeenRequest> =
        written.iter().filter(|seen| seen.address.register().unwrap().offset == 10).collect();
    assert!(values.len() > 150, "{}", values.len());
    for seen in &values {
        assert_eq!((seen.function, seen.count, seen.wanted[2]), (16, 4, 0x0200), "{seen:?}");
        assert!((10_000..=26_000).contains(&signed(&seen.wanted)), "hundredths of a mm: {seen:?}");
        let colour = if trace.seconds(seen.at) < 60.0 { [0x3134, 0x3134] } else { [0x3034, 0x3134] };
        assert!(
            colour.contains(&seen.wanted[3]),
            "{:04x} at {:.1} s",
            seen.wanted[3],
            trace.seconds(seen.at)
        );
    }
    let red = |from: f64, to: f64| {
        let within = values.iter().filter(|seen| (from..to).contains(&trace.seconds(seen.at)));
        within.map(|seen| seen.wanted[3]).all(|colour| colour == 0x3034)
    };
    assert!(red(66.0, 118.0), "red from the fault on\n{}", trace.lines());
    let dashes: Vec<&&SeenRequest> =
        written.iter().filter(|seen| seen.address.register().unwrap().offset == 0).collect();
    assert!(dashes.iter().all(|seen| seen.wanted == [0x2d2d, 0x2d2d]), "{dashes:?}");
    let stale = dashes.iter().filter(|seen| (91.0..106.0).contains(&trace.seconds(seen.at))).count();
    assert!((1..=3).contains(&stale), "{stale} times dashes while the scale is silent");
    let late = values.iter().filter(|seen| (94.0..104.0).contains(&trace.seconds(seen.at))).count();
    assert_eq!(late, 0, "no value over the dashes");
    assert!(values.iter().any(|seen| trace.seconds(seen.at) > 107.0), "the value comes back");
}

/// -3270 with two decimals is FF FF F3 3A 02 00, as in the manual of the display.
#[test]
fn the_example_of_the_displays_manual_is_what_is_encoded() {
    let machine = crate::faults::rig::profile(&display("ditel-dn-nb"));
    let output = &machine.outputs[0];
    assert_eq!(output.encoding.encode(-32.70).registers(), [0xffff, 0xf33a]);
    assert_eq!((output.display.beside[0].register, output.display.beside[0].good), (12, 0x0200));
    let finer = display("ditel-dn-nb").replace("channel = \"value\"", "channel = \"value\"\nscale = 0.001");
    assert_eq!(
        crate::faults::rig::profile(&finer).outputs[0].display.beside[0].good,
        0x0300,
        "three decimals"
    );
}

#[test]
fn a_dm36_display_is_given_sign_decimals_and_digits() {
    let silent = "[[fault]]\ndevice = \"scale\"\nkind = \"silent\"\nat = \"30s\"\nfor_time = \"15s\"\n";
    let trace = run(&display("dm36b06"), silent, MINUTE);
    law::holds(&trace);
    let written = written(&trace);
    let values: Vec<&&SeenRequest> =
        written.iter().filter(|seen| seen.address.register().unwrap().offset == 6).collect();
    assert!(values.len() > 50, "{}", values.len());
    for seen in values {
        assert_eq!(
            (seen.function, seen.count, seen.wanted[0] >> 8),
            (16, 2, 0x03),
            "plus, three decimals: {seen:?}"
        );
        let digits = u32::from(seen.wanted[0] & 0xff) << 16 | u32::from(seen.wanted[1]);
        assert!((100_000..=260_000).contains(&digits), "{digits}");
    }
    let dashes = written.iter().find(|seen| seen.address.register().unwrap().offset == 0).unwrap();
    assert_eq!(dashes.wanted, [0x2d; 6], "while the scale is silent");
}

#[test]
fn linuxcnc_with_plain_zeros_in_its_words_is_not_armed_and_the_count_to_put_there_is_reported() {
    let heartbeat = "[heartbeat]\ndevice = \"cnc\"\nevery = \"500ms\"\n";
    let outputs = outputs(&[("z", "z")]) + heartbeat;
    let text = machine("template = \"linuxcnc-classicladder\"", &["z"], &outputs);
    let zero = "[[fault]]\ndevice = \"cnc\"\nkind = \"register\"\nregister = \"holding:2\"\nwords = [0]\nat = \"0s\"\n";
    let trace = run(&text, zero, MINUTE);
    law::holds(&trace);
    assert_eq!((trace.states(), trace.writes("cnc_z").len()), (vec!["waiting"], 0), "{}", trace.lines());
    let refused = trace.events.iter().find(|event| event.kind == "arm-refused").unwrap();
    for words in ["holds -3276.8 µm", "set the register to zero (register value 32768)"] {
        assert!(refused.text.contains(words), "`{words}` is not in: {}", refused.text);
    }
}
