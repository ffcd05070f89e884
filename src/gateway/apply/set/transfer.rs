//! The requests of a set: its registers read, written in their order, and read back.

use std::collections::BTreeMap;

use super::{Part, SetWriter, found};
use crate::codec::{Register, Table};
use crate::fieldbus::departure::Leave;
use crate::fieldbus::error::{Fault, Outcome};
use crate::fieldbus::line::DeviceLine;
use crate::fieldbus::wire::{Answer, Request};
use crate::gateway::apply::Words;
use crate::gateway::apply::exchange::{self, Cells, Own, Sent};
use crate::gateway::shared::Shared;
use crate::quantity::Moment;

/// What was known before a set was sent.
struct Before {
    uncertain: Vec<Option<Words>>,
    unfinished: Option<Sent>,
    told: (u16, Option<u16>),
}

impl SetWriter {
    /// Every register of the set as it stands now.
    pub(super) async fn look(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        parts: &[Part],
    ) -> Option<Cells> {
        match self.read(line, shared).await {
            Ok(cells) => Some(cells),
            Err(fault) => {
                self.each(parts, |member, part| {
                    if part != Part::Kept {
                        member.fail(shared, shared.profile.output(member.id), fault);
                    }
                });
                None
            }
        }
    }

    async fn read(&mut self, line: &mut DeviceLine, shared: &Shared) -> Result<Cells, Fault> {
        let set = shared.profile.set(self.id);
        let mut cells = BTreeMap::new();
        for stretch in exchange::stretches(&shared.profile, set) {
            let from = Register { table: Table::Holding, offset: stretch.from };
            let request = Request::Read { from, count: stretch.count };
            if let Answer::Words(words) = line.request(set.device, request, Leave::Whenever).await?.answer {
                cells.extend((stretch.from..).zip(words));
            }
        }
        if let Some(found) = set.sequence.and_then(|at| cells.get(&at.offset)) {
            self.sequence = *found;
        }
        if let Some(found) = set.heartbeat.and_then(|at| cells.get(&at.offset)) {
            self.beat = *found;
        }
        Ok(cells)
    }

    /// Writes the values, and where all of them have arrived, the sequence; then the strobe, or the end.
    pub(super) async fn send(
        &mut self,
        line: &mut DeviceLine,
        shared: &Shared,
        parts: &[Part],
        targets: Vec<Option<Words>>,
        not_after: Moment,
    ) {
        let set = shared.profile.set(self.id);
        let Some(values) = targets.into_iter().collect::<Option<Vec<Words>>>() else { return };
        let sequence = set.sequence.map(|_| exchange::next(self.sequence));
        let own = Own { sequence, heartbeat: exchange::next_beat(self.beat), control: self.control(shared) };
        let cells = exchange::cells(&shared.profile, set, &values, own);
        let free = |(value, part): (&Words, &Part)| (*part == Part::Free).then_some(*value);
        let sent: Vec<Option<Words>> = values.iter().zip(parts).map(free).collect();
        let before = self.before();
        for (member, value) in self.members.iter_mut().zip(&sent) {
            member.uncertain = value.or(member.uncertain);
        }
        let single = shared.profile.device(set.device).functions.write_single;
        self.unfinished = Some(Sent { values: sent, cells: cells.clone(), sequence, is_taken: false });
        (self.beat, self.told_control) = (own.heartbeat, Some(own.control));
        for (place, stretch) in exchange::stretches(&shared.profile, set).iter().enumerate() {
            let words = exchange::words(&cells, stretch);
            let request = match words.as_slice() {
                [word] if single => Request::WriteSingle { at: stretch.from, word: *word },
                words => Request::WriteMultiple { at: stretch.from, words },
            };
            // The first request decides; what belongs to it follows, however late.
            let leave = if place == 0 { Leave::Here(not_after) } else { Leave::Whenever };
            if let Err(fault) = line.request(set.device, request, leave).await {
                if place == 0 && fault.outcome() == Outcome::NotDone {
                    // What stood there still stands.
                    self.take_back(before);
                    if fault.has_lapsed() {
                        return;
                    }
                }
                return self.each(parts, |member, part| {
                    if part == Part::Free {
                        member.fail(shared, shared.profile.output(member.id), fault);
                    }
                });
            }
        }
        self.sequence = sequence.unwrap_or_default();
        if set.handshake.is_none() {
            return self.finish(line, shared).await;
        }
        if self.raise(line, shared).await {
            Box::pin(self.advance(line, shared, shared.clock.now())).await;
        }
    }

    /// What is known before a set is sent.
    fn before(&self) -> Before {
        Before {
            uncertain: self.members.iter().map(|member| member.uncertain).collect(),
            unfinished: self.unfinished.clone(),
            told: (self.beat, self.told_control),
        }
    }

    /// Nothing was sent: what was known before is what is known.
    fn take_back(&mut self, before: Before) {
        self.unfinished = before.unfinished;
        (self.beat, self.told_control) = before.told;
        for (member, uncertain) in self.members.iter_mut().zip(before.uncertain) {
            (member.uncertain, member.compare) = (uncertain, true);
        }
    }

    /// Reads everything back: what was sent is believed now, or doubted.
    pub(super) async fn finish(&mut self, line: &mut DeviceLine, shared: &Shared) {
        let parts: Vec<Part> = match &self.unfinished {
            Some(sent) => {
                sent.values.iter().map(|sent| if sent.is_some() { Part::Free } else { Part::Kept }).collect()
            }
            None => return,
        };
        let Some(cells) = self.look(line, shared, &parts).await else { return };
        let Some(sent) = self.unfinished.take() else { return };
        let now = shared.clock.now();
        self.written_at = now;
        self.succeeded(shared);
        for (member, value) in self.members.iter_mut().zip(&sent.values) {
            let Some(value) = value else { continue };
            let output = shared.profile.output(member.id);
            if member.is_verified(shared, output, *value, found(output, &cells), now) {
                member.settle(shared, output, *value, now, true);
            }
        }
    }
}
