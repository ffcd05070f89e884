//! The virtual machine: simulated hardware for a profile.
//!
//! It serves the Modbus servers of a profile on real sockets and pseudo-terminals, and its CAN nodes on their
//! interface. A thermal plant warms up, drifts and bends by its own model, and knows its true error. Written offsets
//! act on it as on a machine, so that a run shows the effect of the compensation. A fault script causes faults of
//! answers, sensors, connections and memories.
//!
//! # Layout
//! ```text
//! plant     a thermal network with sensors, pure          wander    values for signals without a plant
//! registers the tables of a device                        modbus    bytes ↔ frames, requests and answers, pure
//! fault     faults with their times                       hardware  plant + registers + faults
//! server    sockets, and requests on a line               truth     error, Cz, residual, and their ranges
//! port      serial ports                                  gate      the plant's task, closed listeners
//! journal   recorded requests, for tests                  control   strobes, acknowledges, sets accepted as a whole
//! probing   the control's probing cycle, of the axes with a probe
//! can       nodes of a CAN interface                      random    a random number generator for each purpose
//! ```
//!
//! # Time
//! All tasks use the clock that they are given. On a virtual clock, one seed gives one run, byte for byte, at any
//! speed. The plant advances on its own time grid, and requests are answered while the clock stands.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use crate::clock::{Clock, WallTimeout};
use isotherm_core::quantity::Moment;
use isotherm_profile::{AxisId, BusId, DeviceId, Profile, Transport};

pub mod can;
pub mod fault;
pub mod plant;

mod control;
mod gate;
mod hardware;
mod journal;
mod modbus;
mod port;
mod probing;
mod random;
mod registers;
mod serial_side;
mod server;
#[cfg(test)]
mod tests;
mod truth;
mod wander;

pub use control::AcceptedSet;
pub use fault::{FaultError, FaultScript};
pub use journal::SeenRequest;
pub use modbus::answered;
pub use plant::{Plant, PlantError, PlantSpec, Published, PublishedAxis};
pub use truth::{AxisSummary, AxisTruth, Extent, Summary, TruthRow};

use can::line::{CanLine, Port};
use fault::Faults;
use gate::{ListenerSwitch, live};
use hardware::Hardware;
use modbus::Framing;
use probing::Cycle;
use serial_side::SerialSide;
use server::{Line, OpenOrClose, Shared};

/// Interval at which the truth is sampled and spontaneous faults are checked.
pub const TICK: Duration = Duration::from_secs(1);

/// Interval of the probing cycle of an axis with a probe.
const PROBED_EVERY: Duration = Duration::from_secs(3600);

/// Settings of a virtual machine in addition to its profile.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// The plant. Without one, signals vary in a plausible way, and there is no true error.
    pub plant: Option<PlantSpec>,
    /// Seed of the simulated day.
    pub seed: u64,
    /// Faults that begin by time or by number of requests.
    pub faults: FaultScript,
    /// Addresses to listen at.
    pub ports: Ports,
    /// Answer for a unit that does not exist, on lines over TCP. A serial line is silent.
    pub unknown_unit: UnknownUnit,
    /// Time in the plant's day at which the machine starts.
    pub lived: Duration,
    /// Interval of the probing cycle; `None` means once an hour.
    pub probe_every: Option<Duration>,
    /// Records every request that reaches a device, for [`Window::requests`].
    pub journal: bool,
}

impl Setup {
    /// Settings for this plant and seed, with free ports.
    pub fn on_free_ports(plant: PlantSpec, seed: u64) -> Setup {
        Setup { plant: Some(plant), seed, ports: Ports::Free, ..Setup::default() }
    }
}

/// Addresses at which the devices listen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ports {
    /// The addresses of the profile.
    #[default]
    AsInProfile,
    /// Any free ports of the loopback; serial ports at their own paths.
    Free,
}

/// Answer of a line to a request for a unit that does not exist.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UnknownUnit {
    /// Exception 0x0B, as gateways send it.
    #[default]
    Exception,
    /// The line does not answer, as a serial line.
    Silence,
}

/// Reason why a virtual machine does not run.
#[derive(Debug, thiserror::Error)]
pub enum VirtualMachineError {
    /// The virtual machine cannot listen at an address.
    #[error("cannot listen at {address} (bus `{bus}`)")]
    Listen {
        /// Bus of the profile.
        bus: String,
        /// Address of the bus.
        address: String,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A task of the virtual machine has failed.
    #[error("the virtual machine has failed: {0}")]
    Failed(String),
}

/// A running virtual machine. Dropping it ends it at once.
#[derive(Debug)]
pub struct VirtualMachine {
    addresses: Vec<(BusId, String)>,
    shared: Shared,
    stop: watch::Sender<bool>,
    tasks: JoinSet<Result<(), String>>,
}

/// Access to the truth of a running machine, from any thread.
#[derive(Clone, Debug)]
pub struct Window(Shared);

impl Window {
    /// Summary of the run so far.
    pub fn summary(&self) -> Summary {
        self.0.hardware().observer.summary.clone()
    }

