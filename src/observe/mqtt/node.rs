//! A Sparkplug node with a death number (bdSeq) that is kept across restarts.

use std::path::Path;

use isotherm_core::quantity::Moment;
use isotherm_plant::sparkplug::{Address, Sparkplug};
use isotherm_plant::store::NumberFile;
use isotherm_plant::{Message, Publisher, Reaction, Record, Snapshot, Subscription};

/// File name, in the directory of the queue.
const DEATHS: &str = "bdseq";

/// The node, and the file of its death number.
pub(super) struct Node {
    node: Sparkplug,
    number: NumberFile,
    /// Number of left-out records at the last query.
    left_out: u64,
}

impl Node {
    pub(super) fn new(address: Address, directory: &Path, takes_measured: bool) -> Node {
        let number = NumberFile::at(directory.join(DEATHS));
        // Without a file the number begins at zero. A host accepts any number except the last one.
        let last = number.read().ok().flatten().unwrap_or(0);
        let last = u8::try_from(last % 256).unwrap_or(0);
        Node { node: Sparkplug::new(address, last, takes_measured), number, left_out: 0 }
    }
}

impl Publisher for Node {
    fn will(&mut self) -> Message {
        let will = self.node.will();
        // If the disk fails, the next run may use the same number again.
        let _ = self.number.write(self.node.bd_seq().into());
        will
    }

    fn subscriptions(&self) -> Vec<Subscription> {
        self.node.subscriptions()
    }

    fn connected(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        self.node.connected(now, snapshot)
    }

    fn publish(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Message> {
        self.node.publish(now, snapshot)
    }

    fn received(&mut self, now: Moment, snapshot: &Snapshot, topic: &str, payload: &[u8]) -> Reaction {
        self.node.received(now, snapshot, topic, payload)
    }

    fn disconnected(&mut self, last_heard: Moment) -> Vec<Record> {
        self.node.disconnected(last_heard)
    }

    fn absent(&mut self, now: Moment, snapshot: &Snapshot) -> Vec<Record> {
        self.node.absent(now, snapshot)
    }

    fn forward(&mut self, now: Moment, records: &[Record]) -> Vec<Message> {
        self.node.forward(now, records)
    }

    fn may_forward(&self) -> bool {
        self.node.may_forward()
    }

    fn tells_in_order(&self) -> bool {
        self.node.tells_in_order()
    }

    fn farewell(&mut self, now: Moment) -> Vec<Message> {
        self.node.farewell(now)
    }

    fn left_out(&mut self) -> u64 {
        let all = self.node.left_out();
        let all = all.unreadable_records + all.unknown_values + all.unconfirmed_records + all.events;
        all.saturating_sub(std::mem::replace(&mut self.left_out, all))
    }
}
