//! Virtual machine: simulated hardware that serves the devices of a profile.
//!
//! The virtual machine serves the Modbus devices of a profile, and the devices that send text, on real sockets and
//! pseudo-terminals. It serves the CAN devices on their interface, and the nodes of OPC UA servers. A simulated machine
//! (the plant) warms up, drifts and bends by its own model, and its true error is known. Offsets that a client writes
//! act on the plant as on a real machine, so that a run shows the effect of the compensation. A fault script causes
//! faults of answers, sensors, connections and memories.
//!
//! # Layout
//! ```text
//! plant     a thermal network with sensors, pure          wander    values for signals without a plant
//! registers the tables of a device                        modbus    bytes ↔ frames, requests and answers, pure
//! fault     faults with their times                       hardware  plant, registers and faults together
//! server    sockets, and requests on a line               truth     error, Cz, residual, and their ranges
//! port      serial ports                                  gate      plant task; opens and closes listeners
//! journal   recorded requests, for tests                  control   handshakes and output sets
//! probing   probing cycle of the control, for axes with a probe
//! can       nodes of a CAN interface                      random    a random number generator for each purpose
//! text      devices that send lines of text                opcua     OPC UA servers (feature `opcua`)
//! listener  TCP ports, and the connections of devices that send text and of OPC UA servers
//! ```
//!
//! # Time
//! All tasks use one clock. On a virtual clock, runs with the same seed are equal, byte for byte, at any speed. The
//! plant advances on its own time grid. A virtual clock does not advance while a request is answered.

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
mod listener;
mod modbus;
#[cfg(feature = "opcua")]
mod opcua;
mod port;
mod probing;
mod pseudo_terminal;
mod random;
mod registers;
mod serial_side;
mod server;
#[cfg(test)]
mod tests;
mod text;
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
use listener::Switch;
use modbus::Framing;
// With `self`, because the library has the same name.
#[cfg(feature = "opcua")]
use self::opcua::{Endpoint, NodeLine, NodeServer, ServerNodes};
use probing::Cycle;
use pseudo_terminal::{Name, VirtualPort};
use serial_side::SerialSide;
use server::{Line, OpenOrClose, Shared};
use text::{Ask, TextGroup, TextLine};

/// Interval at which the true error is sampled and the start of faults is checked.
pub const TICK: Duration = Duration::from_secs(1);

/// Default interval of the probing cycle of an axis with a probe.
const PROBED_EVERY: Duration = Duration::from_secs(3600);

/// Settings of a virtual machine in addition to its profile.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// Simulated machine. With `None`, signals vary in a plausible way, and the true error is not known.
    pub plant: Option<PlantSpec>,
    /// Seed of all random numbers of the run: the day's weather and operation, and the noise.
    pub seed: u64,
    /// Faults that begin at a time, or after a number of requests.
    pub faults: FaultScript,
    /// Addresses at which the devices listen.
    pub ports: Ports,
    /// Answer to a request for a unit that does not exist, on lines over TCP. A serial line does not answer.
    pub unknown_unit: UnknownUnit,
    /// Simulated time for which the plant has already run when the virtual machine starts.
    pub lived: Duration,
    /// Interval of the probing cycle; `None`: once an hour.
    pub probe_every: Option<Duration>,
    /// Whether every request that reaches a device is recorded, for [`Window::requests`].
    pub journal: bool,
}

impl Setup {
    /// Returns the settings for this plant and seed, with free ports.
    pub fn on_free_ports(plant: PlantSpec, seed: u64) -> Setup {
        Setup { plant: Some(plant), seed, ports: Ports::Free, ..Setup::default() }
    }
}

/// Addresses at which the devices listen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ports {
    /// The addresses in the profile.
    #[default]
    AsInProfile,
    /// Any free TCP ports of the loopback interface, and new paths of serial ports.
    Free,
}

/// Answer of a line to a request for a unit that does not exist.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum UnknownUnit {
    /// Exception 0x0B, as Modbus gateways send it.
    #[default]
    Exception,
    /// The client gets no answer, as on a serial line.
    Silence,
}

/// Reason why a virtual machine does not start, or has ended.
#[derive(Debug, thiserror::Error)]
pub enum VirtualMachineError {
    /// The virtual machine cannot listen at an address.
    #[error("cannot listen at {address} (bus `{bus}`)")]
    Listen {
        /// Name of the bus in the profile.
        bus: String,
        /// Address of the bus.
        address: String,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The virtual machine cannot simulate a bus.
    #[error("bus `{bus}` cannot be simulated: {why}")]
    NotSimulated {
        /// Name of the bus in the profile.
        bus: String,
        /// Reason why the bus cannot be simulated.
        why: String,
    },
    /// A task of the virtual machine has failed, for the reason in the text.
    #[error("the virtual machine has failed: {0}")]
    Failed(String),
}

/// Running virtual machine. Dropping it ends the virtual machine at once.
#[derive(Debug)]
pub struct VirtualMachine {
    addresses: Vec<(BusId, String)>,
    shared: Shared,
    stop: watch::Sender<bool>,
    tasks: JoinSet<Result<(), String>>,
}

/// Handle to read the results of a running virtual machine, from any thread.
#[derive(Clone, Debug)]
pub struct Window(Shared);

impl Window {
    /// Returns the summary of the run so far.
    pub fn summary(&self) -> Summary {
        self.0.hardware().observer.summary.clone()
    }

