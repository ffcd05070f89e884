//! Requests for lines of text, for example from a readout, a gauge or a DCON module.

use std::fmt;

use isotherm_core::codec::{Quoted, TextValue};

/// Read of these values, which are in the lines that follow one request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextRequest<'a>(pub &'a [TextValue]);

impl<'a> TextRequest<'a> {
    /// Returns the text to send; empty if the device sends without a request.
    pub fn text(self) -> &'a str {
        self.0.first().map_or("", |value| value.request.as_str())
    }

    /// Returns whether there is at least one value, and all have the same request.
    pub fn fits(self) -> bool {
        !self.0.is_empty() && self.0.iter().all(|value| value.request == self.text())
    }
}

/// Formats the request: `send "#01\r"`, `receive text`.
impl fmt::Display for TextRequest<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.text() {
            "" => f.write_str("receive text"),
            text => write!(f, "send {}", Quoted(text)),
        }
    }
}
