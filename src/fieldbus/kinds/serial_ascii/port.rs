//! Port of a device that sends lines of text, and discarding of old input.

use std::io;
use std::time::Duration;

use super::lines::LineBuffer;
use crate::clock::{Silence, WallTimeout};
use crate::fieldbus::error::Fault;
use crate::fieldbus::port::{Port, Tapped};
use crate::fieldbus::trace::Tap;

/// Open port of a device that sends text.
pub(super) struct TextPort {
    port: Tapped,
    lines: LineBuffer,
    patience: WallTimeout,
}

/// Input that was discarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Discarded {
    /// Number of characters, without the ends of lines. A line feed often follows the carriage return of an answer.
    pub(super) characters: usize,
    /// Number of whole lines.
    pub(super) lines: usize,
}

impl TextPort {
    pub(super) fn new(port: impl Port + 'static, data_bits: u8, tap: &Tap) -> TextPort {
        let (lines, patience) = (LineBuffer::new(data_bits), WallTimeout::new());
        TextPort { port: Tapped::new(port, tap), lines, patience }
    }

    /// Discards everything that has arrived. Returns the number of discarded characters and lines.
    pub(super) async fn discard(&mut self) -> Result<Discarded, Fault> {
        let mut discarded = Discarded { characters: usize::from(self.lines.is_inside()), lines: 0 };
        let mut bytes = [0; 256];
        loop {
            match self.port.take_waiting(&mut bytes) {
                Ok(0) => return Err(Fault::CLOSED),
                Ok(count) => {
                    self.lines.push(&bytes[..count]);
                    let is_character = |byte: &&u8| !matches!(**byte & 0x7f, b'\r' | b'\n');
                    discarded.characters += bytes[..count].iter().filter(is_character).count();
                    discarded.lines += self.lines.discard();
                    // An endless stream must not block the other tasks.
                    tokio::task::yield_now().await;
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => return Err(Fault::CLOSED),
            }
        }
        // Lines that arrived together with the last answer.
        discarded.lines += self.lines.discard();
        Ok(discarded)
    }

    /// Discards everything that arrives within `span`.
    pub(super) async fn discard_for(&mut self, span: Duration) -> Result<(), Fault> {
        let begun = Silence::begin();
        loop {
            let left = begun.left_of(span);
            if left.is_zero() || !self.receive(left).await? {
                break;
            }
            self.lines.discard();
        }
        self.discard().await.map(|_| ())
    }

    /// Waits until nothing has arrived for `span`, but not longer than `most`. Returns true if the device became
    /// silent. The next character then begins a line.
    pub(super) async fn wait_for_silence(&mut self, span: Duration, most: Duration) -> Result<bool, Fault> {
        let begun = Silence::begin();
        while self.receive(span).await? {
            self.lines.discard();
            if begun.left_of(most).is_zero() {
                return Ok(false);
            }
        }
        self.lines.begin();
        Ok(true)
    }

    pub(super) async fn send(&mut self, text: &str) -> Result<(), Fault> {
        self.port.send(text.as_bytes()).await.map_err(|_| Fault::BROKEN)
    }

    /// Returns whether a part of a line has arrived, without the end of this line.
    pub(super) fn is_inside_line(&self) -> bool {
        self.lines.is_inside()
    }

    /// Returns the next line. Returns `None` if none has arrived within `span`.
    pub(super) async fn next_line(&mut self, span: Duration) -> Result<Option<String>, Fault> {
        let begun = Silence::begin();
        loop {
            if let Some(line) = self.lines.pop() {
                return Ok(Some(line));
            }
            let left = begun.left_of(span);
            if left.is_zero() || !self.receive(left).await? {
                return Ok(None);
            }
        }
    }

    /// Waits for bytes for at most `span`. Returns whether any have arrived.
    async fn receive(&mut self, span: Duration) -> Result<bool, Fault> {
        let mut bytes = [0; 256];
        match self.patience.within(span, self.port.receive(&mut bytes)).await {
            None => Ok(false),
            Some(Ok(0) | Err(_)) => Err(Fault::BROKEN),
            Some(Ok(count)) => {
                self.lines.push(&bytes[..count]);
                Ok(true)
            }
        }
    }
}
