//! A sensor that freezes at a machine: found, told, taken from the others, and in the log as it was.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use isotherm::cli::replay::{SensorFault, replay};
use isotherm::clock::Clock;
use isotherm::fieldbus::connection::{Connection, Dial};
use isotherm::fieldbus::error::{CallerFault, Fault};
use isotherm::fieldbus::kinds::modbus::wire::ModbusWire;
use isotherm::fieldbus::send_guard::SendGuard;
use isotherm::fieldbus::trace::Tap;
use isotherm::fieldbus::wire::{Answer, Boxed, ModbusRequest, Request, Wire};
use isotherm::gateway::Dialer;
use isotherm::observe::status::Command;
use isotherm::virtual_machine::FaultScript;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bus, Profile, parse_with};

use crate::faults::law;
use crate::faults::rig::{Sample, Trace, World, block_on, patient};

const MINUTE: Duration = Duration::from_secs(60);
const SECOND: Duration = Duration::from_secs(1);

/// The wheelhead rises as the bed does; neither is exact. What the scale counts for is next to nothing, but one other
/// would be too few.
const STAND_INS: &str = r#"{ "format": "isotherm-stand-ins", "version": 1, "sensors": [
  { "signal": "wheelhead", "threshold": 0.3, "stands_in": true, "terms": [
    { "signal": "bed", "lag_s": 0, "gain": 1.2 }, { "signal": "scale_z", "lag_s": 0, "gain": 1e-9 }] } ] }"#;