    /// Returns every request that has reached a device, in order; empty without [`Setup::journal`].
    pub fn requests(&self) -> Vec<SeenRequest> {
        self.0.hardware().journal.clone().unwrap_or_default()
    }

    /// Returns the values that controls have accepted from output sets, in order; empty without [`Setup::journal`].
    pub fn taken(&self) -> Vec<AcceptedSet> {
        self.0.hardware().taken.clone()
    }

    /// Sets the offset in µm that a real control applies to this axis. From then on, this offset replaces the
    /// offset that the virtual control applies.
    pub fn applies_elsewhere(&self, axis: AxisId, cz_um: f64) {
        self.0.hardware().applies_elsewhere(axis, cz_um);
    }

    /// Returns the true errors at the last tick; `None` before the first tick, and without a plant.
    pub fn latest_truth(&self) -> Option<TruthRow> {
        self.0.hardware().observer.latest.clone()
    }

    /// Removes the stored true errors, and returns them: one row for every ten seconds since the last call. At most
    /// 10,000 rows (about a day) are kept; later ones are lost.
    pub fn take_course(&self) -> Vec<TruthRow> {
        std::mem::take(&mut self.0.hardware().observer.course)
    }
}

impl VirtualMachine {
    /// Opens the listeners and starts the tasks on the current runtime. Start the virtual machine before its clients.
    /// It then registers with the clock first, so that at equal times the plant advances first. Keep a virtual clock on
    /// [`Clock::hold`] until all clients have registered. Otherwise the plant would run ahead of them.
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
        let (in_registers, texts) = text::in_registers(profile);
        #[cfg(feature = "opcua")]
        let in_registers = opcua::with_types(in_registers);
        let mut hardware = Hardware::new(&in_registers, plant, setup.seed, faults, begin, cycles);
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
                Transport::Tcp | Transport::RtuOverTcp | Transport::ModbusAsciiOverTcp => {
                    let listener = listen(bus, setup.ports).await?;
                    let address = listener.local_addr().map_err(|source| refused(bus, source))?;
                    let (gate, line, switched) = machine.gate(profile, index, setup.unknown_unit);
                    let serving = server::serve(listener, line, switched, stop);
                    machine.keep(address.to_string(), serving);
                    (address.to_string(), gate)
                }
                Transport::Serial(serial) | Transport::ModbusAscii { serial, .. } => {
                    let (path, port) = serial_port(bus, setup.ports)?;
                    let (gate, line, switched) = machine.gate(profile, index, UnknownUnit::Silence);
                    machine.keep(path.clone(), port::serve(port, serial, line, switched, stop));
                    (path, gate)
                }
                Transport::AsciiOverTcp => {
                    let listener = listen(bus, setup.ports).await?;
                    let address = listener.local_addr().map_err(|source| refused(bus, source))?;
                    let (gate, line, switched) = machine.text_gate(profile, index, &texts);
                    machine.keep(address.to_string(), text::serve(listener, line, switched, stop));
                    (address.to_string(), gate)
                }
                Transport::Ascii { serial, .. } => {
                    let (path, port) = serial_port(bus, setup.ports)?;
                    let (gate, line, switched) = machine.text_gate(profile, index, &texts);
                    machine.keep(path.clone(), text::serve_port(port, serial, line, switched, stop));
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
                #[cfg(feature = "opcua")]
                Transport::OpcUa => {
                    let Some(device) = on_line(profile, index).map(|(_, id)| id).next() else { continue };
                    machine.node_gate(&in_registers, (index, device), setup.ports, stop).await?
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
        let is_ascii = matches!(
            profile.buses[bus].transport,
            Transport::ModbusAscii { .. } | Transport::ModbusAsciiOverTcp
        );
        let (slice, shared) = (profile.buses[bus].timeout / WallTimeout::SLICES, self.shared.clone());
        (
            gate,
            Arc::new(Line {
                units,
                framing,
                is_ascii,
                unknown_unit,
                slice,
                serial_side: SerialSide::default(),
                shared,
            }),
            switched,
        )
    }

    fn text_gate(
        &self,
        profile: &Profile,
        bus: usize,
        texts: &[TextGroup],
    ) -> (ListenerSwitch, Arc<TextLine>, mpsc::Receiver<OpenOrClose>) {
        let (switch, switched) = mpsc::channel(1);
        let devices = on_line(profile, bus).map(|(_, id)| id).collect();
        let shared = self.shared.clone();
        let ask: Ask = Arc::new(move |device, pdu| shared.hardware().serve(device, pdu, shared.clock.now()));
        let line = TextLine::of(profile, bus, texts, ask);
        (ListenerSwitch { devices, switch, is_open: true }, Arc::new(line), switched)
    }

    /// Starts the OPC UA server of the bus `index`, whose first device is `device`. Returns the URL of the server, and
    /// the switch that opens and closes its listener.
    #[cfg(feature = "opcua")]
    async fn node_gate(
        &mut self,
        typed: &Profile,
        (index, device): (usize, DeviceId),
        ports: Ports,
        stop: watch::Receiver<bool>,
    ) -> Result<(String, ListenerSwitch), VirtualMachineError> {
        let bus = &typed.buses[index];
        let nodes = ServerNodes::of(typed, index);
        let nodes = nodes.map_err(|why| VirtualMachineError::NotSimulated { bus: bus.name.clone(), why })?;
        let (place, _) = Endpoint::parts(&bus.address);
        let at_place = isotherm_profile::Bus { address: place.to_owned(), ..bus.clone() };
        let listener = listen(&at_place, ports).await?;
        let port = listener.local_addr().map_err(|source| refused(bus, source))?.port();
        let host = match ports {
            Ports::AsInProfile => place.rsplit_once(':').map_or(place, |(host, _)| host),
            Ports::Free => "127.0.0.1",
        };
        let endpoint = Endpoint::new(bus, host, port);
        let line = NodeLine::new(nodes, self.shared.parts(), device);
        let server = NodeServer::start(line, &endpoint).await.map_err(|source| refused(bus, source))?;
        let (switch, switched) = mpsc::channel::<OpenOrClose>(1);
        self.keep(endpoint.url(), server.serve(listener, switched, stop));
        let devices = on_line(typed, index).map(|(_, id)| id).collect();
        Ok((endpoint.url(), ListenerSwitch { devices, switch, is_open: true }))
    }

    fn can_line(&self, profile: &Profile, bus: usize, begin: Moment) -> CanLine {
        let places = self.shared.hardware().places(on_line(profile, bus).map(|(_, id)| id));
        CanLine { places, shared: self.shared.clone(), begin }
    }

    fn keep(&mut self, address: String, serving: impl Future<Output = std::io::Result<()>> + Send + 'static) {
        self.tasks.spawn(async move { serving.await.map_err(|error| format!("{address}: {error}")) });
    }

    /// Returns the actual address of each bus: host and port, URL, path of a serial port, or CAN interface.
    pub fn addresses(&self) -> &[(BusId, String)] {
        &self.addresses
    }

    /// Returns the profile with the actual addresses of the buses, for a client of this virtual machine.
    pub fn serving(&self, mut profile: Profile) -> Profile {
        for (bus, address) in &self.addresses {
            if let Some(bus) = profile.buses.get_mut(bus.0) {
                bus.address.clone_from(address);
            }
        }
        profile
    }

    /// Returns the actual TCP address of a bus; `None` for a bus without TCP.
    pub fn address(&self, bus: BusId) -> Option<SocketAddr> {
        self.addresses.iter().find(|(id, _)| *id == bus).and_then(|(_, address)| address.parse().ok())
    }

    /// Returns a handle to read the results of this virtual machine.
    pub fn window(&self) -> Window {
        Window(self.shared.clone())
    }

    /// Waits until a task of the virtual machine fails, and returns the failure. Call it while the virtual machine is
    /// in use.
    pub async fn failure(&mut self) -> VirtualMachineError {
        match self.tasks.join_next().await {
            Some(Ok(Ok(()))) => VirtualMachineError::Failed("a task ended by itself".to_owned()),
            Some(Ok(Err(message))) => VirtualMachineError::Failed(message),
            Some(Err(error)) => VirtualMachineError::Failed(error.to_string()),
            None => std::future::pending().await,
        }
    }

    /// Ends the virtual machine, and closes listeners and connections. Returns the summary of the run.
    ///
    /// # Errors
    /// A task has failed during the run.
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

impl From<OpenOrClose> for Switch {
    fn from(OpenOrClose { is_open, done }: OpenOrClose) -> Switch {
        (is_open, done)
    }
}

/// Returns the devices on all buses with the address of this bus, each with its unit number.
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

/// Creates a virtual serial port: at the path in the profile if that path is free, otherwise at a new path. Also
/// returns the path.
fn serial_port(
    bus: &isotherm_profile::Bus,
    ports: Ports,
) -> Result<(String, VirtualPort), VirtualMachineError> {
    let wanted = match ports {
        Ports::AsInProfile => Name::wanted(Path::new(&bus.address)),
        Ports::Free => None,
    };
    let name = wanted.map_or_else(|| Name::free(&bus.name), Ok).map_err(|source| refused(bus, source))?;
    let path = name.path().display().to_string();
    Ok((path, VirtualPort::plug_in(name).map_err(|source| refused(bus, source))?))
}

fn refused(bus: &isotherm_profile::Bus, source: std::io::Error) -> VirtualMachineError {
    VirtualMachineError::Listen { bus: bus.name.clone(), address: bus.address.clone(), source }
}
