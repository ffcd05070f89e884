//! Virtual device on a CAN line: a CANopen node with its states, or a device that only sends. Of the CANopen services,
//! NMT changes the state of a node, and SDO reads and writes single objects. PDO frames contain measured values, and a
//! SYNC message triggers PDOs.

use std::time::Duration;

use isotherm_core::codec::{CanId, Entry, Frame};
use isotherm_core::quantity::Moment;

use super::dictionary::{Dictionary, SdoReply, Server};

/// Identifiers of CANopen services, to which the number of the node is added, except for NMT. `SYNC` is not an
/// identifier, but the object that contains the identifier of the SYNC message.
const NMT: u16 = 0x000;
const SYNC: Entry = Entry::new(0x1005, 0);
const EMERGENCY: u16 = 0x080;
const SDO_ANSWER: u16 = 0x580;
const SDO_REQUEST: u16 = 0x600;
const HEARTBEAT: u16 = 0x700;

/// Object with the interval at which the node sends its heartbeat, ms.
pub(crate) const HEARTBEAT_TIME: Entry = Entry::new(0x1017, 0);
/// Object with the error register: one bit for each kind of active error.
pub(crate) const ERROR_REGISTER: Entry = Entry::new(0x1001, 0);
/// Object with the cycle time of an encoder, ms. A write to this object also sets the event timer of the first PDO, and
/// vice versa.
pub(crate) const CYCLE: Entry = Entry::new(0x6200, 0);

/// Returns the objects with the communication parameters of a PDO: identifier, transmission type, and event timer in
/// ms.
pub(crate) const fn communication(pdo: u16) -> [Entry; 3] {
    let index = 0x1800 + pdo;
    [Entry::new(index, 1), Entry::new(index, 2), Entry::new(index, 5)]
}

/// Range of the objects of the communication profile. A communication reset sets them to their values at power-on.
const COMMUNICATION: std::ops::Range<u16> = 0x1000..0x2000;

/// Returns whether the node itself determines the value of an object, so that the value is not a measurement.
pub(crate) fn is_own(at: Entry) -> bool {
    COMMUNICATION.contains(&at.index) || at == CYCLE
}

#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// Node number; `None` for a device that only sends and is not a CANopen node.
    number: Option<u8>,
    /// Whether the node becomes operational by itself, without a command of a master.
    starts_itself: bool,
    state: State,
    pub(crate) objects: Dictionary,
    at_power_on: Dictionary,
    server: Server,
    heartbeat: Option<Moment>,
    pdos: Vec<Pdo>,
    /// Actions of this node that the virtual CAN line has not executed yet.
    pub(crate) acts: Vec<NodeAction>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Stopped = 0x04,
    Operational = 0x05,
    PreOperational = 0x7f,
}

/// PDO (process data object): a frame in which the node sends measured values.
#[derive(Clone, Debug)]
pub(crate) struct Pdo {
    id: CanId,
    /// Number of the PDO, which determines the objects with its parameters; `None`: no object has them.
    number: Option<u16>,
    /// Period of sending, used if no object has the parameters.
    every: Duration,
    due: Option<Moment>,
    syncs: u8,
}

/// Action of a node that the virtual CAN line executes for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NodeAction {
    /// Send this frame.
    Send(Frame),
    /// Send the measured values of the PDO with this index in the node's list.
    Measured(usize),
    /// Discard all written values, as after power-on. A call of [`Node::boot`] must follow.
    Reset,
    /// Update the stored values of the device, because the node itself has restored some objects.
    Restored,
}

impl Pdo {
    pub(crate) fn new(id: CanId, number: Option<u16>, every: Duration) -> Pdo {
        Pdo { id, number, every, due: None, syncs: 0 }
    }

    /// Returns the period of the PDO; `None` if no timer sends this PDO.
    fn period(&self, objects: &Dictionary) -> Option<Duration> {
        let Some(number) = self.number else { return Some(self.every) };
        let [_, kind, timer] = communication(number);
        let is_by_clock = objects.number(kind).is_some_and(|kind| kind >= 254);
        milliseconds(objects, timer).filter(|_| is_by_clock && self.is_valid(objects))
    }

    /// Returns the number of SYNC messages after which the PDO is sent; `None` if SYNC messages do not trigger this
    /// PDO.
    fn every_sync(&self, objects: &Dictionary) -> Option<u8> {
        let kind = objects.number(communication(self.number?)[1])?;
        u8::try_from(kind).ok().filter(|kind| *kind <= 240 && self.is_valid(objects))
    }

