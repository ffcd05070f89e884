//! Load of each line, as `check` reports it in advance.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use super::*;
use crate::can::{LATHE, lathe};
use isotherm_profile::preview::{self, Load, Preview, Verdict};
use isotherm_profile::{BusId, Profile};

const TCP: &str = "type = \"modbus-tcp\"\naddress = \"127.0.0.1:1502\"";
const THROUGH_SERVER: &str = "type = \"modbus-rtu-over-tcp\"\naddress = \"127.0.0.1:1502\"";
const SERIAL: &str =
    "type = \"modbus-rtu\"\nport = \"/dev/serial/by-id/usb-FTDI_FT232R-if00-port0\"\nbaud = 19200";

/// Returns a machine with one register that is read once per second, and axes with this period. `output` is added to
/// the output of each axis, and `more` to the end.
fn machine(line: &str, axes: u16, every: &str, output: &str, more: &str) -> String {
    let mut text = format!(
        "[machine]\nname = \"cell\"\n[bus.cell]\n{line}\n[device.module]\nbus = \"cell\"\nunit = 1\n\
         [device.cnc]\nbus = \"cell\"\nunit = 2\n[signal.bed]\ndevice = \"module\"\nregister = \"input:0\"\n\
         type = \"i16\"\nscale = 0.1\nunit = \"degC\"\nrange = [-10.0, 80.0]\n"
    );
    for axis in 0..axes {
        let register = 100 + 2 * axis;
        text += &format!(
            "[axis.a{axis}]\nlimit = 40.0\nstep = 1.0\nrate = 0.5\ndeadband = 0.1\nevery = \"{every}\"\n\
             on_fault = {{ action = \"hold\" }}\n[[axis.a{axis}.model]]\nname = \"bed\"\nkind = \"linear\"\n\
             terms = [{{ signal = \"bed\", gain = 2.4, reference = 20.0 }}]\n\
             [output.a{axis}]\naxis = \"a{axis}\"\ndevice = \"cnc\"\nwrites = \"offset\"\nregister = \"holding:{register}\"\n\
             type = \"i32\"\nword_order = \"msw-first\"\nscale = 0.1\n{output}\n"
        );
    }
    text + more
}

fn resolved(text: &str) -> Profile {
    parse(text).unwrap_or_else(|errors| panic!("{errors}\n{text}")).profile
}

fn load(text: &str) -> Load {
    Load::of(&resolved(text), BusId(0)).unwrap()
}

#[track_caller]
fn is_near(found: f64, wanted: f64, what: &str) {
    assert!((found - wanted).abs() < 1e-3 * wanted.abs().max(1.0), "{what}: {found} instead of {wanted}");
}