const RISES: &str = "terms = [
  { signal = \"bed\", gain = 2.0, reference = \"start\" },
  { signal = \"wheelhead\", gain = -1.0, reference = \"start\", lag = \"10min\" },
]";

fn profile(stand_ins: &str) -> Profile {
    bench(&patient(), RISES, stand_ins)
}

/// The bench with this one model.
fn bench(bench: &str, model: &str, stand_ins: &str) -> Profile {
    let model =
        format!("[[axis.z.model]]\nname = \"rises\"\nkind = \"linear\"\nstand_ins = \"s.json\"\n{model}\n");
    let (before, rest) = bench.split_once("[[axis.z.model]]").unwrap();
    let (_, after) = rest.split_once("[output.").unwrap();
    // The scale is as good as the bed for as long.
    let text = format!("{before}{model}\n[output.{after}").replace("max_age = \"3s\"", "max_age = \"5s\"");
    let files = [("s.json", stand_ins.as_bytes())];
    let loaded = parse_with(Path::new("bench.toml"), &text, &files, &[], &[]);
    loaded.unwrap_or_else(|errors| panic!("{errors}")).profile
}

/// The wheelhead reads the same from the twentieth minute on; what else fails, and what is commanded in which minute.
fn a_frozen_wheelhead(directory: &Path, more: &str, commands: &[(u32, Command)]) -> Trace {
    let faults = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"value\"
        signal = \"wheelhead\"
        value = 23.0
        at = \"20min\"
        for_time = \"65min\"
        ";
    block_on(async {
        let profile = profile(STAND_INS);
        let faults = FaultScript::parse(&format!("{faults}{more}"), &profile).unwrap();
        let mut world = World::start(profile, faults, None).await;
        let state = Some(directory.to_owned());
        let trial = world.gateway().options(|options| options.directory = state);
        let trial =
            commands.iter().fold(trial, |trial, (minute, command)| trial.command(*minute * MINUTE, *command));
        trial.run(100 * MINUTE).await
    })
}

#[test]
fn an_axis_that_was_switched_off_by_itself_believes_its_frozen_sensor_no_more_than_before() {
    let directory = tempfile::tempdir().unwrap();
    let foreign = "
        [[fault]]
        device = \"cnc\"
        kind = \"register\"
        register = \"holding:104\"
        words = [0, 55]
        at = \"60min\"";
    let trace = a_frozen_wheelhead(directory.path(), foreign, &[(62, Command::Arm)]);
    assert_eq!((trace.reported("foreign-change"), trace.reported("disarmed")), (1, 1), "{}", trace.lines());
    for sample in trace.between(64 * 60, 80 * 60) {
        let axis = &sample.status.axes[0];
        assert_eq!((axis.state, axis.stood_in.is_some()), ("degraded", true), "{}", trace.lines());
    }
}

#[test]
fn a_frozen_sensor_is_taken_from_the_others_until_a_person_has_looked() {
    let directory = tempfile::tempdir().unwrap();
    // After an hour and a half a person looks.
    let looks = [(90, Command::Disarm), (91, Command::Arm)];
    let trace = a_frozen_wheelhead(directory.path(), "", &looks);
    law::holds(&trace);
    assert_eq!(trace.reported("frozen"), 1, "{}", trace.lines());
    // The value from which it stands comes too fast at first: lost for two seconds, and believed at once.
    assert_eq!(trace.reported("stood-in"), 1, "{}", trace.lines());
    assert_eq!(trace.reported("stand-in-over"), 2, "{}", trace.lines());
    let told = trace.events.iter().find(|event| event.kind == "frozen").unwrap();
    assert!(told.text.contains("axis z: wheelhead frozen for "), "{}", told.text);
    let by = "replaced by a stand-in from 2 other sensors";
    assert!(told.data["cause"].as_str().unwrap().ends_with(by), "{}", told.text);
    let frozen = trace.between(85 * 60, 89 * 60).map(|sample| &sample.status.axes[0]);
    for axis in frozen {
        let found = axis.stood_in.as_ref().unwrap();
        assert_eq!((axis.state, axis.model.as_deref()), ("degraded", Some("rises")));
        assert_eq!((found.signal.as_str(), found.frozen, found.others), ("wheelhead", true, 2));
        assert_eq!(axis.why.cause, "wheelhead frozen, replaced by a stand-in from 2 other sensors");
        assert!(&found.since[11..16] > "06:19" && &found.since[11..16] < "06:22", "{}", found.since);
    }
    let after = trace.between(93 * 60, 99 * 60).map(|sample| &sample.status.axes[0]);
    after.for_each(|axis| assert_eq!((axis.state, axis.stood_in.is_none()), ("active", true)));

    let log = directory.path().join("bench-2026-01-05.csv");
    let text = std::fs::read_to_string(&log).unwrap();
    assert!(text.lines().next().unwrap().contains(",z_stood_in"), "{}", text.lines().next().unwrap());
    assert!(text.matches(",wheelhead,").count() > 500, "it stands in the rows");
    let again = |stand_ins: &str| {
        replay(&profile(stand_ins), std::fs::File::open(&log).unwrap(), "the day", None).unwrap()
    };
    let summary = again(STAND_INS);
    let reproduced = summary.axes["z"].reproduced.as_ref().unwrap();
    assert!(reproduced.first.is_none() && reproduced.rows > 1500, "{summary}");
    assert_eq!(summary.warnings, [""; 0]);
    let stand_ins = summary.axes["z"].spans.stand_ins.iter();
    let frozen: Vec<_> = stand_ins.filter(|span| span.what.kind == SensorFault::Frozen).collect();
    assert!(frozen.len() == 1 && !frozen[0].lasts, "{summary}");
    assert_eq!(
        (frozen[0].what.signal.as_str(), frozen[0].what.by.join(", ")),
        ("wheelhead", "bed, scale_z".into())
    );
}

#[test]
fn a_log_that_goes_on_with_another_file_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let run = || {
        block_on(async {
            let profile = profile(STAND_INS);
            let faults = FaultScript::parse("", &profile).unwrap();
            let mut world = World::start(profile, faults, None).await;
            let state = Some(directory.path().to_owned());
            world.gateway().options(|options| options.directory = state.clone()).run(2 * MINUTE).await;
            world.gateway().options(|options| options.directory = state).run(2 * MINUTE).await
        })
    };
    law::holds(&run());
    let log = directory.path().join("bench-2026-01-05.csv");
    let warnings = |stand_ins: &str| {
        let log = std::fs::File::open(&log).unwrap();
        replay(&profile(stand_ins), log, "the day", None).unwrap().warnings
    };
    assert_eq!(warnings(STAND_INS), [""; 0]);
    let told = warnings(&STAND_INS.replace("1.2", "1.3")).concat();
    assert!(told.contains("axis z, model rises: the stand-ins of the model have changed"), "{told}");
}