    /// Returns whether the objects of the node enable this PDO with the identifier in the profile. A PDO without
    /// parameter objects is always enabled.
    fn is_valid(&self, objects: &Dictionary) -> bool {
        let Some(number) = self.number else { return true };
        let wanted = u64::from(self.id.raw()) | if self.id.is_extended() { 1 << 29 } else { 0 };
        // Bit 30 concerns remote requests.
        objects.number(communication(number)[0]).is_some_and(|id| id & !(1 << 30) == wanted)
    }
}

/// Returns the time that an object contains in milliseconds; `None` for 0.
fn milliseconds(objects: &Dictionary, at: Entry) -> Option<Duration> {
    objects.number(at).filter(|time| *time > 0).map(Duration::from_millis)
}

impl Node {
    /// Returns a node whose power is off. [`Node::boot`] switches it on.
    pub(crate) fn new(number: Option<u8>, starts_itself: bool, objects: Dictionary, pdos: Vec<Pdo>) -> Node {
        Node {
            number,
            starts_itself,
            state: State::Stopped,
            at_power_on: objects.clone(),
            objects,
            server: Server::default(),
            heartbeat: None,
            pdos,
            acts: Vec::new(),
        }
    }

    /// Switches the power of the node on. All objects get their values at power-on.
    pub(crate) fn boot(&mut self, now: Moment) {
        self.acts.clear();
        self.objects = self.at_power_on.clone();
        self.begin(now);
    }

    /// Returns the time of the next heartbeat, or of the next PDO that a timer sends; `None` if neither is planned.
    pub(crate) fn due(&self) -> Option<Moment> {
        let heartbeat = self.heartbeat.filter(|_| milliseconds(&self.objects, HEARTBEAT_TIME).is_some());
        let by_clock = self.pdos.iter().filter(|pdo| pdo.period(&self.objects).is_some());
        let pdos = by_clock.filter_map(|pdo| pdo.due);
        pdos.filter(|_| self.state == State::Operational).chain(heartbeat).min()
    }

    /// Sends the heartbeat and the PDOs that are due at `now`, by adding them to the actions `acts`.
    pub(crate) fn tick(&mut self, now: Moment) {
        if let (Some(due), Some(period)) = (self.heartbeat, milliseconds(&self.objects, HEARTBEAT_TIME))
            && due <= now
        {
            self.send(HEARTBEAT, [self.state as u8]);
            self.heartbeat = Some(now.next_tick(due, period));
        }
        if self.state != State::Operational {
            return;
        }
        for (place, pdo) in self.pdos.iter_mut().enumerate() {
            if let (Some(due), Some(period)) = (pdo.due, pdo.period(&self.objects))
                && due <= now
            {
                self.acts.push(NodeAction::Measured(place));
                pdo.due = Some(now.next_tick(due, period));
            }
        }
    }

    /// Processes a frame of a CANopen service, if the frame is for this node. Returns the result of an SDO request;
    /// `None` for other frames.
    pub(crate) fn take(&mut self, frame: &Frame, now: Moment) -> Option<SdoReply> {
        let number = self.number?;
        let id = frame.id();
        if id == CanId::of_11_bits(NMT) {
            match frame.data() {
                [command, to, ..] if *to == number || *to == 0 => self.command(*command, now),
                _ => {}
            }
        } else if self.is_asked_by(frame) {
            let served = self.server.serve(frame.data(), &mut self.objects);
            if let Some(at) = served.written {
                self.has_changed(at, now);
            }
            return Some(served);
        } else if self.objects.number(SYNC).is_some_and(|sync| sync == u64::from(id.raw())) {
            self.sync();
        }
        None
    }

    /// Returns the identifiers of the services that the node receives.
    pub(crate) fn receives(&self) -> Vec<CanId> {
        let Some(number) = self.number else { return Vec::new() };
        let sync = self.objects.number(SYNC).and_then(|sync| CanId::standard(u32::try_from(sync).ok()?));
        let services = [NMT, SDO_REQUEST + u16::from(number)].map(CanId::of_11_bits);
        services.into_iter().chain(sync).collect()
    }

