//! Reader that converts a text part by part while the text is read, for example to another encoding.

use std::io::{self, Chain, Cursor, Read};

/// Input of which the first bytes were already read, to decide whether a conversion is necessary.
pub(super) type Begun<R> = Chain<Cursor<Vec<u8>>, R>;

/// Reader of a text that is either passed on unchanged, or converted by the converter `C`.
pub(super) enum TextReader<R, C> {
    /// The input is returned unchanged.
    Plain(Begun<R>),
    /// The input is converted.
    Converted(Box<Parts<C>>),
}

/// Converter of a text that is read part by part.
pub(super) trait Convert {
    /// Reads the next part of the input, and writes its converted text to `text`, which must be empty.
    /// Returns `false` after the last part, which may also contain text.
    fn next_part(&mut self, text: &mut Vec<u8>) -> io::Result<bool>;
}

/// State of a conversion: the converter, and the part of the text that was converted last.
pub(super) struct Parts<C> {
    converter: C,
    /// Current part of the converted text. The bytes from `at` onwards have not been returned yet.
    text: Vec<u8>,
    at: usize,
    is_over: bool,
}

impl<R, C> TextReader<R, C> {
    /// Returns a reader that converts its input.
    pub(super) fn converted(converter: C) -> TextReader<R, C> {
        TextReader::Converted(Box::new(Parts { converter, text: Vec::new(), at: 0, is_over: false }))
    }

    /// Returns whether the input is converted.
    pub(super) fn is_converted(&self) -> bool {
        matches!(self, TextReader::Converted(_))
    }
}

impl<R: Read, C: Convert> Read for TextReader<R, C> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        match self {
            TextReader::Plain(input) => input.read(out),
            TextReader::Converted(parts) => parts.read(out),
        }
    }
}

impl<C: Convert> Parts<C> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.at == self.text.len() && !self.is_over {
            self.text.clear();
            self.at = 0;
            self.is_over = !self.converter.next_part(&mut self.text)?;
        }
        let count = out.len().min(self.text.len() - self.at);
        out[..count].copy_from_slice(&self.text[self.at..self.at + count]);
        self.at += count;
        Ok(count)
    }
}
