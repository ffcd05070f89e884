use super::client::Answer;
use super::support::start_with;
use super::*;
use isotherm_core::codec::{Address, DataType, Encoding, Scale};
use isotherm_core::reading::SignalId;
use isotherm_profile::{Bit, Handshake, OutputId, OutputSet, SetId, Signal};

fn joined(words: &[u16]) -> i32 {
    i32::from_be_bytes([words[0].to_be_bytes(), words[1].to_be_bytes()].concat().try_into().unwrap())
}

#[tokio::test]
async fn each_device_answers_under_its_own_unit_with_what_its_plant_measures() {
    let mut run = start("").await;
    let mut plant = Plant::new(&PlantSpec::shipped("surface-grinder").unwrap().unwrap(), 1, run.begin);
    let (mut cell, mut control) = (run.cell().await, run.control().await);
    for _ in 0..5 {
        run.sleeper.sleep(Duration::from_millis(600_500)).await;
        plant.advance_to(run.sleeper.now());
        let words = cell.read(THERMOCOUPLES, 4, 0, 2).await;
        for (word, signal) in words.iter().zip(["bed", "wheelhead"]) {
            assert!((f64::from(*word) * 0.1 - plant.sensor(signal).unwrap()).abs() < 1e-9);
        }
        let scale = f64::from(joined(&cell.read(2, 3, 84, 2).await)) * 0.0001;
        assert!((scale - plant.sensor("scale_z").unwrap()).abs() <= 0.000_051);
        assert_eq!(control.ask(CNC, &[2, 0, 0, 0, 1]).await, [2, 1, 1]);
    }
    run.machine.stop().await.unwrap();
}

#[tokio::test]
async fn a_unit_that_is_not_there_is_an_exception_or_silence() {
    let run = start("").await;
    assert_eq!(run.cell().await.ask(9, &[3, 0, 0, 0, 1]).await, [0x83, 0x0b]);
    let silent = Setup { unknown_unit: UnknownUnit::Silence, ..Setup::default() };
    let run = start_with(&profile(), silent).await;
    let mut cell = run.cell().await;
    assert_eq!(cell.request(9, &[3, 0, 0, 0, 1]).await, Answer::Silence);
    assert_eq!(cell.read(2, 3, 84, 2).await.len(), 2);
}

#[tokio::test]
async fn a_function_the_profile_does_not_list_is_refused() {
    let run = start("").await;
    let mut cell = run.cell().await;
    assert_eq!(cell.ask(3, &[6, 0, 10, 0, 1]).await, [0x86, 1]);
    assert_eq!(cell.write(3, 10, 7).await, [16, 0, 10, 0, 2]);
}

#[tokio::test]
async fn nonsense_closes_its_own_connection_and_no_other() {
    let run = start("").await;
    let (mut nonsense, mut good) = (run.cell().await, run.cell().await);
    nonsense.send(b"GET / HTTP/1.1\r\n\r\n").await;
    assert_eq!(nonsense.receive().await, Answer::Closed);
    let mut short = run.cell().await;
    assert_eq!(short.ask(THERMOCOUPLES, &[15]).await, [0x8f, 3]);
    assert_eq!(short.ask(THERMOCOUPLES, &[43, 14]).await, [0xab, 1]);
    assert_eq!(short.ask(THERMOCOUPLES, &[4, 0xff, 0xff, 0, 2]).await, [0x84, 2]);
    assert_eq!(good.read(THERMOCOUPLES, 4, 0, 2).await.len(), 2);
    run.machine.stop().await.unwrap();
}

#[tokio::test]
async fn what_is_written_as_an_offset_acts_on_the_error() {
    let mut run = start("").await;
    let mut control = run.control().await;
    assert_eq!(control.read(CNC, 3, 100, 6).await, [0; 6]);
    control.write(CNC, 104, -123).await;
    run.sleeper.sleep(TICK).await;
    let truth = run.machine.window().latest_truth().unwrap();
    assert!((truth.axes[0].cz_um + 12.3).abs() < 1e-9);
    assert!((truth.axes[0].residual_um() - truth.axes[0].error_um + 12.3).abs() < 1e-9);
    // The signal that shows the offset register does not overwrite it.
    assert_eq!(joined(&control.read(CNC, 3, 104, 2).await), -123);
    control.ask(CNC, &[6, 0, 100, 0, 77]).await;
    assert_eq!(control.read(CNC, 3, 100, 1).await, [77]);
}

