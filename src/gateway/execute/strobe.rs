//! The handshake around a set: strobe up, acknowledge up, strobe down, acknowledge down.
//!
//! ```text
//!   values written and read back ─► strobe up ─► Acknowledge ─► strobe down ─► Release ─► taken
//!                                                    │ not in time                │ not in time
//!                                                    ▼                            ▼
//!                                     strobe down at once, reported, tried again: the same values, from the beginning
//! ```
//!
//! Before anything is written the acknowledge must be down (`Clear`): one that is still up from before would answer a
//! strobe that the control has not seen. No wait blocks the line: the acknowledge is asked for once in every cycle, the
//! rest of which belongs to the others.

use std::time::Duration;

use super::LineTurn;
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{CallerFault, Fault, Outcome};
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::{Stand, Wait};
use crate::observe::events::{Event, HandshakeFault};
use isotherm_core::codec::{Address, DataType, Encoded};
use isotherm_core::quantity::Moment;
use isotherm_profile::{Bit, DeviceId, SetId};

/// How often the acknowledge is asked for at most.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// The strobe and what is waited for.
#[derive(Debug)]
pub(super) struct Strobe {
    set: SetId,
    device: DeviceId,
    pub(super) stands: Stands,
    /// What is waited for, until when, and when the acknowledge is asked for again.
    pub(super) waits: Option<(Wait, Moment, Moment)>,
    /// It was raised in a write that nobody answered, and may rise late.
    may_rise: bool,
    /// The failure that has been reported; the next success ends it.
    reported: Option<HandshakeFault>,
    /// The control word of the set may say that every axis is armed.
    pub(super) says_enabled: bool,
    /// What stands in the registers of the set was not taken yet.
    pub(super) is_untaken: bool,
}

/// What is known of a strobe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Stands {
    /// A gateway before this one may have left it up: dropped before the first write.
    #[default]
    Unknown,
    Down,
    /// Raised, or it may have been: dropped as soon as the device can be reached.
    Up,
}

/// What came of waiting.
pub(super) enum Waited {
    /// Not yet.
    Still,
    /// What was waited for is there.
    Over,
    /// It failed, which has been reported.
    Failed,
    /// The control answered each time, and what was waited for did not come. That has been reported.
    Missing,
}

impl Strobe {
    pub(super) fn new(shared: &LineHandle, set: SetId, stands: Stands) -> Strobe {
        Strobe {
            set,
            device: shared.profile.set(set).device,
            stands,
            waits: None,
            may_rise: false,
            reported: None,
            says_enabled: false,
            is_untaken: false,
        }
    }

    /// Raises the strobe and begins to wait for the acknowledge.
    pub(super) async fn raise(&mut self, turn: &mut LineTurn<'_>) -> bool {
        let shared = turn.shared;
        let Some(handshake) = &shared.profile.set(self.set).handshake else { return false };
        self.stands = Stands::Up;
        self.publish(turn.shared);
        if let Err(fault) = self.write(turn, &handshake.strobe, true).await {
            if fault.outcome() == Outcome::NotDone {
                // It never went up.
                self.stands = Stands::Down;
            } else {
                self.may_rise = true;
            }
            self.failed(turn, HandshakeFault::StrobeNotWritten, fault.to_string()).await;
            return false;
        }
        self.wait_for(turn.shared, Wait::Acknowledge, handshake.timeout);
        true
    }

    /// Drops the strobe. Where that fails it is reported, and tried again.
    pub(super) async fn lower(&mut self, turn: &mut LineTurn<'_>) -> bool {
        let shared = turn.shared;
        let Some(handshake) = &shared.profile.set(self.set).handshake else { return true };
        if let Err(fault) = self.write(turn, &handshake.strobe, false).await {
            self.report_failed(turn.shared, HandshakeFault::StrobeNotDropped, fault.to_string());
            return false;
        }
        self.stands = Stands::Down;
        self.publish(turn.shared);
        true
    }

    /// The gateway is about to end: nothing is waited for, and what may have risen meanwhile is dropped.
    pub(super) fn leaves(&mut self) {
        self.waits = None;
        if std::mem::take(&mut self.may_rise) {
            self.stands = Stands::Up;
        }
    }

    pub(super) fn wait_for(&mut self, shared: &LineHandle, wait: Wait, timeout: Duration) {
        let now = shared.clock.now();
        self.waits = Some((wait, now.after(timeout), now));
        self.publish(shared);
    }