/// The line of the control, on which the first change of Cz after this moment waits for so long before it is sent.
#[derive(Clone)]
struct Waiting {
    bus: Bus,
    clock: Clock,
    from: Moment,
    waits: Duration,
    /// Whether that change left.
    left: Arc<Mutex<Option<bool>>>,
}

struct WaitingWire {
    wire: Connection,
    by: Waiting,
}

impl Dial for Waiting {
    fn dial<'a>(&'a mut self, tap: &'a Tap) -> Boxed<'a, Result<Connection, Fault>> {
        Box::pin(async {
            let wire = isotherm::fieldbus::dial(&self.bus).unwrap().dial(tap).await?;
            Ok(Connection::Modbus(Box::new(WaitingWire { wire, by: self.clone() })))
        })
    }
}

impl ModbusWire for WaitingWire {}

impl Wire for WaitingWire {
    fn exchange<'a>(
        &'a mut self,
        unit: u8,
        request: Request<'a>,
        send_guard: &'a mut SendGuard,
    ) -> Boxed<'a, Result<Answer, Fault>> {
        let is_change = matches!(request, Request::Modbus(ModbusRequest::WriteMultiple { at: 104, .. }));
        let is_first = self.by.left.lock().unwrap().is_none();
        if !(is_change && is_first && self.by.clock.now() >= self.by.from) {
            return Box::pin(self.wire.exchange(unit, request, send_guard));
        }
        self.by.clock.skip(self.by.waits);
        Box::pin(async move {
            let done = self.wire.exchange(unit, request, send_guard).await;
            let too_late = matches!(done, Err(Fault::Caller(CallerFault::TooLate)));
            assert!(done.is_ok() || too_late, "{done:?}");
            *self.by.left.lock().unwrap() = Some(done.is_ok());
            done
        })
    }
}

/// Whether a change leaves that waits so long on its line. The model reads the wheelhead alone, which has been lost for
/// two minutes by then: the bed says what it would read. Cz is on its way all the time, so that every decision is a
/// change.
fn leaves_after(waits: Duration, more: &str) -> bool {
    // On a device of its own, so that its last reading grows old.
    let lost = "
        [[fault]]
        device = \"case\"
        kind = \"silent\"
        at = \"5min\"";
    let own = "[bus.case]\ntype = \"modbus-tcp\"\naddress = \"127.0.0.1:1506\"\ntimeout = \"100ms\"\n\
               [device.case]\nbus = \"case\"\nunit = 1\nevery = \"1s\"\n[signal.wheelhead]\ndevice = \"case\"";
    let text = patient()
        .replace("rate = 0.5", "rate = 0.05")
        .replace("[signal.wheelhead]\ndevice = \"thermocouples\"", own);
    let model = "offset = 39.0\nterms = [ { signal = \"wheelhead\", gain = -0.1, reference = \"start\" } ]";
    let profile = bench(&text, model, STAND_INS);
    let left = Arc::new(Mutex::new(None));
    let trace = block_on(async {
        let faults = FaultScript::parse(&format!("{lost}{more}"), &profile).unwrap();
        let mut world = World::start(profile, faults, None).await;
        let (clock, left) = (world.clock.clone(), left.clone());
        let from = clock.now().after(7 * MINUTE);
        let dialer: Dialer = Arc::new(move |bus: &Bus| {
            if bus.name != "control" {
                return isotherm::fieldbus::dial(bus);
            }
            let (bus, clock, left) = (bus.clone(), clock.clone(), left.clone());
            Some(Box::new(Waiting { bus, clock, from, waits, left }))
        });
        world.gateway().options(|options| options.dialer = dialer).run(7 * MINUTE + 30 * SECOND).await
    });
    let before: Vec<&Sample> = trace.between(6 * 60, 7 * 60).collect();
    assert!(before.iter().all(|sample| sample.status.axes[0].stood_in.is_some()), "{}", trace.lines());
    let first = trace
        .writes("cnc_z")
        .into_iter()
        .filter(|(at, _)| (6 * 60..7 * 60).contains(&at.since(trace.begin).as_secs()));
    assert!(first.count() > 20, "changes leave all the time: {}", trace.lines());
    let left = left.lock().unwrap();
    left.unwrap_or_else(|| panic!("there was no change: {}", trace.lines()))
}