#[test]
fn what_is_asked_in_a_second_is_polls_and_what_each_kind_of_write_takes() {
    let scale = |counter: &str| {
        format!(
            "[device.counter]\nbus = \"cell\"\nunit = 3\nevery = \"400ms\"\n[signal.scale]\ndevice = \"counter\"\n\
             register = \"holding:84\"\ntype = \"i32\"\nword_order = \"msw-first\"\nscale = 0.001\nunit = \"mm\"\n\
             range = [-50.0, 500.0]\n{counter}\n"
        )
    };
    let corrected = |verify: &str| {
        scale("")
            + &format!(
                "[device.readout]\nbus = \"cell\"\nunit = 4\n[output.shown]\naxis = \"a0\"\ndevice = \"readout\"\n\
                 writes = \"corrected\"\nposition = \"scale\"\nregister = \"holding:10\"\ntype = \"i32\"\n\
                 word_order = \"msw-first\"\nscale = 0.0001\n{verify}\n"
            )
    };
    let none = String::new();
    let capture = scale("counter = { max_speed = 500.0, capture = { register = \"holding:132\" } }");
    let heartbeat =
        "[heartbeat]\ndevice = \"cnc\"\nregister = \"holding:90\"\nevery = \"500ms\"\n".to_owned();
    let set = "[set.block]\nsequence = \"holding:99\"\n".to_owned();
    let handshake =
        "handshake = { strobe = \"coil:20\", acknowledge = \"discrete:20\", timeout = \"800ms\" }";
    // Number of axes, keys of their output, further tables, exchanges per second for polls and for writes.
    let cases: [(u16, &str, String, f64, f64); 14] = [
        (0, "", none.clone(), 1.0, 0.0),
        // Read, write and read back, every ten seconds.
        (1, "verify = \"read-back\"", none.clone(), 1.0, 0.3),
        (1, "verify = \"echo\"", none.clone(), 1.0, 0.1),
        // A change restarts the refresh period: five writes in ten seconds.
        (1, "refresh = \"2s\"", none.clone(), 1.0, 1.5),
        (1, "refresh = \"3s\"", none.clone(), 1.0, 1.2),
        (1, "refresh = \"20s\"", none.clone(), 1.0, 0.3),
        // Read, promise on disk, read, write, read back; plus the periodic read.
        (1, "share = \"ledger\"", none.clone(), 1.0, 0.4),
        (1, "share = \"ledger\"\nrefresh = \"2s\"", none.clone(), 1.0, 0.4),
        (1, "", capture, 1.0 + 2.0 * 2.5, 0.3),
        (1, "", corrected("verify = \"echo\""), 3.5, 0.3 + 2.5),
        (1, "", corrected("verify = \"read-back\""), 3.5, 0.3 + 2.0 * 2.5),
        (1, "", heartbeat, 1.0, 2.3),
        // One request reads, one writes and one reads back the adjacent registers, for any number of axes.
        (3, "set = \"block\"", set, 1.0, 0.3),
        // With the handshake: clear, strobe up, rise read twice, strobe down, drop read twice.
        (1, handshake, none, 1.0, 1.0),
    ];
    for (axes, output, more, polls, writes) in cases {
        let found = load(&machine(TCP, axes, "10s", output, &more));
        let what = format!("{output} {more}");
        is_near(found.polls_percent, polls, &what);
        is_near(found.writes_percent, writes, &what);
        is_near(found.exchanges_per_second, polls + writes, &what);
        is_near(found.full_at_answer_ms.unwrap(), 1000.0 / (polls + writes), &what);
    }
}

#[test]
fn an_exchange_takes_what_its_line_is_made_of() {
    let quirks = |keys: &str| format!("{TCP}\nquirks = {{ {keys} }}");
    let parity = format!("{SERIAL}\nparity = \"even\"");
    // Line, milliseconds of one exchange, assumed answer time in milliseconds.
    let cases = [
        (TCP.to_owned(), 10.0, 10.0),
        (THROUGH_SERVER.to_owned(), 30.0, 30.0),
        // 8 and 7 characters of 0.5208 ms, two silences of 2.0052 ms.
        (SERIAL.to_owned(), 21.823, 10.0),
        // The same numbers with 0.5729 ms per character.
        (parity, 22.604, 10.0),
        (quirks("pause_between_requests = \"5ms\""), 15.0, 10.0),
        (quirks("close_after_each = true, pause_after_connect = \"50ms\""), 70.0, 10.0),
    ];
    for (line, takes, answer) in cases {
        let found = load(&machine(&line, 0, "10s", "", ""));
        is_near(found.percent, takes / 10.0, &line);
        is_near(found.answer_ms, answer, &line);
    }
}