    /// Every request that has reached a device, in order; empty without [`Setup::journal`].
    pub fn requests(&self) -> Vec<SeenRequest> {
        self.0.hardware().journal.clone().unwrap_or_default()
    }

    /// Values that controls have accepted from their sets, in order; empty without [`Setup::journal`].
    pub fn taken(&self) -> Vec<AcceptedSet> {
        self.0.hardware().taken.clone()
    }

    /// Sets the offset in µm that a real control applies to this axis, in place of the virtual one.
    pub fn applies_elsewhere(&self, axis: AxisId, cz_um: f64) {
        self.0.hardware().applies_elsewhere(axis, cz_um);
    }

    /// Truth at the last tick; `None` before the first one, and without a plant.
    pub fn latest_truth(&self) -> Option<TruthRow> {
        self.0.hardware().observer.latest.clone()
    }

    /// Truth every ten seconds since the last call. If that is long ago, only its first day.
    pub fn take_course(&self) -> Vec<TruthRow> {
        std::mem::take(&mut self.0.hardware().observer.course)
    }
}

impl VirtualMachine {
    /// Binds the listeners and starts the tasks on the current runtime. Start the virtual machine before its clients:
    /// it joins the clock first, so that at equal times the plant advances first. Keep a virtual clock on
    /// [`Clock::hold`] until all clients have joined. Otherwise the plant would run ahead.
    ///
    /// # Errors
    /// The virtual machine cannot listen at an address.
    pub async fn start(
        profile: &Profile,
        setup: Setup,
        clock: &Clock,
    ) -> Result<VirtualMachine, VirtualMachineError> {
        let sleeper = clock.join();
        let begin = clock.now();
        let plant = setup.plant.as_ref().map(|spec| {
            let mut plant = Plant::new(spec, setup.seed, begin.before(setup.lived));
            plant.advance_to(begin);
            plant
        });
        let faults = Faults::new(setup.faults, begin);
        let cycles = Cycle::of(profile, setup.probe_every.unwrap_or(PROBED_EVERY), begin);
        let mut hardware = Hardware::new(profile, plant, setup.seed, faults, begin, cycles);
        hardware.journal = setup.journal.then(Vec::new);
        let shared = Shared::new(hardware, clock.clone());
        let (stop, stopped) = watch::channel(false);
        let mut machine = VirtualMachine { addresses: Vec::new(), shared, stop, tasks: JoinSet::new() };
        let mut gates = Vec::new();
        for (index, bus) in profile.buses.iter().enumerate() {
            let is_same = |other: &isotherm_profile::Bus| other.address == bus.address;
            let first = profile.buses.iter().position(is_same).unwrap_or(index);
            if let Some((_, address)) = machine.addresses.iter().find(|(id, _)| id.0 == first) {
                let address = address.clone();
                machine.addresses.push((BusId(index), address));
                continue;
            }
            let stop = stopped.clone();
            let (address, gate) = match bus.transport {
                Transport::Tcp | Transport::RtuOverTcp => {
                    let listener = listen(bus, setup.ports).await?;
                    let address = listener.local_addr().map_err(|source| refused(bus, source))?;
                    let (gate, line, switched) = machine.gate(profile, index, setup.unknown_unit);
                    let serving = server::serve(listener, line, switched, stop);
                    machine.keep(address.to_string(), serving);
                    (address.to_string(), gate)
                }
                Transport::Serial(serial) => {
                    let name = name(bus, setup.ports).map_err(|source| refused(bus, source))?;
                    let path = name.path().display().to_string();
                    let (gate, line, switched) = machine.gate(profile, index, UnknownUnit::Silence);
                    machine.keep(path.clone(), port::serve(name, serial, line, switched, stop));
                    (path, gate)
                }
                Transport::Can => {
                    let line = machine.can_line(profile, index, begin);
                    let wanted = machine.shared.hardware().can_wanted(&line.places);
                    let port = Port::open(&bus.address, wanted, clock);
                    let port = port.map_err(|source| refused(bus, source))?;
                    machine.keep(bus.address.clone(), can::line::serve(port, line, clock.join(), stop));
                    machine.addresses.push((BusId(index), bus.address.clone()));
                    continue;
                }
                // Lines of other types are not simulated. Their devices are left out.
                _ => continue,
            };
            machine.addresses.push((BusId(index), address));
            gates.push(gate);
        }
        let (shared, stop) = (machine.shared.clone(), stopped);
        machine.tasks.spawn(live(shared, sleeper, begin, gates, stop));
        Ok(machine)
    }

