//! Files with the topics and the death number that earlier runs have published.
//!
//! The death number (bdSeq) of a Sparkplug node must follow the last death number of the previous run. For JSON
//! messages, the broker retains the last message of each topic. If a topic is no longer published, its last message
//! would look current forever. The topics are therefore saved, and the next run clears the topics that it does not
//! publish.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use isotherm_core::quantity::Moment;
use isotherm_plant::store::{NumberFile, TopicsFile};
use isotherm_plant::{Message, Publisher, Qos};

/// Name of the file with the death number, in the directory of unpublished records.
const DEATHS: &str = "bdseq";
/// Name of the file with the topics, in the directory of unpublished records.
const TOPICS: &str = "topics";
/// Duration of a connection after which its first messages count as delivered.
const ARRIVED_AFTER: Duration = Duration::from_secs(60);

/// Topics or death number that earlier runs have published, and the file that stores them. The variant
/// depends on the message format.
pub(super) enum Memory {
    /// File with the death number of a Sparkplug node, and the number that it contains.
    Deaths { file: NumberFile, kept: Option<u8> },
    /// Topics of JSON messages that the broker may have retained.
    Topics {
        file: TopicsFile,
        /// Topics of earlier runs that this run does not publish. Their retained messages may not be cleared
        /// yet.
        gone: BTreeSet<String>,
        /// Start of the present connection, and the topics of the messages that were published on this connection.
        told: (Moment, BTreeSet<String>),
    },
}

impl Memory {
    /// Reads the death number of the last run. `None` if no number was saved: the numbers then begin at zero.
    pub(super) fn of_deaths(directory: &Path) -> (Memory, Option<u8>) {
        let file = NumberFile::at(directory.join(DEATHS));
        let last = file.read().ok().flatten();
        let kept = last.map(|last| u8::try_from(last % 256).unwrap_or(0));
        (Memory::Deaths { file, kept }, kept)
    }

    /// Reads the topics to which earlier runs have published.
    pub(super) fn of_topics(directory: &Path) -> Memory {
        let file = TopicsFile::at(directory.join(TOPICS));
        // If the list cannot be read, old messages stay at the broker.
        let gone = file.read().unwrap_or_default();
        Memory::Topics { file, gone, told: (Moment::default(), BTreeSet::new()) }
    }

    /// Saves the death number in the will message of the next connection. The program may be killed as soon as the
    /// CONNECT packet is sent.
    pub(super) fn wills(&mut self, publisher: &dyn Publisher) {
        self.keep_number(publisher.number_to_keep());
    }

    /// Saves the death number that was sent last, at the end of the run. The number in the file may be newer,
    /// from a will message that was never sent.
    pub(super) fn ends(&mut self, publisher: &dyn Publisher) {
        self.keep_number(publisher.number_sent());
    }

    fn keep_number(&mut self, number: Option<u8>) {
        let Memory::Deaths { file, kept } = self else { return };
        if *kept == number {
            return;
        }
        // If the disk fails, the next run may use the same number again.
        let written = match number {
            Some(number) => file.write(number.into()),
            None => file.clear(),
        };
        if written.is_ok() {
            *kept = number;
        }
    }

    /// Adds messages that clear the topics of earlier runs to the first messages of a connection, and saves the topics.
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

    /// Removes the cleared topics from the file as soon as the messages that clear them count as delivered.
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

/// Makes a message by which the broker deletes the retained message of a topic.
fn cleared(topic: &str) -> Message {
    Message { topic: topic.to_owned(), payload: Vec::new(), qos: Qos::AtLeastOnce, retained: true }
}

#[cfg(test)]
mod tests;
