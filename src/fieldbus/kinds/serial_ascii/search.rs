//! Search for values in the text lines of one answer. The module has no input, no output and no clock.

use crate::fieldbus::error::{Fault, PeerFault};
use isotherm_core::codec::TextValue;
use isotherm_core::reading::Reason;

/// Search for the values in the lines of text that answer a request.
pub(super) struct Search<'a> {
    texts: &'a [TextValue],
    /// For each value: the last number in a line that matches its pattern, or its fault. `None` if no such line has
    /// arrived.
    found: Vec<Option<Result<f64, Reason>>>,
    /// Request without its end, as an adapter without echo suppression returns it. Empty if the device sends without a
    /// request.
    echo: &'a str,
    echoes: usize,
    /// Number of received lines that match no pattern.
    others: usize,
}

impl<'a> Search<'a> {
    pub(super) fn new(texts: &'a [TextValue], request: &'a str) -> Search<'a> {
        let echo = request.trim_end_matches(['\r', '\n']);
        Search { texts, found: vec![None; texts.len()], echo, echoes: 0, others: 0 }
    }

    /// Searches the next received line for the values. A line that is an echo of the request is skipped.
    pub(super) fn take(&mut self, line: &str) {
        // A request such as "1" is never taken for the value of its answer.
        if !self.echo.is_empty() && line == self.echo {
            self.echoes += 1;
            return;
        }
        let behind_echo = line.strip_prefix(self.echo).filter(|_| self.is_distinct());
        if !self.matches(line) && !behind_echo.is_some_and(|answer| self.matches(answer)) {
            self.others += 1;
        }
    }

    /// Returns whether the echo of the request can be recognised at the beginning of a line. The echo of the request
    /// "1" cannot be recognised, because a value may begin with the same digit.
    fn is_distinct(&self) -> bool {
        self.echo
            .chars()
            .any(|other| !other.is_ascii_digit() && !matches!(other, '+' | '-' | '.' | ',' | ' '))
    }

    fn matches(&mut self, line: &str) -> bool {
        let mut is_matched = false;
        for (text, found) in self.texts.iter().zip(&mut self.found) {
            match text.pattern.read(line) {
                Ok(value) => *found = Some(Ok(value)),
                // A later line may be right.
                Err(Reason::Checksum) if found.is_none() => *found = Some(Err(Reason::Checksum)),
                Err(Reason::Checksum) => {}
                Err(_) => continue,
            }
            is_matched = true;
        }
        is_matched
    }

    /// Returns whether a valid number was found for each value.
    pub(super) fn is_complete(&self) -> bool {
        self.found.iter().all(|found| matches!(found, Some(Ok(_))))
    }

    /// Returns whether a line of the answer has arrived. An echo of the request does not count.
    pub(super) fn has_begun(&self) -> bool {
        self.others > 0 || self.found.iter().any(Option::is_some)
    }

    /// Returns the number of each value, or the reason why it has none.
    ///
    /// # Errors
    /// No line has arrived, or no line has a value.
    pub(super) fn values(self) -> Result<Vec<Result<f64, Reason>>, Fault> {
        if !self.has_begun() {
            let is_echoed = self.echoes > 0;
            return Err(if is_echoed { Fault::Peer(PeerFault::Echoed) } else { Fault::Timeout });
        }
        if !self.found.iter().any(|found| matches!(found, Some(Ok(_)))) {
            // A line with a wrong checksum has the right form.
            let is_disturbed = self.found.iter().any(Option::is_some);
            return Err(Fault::Peer(if is_disturbed { PeerFault::Checksum } else { PeerFault::Malformed }));
        }
        let missing = if self.others > 0 { Reason::BadReply } else { Reason::Timeout };
        Ok(self.found.into_iter().map(|found| found.unwrap_or(Err(missing))).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(request: &str, patterns: &[&str]) -> Vec<TextValue> {
        let value =
            |pattern: &&str| TextValue { request: request.to_owned(), pattern: pattern.parse().unwrap() };
        patterns.iter().map(value).collect()
    }

    fn found(request: &str, patterns: &[&str], lines: &[&str]) -> Result<Vec<Result<f64, Reason>>, Fault> {
        let texts = texts(request, patterns);
        let mut search = Search::new(&texts, request);
        lines.iter().for_each(|line| search.take(line));
        search.values()
    }

    #[test]
    fn each_value_is_taken_from_the_line_that_it_matches() {
        const MALFORMED: Fault = Fault::Peer(PeerFault::Malformed);
        const CHECKSUM: Fault = Fault::Peer(PeerFault::Checksum);
        let summed = [">{number 7}{any}{sum}", ">{skip}{number 7}{any}{sum}"];
        let axes = ["X{number} mm", "Y{number} mm"];
        for (request, patterns, lines, expected) in [
            ("", &axes[..], &["X+1.5 mm", "Y-2.0 mm"][..], Ok(vec![Ok(1.5), Ok(-2.0)])),
            ("", &axes, &["X+1.5 mm", "X+1.6 mm"], Ok(vec![Ok(1.6), Err(Reason::Timeout)])),
            ("", &axes, &["X+1.5 mm", "Y-0.08 in"], Ok(vec![Ok(1.5), Err(Reason::BadReply)])),
            ("", &axes, &["X+0.06 in", "Y-0.08 in"], Err(MALFORMED)),
            ("", &axes, &[], Err(Fault::Timeout)),
            ("#01\r", &[">{number}"], &["#01", ">+1.0"], Ok(vec![Ok(1.0)])),
            ("#01\r", &[">{number}"], &["#01>+1.0"], Ok(vec![Ok(1.0)])),
            ("#01\r", &[">{number}"], &["#01"], Err(Fault::Peer(PeerFault::Echoed))),
            ("#01\r", &[">{number}"], &["?01"], Err(MALFORMED)),
            ("#01\r", &[">{number}{sum}"], &[">+1.000"], Err(CHECKSUM)),
            ("#01C4\r", &summed, &[">+025.12+023.4000"], Err(CHECKSUM)),
            ("#01C4\r", &summed, &["?01A0"], Err(MALFORMED)),
            ("1\r", &["{number}"], &["1"], Err(Fault::Peer(PeerFault::Echoed))),
            ("1\r", &["{number}"], &["1", "+1.0"], Ok(vec![Ok(1.0)])),
            ("1\r", &["{number.3 6}"], &["112.345"], Err(MALFORMED)),
        ] {
            assert_eq!(found(request, patterns, lines), expected, "{patterns:?} in {lines:?}");
        }
    }

    #[test]
    fn an_echo_is_no_answer_and_a_wrong_line_is_one() {
        let texts = texts("#01\r", &[">{number}"]);
        let mut search = Search::new(&texts, "#01\r");
        search.take("#01");
        assert!(!search.has_begun() && !search.is_complete());
        search.take("?01");
        assert!(search.has_begun() && !search.is_complete());
        search.take(">+1.0");
        assert!(search.is_complete());
    }
}