    fn gate(
        &self,
        profile: &Profile,
        bus: usize,
        unknown_unit: UnknownUnit,
    ) -> (ListenerSwitch, Arc<Line>, mpsc::Receiver<OpenOrClose>) {
        let units: Vec<_> = on_line(profile, bus).collect();
        let (switch, switched) = mpsc::channel(1);
        let gate =
            ListenerSwitch { devices: units.iter().map(|(_, id)| *id).collect(), switch, is_open: true };
        let is_tcp = profile.buses[bus].transport == Transport::Tcp;
        let framing = if is_tcp { Framing::Tcp } else { Framing::Rtu };
        let (slice, shared) = (profile.buses[bus].timeout / WallTimeout::SLICES, self.shared.clone());
        (
            gate,
            Arc::new(Line {
                units,
                framing,
                unknown_unit,
                slice,
                serial_side: SerialSide::default(),
                shared,
            }),
            switched,
        )
    }

    fn can_line(&self, profile: &Profile, bus: usize, begin: Moment) -> CanLine {
        let places = self.shared.hardware().places(on_line(profile, bus).map(|(_, id)| id));
        CanLine { places, shared: self.shared.clone(), begin }
    }

    fn keep(&mut self, address: String, serving: impl Future<Output = std::io::Result<()>> + Send + 'static) {
        self.tasks.spawn(async move { serving.await.map_err(|error| format!("{address}: {error}")) });
    }

    /// Actual address of each bus: host and port, or the path of a serial port.
    pub fn addresses(&self) -> &[(BusId, String)] {
        &self.addresses
    }

    /// The profile with the actual addresses of the devices.
    pub fn serving(&self, mut profile: Profile) -> Profile {
        for (bus, address) in &self.addresses {
            if let Some(bus) = profile.buses.get_mut(bus.0) {
                bus.address.clone_from(address);
            }
        }
        profile
    }

    /// Actual address of a bus over TCP.
    pub fn address(&self, bus: BusId) -> Option<SocketAddr> {
        self.addresses.iter().find(|(id, _)| *id == bus).and_then(|(_, address)| address.parse().ok())
    }

    /// Access to the truth of this machine.
    pub fn window(&self) -> Window {
        Window(self.shared.clone())
    }

    /// Returns only when a task has failed. Await it in parallel to the use of the machine.
    pub async fn failure(&mut self) -> VirtualMachineError {
        match self.tasks.join_next().await {
            Some(Ok(Ok(()))) => VirtualMachineError::Failed("a task ended by itself".to_owned()),
            Some(Ok(Err(message))) => VirtualMachineError::Failed(message),
            Some(Err(error)) => VirtualMachineError::Failed(error.to_string()),
            None => std::future::pending().await,
        }
    }

    /// Ends the machine, and closes listeners and connections.
    ///
    /// # Errors
    /// A task has failed.
    pub async fn stop(mut self) -> Result<Summary, VirtualMachineError> {
        let _ = self.stop.send(true);
        while let Some(ended) = self.tasks.join_next().await {
            ended
                .map_err(|error| VirtualMachineError::Failed(error.to_string()))?
                .map_err(VirtualMachineError::Failed)?;
        }
        Ok(self.window().summary())
    }
}

/// Devices that share the address of a bus, each with its unit.
fn on_line(profile: &Profile, bus: usize) -> impl Iterator<Item = (u8, DeviceId)> {
    let address = &profile.buses[bus].address;
    let devices = profile.devices.iter().enumerate();
    let same = devices.filter(move |(_, device)| profile.bus(device.bus).address == *address);
    same.map(|(index, device)| (device.unit, DeviceId(index)))
}

async fn listen(bus: &isotherm_profile::Bus, ports: Ports) -> Result<TcpListener, VirtualMachineError> {
    let address = match ports {
        Ports::AsInProfile => bus.address.as_str(),
        Ports::Free => "127.0.0.1:0",
    };
    TcpListener::bind(address).await.map_err(|source| refused(bus, source))
}

/// Name of a serial port: the path in the profile if it is free, otherwise another one.
fn name(bus: &isotherm_profile::Bus, ports: Ports) -> std::io::Result<port::Name> {
    let wanted = match ports {
        Ports::AsInProfile => port::Name::wanted(Path::new(&bus.address)),
        Ports::Free => None,
    };
    wanted.map_or_else(|| port::Name::free(&bus.name), Ok)
}

fn refused(bus: &isotherm_profile::Bus, source: std::io::Error) -> VirtualMachineError {
    VirtualMachineError::Listen { bus: bus.name.clone(), address: bus.address.clone(), source }
}
