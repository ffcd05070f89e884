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

use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::line_handle::LineHandle;
use crate::gateway::output::Wait;
use crate::observe::events::Event;
use crate::observe::handshake::HandshakeFault;
use isotherm_core::quantity::Moment;
use isotherm_profile::{Flag, OutputSet, SetId};

/// How often the acknowledge is asked for at most.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// The strobe and what is waited for.
#[derive(Debug)]
pub(super) struct Strobe {
    set: SetId,
    pub(super) stands: Stands,
    /// What is waited for, until when, and when the acknowledge is asked for again.
    pub(super) waits: Option<(Wait, Moment, Moment)>,
    /// It was raised in a write that nobody answered, and may rise late.
    may_rise: bool,
    /// The failure that has been reported; the next success ends it.
    reported: Option<HandshakeFault>,
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
}

impl Strobe {
    pub(super) fn new(set: SetId, stands: Stands) -> Strobe {
        Strobe { set, stands, waits: None, may_rise: false, reported: None }
    }

    /// Raises the strobe and begins to wait for the acknowledge.
    pub(super) async fn raise(&mut self, line: &mut DeviceLine, shared: &LineHandle) -> bool {
        let set = shared.profile.set(self.set);
        let Some(handshake) = set.handshake else { return false };
        self.stands = Stands::Up;
        self.publish(shared);
        if let Err(fault) = write_strobe(line, shared, set, handshake.strobe, true).await {
            if fault.outcome() == Outcome::NotDone {
                // It never went up.
                self.stands = Stands::Down;
            } else {
                self.may_rise = true;
            }
            self.failed(line, shared, HandshakeFault::StrobeNotWritten, fault.to_string()).await;
            return false;
        }
        self.wait_for(shared, Wait::Acknowledge, handshake.timeout);
        true
    }

    /// Drops the strobe. Where that fails it is reported, and tried again.
    pub(super) async fn lower(&mut self, line: &mut DeviceLine, shared: &LineHandle) -> bool {
        let set = shared.profile.set(self.set);
        let Some(handshake) = set.handshake else { return true };
        let done = write_strobe(line, shared, set, handshake.strobe, false).await;
        if let Err(fault) = done {
            self.report_failed(shared, HandshakeFault::StrobeNotDropped, fault.to_string());
            return false;
        }
        self.stands = Stands::Down;
        self.publish(shared);
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
    pub(super) async fn wait(&mut self, line: &mut DeviceLine, shared: &LineHandle) -> Waited {
        let set = shared.profile.set(self.set);
        let (Some((wait, until, ask)), Some(handshake)) = (self.waits, set.handshake) else {
            return Waited::Over;
        };
        let now = shared.clock.now();
        if now < ask {
            return Waited::Still;
        }
        let is_up = match read_flag(line, set, handshake.acknowledge).await {
            Ok(is_up) => is_up,
            Err(fault) => {
                self.failed(line, shared, HandshakeFault::AcknowledgeNotRead, fault.to_string()).await;
                return Waited::Failed;
            }
        };
        if is_up == (wait == Wait::Acknowledge) {
            self.waits = None;
            self.publish(shared);
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
        self.failed(line, shared, fault, format!("within {} ms", handshake.timeout.as_millis())).await;
        Waited::Failed
    }

    /// First of all the strobe goes down; then it is reported.
    async fn failed(
        &mut self,
        line: &mut DeviceLine,
        shared: &LineHandle,
        fault: HandshakeFault,
        cause: String,
    ) {
        self.waits = None;
        let lowered = self.stands != Stands::Up || self.lower(line, shared).await;
        // Where it cannot even be dropped, that is what is wrong, and it has been reported.
        if lowered || self.reported.is_none() {
            self.report_failed(shared, fault, cause);
        }
    }

    fn report_failed(&mut self, shared: &LineHandle, fault: HandshakeFault, cause: String) {
        if self.reported.replace(fault) != Some(fault) {
            self.stand(shared, |stand| stand.failed = Some(fault));
            let set = shared.profile.set(self.set);
            let register = set.handshake.map_or(String::new(), |handshake| match fault.is_of_the_strobe() {
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
        self.stand(shared, |stand| stand.failed = None);
    }

    /// What people see of it.
    fn publish(&self, shared: &LineHandle) {
        let (waits, strobe_up) = (self.waits.map(|(wait, ..)| wait), self.stands == Stands::Up);
        self.stand(shared, |stand| (stand.waits, stand.strobe_up) = (waits, strobe_up));
    }

    /// The same at the end of a turn; `says_enabled`: the control word of the set may say that every axis is armed.
    pub(super) fn show(&self, shared: &LineHandle, says_enabled: bool, is_untaken: bool) {
        self.publish(shared);
        self.stand(shared, |stand| (stand.says_enabled, stand.is_untaken) = (says_enabled, is_untaken));
    }

    fn stand(&self, shared: &LineHandle, change: impl Fn(&mut crate::gateway::output::Stand)) {
        let mut core = shared.core();
        for id in &shared.profile.set(self.set).outputs {
            change(&mut core.outputs[id.0].handshake);
        }
    }
}

async fn write_strobe(
    line: &mut DeviceLine,
    shared: &LineHandle,
    set: &OutputSet,
    strobe: Flag,
    up: bool,
) -> Result<(), Fault> {
    let at = strobe.address.offset;
    let word = [if up { strobe.raised() } else { 0 }];
    let request = if strobe.address.table.is_bits() {
        Request::WriteCoil { at, value: up }
    } else if shared.profile.device(set.device).functions.write_single {
        Request::WriteSingle { at, word: word[0] }
    } else {
        Request::WriteMultiple { at, words: &word }
    };
    line.request(set.device, request, Leave::Whenever).await.map(|_| ())
}

async fn read_flag(line: &mut DeviceLine, set: &OutputSet, flag: Flag) -> Result<bool, Fault> {
    let request = Request::Read { from: flag.address, count: 1 };
    let answered = line.request(set.device, request, Leave::Whenever).await?;
    Ok(match answered.answer {
        Answer::Bits(bits) => bits.first().copied().unwrap_or_default(),
        Answer::Words(words) => words.first().is_some_and(|word| flag.is_up(*word)),
        Answer::Done => false,
    })
}
