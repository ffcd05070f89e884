//! What stands between the commas of a data line.

use super::Fault;
use super::card::{Line, Place};

/// The values of a line.
pub(super) struct Fields<'a> {
    line: &'a Line,
    values: Vec<&'a str>,
}

impl<'a> Fields<'a> {
    pub(super) fn of(line: &'a Line) -> Self {
        let mut values: Vec<&str> = line.text.split(',').map(str::trim).collect();
        while values.last().is_some_and(|last| last.is_empty()) {
            values.pop();
        }
        Self { line, values }
    }

    pub(super) fn place(&self) -> &Place {
        &self.line.place
    }

    pub(super) fn len(&self) -> usize {
        self.values.len()
    }

    /// Refuses a line with fewer or more values than `names` has.
    pub(super) fn exactly(&self, names: &[&str]) -> Result<(), Fault> {
        let (found, wanted) = (self.len(), names.len());
        let names = names.join(", ");
        if found < wanted {
            return Err(self.fault(format!("{} of {wanted} ({names})", counted(found, "value"))));
        }
        if found > wanted {
            let hint = "a decimal comma makes two values of one: write 1.5, not 1,5";
            return Err(
                self.fault(format!("{} where {wanted} belong ({names}); {hint}", counted(found, "value")))
            );
        }
        Ok(())
    }

    pub(super) fn text(&self, at: usize) -> &'a str {
        self.values.get(at).copied().unwrap_or_default()
    }

    /// A finite number; a Fortran exponent (`1.5D3`) is one too.
    pub(super) fn number(&self, at: usize, name: &str) -> Result<f64, Fault> {
        let text = self.text(at);
        let parsed = text.parse::<f64>().or_else(|_| text.replace(['d', 'D'], "E").parse());
        match parsed {
            Ok(number) if number.is_finite() => Ok(number),
            _ if text.is_empty() => Err(self.fault(format!("the {name} is missing"))),
            _ => Err(self.fault(format!("`{text}` is not a number; the {name} belongs here"))),
        }
    }

    /// The number of a node, an element or a direction.
    pub(super) fn whole(&self, at: usize, name: &str) -> Result<u32, Fault> {
        let text = self.text(at);
        match text.parse::<u32>() {
            Ok(0) | Err(_) => {
                Err(self.fault(format!("`{text}` is not a number from 1 up; the {name} belongs here")))
            }
            Ok(number) => Ok(number),
        }
    }

    pub(super) fn fault(&self, message: impl Into<String>) -> Fault {
        self.line.place.fault(message)
    }
}

fn counted(count: usize, what: &str) -> String {
    if count == 1 { format!("1 {what}") } else { format!("{count} {what}s") }
}