#[tokio::test]
async fn without_an_offset_the_corrected_position_tells_what_is_applied() {
    let mut profile = profile();
    profile.outputs.truncate(1);
    let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
    let mut run = start_with(&profile, Setup { plant: Some(plant), ..Setup::default() }).await;
    let mut cell = run.cell().await;
    run.sleeper.sleep(Duration::from_secs(100)).await;
    let shown = joined(&cell.read(2, 3, 84, 2).await);
    cell.write(3, 10, shown + 84).await;
    run.sleeper.sleep(Duration::from_secs(30)).await;
    let truth = run.machine.window().latest_truth().unwrap();
    assert!((truth.axes[0].cz_um - 8.4).abs() < 1e-6, "{truth:?}");
}

#[tokio::test]
async fn a_client_that_writes_minus_the_error_leaves_next_to_nothing() {
    let mut run = start("").await;
    let mut control = run.control().await;
    for _ in 0..360 {
        run.sleeper.sleep(Duration::from_secs(10)).await;
        let error = run.machine.window().latest_truth().unwrap().axes[0].error_um;
        let counts = (-error * 10.0).round();
        let counts = (-400..400).find(|whole| (f64::from(*whole) - counts).abs() < 0.5).unwrap();
        control.write(CNC, 104, counts).await;
    }
    let last = run.machine.window().latest_truth().unwrap();
    assert_eq!(last.at.since(run.begin), Duration::from_secs(3600));
    let summary = run.machine.stop().await.unwrap();
    let z = &summary.axes[0];
    assert_eq!((z.axis.as_str(), z.samples), ("z", 3600 - 60 + 1));
    assert!(z.uncompensated.range_um() > 0.5, "{z:?}");
    assert!(z.compensated.range_um() < 0.3, "{z:?}");
}

#[tokio::test]
async fn one_seed_gives_one_run_and_another_seed_another() {
    let mut runs = Vec::new();
    for seed in [4, 4, 5] {
        let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
        let setup = Setup { plant: Some(plant), seed, ..Setup::default() };
        let mut run = start_with(&profile(), setup).await;
        let mut cell = run.cell().await;
        let mut seen = Vec::new();
        for _ in 0..60 {
            run.sleeper.sleep(Duration::from_millis(7_300)).await;
            let truth = run.machine.window().latest_truth();
            seen.push((cell.read(THERMOCOUPLES, 4, 0, 4).await, truth));
        }
        runs.push(seen);
    }
    assert_eq!(runs[0], runs[1]);
    assert_ne!(runs[0], runs[2]);
}

#[tokio::test]
async fn any_profile_can_be_served_without_a_plant() {
    let mut run = start_with(&profile(), Setup::default()).await;
    let mut cell = run.cell().await;
    run.sleeper.sleep(Duration::from_secs(60)).await;
    for word in cell.read(THERMOCOUPLES, 4, 0, 2).await {
        assert!((195..=245).contains(&word), "{word}");
    }
    assert_eq!(run.control().await.ask(CNC, &[2, 0, 0, 0, 1]).await, [2, 1, 1]);
    assert_eq!(run.machine.window().latest_truth().map(|row| row.axes.len()), None);
    assert_eq!(run.machine.window().summary().axes, []);
}

