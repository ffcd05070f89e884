//! Files from which the publisher knows what earlier runs have published.
//!
//! The death number (bdSeq) of a Sparkplug node must differ from the last one. The broker retains readable messages for
//! later subscribers. Retained messages of topics that are no longer published would look current forever. The topics
//! are therefore kept on disk, and the next run clears those that it no longer publishes.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use isotherm_core::quantity::Moment;
use isotherm_plant::store::{NumberFile, TopicsFile};
use isotherm_plant::{Message, Publisher, Qos};

/// Name of the file with the death number, in the directory of the queue.
const DEATHS: &str = "bdseq";
/// Name of the file with the topics.
const TOPICS: &str = "topics";
/// Age of a connection after which its first messages count as delivered.
const ARRIVED_AFTER: Duration = Duration::from_secs(60);

/// Memory of earlier runs.
pub(super) enum Memory {
    /// Death number of a Sparkplug node.
    Deaths(NumberFile),
    /// Topics that the broker may have retained.
    Topics {
        file: TopicsFile,
        /// Topics of earlier runs that this run does not publish.
        gone: BTreeSet<String>,
        /// Start of this connection, and the topics published on it.
        told: (Moment, BTreeSet<String>),
    },
}

impl Memory {
    /// Reads the last death number.
    pub(super) fn of_deaths(directory: &Path) -> (Memory, u8) {
        let file = NumberFile::at(directory.join(DEATHS));
        // Without a file the number begins at zero. A host accepts any number except the last one.
        let last = file.read().ok().flatten().unwrap_or(0);
        (Memory::Deaths(file), u8::try_from(last % 256).unwrap_or(0))
    }

    /// Reads the topics of earlier runs.
    pub(super) fn of_topics(directory: &Path) -> Memory {
        let file = TopicsFile::at(directory.join(TOPICS));
        // If the list cannot be read, old messages stay at the broker.
        let gone = file.read().unwrap_or_default();
        Memory::Topics { file, gone, told: (Moment::default(), BTreeSet::new()) }
    }

    /// Keeps the death number in the will of the next connection.
    pub(super) fn wills(&self, publisher: &dyn Publisher) {
        if let (Memory::Deaths(file), Some(number)) = (self, publisher.number_to_keep()) {
            // If the disk fails, the next run may use the same number again.
            let _ = file.write(number.into());
        }
    }

    /// Adds messages that clear topics to the first messages of a connection.
    pub(super) fn connects(&mut self, now: Moment, messages: &mut Vec<Message>) {
        let Memory::Topics { file, gone, told } = self else { return };
        let kept = messages.iter().filter(|message| message.retained);
        let topics: BTreeSet<String> = kept.map(|message| message.topic.clone()).collect();
        gone.retain(|topic| !topics.contains(topic));
        messages.extend(gone.iter().map(|topic| cleared(topic)));
        // If the disk fails, the next run uses an older list.
        let _ = file.write(topics.union(gone));
        *told = (now, topics);
    }

    /// Forgets the cleared topics when these messages count as delivered.
    pub(super) fn publishes(&mut self, now: Moment) {
        if let Memory::Topics { file, gone, told: (since, topics) } = self
            && !gone.is_empty()
            && now.since(*since) > ARRIVED_AFTER
        {
            gone.clear();
            let _ = file.write(&*topics);
        }
    }
}

/// Message that makes the broker delete the retained message of a topic.
fn cleared(topic: &str) -> Message {
    Message { topic: topic.to_owned(), payload: Vec::new(), qos: Qos::AtLeastOnce, retained: true }
}

#[cfg(test)]
mod tests;