#[test]
fn sixty_axes_with_a_ledger_each_beside_their_sensors_are_too_much_each_second_and_fit_each_ten() {
    let ledger = |every| machine(TCP, 60, every, "share = \"ledger\"", "");
    let cases = [
        (
            "10s",
            25.0,
            Verdict::Fits,
            40.0,
            "load 25 % (polls 1 %, writes 24 %), up to 25 exchanges a second at 10 ms an answer",
        ),
        ("3s", 81.0, Verdict::Tight, 12.346, "note: there is little time left for lost answers"),
        (
            "1s",
            241.0,
            Verdict::Full,
            4.149,
            "at 10 ms an answer; full if an answer takes longer than 4.1 ms\n",
        ),
    ];
    for (every, percent, verdict, full_at, words) in cases {
        let machine = parse(&ledger(every)).unwrap().profile;
        let explanation = Preview::of(&machine);
        let found = Load::of(&machine, BusId(0)).unwrap();
        is_near(found.percent, percent, every);
        is_near(found.full_at_answer_ms.unwrap(), full_at, every);
        assert_eq!(found.verdict, verdict, "{every}");
        assert!(explanation.to_string().contains(words), "`{words}` is not in:\n{explanation}");
        let warnings = preview::warnings(&machine);
        assert_eq!(warnings.len(), usize::from(verdict == Verdict::Full), "{warnings:?}");
        for warning in warnings {
            let reported = warning.to_string();
            assert!(
                reported.starts_with("machine.toml: bus.cell: load 241 % (polls 1 %, writes 240 %)"),
                "{reported}"
            );
            assert!(reported.contains("help: update the axes less often"), "{reported}");
        }
    }
    // With an answer time of 30 ms, the load is as the last figure predicts.
    let found = load(&ledger("10s"));
    is_near(found.exchanges_per_second * 30.0 / 10.0, 75.0, "30 ms an answer");
}

#[test]
fn a_serial_line_that_cannot_keep_up_says_so_and_one_that_polls_too_much_says_that() {
    let text = machine(SERIAL, 0, "10s", "", "").replacen("unit = 1\n", "unit = 1\nevery = \"20ms\"\n", 1);
    let machine = parse(&text.replacen(SERIAL, &format!("{SERIAL}\ntimeout = \"15ms\""), 1)).unwrap().profile;
    let load = Load::of(&machine, BusId(0)).unwrap();
    is_near(load.percent, 109.115, "fifty polls of 21.8 ms");
    is_near(load.full_at_answer_ms.unwrap(), 8.177, "what the bytes leave");
    let reported = preview::warnings(&machine)[0].to_string();
    assert!(reported.contains("at 10 ms for a device to begin its answer"), "{reported}");
    assert!(reported.contains("help: poll the devices of this line less often"), "{reported}");
}

#[test]
fn a_can_line_is_as_full_as_its_objects_make_it_and_its_frames_cost_nothing() {
    let machine = lathe(LATHE).unwrap().profile;
    let load = |machine: &Profile, name: &str| {
        Load::of(machine, BusId(machine.buses.iter().position(|bus| bus.name == name).unwrap()))
    };
    is_near(load(&machine, "field").unwrap().exchanges_per_second, 1.0, "one object each second");
    is_near(load(&machine, "cell").unwrap().exchanges_per_second, 1.5, "one offset each two seconds");
    let reported = Preview::of(&machine).to_string();
    assert!(reported.contains("up to 1 exchange a second"), "{reported}");
    let frames_only =
        lathe(&LATHE.replace("fault_when = \"column_status != 0\"\n", "").replace(
            "[signal.column_status]\ndevice = \"axtc\"\nsdo    = \"6150:01\"\ntype   = \"u8\"\n",
            "",
        ));
    assert_eq!(load(&frames_only.unwrap().profile, "field"), None);
}

#[test]
fn a_program_finds_the_load_in_the_document_too() {
    let document =
        serde_json::to_value(Preview::of(&resolved(&machine(TCP, 60, "1s", "share = \"ledger\"", ""))))
            .unwrap();
    let load = &document["buses"][0]["load"];
    assert_eq!((&load["verdict"], load["answer_ms"].as_f64()), (&"full".into(), Some(10.0)));
    is_near(load["percent"].as_f64().unwrap(), 241.0, "percent");
    assert!(load.get("timeout_ms").is_none(), "{load}");
}
