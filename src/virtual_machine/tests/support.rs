//! A small machine: thermocouples, counter and readout on one line, a control on another.

use super::*;
use crate::clock::Sleeper;
use isotherm_core::codec::{Address, DataType, Encoding, Scale, WordOrder};
use isotherm_core::compensation::settings::{
    AxisSettings, Datum, GuardSettings, Levels, MachineSettings, OnFault,
};
use isotherm_core::quantity::{Micron, MicronPerSecond};
use isotherm_core::reading::SignalId;
use isotherm_profile::{
    Arm, Axis, AxisId, Bus, DefaultLimits, Device, Functions, Heartbeat, History, OnStop, Output, Purpose,
    Quirks, ReadBy, Share, Signal, Transport, Unit, Verify, Writes,
};

pub(crate) const THERMOCOUPLES: u8 = 1;
pub(crate) const CNC: u8 = 1;

/// Machine on a virtual clock, which advances only when the test sleeps.
pub(super) struct Run {
    pub(super) machine: VirtualMachine,
    pub(super) sleeper: Sleeper,
    pub(super) begin: Moment,
}

/// Starts the small machine with the plant of the grinder.
pub(super) async fn start(faults: &str) -> Run {
    let profile = profile();
    let faults = FaultScript::parse(faults, &profile).unwrap();
    let plant = PlantSpec::shipped("surface-grinder").unwrap().unwrap();
    start_with(&profile, Setup { plant: Some(plant), seed: 1, faults, ..Setup::default() }).await
}

pub(super) async fn start_with(profile: &Profile, setup: Setup) -> Run {
    let begin = PlantSpec::shipped("surface-grinder").unwrap().unwrap().start();
    let clock = Clock::simulated(begin, None);
    let hold = clock.hold();
    let machine =
        VirtualMachine::start(profile, Setup { ports: Ports::Free, ..setup }, &clock).await.unwrap();
    let sleeper = clock.join();
    drop(hold);
    Run { machine, sleeper, begin }
}

impl Run {
    /// Connects to the line of the thermocouples.
    pub(super) async fn cell(&self) -> Client {
        Client::connect(self.machine.address(BusId(0)).unwrap()).await
    }

    /// Connects to the line of the control.
    pub(super) async fn control(&self) -> Client {
        Client::connect(self.machine.address(BusId(1)).unwrap()).await
    }
}

pub(crate) fn profile() -> Profile {
    let axis = AxisSettings {
        name: "z".to_owned(),
        models: Vec::new(),
        guard: GuardSettings {
            limit: Micron::new(40.0).unwrap(),
            step: Micron::new(1.0).unwrap(),
            rate: MicronPerSecond::new(0.5).unwrap(),
            deadband: Micron::ZERO,
            count: None,
        },
        every: Duration::from_secs(10),
        on_fault: OnFault::Hold,
        levels: Levels::default(),
        datum: Datum::Model,
        intercept_slope: None,
        probe: None,
        learned: None,
    };
    let signals = vec![
        signal("bed", 0, "input:0", plain(DataType::I16, 0.1), "degC"),
        signal("wheelhead", 0, "input:1", plain(DataType::I16, 0.1), "degC"),
        signal("oil", 0, "input:2", plain(DataType::F32, 1.0), "degC"),
        signal("scale_z", 1, "holding:84", plain(DataType::I32, 0.0001), "mm"),
        signal("hydraulics_on", 3, "discrete:0", plain(DataType::Bool, 1.0), "bool"),
        signal("offset_now", 3, "holding:104", plain(DataType::I32, 0.1), "um"),
    ];
    let machine = MachineSettings { signals: signals.len(), ..MachineSettings::default() };
    Profile {
        name: "small".to_owned(),
        description: String::new(),
        label: String::new(),
        path: "small.toml".into(),
        machine,
        arm: Arm::Auto,
        only_recorded: Vec::new(),
        arm_timeout: Duration::from_secs(600),
        on_stop: OnStop::FaultAction,
        buses: vec![bus("cell", "127.0.0.1:1502"), bus("control", "127.0.0.1:1503")],
        devices: vec![
            device("thermocouples", 0, THERMOCOUPLES),
            device("counter", 0, 2),
            device("readout", 0, 3),
            device("cnc", 1, CNC),
        ],
        signals,
        axes: vec![Axis {
            settings: axis,
            label: String::new(),
            diameter: false,
            probe_input: None,
            learning: None,
            purpose: Purpose::Compensation,
        }],
        outputs: vec![
            output("readout_z", 2, "holding:10", 0.0001, Writes::Corrected { position: SignalId(3) }),
            output("cnc_z", 3, "holding:104", 0.1, Writes::Offset),
        ],
        sets: Vec::new(),
        heartbeat: Some(Heartbeat {
            device: DeviceId(3),
            address: Address::Modbus("holding:100".parse().unwrap()),
            every: Duration::from_secs(1),
        }),
        web: None,
        mqtt: None,
        opcua_server: None,
        notify: Vec::new(),
        history: History { directory: None, keep: Duration::ZERO, max_size: u64::MAX },
        overridden: Vec::new(),
        members: isotherm_profile::ProfileMembers::default(),
    }
}