    /// Returns whether a frame is a request to the node's SDO server (server for object access).
    pub(crate) fn is_asked_by(&self, frame: &Frame) -> bool {
        let request = self.number.map(|number| CanId::of_11_bits(SDO_REQUEST + u16::from(number)));
        request == Some(frame.id()) && self.state != State::Stopped
    }

    /// Reverts the last write to an object. `objects` are the objects before this write. Timers that depend
    /// on the object are restarted.
    pub(crate) fn undo(&mut self, at: Entry, objects: Dictionary, now: Moment) {
        self.objects = objects;
        self.has_changed(at, now);
    }

    /// Returns whether the node accepts process data (frames with output values), that is, whether its state is
    /// operational.
    pub(crate) const fn takes_process_data(&self) -> bool {
        matches!(self.state, State::Operational)
    }

    /// Returns the frame with this answer to an SDO request; `None` for a device that only sends.
    pub(crate) fn answer(&self, bytes: [u8; 8]) -> Option<Frame> {
        self.service(SDO_ANSWER, bytes)
    }

    /// Sends an emergency message with this error code, and sets the error register to the kind of this
    /// error. Code 0 means that no error is present.
    pub(crate) fn complain(&mut self, code: u16) {
        let register = match code >> 12 {
            0 if code == 0 => 0,
            2 => 0x03,
            3 => 0x05,
            4 => 0x09,
            8 => 0x11,
            0xf => 0x81,
            _ => 0x01,
        };
        self.objects.set(ERROR_REGISTER, &[register]);
        let [low, high] = code.to_le_bytes();
        if self.state != State::Stopped {
            self.send(EMERGENCY, [low, high, register, 0, 0, 0, 0, 0]);
        }
    }

    fn command(&mut self, command: u8, now: Moment) {
        match command {
            0x01 => self.start(now),
            0x02 => self.state = State::Stopped,
            0x80 => self.state = State::PreOperational,
            0x81 => self.acts.push(NodeAction::Reset),
            0x82 => {
                self.objects.restore(&self.at_power_on, COMMUNICATION);
                self.acts.push(NodeAction::Restored);
                self.begin(now);
            }
            _ => {}
        }
    }

    fn begin(&mut self, now: Moment) {
        self.server = Server::default();
        self.send(HEARTBEAT, [0]);
        self.state = State::PreOperational;
        self.set_heartbeat(now);
        if self.starts_itself || self.number.is_none() {
            self.start(now);
        }
    }

    fn start(&mut self, now: Moment) {
        if self.state == State::Operational {
            return;
        }
        self.state = State::Operational;
        for pdo in &mut self.pdos {
            (pdo.syncs, pdo.due) = (0, pdo.period(&self.objects).map(|_| now));
        }
    }

    /// Applies the new value of an object that an SDO request has written.
    fn has_changed(&mut self, at: Entry, now: Moment) {
        let timer = communication(0)[2];
        for (from, to) in [(CYCLE, timer), (timer, CYCLE)] {
            if let Some(bytes) = self.objects.get(from).filter(|_| from == at) {
                let bytes = bytes.to_vec();
                self.objects.set(to, &bytes);
            }
        }
        if at == HEARTBEAT_TIME {
            self.set_heartbeat(now);
        }
        for pdo in &mut self.pdos {
            let own = pdo.number.map(communication);
            if at == CYCLE || own.is_some_and(|own| own.contains(&at)) {
                pdo.due = pdo.period(&self.objects).map(|period| now.after(period));
            }
        }
    }

    fn set_heartbeat(&mut self, now: Moment) {
        self.heartbeat = milliseconds(&self.objects, HEARTBEAT_TIME).map(|period| now.after(period));
    }

    fn sync(&mut self) {
        if self.state != State::Operational {
            return;
        }
        for (place, pdo) in self.pdos.iter_mut().enumerate() {
            let Some(every) = pdo.every_sync(&self.objects) else { continue };
            pdo.syncs += 1;
            if pdo.syncs >= every {
                pdo.syncs = 0;
                self.acts.push(NodeAction::Measured(place));
            }
        }
    }

    fn send<const N: usize>(&mut self, service: u16, bytes: [u8; N]) {
        self.acts.extend(self.service(service, bytes).map(NodeAction::Send));
    }

    fn service<const N: usize>(&self, service: u16, bytes: [u8; N]) -> Option<Frame> {
        let number = self.number?;
        Some(Frame::short(CanId::of_11_bits(service + u16::from(number)), bytes))
    }
}
