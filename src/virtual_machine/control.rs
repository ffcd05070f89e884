//! Virtual control that receives output sets, with or without a handshake. With a handshake, the control
//! acknowledges a strobe signal after a delay, and then accepts the values. If the set has a sequence number,
//! that number must have changed. Without a handshake, the control accepts the values when the sequence
//! number changes. Without handshake and sequence number, the control accepts the values at once.

use std::time::Duration;

use super::fault::AcknowledgeFault;
use super::registers::Bank;
use isotherm_core::codec::{Address, Node, Register};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bit, OutputId, OutputSet, Profile, SetId};

/// Time from a change of the strobe signal until the control reacts.
const REACTS_AFTER: Duration = Duration::from_millis(30);

/// Values that a control has accepted from an output set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AcceptedSet {
    /// Time at which the control accepted the values.
    pub at: Moment,
    /// Output set to which the values belong.
    pub set: SetId,
    /// Register values of each output, in the order of the output set.
    pub words: Vec<Vec<u16>>,
}

/// State of the virtual control for one output set: handshake, and accepted values.
#[derive(Clone, Debug)]
pub(super) struct Control {
    pub(super) set: SetId,
    /// Index of the hardware unit to which the output set belongs.
    pub(super) place: usize,
    outputs: Vec<(OutputId, Address, u16)>,
    /// Bits of the handshake: strobe and acknowledge; `None` if the output set has no handshake.
    handshake: Option<[Bit; 2]>,
    sequence: Option<Register>,
    last_sequence: u16,
    strobe_up: bool,
    /// Time at which the strobe signal last changed.
    changed: Moment,
    acknowledges: bool,
    taken: Vec<Vec<u16>>,
}

impl Control {
    pub(super) fn new(profile: &Profile, id: SetId, set: &OutputSet, place: usize, bank: &Bank) -> Control {
        let outputs = set.outputs.iter().zip(set.members(profile));
        let outputs =
            outputs.map(|(id, output)| (*id, output.address.clone(), output.encoding.data_type.registers()));
        let mut control = Control {
            set: id,
            place,
            outputs: outputs.collect(),
            handshake: bits(set),
            sequence: set.sequence,
            last_sequence: 0,
            strobe_up: false,
            changed: Moment::default(),
            acknowledges: false,
            taken: Vec::new(),
        };
        control.taken = control.read(bank);
        control
    }

    /// Returns the registers and bits of the output set itself (for example sequence number and handshake), without
    /// those of its outputs.
    pub(super) fn own(set: &OutputSet) -> impl Iterator<Item = Register> {
        let flags = bits(set).into_iter().flatten().filter_map(|bit| bit.flag());
        set.own_registers().chain(flags.map(|flag| flag.address))
    }

    /// Returns the OPC UA nodes of the output set itself (for example sequence number and handshake), without those of
    /// its outputs.
    pub(super) fn own_nodes(set: &OutputSet) -> impl Iterator<Item = Node> {
        let bits = bits(set).into_iter().flatten().filter_map(|bit| match bit {
            Bit::Node(node) => Some(node),
            Bit::Flag(_) => None,
        });
        set.own_nodes().map(|(_, node)| node.clone()).chain(bits)
    }

    /// Returns the register values of an output that the control accepted last; `None` if the output is not in this
    /// output set.
    pub(super) fn taken(&self, output: OutputId) -> Option<&[u16]> {
        let place = self.outputs.iter().position(|(id, ..)| *id == output)?;
        self.taken.get(place).map(Vec::as_slice)
    }

    /// Processes a write to the unit. Returns the values that the control accepts at once; `None` if it accepts none.
    pub(super) fn check(&mut self, bank: &Bank, now: Moment) -> Option<AcceptedSet> {
        if let Some([strobe, _]) = &self.handshake {
            let up = is_up(bank, strobe);
            if up != self.strobe_up {
                (self.strobe_up, self.changed) = (up, now);
            }
            return None;
        }
        let is_new =
            if self.sequence.is_some() { self.is_another(bank) } else { self.read(bank) != self.taken };
        is_new.then(|| self.take(bank, now))
    }