pub(super) fn plain(data_type: DataType, scale: f64) -> Encoding {
    Encoding {
        data_type,
        word_order: WordOrder::MswFirst,
        byte_swap: false,
        scale: Scale::of(scale),
        offset: 0.0,
        bias: 0,
        bad: if data_type == DataType::I16 { vec![32767.into()] } else { Vec::new() },
    }
}

pub(super) fn bus(name: &str, address: &str) -> Bus {
    let quirks = quirks();
    let timeout = Duration::from_millis(300);
    Bus {
        name: name.to_owned(),
        transport: Transport::Tcp,
        address: address.to_owned(),
        tls: None,
        opcua: None,
        timeout,
        late: Transport::Tcp.late(timeout),
        pipeline: 1,
        quirks,
        sync: None,
    }
}

fn quirks() -> Quirks {
    Quirks {
        pause_after_connect: Duration::ZERO,
        pause_between_requests: Duration::ZERO,
        one_request_per_field: false,
        max_registers_per_request: 125,
        max_gap: 0,
        close_after_each: false,
        loses_first_request: false,
        gateway: isotherm_profile::Gateway::ByUnits,
    }
}

pub(super) fn device(name: &str, bus: usize, unit: u8) -> Device {
    let functions = Functions {
        read_coils: true,
        read_discrete: true,
        read_holding: true,
        read_input: true,
        write_coil: true,
        write_single: name != "readout",
        write_coils: true,
        write_multiple: true,
    };
    let (name, every) = (name.to_owned(), Duration::from_secs(1));
    Device {
        name,
        label: String::new(),
        bus: BusId(bus),
        unit,
        every,
        functions,
        quirks: quirks(),
        verify: Vec::new(),
        template: None,
        can: None,
        source_time: None,
        is_pc: false,
        read: ReadBy::Poll,
    }
}

fn signal(name: &str, device: usize, register: &str, encoding: Encoding, unit: &'static str) -> Signal {
    Signal {
        label: String::new(),
        name: name.to_owned(),
        device: DeviceId(device),
        address: Address::Modbus(register.parse().unwrap()),
        encoding,
        scale_from: None,
        unit: Unit(unit),
        range: None,
        max_rate: None,
        defaults: DefaultLimits::default(),
        is_difference: false,
        max_age: Duration::from_secs(5),
        fault_when: None,
        merge: true,
        counter: None,
        capture: None,
    }
}

pub(super) fn output(name: &str, device: usize, register: &str, scale: f64, writes: Writes) -> Output {
    Output {
        name: name.to_owned(),
        axis: AxisId(0),
        device: DeviceId(device),
        address: Address::Modbus(register.parse().unwrap()),
        encoding: plain(DataType::I32, scale),
        writes,
        verify: Verify::ReadBack,
        refresh: None,
        when: None,
        set: None,
        boot_counter: None,
        share: Share::Whole,
        applied: None,
        display: isotherm_profile::Display::default(),
        stated: None,
    }
}