#[test]
fn a_change_that_rests_on_what_others_say_leaves_as_long_as_their_readings_may_be_used() {
    // The bed's reading is a second old at most, and may be used for five; the next decision is due in two.
    assert!(leaves_after(Duration::from_millis(3500), ""));
    assert!(!leaves_after(8 * SECOND, ""));
}

#[test]
fn where_the_others_have_just_been_lost_as_well_a_change_leaves_until_the_next_decision_is_due() {
    let bed = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"sentinel\"
        signal = \"bed\"
        at = \"410s\"";
    assert!(leaves_after(SECOND, bed), "the mean of a minute outlives a reading that is missing");
    assert!(!leaves_after(8 * SECOND, bed));
}

#[test]
fn a_replay_reports_a_row_in_which_another_sensor_was_stood_in_for_than_it_finds() {
    let directory = tempfile::tempdir().unwrap();
    let lost = "
        [[fault]]
        device = \"thermocouples\"
        kind = \"nan\"
        signal = \"wheelhead\"
        at = \"5min\"";
    let trace = block_on(async {
        let profile = profile(STAND_INS);
        let faults = FaultScript::parse(lost, &profile).unwrap();
        let mut world = World::start(profile, faults, None).await;
        let state = Some(directory.path().to_owned());
        world.gateway().options(|options| options.directory = state).run(7 * MINUTE).await
    });
    law::holds(&trace);
    let log = std::fs::read_to_string(directory.path().join("bench-2026-01-05.csv")).unwrap();
    let place = log.lines().next().unwrap().split(',').position(|name| name == "z_stood_in").unwrap();
    let rows: Vec<usize> = (log.lines().enumerate())
        .filter(|(_, line)| line.split(',').nth(place) == Some("wheelhead"))
        .map(|(row, _)| row)
        .collect();
    assert!(rows.len() > 30, "{log}");
    // What the log says in one of these rows instead.
    let differs = |says: &str| {
        let changed = rows[rows.len() / 2];
        let line = |(row, line): (usize, &str)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            if row == changed {
                cells[place] = says;
            }
            cells.join(",") + "\n"
        };
        let text: String = log.lines().enumerate().map(line).collect();
        let summary = replay(&profile(STAND_INS), text.as_bytes(), "the day", None).unwrap();
        let reproduced = summary.axes["z"].reproduced.clone().unwrap();
        let shown = |found: isotherm::cli::replay::Difference| {
            (found.line, found.column, found.recorded, found.replayed)
        };
        (reproduced.differing, reproduced.first.map(shown), u64::try_from(changed).unwrap() + 1)
    };
    assert_eq!((differs("wheelhead").0, differs("wheelhead").1), (0, None));
    for says in ["bed", ""] {
        let (differing, first, line) = differs(says);
        let expected = (line, "z_stood_in".to_owned(), says.to_owned(), "wheelhead".to_owned());
        assert_eq!((differing, first), (1, Some(expected)));
    }
}