    /// Returns whether the sequence number has changed since the last call. Without a sequence number, always returns
    /// true.
    fn is_another(&mut self, bank: &Bank) -> bool {
        let sequence = self.sequence.and_then(|at| word(bank, at));
        sequence.is_none_or(|sequence| std::mem::replace(&mut self.last_sequence, sequence) != sequence)
    }

    /// Returns whether the sequence number follows the last accepted one. Without a sequence number, always returns
    /// true.
    fn is_next(&self, bank: &Bank) -> bool {
        let next = self.last_sequence.checked_add(1).unwrap_or(1);
        self.sequence.and_then(|at| word(bank, at)).is_none_or(|number| number == next)
    }

    /// Advances the handshake to `now`. Returns the values that the control has now acknowledged and accepted; `None`
    /// if it has accepted none.
    pub(super) fn advance(
        &mut self,
        bank: &mut Bank,
        fault: Option<AcknowledgeFault>,
        now: Moment,
    ) -> Option<AcceptedSet> {
        let [_, acknowledge] = self.handshake.as_ref()?;
        let delay = match fault {
            Some(AcknowledgeFault::Late(delay)) if self.strobe_up => delay,
            _ => REACTS_AFTER,
        };
        let is_kept = match fault {
            Some(AcknowledgeFault::Never) => self.strobe_up,
            Some(AcknowledgeFault::Stuck) => !self.strobe_up,
            Some(AcknowledgeFault::NextNumber) => self.strobe_up && !self.is_next(bank),
            _ => false,
        };
        if self.acknowledges == self.strobe_up || is_kept || now.since(self.changed) < delay {
            return None;
        }
        self.acknowledges = self.strobe_up;
        set_bit(bank, acknowledge, self.acknowledges);
        (self.acknowledges && self.is_another(bank)).then(|| self.take(bank, now))
    }

    /// Restarts the control. It loses its state, and accepts the present content of its registers.
    pub(super) fn restart(&mut self, bank: &Bank, now: Moment) -> AcceptedSet {
        (self.strobe_up, self.acknowledges, self.changed, self.last_sequence) = (false, false, now, 0);
        self.take(bank, now)
    }

    fn take(&mut self, bank: &Bank, at: Moment) -> AcceptedSet {
        self.taken = self.read(bank);
        AcceptedSet { at, set: self.set, words: self.taken.clone() }
    }

    fn read(&self, bank: &Bank) -> Vec<Vec<u16>> {
        let words = |(_, address, count): &(OutputId, Address, u16)| bank.read(address, *count);
        self.outputs.iter().map(|output| words(output).unwrap_or_default().to_vec()).collect()
    }
}

fn bits(set: &OutputSet) -> Option<[Bit; 2]> {
    let handshake = set.handshake.as_ref()?;
    Some([handshake.strobe.clone(), handshake.acknowledge.clone()])
}

fn word(bank: &Bank, address: Register) -> Option<u16> {
    bank.registers(address, 1).and_then(|words| words.first().copied())
}

fn is_up(bank: &Bank, bit: &Bit) -> bool {
    match bit {
        Bit::Flag(flag) => word(bank, flag.address).is_some_and(|word| flag.is_up(word)),
        Bit::Node(node) => {
            let words = bank.read(&bit.address(), node.taken_as().registers());
            words.is_some_and(|words| words.iter().any(|word| *word != 0))
        }
    }
}

fn set_bit(bank: &mut Bank, bit: &Bit, up: bool) {
    let flag = match bit {
        Bit::Flag(flag) => flag,
        Bit::Node(node) => return bank.set(&bit.address(), node.word(u16::from(up)).registers()),
    };
    let before = word(bank, flag.address).unwrap_or_default();
    let after = match flag.bit {
        Some(_) if up => before | flag.raised(),
        Some(_) => before & !flag.raised(),
        None => u16::from(up),
    };
    bank.set(&flag.address.into(), &[after]);
}