#[tokio::test]
async fn two_buses_at_one_address_share_one_listener() {
    let mut profile = profile();
    profile.buses[1].address = profile.buses[0].address.clone();
    profile.devices[3].unit = 4;
    let run = start_with(&profile, Setup::default()).await;
    assert_eq!(run.machine.address(BusId(0)), run.machine.address(BusId(1)));
    let mut cell = run.cell().await;
    assert_eq!(cell.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
    assert_eq!(cell.read(4, 3, 104, 2).await, [0, 0]);
}

#[tokio::test]
async fn an_address_that_is_taken_is_said_to_be() {
    let taken = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let mut profile = profile();
    profile.buses[0].address = taken.local_addr().unwrap().to_string();
    let error = VirtualMachine::start(&profile, Setup::default(), &Clock::wall()).await.unwrap_err();
    assert!(error.to_string().contains("(bus `cell`)"), "{error}");
}

#[tokio::test]
async fn it_also_runs_by_the_wall() {
    let setup = Setup { ports: Ports::Free, ..Setup::default() };
    let mut machine = VirtualMachine::start(&profile(), setup, &Clock::wall()).await.unwrap();
    let mut cell = Client::connect(machine.address(BusId(0)).unwrap()).await;
    assert_eq!(cell.read(THERMOCOUPLES, 4, 0, 1).await.len(), 1);
    let failed = tokio::time::timeout(Duration::from_millis(20), machine.failure()).await;
    assert!(failed.is_err(), "{failed:?}");
    machine.stop().await.unwrap();
}

/// The small machine, with a CNC that accepts its offset by a handshake and counts its boots.
fn shaken() -> isotherm_profile::Profile {
    let mut profile = profile();
    let flag = |text: &str| Bit::Flag(text.parse().unwrap());
    let timeout = Duration::from_millis(500);
    let handshake = Handshake { strobe: flag("coil:20"), acknowledge: flag("input:16.2"), timeout };
    profile.sets.push(OutputSet {
        name: "cnc_z".to_owned(),
        is_named: false,
        device: DeviceId(3),
        outputs: vec![OutputId(1)],
        sequence: None,
        complement: None,
        heartbeat: None,
        control: None,
        version: None,
        zeros: false,
        handshake: Some(handshake),
    });
    let boots = Signal {
        name: "cnc.boot_counter".to_owned(),
        address: Address::Modbus("holding:98".parse().unwrap()),
        encoding: Encoding {
            data_type: DataType::U16,
            scale: Scale::ONE,
            ..profile.signals[5].encoding.clone()
        },
        ..profile.signals[5].clone()
    };
    profile.signals.push(boots);
    profile.outputs[1].set = Some(SetId(0));
    profile.outputs[1].boot_counter = Some(SignalId(6));
    profile
}

#[tokio::test]
async fn a_control_with_a_handshake_acts_on_an_offset_when_it_has_acknowledged_it() {
    let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
    let setup = Setup { plant: Some(plant), journal: true, ..Setup::default() };
    let mut run = start_with(&shaken(), setup).await;
    let mut control = run.control().await;
    let acknowledged = [4, 0, 16, 0, 1];
    control.write(CNC, 104, 70).await;
    run.sleeper.sleep(TICK).await;
    assert!(run.machine.window().latest_truth().unwrap().axes[0].cz_um.abs() < 1e-9, "not taken yet");
    control.ask(CNC, &[5, 0, 20, 0xff, 0]).await;
    assert_eq!(control.ask(CNC, &acknowledged).await, [4, 2, 0, 0], "it needs its time");
    run.sleeper.sleep(Duration::from_millis(40)).await;
    assert_eq!(control.ask(CNC, &acknowledged).await, [4, 2, 0, 4]);
    run.sleeper.sleep(TICK).await;
    assert!((run.machine.window().latest_truth().unwrap().axes[0].cz_um - 7.0).abs() < 1e-9);
    control.ask(CNC, &[5, 0, 20, 0, 0]).await;
    run.sleeper.sleep(Duration::from_millis(40)).await;
    assert_eq!(control.ask(CNC, &acknowledged).await, [4, 2, 0, 0]);
    let taken = run.machine.window().taken();
    assert_eq!(taken.iter().map(|taken| taken.words.clone()).collect::<Vec<_>>(), [[[0, 70]]]);
}

#[tokio::test]
async fn a_control_counts_its_boots() {
    let profile = shaken();
    let faults = "[[fault]]\ndevice = \"cnc\"\nkind = \"restart\"\nat = \"10s\"\n";
    let faults = FaultScript::parse(faults, &profile).unwrap();
    let mut run = start_with(&profile, Setup { faults, ..Setup::default() }).await;
    let mut control = run.control().await;
    assert_eq!(control.read(CNC, 3, 98, 1).await, [1]);
    run.sleeper.sleep(Duration::from_secs(11)).await;
    assert_eq!(control.read(CNC, 3, 98, 1).await, [2]);
}