    /// Asks for the acknowledge, once.
    pub(super) async fn wait(&mut self, turn: &mut LineTurn<'_>) -> Waited {
        let shared = turn.shared;
        let handshake = &shared.profile.set(self.set).handshake;
        let (Some((wait, until, ask)), Some(handshake)) = (self.waits, handshake) else {
            return Waited::Over;
        };
        let now = turn.shared.clock.now();
        if now < ask {
            return Waited::Still;
        }
        let is_up = match self.read(turn, &handshake.acknowledge).await {
            Ok(is_up) => is_up,
            Err(fault) => {
                self.failed(turn, HandshakeFault::AcknowledgeNotRead, fault.to_string()).await;
                return Waited::Failed;
            }
        };
        if is_up == (wait == Wait::Acknowledge) {
            self.waits = None;
            self.publish(turn.shared);
            return Waited::Over;
        }
        if now < until {
            self.waits = Some((wait, until, now.after(ASK_EVERY).min(until)));
            return Waited::Still;
        }
        if wait == Wait::Clear {
            // What answers may be a strobe that was given up, and was raised late.
            self.stands = Stands::Up;
        }
        let fault = match wait {
            Wait::Clear => HandshakeFault::AcknowledgeEarly,
            Wait::Acknowledge => HandshakeFault::AcknowledgeMissing,
            Wait::Release => HandshakeFault::AcknowledgeStuck,
        };
        self.failed(turn, fault, format!("within {} ms", handshake.timeout.as_millis())).await;
        Waited::Missing
    }

    /// First of all the strobe goes down; then it is reported.
    async fn failed(&mut self, turn: &mut LineTurn<'_>, fault: HandshakeFault, cause: String) {
        self.waits = None;
        let lowered = self.stands != Stands::Up || self.lower(turn).await;
        // Where it cannot even be dropped, that is what is wrong, and it has been reported.
        if lowered || self.reported.is_none() {
            self.report_failed(turn.shared, fault, cause);
        }
    }

    fn report_failed(&mut self, shared: &LineHandle, fault: HandshakeFault, cause: String) {
        if self.reported.replace(fault) != Some(fault) {
            let set = shared.profile.set(self.set);
            let register =
                set.handshake.as_ref().map_or(String::new(), |handshake| match fault.is_of_the_strobe() {
                    true => handshake.strobe.to_string(),
                    false => handshake.acknowledge.to_string(),
                });
            shared.report(&Event::Handshake { set: set.label(), fault, register, cause });
        }
        self.publish(shared);
    }

    /// A handshake came to its end.
    pub(super) fn succeeded(&mut self, shared: &LineHandle) {
        self.reported = None;
        self.publish(shared);
    }

    /// What people see of it.
    pub(super) fn publish(&self, shared: &LineHandle) {
        let stand = Stand {
            waits: self.waits.map(|(wait, ..)| wait),
            failed: self.reported,
            strobe_up: self.stands == Stands::Up,
            says_enabled: self.says_enabled,
            is_untaken: self.is_untaken,
        };
        let mut core = shared.core();
        for id in &shared.profile.set(self.set).outputs {
            core.outputs[id.0].handshake = stand;
        }
    }

    async fn write(&self, turn: &mut LineTurn<'_>, strobe: &Bit, up: bool) -> Result<(), Fault> {
        let functions = turn.shared.profile.device(self.device).functions;
        let (content, address) = match strobe {
            Bit::Flag(flag) => (Encoded::of(&[if up { flag.raised() } else { 0 }]), flag.address.into()),
            Bit::Node(node) => (node.word(u16::from(up)), Address::Node(node.clone())),
        };
        let request = match address.register() {
            Some(register) if register.table.is_bits() => {
                Request::WriteCoil { at: register.offset, value: up }
            }
            _ => Request::write(&address, content.registers(), functions),
        };
        turn.line.request(self.device, request, Leave::Whenever).await.map(|_| ())
    }

    async fn read(&self, turn: &mut LineTurn<'_>, bit: &Bit) -> Result<bool, Fault> {
        let (address, data_type) = match bit {
            Bit::Flag(flag) => (flag.address.into(), DataType::U16),
            Bit::Node(node) => (Address::Node(node.clone()), node.taken_as()),
        };
        let Some(request) = Request::read(&address, data_type) else {
            return Err(Fault::Caller(CallerFault::Function));
        };
        let answered = turn.line.request(self.device, request, Leave::Whenever).await?;
        Ok(match (answered.answer.believed()?, bit) {
            (Answer::Bits(bits), _) => bits.first().copied().unwrap_or_default(),
            (answer, Bit::Flag(flag)) => {
                answer.registers().first().is_some_and(|register| flag.is_up(*register))
            }
            (answer, Bit::Node(_)) => answer.registers().iter().any(|word| *word != 0),
        })
    }
}
